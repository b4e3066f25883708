"""From what is named on a command line to the tasks and truths that answer it."""

from __future__ import annotations

from typing import Any

from approximations.contract import Technique
from compare import gate
from compare.task import PATH_TRACER, PROFILES, Task, all_measured, find_measured, merge, plan
from reference.store import ENOUGH, Demand
from reference.truth import has_closed_form
from scenes.contract import QUANTITIES, BadInput, Quantity, Scene, find_scene, make_scene, parse_text, unknown

Question = tuple[Scene, Quantity, int]


def select(names: list[str] | None, theme: str | None) -> list[Technique]:
    """The techniques named, of a theme, or all. Raises BadInput for unknown ones."""
    chosen = [find_measured(n) for n in names] if names else list(all_measured().values())
    if theme is None:
        return chosen
    themes = {t.theme for t in all_measured().values()}
    if theme not in themes:
        raise unknown("theme", theme, themes)
    return [t for t in chosen if t.theme == theme]


def technique_tasks(techniques: list[Technique], profile: str, seed: int = 1, **narrowed: Any) -> list[Task]:
    """The plan of a selection, and what the thresholds of these techniques ask for unless it is narrowed by
    any of the keywords of `plan`."""
    tasks = plan(techniques, PROFILES[profile], seed=seed, **narrowed)
    if profile == "quick" and not any(v and v != ENOUGH for v in narrowed.values()):
        tasks = merge([*tasks, *gate.tasks(gate.load_thresholds(), techniques, seed)])
    return tasks


def thinned(tasks: list[Task]) -> list[Task]:
    """A quick look at everything: what a threshold, a table or a ladder needs, and the ends and the middle of
    a stressed axis."""
    stressed: dict[tuple, list[Task]] = {}
    for task in tasks:
        for role in task.roles:
            if role.startswith("stress:"):
                stressed.setdefault((task.technique, task.scene, role), []).append(task)
    kept = {id(t) for t in tasks if any(not role.startswith(("knob:", "stress:")) for role in t.roles)}
    for (_, _, role), there in stressed.items():
        field = role.removeprefix("stress:")
        there = sorted(there, key=lambda t: t.make_scene().fields()[field])
        kept |= {id(there[0]), id(there[len(there) // 2]), id(there[-1])}
    return [t for t in tasks if id(t) in kept]


def path_tracer_tasks(
    scene: str | None, fields: dict, knobs: dict, profile: str, size: int | None, seed: int, demand: Demand
) -> list[Task]:
    """The path tracer alone on one scene, at --knob spp=N."""
    if scene is None or set(knobs) != {"spp"} or not isinstance(knobs["spp"], int) or knobs["spp"] < 1:
        raise BadInput("path_tracer needs --scene NAME and --knob spp=N with a whole N of 1 or more")
    cls = find_scene(scene)
    names = [q.name for q in cls.quantities if not q.probes and q.kind == "radiance"]
    side = size or PROFILES[profile].size
    return [
        Task(
            PATH_TRACER,
            cls.__name__,
            side,
            fields,
            knobs,
            (q,),
            ("path tracer",),
            seed,
            600,
            demand=demand,
            all_counted=True,
        )
        for q in names
    ]


def profile_questions(scenes: list[str], profile: str) -> list[Question]:
    """The rendered truths that a profile and the thresholds need, of some scenes or of all."""
    wanted = {find_scene(name) for name in scenes}
    if profile not in PROFILES:
        raise unknown("profile", profile, PROFILES)
    found: dict[tuple, Question] = {}
    for task in technique_tasks(list(all_measured().values()), profile):
        scene = task.make_scene()
        if wanted and type(scene) not in wanted:
            continue
        for name in task.quantities:
            question = (scene, QUANTITIES[name], task.size)
            if not has_closed_form(type(scene), QUANTITIES[name]):
                found.setdefault((scene, name, task.size), question)
    return list(found.values())


def named_questions(
    scenes: list[str], fields: dict[str, Any], size: int, quantity: str | None
) -> list[Question]:
    """The truths of the scenes named, with fields set, of one quantity or of all that they have. Raises
    BadInput for a quantity that a scene lacks."""
    if not scenes:
        raise BadInput("--set, --size and --quantity need a scene: reference render SCENE --size 64")
    found = []
    for name in scenes:
        scene = make_scene(name, fields)
        names = [q.name for q in scene.quantities]
        if quantity is not None and quantity not in names:
            raise BadInput(f"{name} has no {quantity}: it has {', '.join(names)}")
        found += [(scene, QUANTITIES[q], size) for q in names if quantity in (None, q)]
    return found


def pairs(texts: list[str] | None, option: str) -> dict[str, Any]:
    """name=value texts as a dictionary. Raises BadInput for any other form."""
    found = {}
    for text in texts or []:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise BadInput(f"{option} {text!r}: write name=value")
        found[name] = parse_text(value)
    return found
