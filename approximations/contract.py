"""What a technique is: a function from a view to an image, with knobs, declared beside its source.

    @technique(source=..., covers=..., estimates=RADIANCE, on=(Scene,), replaces=..., neglects=(...))
    def name(view, [baked,] *, knob: Annotated[int, Sweep(8, 16, low=1, high=64)] = 8) -> mi.Color3f: ...

Keyword-only parameters are the knobs, their annotations what to sweep. A knob whose last option is
"exact" is a stage: swapping stages for their exact counterparts one by one makes the ladder.
"""

from __future__ import annotations

import functools
import importlib.util
import inspect
import sys
import typing
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from scenes.contract import BadInput, Quantity, Scene, check_value, discover, unknown


@dataclass(frozen=True)
class Assumption:
    """One thing that techniques leave out; the fixed vocabulary below names them all."""

    name: str
    means: str


SHAPE_OF_VISIBILITY = Assumption("shape of visibility", "the visible set is not the simple shape assumed")
HORIZON_CLIPPING = Assumption("horizon clipping", "part of the light below the horizon is still counted")
COSINE_OVER_LIGHT = Assumption("cosine over the light", "one direction stands for the whole visible light")
INTERREFLECTION = Assumption("interreflection", "light that met more than one surface")
OCCLUSION = Assumption("occlusion", "everything is taken to be visible")
INSCATTERED_LIGHT = Assumption("in-scattered light", "its variation along and across rays")
MEDIUM_SHADOWS = Assumption("medium shadows", "objects and medium do not shade the medium or the ground")
HEIGHT_PROFILE = Assumption("height profile", "density is taken to be the same at every height")
MULTIPLE_SCATTERING = Assumption("multiple scattering", "light scattered more than once")
PHASE_FUNCTION = Assumption("phase function", "a broad lobe stands for a narrow one")
DEPTH_ORDER = Assumption("depth order", "layers are composited in the order of arrival")
NUMBER_FORMAT = Assumption("number format", "rounding, range or cancellation of the numbers stored")
CAPACITY = Assumption("capacity", "what does not fit a fixed array is dropped")
PRINTED_SLIP = Assumption("slip in print", "the formula as it stands in print, which is wrong")
SPECTRUM = Assumption("spectrum", "three channels stand for all wavelengths")
SAMPLING = Assumption("sampling", "too few samples of an integral")
REPRESENTATIVE_POINT = Assumption("representative point", "one point of a light stands for all of it")
SHAPE_OF_LOBE = Assumption("shape of the lobe", "a simpler lobe stands for the reflection's")
FRESNEL = Assumption("Fresnel", "how reflection rises towards grazing angles")
DISTANT_LIGHT = Assumption("distant light", "light has the same direction everywhere, without parallax")
ANGULAR_DETAIL = Assumption("angular detail", "a few coefficients stand for all directions")
SPATIAL_DETAIL = Assumption("spatial detail", "a few places stand for all places")
HIDDEN_GEOMETRY = Assumption("hidden geometry", "what the depth buffer or the volume does not hold")
PENUMBRA_WIDTH = Assumption("width of the penumbra", "a filter of chosen width stands for the light's size")
NO_MODEL = Assumption("no model", "a look chosen by eye, which stands for no integral")
MOTION = Assumption("motion", "what moves is taken to stand still, or to keep its pace or its shape")
FILTERED_PARAMETERS = Assumption("filtered parameters", "inputs are averaged ahead of a nonlinear formula")
STALE_FRAMES = Assumption("stale frames", "what was seen in earlier frames stands for what is seen now")


@dataclass(frozen=True)
class Sweep:
    """The values of a numeric knob worth a sweep, and the range that it accepts."""

    points: tuple[float, ...]
    low: float
    high: float

    def __init__(self, *points: float, low: float, high: float) -> None:
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)


@dataclass(frozen=True)
class Claim:
    """Something that must hold, tested for every technique that says so.

    "linear in light": twice the light, twice the image. "at most": no value exceeds `bound`.
    "exact": with these fields and knobs the relative RMS error stays under `bound`, against the truth of
    `quantity` where one is named and of what the technique estimates where not.
    """

    kind: Literal["linear in light", "at most", "exact"]
    bound: float = 0.0
    scene: str = ""
    fields: dict[str, Any] = field(default_factory=dict)
    knobs: dict[str, Any] = field(default_factory=dict)
    quantity: Quantity | None = None


LINEAR_IN_LIGHT = Claim("linear in light")


def at_most(bound: float) -> Claim:
    """No value of the image exceeds the bound."""
    return Claim("at most", bound)


def exact_when(
    scene: str,
    bound: float,
    fields: dict | None = None,
    knobs: dict | None = None,
    quantity: Quantity | None = None,
) -> Claim:
    """On this scene with these fields and knobs the relative RMS error is under the bound."""
    return Claim("exact", bound, scene, fields or {}, knobs or {}, quantity)


@dataclass(frozen=True)
class Domain:
    """Whether the author of a technique would use it on a scene, and the reason where not."""

    inside: bool
    reason: str = ""


