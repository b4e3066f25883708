"""What to measure: tasks, their identity, and the plan that a selection expands to."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from approximations.contract import Technique, all_techniques
from reference.store import ENOUGH, Demand
from reference.transport import MEDIA, plugin_types
from scenes.contract import (
    QUANTITIES,
    SUBSAMPLES,
    BadInput,
    Quantity,
    Scene,
    find_scene,
    make_scene,
    unknown,
)

PATH_TRACER = "path_tracer"
RGB_RENDERING = "rgb_rendering"
ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Profile:
    """How much of everything: image sizes, points on a stress axis, path-tracer samples, seconds that
    one measurement may take, batches that a truth may grow to before a question is left unsettled, and
    whether all work is counted or that of the techniques' default frames alone: a count takes longer than
    all else."""

    name: str
    size: int
    stress_size: int
    stress_points: int
    samples: tuple[int, ...]
    samples_in_media: tuple[int, ...]
    seconds: float
    batches: int
    all_counted: bool


PROFILES = {
    p.name: p
    for p in (
        Profile("quick", 128, 64, 5, (1, 4), (1, 2), 120, 128, False),
        Profile("full", 512, 128, 9, (1, 2, 4, 8, 16, 32, 64, 128), (1, 2, 4, 8, 16, 32), 1800, 1024, True),
    )
}


@dataclass(frozen=True)
class Task:
    """One technique (or the path tracer) on one scene with one setting of fields and knobs.

    roles say why it is measured: "default", "knob:NAME", "ladder:RUNG", "stress:FIELD", "path tracer".
    """

    technique: str
    scene: str
    size: int
    fields: dict[str, Any] = field(default_factory=dict)
    knobs: dict[str, Any] = field(default_factory=dict)
    quantities: tuple[str, ...] = ()
    roles: tuple[str, ...] = ("default",)
    seed: int = 1
    seconds: float = 120
    batches: int = 128
    demand: Demand = ENOUGH
    all_counted: bool = False

    def make_scene(self) -> Scene:
        """The scene with its fields set."""
        return make_scene(self.scene, self.fields)

    def identity(self) -> dict[str, Any]:
        """Everything that its figures depend on, but for the versions of the libraries."""
        return {
            "technique": self.technique,
            "scene": self.scene,
            "fields": self.make_scene().fields(),
            "knobs": self.knobs,
            "size": self.size,
            "seed": self.seed,
            "demand": asdict(self.demand),
        }

    def key(self, variant: str) -> str:
        """Digest of identity, source code, variant and versions: no stale figure survives a change."""
        import drjit
        import mitsuba

        content = [
            self.identity(),
            variant,
            drjit.__version__,
            mitsuba.__version__,
            house_digest(),
            "" if self.technique == PATH_TRACER else file_digest(find_measured(self.technique).file),
            file_digest(scene_file(self.scene)),
        ]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:20]

    def command(self) -> str:
        """The command line that repeats this measurement alone."""
        words = ["lightproof compare", self.technique, "--scene", self.scene, "--only"]
        defaults = find_scene(self.scene)().fields()
        words += [f"--set {k}={v}" for k, v in self.make_scene().fields().items() if v != defaults[k]]
        side = self.size
        if self.technique != PATH_TRACER:
            side *= 2 if find_measured(self.technique).estimates.probes else 1
            plain = find_measured(self.technique).settings({})
            words += [f"--knob {k}={v}" for k, v in self.knobs.items() if v != plain[k]]
        else:
            words += [f"--knob {k}={v}" for k, v in self.knobs.items()]
        return " ".join([*words, f"--size {side}", f"--seed {self.seed}"])


def wants_costs(task: Task) -> bool:
    """Whether more is asked of a task than its errors at a stressed field, whose code is the default's."""
    return not all(role.startswith("stress:") for role in task.roles)


