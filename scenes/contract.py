"""What a scene is: parameters, geometry, and what a real-time renderer would be given of it.

A scene is a frozen dataclass whose fields are its parameters. It knows how to describe itself to
Mitsuba and how to hand a technique its inputs; it knows nothing of integrators or techniques.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import importlib
import math
import pkgutil
import types
import typing
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, ClassVar, Literal


class BadInput(ValueError):
    """Wrong use or bad input: one line that says what was wrong, what was expected and how to mend it."""


def unknown(kind: str, name: str, known: Iterable[str]) -> BadInput:
    """The error for a name that nothing has, with the nearest real ones."""
    known = sorted(known)
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4) or known
    return BadInput(f"unknown {kind} {name!r}: did you mean {' or '.join(near[:6])}?")


@dataclass(frozen=True)
class Quantity:
    """What an image holds.

    kind "radiance" is linear and unbounded above, "ratio" lies in [0, 1], "length" is signed and in metres.
    On `probes` the pixels are points and directions inside the scene instead of camera rays.
    """

    name: str
    unit: str
    kind: Literal["radiance", "ratio", "length"]
    means: str
    probes: bool = False


RADIANCE = Quantity("radiance", "W m^-2 sr^-1", "radiance", "all light transport that the scene has")
DIRECT_RADIANCE = Quantity(
    "direct_radiance", "W m^-2 sr^-1", "radiance", "light that met one surface and no other"
)
SINGLE_SCATTERING = Quantity("single_scattering", "W m^-2 sr^-1", "radiance", "light that was scattered once")
SOURCE_FUNCTION = Quantity(
    "source_function", "W m^-2 sr^-1", "radiance", "in-scattered radiance at a point, all orders", probes=True
)
TRANSMITTANCE = Quantity("transmittance", "1", "ratio", "share of radiance that crosses the medium")
INDIRECT_RADIANCE = Quantity(
    "indirect_radiance", "W m^-2 sr^-1", "radiance", "light that met two surfaces or more"
)
ONE_BOUNCE = Quantity(
    "one_bounce", "W m^-2 sr^-1", "radiance", "light that met one surface on its way to the one seen"
)
IRRADIANCE = Quantity("irradiance", "W m^-2", "radiance", "on a surface element at a probe", probes=True)
LIGHT_VISIBILITY = Quantity(
    "light_visibility", "1", "ratio", "share of the first light's surface that a point sees"
)
SKY_VISIBILITY = Quantity(
    "sky_visibility", "1", "ratio", "cosine-weighted share of the hemisphere that no surface hides"
)
DISTANCE = Quantity(
    "distance", "m", "length", "to the nearest surface, positive outside and negative inside", probes=True
)
DENSITY = Quantity("density", "1", "ratio", "of a cloud, from none to the most that it can have", probes=True)
SUN_TRANSMITTANCE = Quantity(
    "sun_transmittance",
    "1",
    "ratio",
    "share of the sun's light that comes to a point unscattered",
    probes=True,
)
QUANTITIES = {
    q.name: q
    for q in (
        RADIANCE,
        DIRECT_RADIANCE,
        INDIRECT_RADIANCE,
        ONE_BOUNCE,
        SINGLE_SCATTERING,
        SOURCE_FUNCTION,
        TRANSMITTANCE,
        IRRADIANCE,
        LIGHT_VISIBILITY,
        SKY_VISIBILITY,
        DISTANCE,
        DENSITY,
        SUN_TRANSMITTANCE,
    )
}


@dataclass(frozen=True)
class Axis:
    """The range over which a numeric field may be swept, ends included."""

    low: float
    high: float
    log: bool = False
    unit: str = "1"

    def points(self, n: int) -> list[float]:
        """n values from low to high, even on the axis's own scale."""
        if self.log:
            a, b = math.log(self.low), math.log(self.high)
            inner = [math.exp(a + (b - a) * i / (n - 1)) for i in range(1, n - 1)]
        else:
            inner = [self.low + (self.high - self.low) * i / (n - 1) for i in range(1, n - 1)]
        return [self.low, *(float(f"{x:.4g}") for x in inner), self.high]