@dataclass
class Technique:
    """A declared technique. Call it as the function that it is."""

    function: Callable[..., Any]
    source: str
    covers: tuple[str, ...]
    estimates: Quantity
    on: tuple[type[Scene], ...]
    replaces: str
    neglects: tuple[Assumption, ...]
    claims: tuple[Claim, ...] = ()
    also: tuple[Quantity, ...] = ()
    stress: dict[str, tuple[str, ...]] = field(default_factory=dict)
    baseline: bool = False
    bake_function: Callable[..., Any] | None = None
    domain_function: Callable[[Scene], Domain] | None = None

    @property
    def name(self) -> str:
        """The function's name."""
        return self.function.__name__

    @property
    def file(self) -> Path:
        """The module that declares it."""
        return Path(inspect.getsourcefile(self.function))

    @property
    def theme(self) -> str:
        """The folder that it stands in."""
        return self.file.parent.name

    def __call__(self, *args: Any, **knobs: Any) -> Any:
        return self.function(*args, **knobs)

    def bake(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Declare the offline stage: its result is the function's second argument. It takes the view, or
        nothing but knobs where its result is the same for every view."""
        self.bake_function = function
        return function

    @property
    def bakes_a_view(self) -> bool:
        """Whether the offline stage takes the view."""
        kinds = (p.kind for p in inspect.signature(self.bake_function).parameters.values())
        return any(kind is not inspect.Parameter.KEYWORD_ONLY for kind in kinds)

    def run_bake(self, view: Any, settings: dict[str, Any]) -> Any:
        """The result of the offline stage for a view."""
        return self.bake_function(*((view,) if self.bakes_a_view else ()), **settings)

    def domain(self, function: Callable[[Scene], Domain]) -> Callable[[Scene], Domain]:
        """Declare where its author would use it."""
        self.domain_function = function
        return function

    def knobs(self) -> dict[str, tuple[Any, Any]]:
        """Knob name -> (annotation, default), of the frame and then of the bake."""
        return _knobs(self.function) | (_knobs(self.bake_function) if self.bake_function else {})

    def settings(self, given: dict[str, Any]) -> dict[str, Any]:
        """All knobs with defaults filled in. Raises BadInput for unknown names and bad values."""
        known = self.knobs()
        for name in given:
            if name not in known:
                raise (
                    unknown(f"knob of {self.name}", name, known)
                    if known
                    else BadInput(f"{self.name} has no knobs, so {name!r} cannot be set: drop it")
                )
        return {n: check_value(self.name, n, hint, given.get(n, d)) for n, (hint, d) in known.items()}

    def split(self, settings: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Settings of the frame function and of the bake."""
        frame = inspect.signature(self.function).parameters
        return (
            {k: v for k, v in settings.items() if k in frame},
            {k: v for k, v in settings.items() if k not in frame},
        )

    def variations(self) -> dict[str, list[Any]]:
        """Knob -> the values worth measuring besides the default."""
        found = {}
        for name, (hint, default) in self.knobs().items():
            sweep = next((m for m in getattr(hint, "__metadata__", ()) if isinstance(m, Sweep)), None)
            points = sweep.points if sweep else typing.get_args(hint) or (False, True)
            found[name] = [p for p in points if p != default]
        return found

    def stages(self) -> list[str]:
        """Knobs that have an exact counterpart, in the order of the pipeline."""
        return [n for n, values in self.variations().items() if "exact" in values]


@functools.cache
def _knobs(function: Callable[..., Any]) -> dict[str, tuple[Any, Any]]:
    hints = typing.get_type_hints(function, include_extras=True)
    parameters = inspect.signature(function).parameters.items()
    return {name: (hints[name], p.default) for name, p in parameters if p.kind is p.KEYWORD_ONLY}


TECHNIQUES: dict[str, Technique] = {}


def technique(
    *,
    source: str,
    covers: tuple[str, ...] = (),
    estimates: Quantity,
    on: tuple[type[Scene], ...],
    replaces: str,
    neglects: tuple[Assumption, ...],
    claims: tuple[Claim, ...] = (),
    also: tuple[Quantity, ...] = (),
    stress: dict[str, tuple[str, ...]] | None = None,
    baseline: bool = False,
) -> Callable[[Callable[..., Any]], Technique]:
    """Declare a technique.

    source: book, chapter, section. covers: catalog ids. estimates: the quantity that it returns.
    on: scenes to try it on. replaces: the term of the exact model that it stands for. neglects: what
    it leaves out, from the vocabulary. claims: what must hold. also: further truths that it is held
    against. stress: scene name -> fields that are swept to both ends. baseline: it is what others are
    compared with, not a technique of a source.
    """

    def declare(function: Callable[..., Any]) -> Technique:
        declared = Technique(
            function, source, covers, estimates, on, replaces, neglects, claims, also, stress or {}, baseline
        )
        TECHNIQUES[declared.name] = declared
        return declared

    return declare


def all_techniques() -> dict[str, Technique]:
    """Every technique by name, in the order of themes and files."""
    import approximations

    discover(approximations)
    return TECHNIQUES


def find_technique(name: str) -> Technique:
    """The technique of that name. Raises BadInput with the nearest names."""
    known = all_techniques()
    if name not in known:
        raise unknown("technique", name, known)
    return known[name]


def load_plugin(path: Path) -> list[str]:
    """Import a file from outside that declares techniques or scenes; the names that it added.

    Raises BadInput when the file is missing, raises on import, or declares nothing.
    """
    if not path.is_file():
        raise BadInput(f"plugin {path}: no such file; give the path of a Python file with a @technique")
    before = set(all_techniques())
    name = f"lightproof_plugin_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise BadInput(f"plugin {path}: not a Python file; its name must end in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        line = next((e for e in reversed(_lines(error, path))), "?")
        raise BadInput(
            f"plugin {path}, line {line}: {type(error).__name__}: {error}; mend the file and run again"
        ) from error
    added = [n for n in TECHNIQUES if n not in before]
    if not added:
        raise BadInput(f"plugin {path}: declares no new technique; decorate a function with @technique")
    return added


def _lines(error: BaseException, path: Path) -> list[int]:
    found = [error.lineno] if isinstance(error, SyntaxError) and error.lineno else []
    trace = error.__traceback__
    while trace:
        if Path(trace.tb_frame.f_code.co_filename).resolve() == path.resolve():
            found.append(trace.tb_lineno)
        trace = trace.tb_next
    return found