@cache
def file_digest(path: Path) -> str:
    """Digest of a source file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def house_digest() -> str:
    """Digest of all that every measurement goes through: scenes' and techniques' shared code, truths,
    statistics. A technique's own module and a scene's are added by the task that uses them."""
    files = [
        ROOT / "scenes/contract.py",
        ROOT / "scenes/mitsuba_parts.py",
        ROOT / "approximations/contract.py",
        *sorted((ROOT / "approximations/kit").glob("*.py")),
        *sorted((ROOT / "reference").rglob("*.py")),
        *(ROOT / f"compare/{name}.py" for name in ("statistics", "metrics", "cost", "measure", "task")),
    ]
    return hashlib.sha256("".join(file_digest(f) for f in files).encode()).hexdigest()


def scene_file(name: str) -> Path:
    """The module that declares a scene."""
    import inspect

    return Path(inspect.getsourcefile(find_scene(name)))


def all_measured() -> dict[str, Technique]:
    """All that is held against truths, by name: the techniques, and RGB rendering of spectral scenes."""
    from compare.colour import declared

    return {**all_techniques(), RGB_RENDERING: declared()}


def find_measured(name: str) -> Technique:
    """What is measured under that name. Raises BadInput with the nearest names."""
    known = all_measured()
    if name not in known:
        raise unknown("technique", name, known)
    return known[name]


def variations_on(technique: Technique, scene: type[Scene]) -> dict[str, list[Any]]:
    """Knob -> the values worth measuring on a scene: a rule of extinction only where there is a medium."""
    found = technique.variations()
    if technique.name == RGB_RENDERING and not plugin_types(scene().mitsuba()) & MEDIA:
        del found["extinction"]
    return found


def quantities_on(technique: Technique, scene: type[Scene]) -> tuple[str, ...]:
    """The truths that a technique is held against on a scene, its own quantity first."""
    return tuple(q.name for q in (technique.estimates, *technique.also) if q in scene.quantities)


def plan(
    techniques: Iterable[Technique],
    profile: Profile,
    *,
    scene: str | None = None,
    fields: dict[str, Any] | None = None,
    knobs: dict[str, Any] | None = None,
    size: int | None = None,
    seed: int = 1,
    only: bool = False,
    demand: Demand = ENOUGH,
) -> list[Task]:
    """All tasks of a selection: defaults, one-at-a-time knob sweeps, ladders, stress sweeps and the path
    tracer's curve on each scene. With `only`, just the setting asked for. Probes are taken at half the
    size, since they vary slowly and have no edges.

    Raises BadInput for unknown names, values out of range, or a scene that a technique is not for.
    """
    fields, knobs = fields or {}, knobs or {}
    size = size or profile.size
    tasks: list[Task] = []
    curves: dict[str, tuple[Quantity, ...]] = {}
    for technique in techniques:
        wanted = [find_scene(scene)] if scene else list(technique.on)
        for cls in wanted:
            if cls not in technique.on:
                known = ", ".join(c.__name__ for c in technique.on)
                raise BadInput(f"{technique.name} is not for {cls.__name__}: it declares {known}")
            make_scene(cls.__name__, fields)
            names = quantities_on(technique, cls)
            settings = technique.settings(knobs)

            def task(knobs: dict, *roles: str, side: int = size, **changed: Any) -> Task:
                return Task(
                    technique.name,
                    cls.__name__,
                    side // 2 if technique.estimates.probes else side,
                    {**fields, **changed},
                    knobs,
                    names,
                    roles,
                    seed,
                    profile.seconds,
                    profile.batches,
                    demand,
                    profile.all_counted,
                )

            tasks.append(task(settings, "default"))
            if only:
                continue
            curves[cls.__name__] = tuple(QUANTITIES[n] for n in names) + curves.get(cls.__name__, ())
            tasks += [
                task({**settings, knob: value}, f"knob:{knob}")
                for knob, values in variations_on(technique, cls).items()
                for value in values
            ]
            tasks += [task(rung, f"ladder:{i}") for i, rung in enumerate(ladder(technique, settings)) if i]
            for name in technique.stress.get(cls.__name__, ()):
                points = points_on(cls, name, profile.stress_points)
                tasks += [
                    task(settings, f"stress:{name}", side=profile.stress_size, **{name: x}) for x in points
                ]
    for name, quantities in curves.items():
        rendered = tuple(dict.fromkeys(q.name for q in quantities if not q.probes and q.kind == "radiance"))
        tasks += [
            Task(
                PATH_TRACER,
                name,
                size,
                fields,
                {"spp": n},
                (q,),
                ("path tracer",),
                seed,
                profile.seconds,
                demand=demand,
                all_counted=profile.all_counted,
            )
            for q in rendered
            for n in samples(profile, name)
        ]
    return merge(tasks)


def samples(profile: Profile, scene: str) -> tuple[int, ...]:
    """Samples per pixel of the path tracer's curve; fewer in media, where one takes tens of times longer."""
    media = plugin_types(find_scene(scene)().mitsuba()) & MEDIA
    return profile.samples_in_media if media else profile.samples


def ladder(technique: Technique, settings: dict[str, Any]) -> list[dict[str, Any]]:
    """Settings with the first 0, 1, 2, ... stages exact: rung 0 is the technique as it is."""
    rungs = [dict(settings)]
    for stage in technique.stages():
        rungs.append({**rungs[-1], stage: "exact"})
    return rungs


def merge(tasks: list[Task]) -> list[Task]:
    """Each setting once, with all the roles that it plays and all the truths that it is held against."""
    found: dict[str, Task] = {}
    for t in tasks:
        label = json.dumps(
            [t.identity(), t.quantities if t.technique == PATH_TRACER else None], sort_keys=True
        )
        if label in found:
            roles = tuple(dict.fromkeys(found[label].roles + t.roles))
            quantities = tuple(dict.fromkeys(found[label].quantities + t.quantities))
            found[label] = replace(found[label], roles=roles, quantities=quantities)
        else:
            found[label] = t
    return list(found.values())


def in_order(tasks: list[Task]) -> list[Task]:
    """Those of a technique on a scene together, with those that share the offline stage's result together."""
    found: dict[tuple, dict[str, list[Task]]] = {}
    for t in tasks:
        offline = {} if t.technique == PATH_TRACER else find_measured(t.technique).split(t.knobs)[1]
        alike = found.setdefault((t.technique, t.scene), {})
        alike.setdefault(json.dumps(offline, sort_keys=True), []).append(t)
    return [t for alike in found.values() for together in alike.values() for t in together]


def points_on(cls: type[Scene], name: str, n: int) -> list[float]:
    """n values of a field from end to end of its axis. Raises BadInput for a field without one."""
    axes = cls.axes()
    if name not in axes:
        raise BadInput(f"{cls.__name__} has no axis {name!r} to stress: it has {', '.join(axes)}")
    points = axes[name].points(n)
    if isinstance(getattr(cls(), name), int):
        return sorted({round(p) for p in points})
    return points


def fine_size(size: int, quantity: Quantity) -> int:
    """Samples along an image side: SUBSAMPLES per pixel, one per probe."""
    return size if quantity.probes else size * SUBSAMPLES