def check_value(owner: str, name: str, hint: Any, value: Any) -> Any:
    """The value as the annotation wants it. Raises BadInput for a wrong type or a value out of range."""
    limits = next((m for m in getattr(hint, "__metadata__", ()) if hasattr(m, "low")), None)
    base = hint.__origin__ if hasattr(hint, "__metadata__") else hint
    label = f"{owner}: {name}"
    if typing.get_origin(base) is Literal:
        options = typing.get_args(base)
        if value not in options or isinstance(value, bool) != isinstance(options[0], bool):
            raise BadInput(f"{label} must be one of {', '.join(map(str, options))}, not {value!r}")
        return value
    if base is bool:
        if not isinstance(value, bool):
            raise BadInput(f"{label} must be true or false, not {value!r}")
        return value
    if base in (int, float):
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or (base is int and value != int(value)):
            kind = "a whole number" if base is int else "a finite number"
            raise BadInput(f"{label} must be {kind}, not {value!r}")
        if limits is not None and not limits.low <= value <= limits.high:
            raise BadInput(f"{label} must lie in [{limits.low:g}, {limits.high:g}], not {value!r}")
        return base(value)
    raise TypeError(f"{label}: annotation {hint!r} is not one that Lightproof can check")


def parse_text(text: str) -> Any:
    """A value typed on the command line: true, false, a number, or the text itself."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


@dataclass(frozen=True)
class Camera:
    """One ray per pixel, row by row from the top: origin (m) and unit direction."""

    origin: Any
    direction: Any
    forward: Any
    near: float
    far: float


@dataclass(frozen=True)
class Surface:
    """G-buffer: what the camera rays meet first. Where `valid` is false the ray meets nothing.

    The reflection is albedo / pi plus `specular` times the single-scattering GGX lobe of width `alpha` with
    Smith's masking; parts that a scene lacks are None.
    """

    valid: Any
    position: Any  # m
    normal: Any  # unit, towards the side seen
    albedo: Any  # diffuse reflectance, 0..1
    distance: Any  # along the ray, m; infinite where not valid
    specular: Any = None  # Fresnel reflectance at normal incidence, 0..1
    alpha: Any = None  # GGX roughness, 0..1
    uv: Any = None  # texture coordinates, 0..1
    chart: Any = None  # index into the view's charts


@dataclass(frozen=True)
class Chart:
    """A flat rectangle with a light map of its own: (s, t) in [0, 1]^2 is the point corner + s u + t v, and
    its lit side is that of u x v."""

    corner: Any  # m
    u: Any  # m, a whole edge
    v: Any  # m, at right angles to u
    albedo: Any = None  # diffuse reflectance, 0..1, a number or three


@dataclass(frozen=True)
class AreaLight:
    """A glowing shape; radiance (W m^-2 sr^-1) a number or a colour, the same in all directions of its side.

    sphere     radius |u|
    disk       u, v: radii at right angles; glows on the side of u x v
    rectangle  u, v: half edges at right angles; glows on the side of u x v
    tube       u: from the middle to an end, |v| the radius; no caps
    texture    factor on the radiance at (s, t) in [0, 1]^2 of a rectangle, s along u; None: 1 everywhere
    """

    shape: Literal["sphere", "disk", "rectangle", "tube"]
    centre: Any  # m
    u: Any  # m
    v: Any  # m
    radiance: Any
    texture: Callable[[Any], Any] | None = None


@dataclass(frozen=True)
class PointLight:
    """intensity (W/sr) a number or a colour."""

    position: Any  # m
    intensity: Any


@dataclass(frozen=True)
class Solid:
    """A closed opaque body: a ball of radius half[0], or a box of half edges `half` along the unit vectors
    `axes`, which are at right angles to each other."""

    shape: Literal["ball", "box"]
    centre: tuple[float, float, float]  # m
    half: tuple[float, float, float]  # m
    axes: tuple[tuple[float, float, float], ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    albedo: Any = 0.5  # diffuse reflectance, 0..1


@dataclass(frozen=True)
class Sun:
    """A distant round light: unit direction to its centre, angular radius (rad, 0 = a point), and the
    irradiance that it gives a surface facing it (W m^-2)."""

    direction: Any
    angular_radius: float
    irradiance: float

    @property
    def radiance(self) -> float:
        """Radiance of the disk; its vector irradiance is pi sin(r)^2 L."""
        return self.irradiance / (math.pi * math.sin(self.angular_radius) ** 2)


@dataclass(frozen=True)
class Fog:
    """Density b exp(-c z) in a box: b is the extinction at z = 0 (1/m), c the falloff (1/m)."""

    b: float
    c: float
    albedo: float
    colour: float  # the constant in-scattered radiance that an artist would set
    box_exit: Callable[[Any, Any], Any]  # (point inside, direction): distance to where the fog ends, m


@dataclass(frozen=True)
class Cloud:
    """A density field. `extinction(p)` gives sigma_t (1/m); `span(o, d)` the near and far distances at
    which a ray is inside, both 0 where it misses. sigma_t: extinction (1/m) where the density is 1; model:
    what the density is modelled with (scenes.cloud_density), where it is."""

    extinction: Callable[[Any], Any]
    span: Callable[[Any, Any], tuple[Any, Any]]
    albedo: float
    g: float
    precipitation: float
    sigma_t: float = 0.0
    model: Any = None


@dataclass(frozen=True)
class Fragments:
    """What the rasteriser emits, in arrival order: flat arrays of one entry per fragment.

    pixel: index y * width + x; depth: NDC z in [-1, 1], -1 nearest; colour (not premultiplied); alpha.
    distance: along the ray from the eye (m, float64), which no rasteriser keeps: for exact stages.
    draws: fragments of each primitive, in the order drawn; no primitive covers a pixel twice.
    """

    pixel: Any
    depth: Any
    distance: Any
    colour: Any
    alpha: Any
    background: Any  # colour per pixel
    draws: tuple[int, ...]


@dataclass(frozen=True)
class Inlay:
    """Two materials in one texture: mask (n, n), 1 where a texel is metal, row 0 at v = 0; the mip level that
    the texture unit reads; the stone's diffuse reflectance, the metal's specular one, colours in 0..1; and
    the specular reflectance of the stone."""

    mask: Any
    level: int
    stone: tuple[float, float, float]
    metal: tuple[float, float, float]
    dielectric: float


@dataclass(frozen=True)
class View:
    """What a real-time renderer has of a scene. Parts that a scene lacks are None or empty.

    Offline tools for bakes: `visible(p, n, w)`, true where nothing opaque lies from a point p with normal n
    along w; `gather(p, w, seed)`, a noisy and unbiased sample of the radiance that arrives at p from w.
    `trace(o, d)` gives the distance to the first surface (infinite where there is none): it stands for the
    rasteriser, one ray per texel of a shadow map or cube map, in frames too. `chart(uv)` gives the position
    and the unit normal at texture coordinates, for what is baked into a map that `surface.uv` reads.
    `moving(o, d)` is `trace` for what moves, where a scene tells it apart; `trace` then meets the rest.
    `transmittance(o, d)`, for bakes: the share, by colour, of light from outside that comes in along a ray.
    """

    width: int
    height: int
    camera: Camera
    surface: Surface | None = None
    sun: Sun | None = None
    sky: float | None = None  # radiance of a uniform sky
    environment: Callable[[Any], Any] | None = None  # radiance from a unit direction
    lights: tuple[AreaLight, ...] = ()
    points: tuple[PointLight, ...] = ()
    charts: tuple[Chart, ...] = ()  # the surfaces that can have light maps
    velocity: Any = None  # of the model at each probe, m/s
    fog: Fog | None = None
    cloud: Cloud | None = None
    noise: Any = None  # what the noise at the probes is made of (scenes.noise_tile.Recipe), in tiles
    fragments: Fragments | None = None
    solids: tuple[Solid, ...] = ()
    bounds: tuple[Any, Any] | None = None  # corners of what a volume has to cover, m; infinite: all alike
    inlay: Inlay | None = None
    visible: Callable[[Any, Any, Any], Any] | None = None
    trace: Callable[[Any, Any], Any] | None = None
    gather: Callable[[Any, Any, int], Any] | None = None
    chart: Callable[[Any], tuple[Any, Any]] | None = None
    moving_bounds: tuple[Any, Any] | None = None  # of what moves
    transmittance: Callable[[Any, Any], Any] | None = None
    moving: Callable[[Any, Any], Any] | None = None

    def brighter(self, k: float) -> View:
        """The same view with every source of light k times as strong."""
        scale = dataclasses.replace

        def scaled(function: Callable | None) -> Callable | None:
            return function and (lambda *given: k * function(*given))

        return scale(
            self,
            sun=self.sun and scale(self.sun, irradiance=k * self.sun.irradiance),
            sky=None if self.sky is None else k * self.sky,
            environment=scaled(self.environment),
            gather=scaled(self.gather),
            lights=tuple(scale(light, radiance=k * light.radiance) for light in self.lights),
            points=tuple(scale(light, intensity=k * light.intensity) for light in self.points),
            fog=self.fog and scale(self.fog, colour=k * self.fog.colour),
            fragments=self.fragments
            and scale(
                self.fragments,
                colour=k * self.fragments.colour,
                background=k * self.fragments.background,
            ),
        )


@dataclass(frozen=True)
class Scene:
    """Base of all scenes. Subclasses add annotated fields and the methods below."""

    theme: ClassVar[str]
    shows: ClassVar[str]
    quantities: ClassVar[tuple[Quantity, ...]]
    exposure: ClassVar[tuple[float, float]]  # FLIP-HDR start and stop, pinned (stops)
    spectral: ClassVar[bool] = False  # its truth is rendered wavelength by wavelength

    def __post_init__(self) -> None:
        for name, hint in self.field_types().items():
            object.__setattr__(self, name, check_value(type(self).__name__, name, hint, getattr(self, name)))

    @classmethod
    @functools.cache
    def field_types(cls) -> dict[str, Any]:
        """Field name -> annotation with its Axis."""
        hints = typing.get_type_hints(cls, include_extras=True)
        return {f.name: hints[f.name] for f in dataclasses.fields(cls)}

    @classmethod
    def axes(cls) -> dict[str, Axis]:
        """The numeric fields and their ranges."""
        found = {}
        for name, hint in cls.field_types().items():
            found.update((name, m) for m in getattr(hint, "__metadata__", ()) if isinstance(m, Axis))
        return found

    def fields(self) -> dict[str, Any]:
        """The parameters as plain data."""
        return dataclasses.asdict(self)

    def mitsuba(self, size: int = 128) -> dict:
        """Mitsuba scene dictionary with a sensor of size x size pixels and a box filter, no integrator."""
        raise NotImplementedError

    def view(self, size: int = 128) -> View:
        """What a renderer has, at size x size samples."""
        raise NotImplementedError

    def probes(self, size: int = 128) -> View:
        """size x size points and directions inside the scene, for quantities that are taken there."""
        raise NotImplementedError

    def surfaces(self) -> dict:
        """The opaque shapes without the lights, as Mitsuba dictionaries by name."""
        raise NotImplementedError


def scene(
    *, theme: str, shows: str, quantities: tuple[Quantity, ...], exposure: tuple[float, float]
) -> Callable[[type[Scene]], type[Scene]]:
    """Declare a scene: its theme, what it shows, which quantities have a truth on it."""

    def declare(cls: type[Scene]) -> type[Scene]:
        cls.theme, cls.shows, cls.quantities, cls.exposure = theme, shows, quantities, exposure
        SCENES[cls.__name__] = cls
        return cls

    return declare


SCENES: dict[str, type[Scene]] = {}


@functools.cache
def discover(package: types.ModuleType) -> None:
    """Import every module below a package, so that what it declares registers itself."""
    for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        importlib.import_module(info.name)


def all_scenes() -> dict[str, type[Scene]]:
    """Every scene class by name."""
    import scenes

    discover(scenes)
    return SCENES


def find_scene(name: str) -> type[Scene]:
    """The scene class of that name. Raises BadInput with the nearest names."""
    known = all_scenes()
    if name not in known:
        raise unknown("scene", name, known)
    return known[name]


def make_scene(name: str, fields: dict[str, Any]) -> Scene:
    """A scene by name with some fields set. Raises BadInput for unknown names and bad values."""
    cls = find_scene(name)
    for field in fields:
        if field not in cls.field_types():
            raise unknown(f"field of {name}", field, cls.field_types())
    return cls(**fields)


SUBSAMPLES = 4
"""Techniques and closed forms are evaluated at 4 x 4 even points of every pixel and averaged (the box
filter of the film); the frame cost is taken at one sample a pixel."""
