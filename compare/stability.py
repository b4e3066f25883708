"""Sweeps of a technique along the axes of its scenes, both ends included, and their envelopes."""

from __future__ import annotations

from typing import Any

from approximations.contract import Technique
from compare.envelope import envelope, point, sentence, tolerance_of
from compare.summary import is_length
from compare.task import PROFILES, Task, points_on, quantities_on
from scenes.contract import BadInput, Scene, find_scene, unknown


def sweeps(
    technique: Technique, scene: str | None, axis: str | None, points: int, size: int
) -> dict[tuple[str, str], list[Task]]:
    """(scene, field) -> the tasks of its sweep, the scene's own value among them. The fields are those that
    the technique names as its stress, or the one asked for.

    Raises BadInput for a scene that the technique is not for and a field that no scene of it has.
    """
    on = [s for s in technique.on if scene in (None, s.__name__)]
    if not on:
        known = ", ".join(s.__name__ for s in technique.on)
        raise BadInput(f"{technique.name} is not for {find_scene(scene).__name__}: it declares {known}")
    found = {}
    for cls in on:
        fields = technique.stress.get(cls.__name__, ()) if axis is None else (axis,) * (axis in cls.axes())
        for field in fields:
            values = sorted({*points_on(cls, field, points), getattr(cls(), field)})
            found[cls.__name__, field] = [_task(technique, cls, field, x, size) for x in values]
    if not found:
        axes = {a for s in on for a in s.axes()}
        if axis is None:
            raise BadInput(
                f"{technique.name} names no axis to stress: give one with --axis, {', '.join(axes)}"
            )
        raise unknown(f"axis of {technique.name}", axis, axes)
    return found


def _task(technique: Technique, cls: type[Scene], field: str, x: float, size: int) -> Task:
    side = size // 2 if technique.estimates.probes else size
    names = quantities_on(technique, cls)
    seconds = PROFILES["quick"].seconds
    role = (f"stress:{field}",)
    return Task(
        technique.name, cls.__name__, side, {field: x}, technique.settings({}), names, role, 1, seconds
    )


def rows(found: list[dict], field: str, limit: float | None) -> list[dict[str, Any]]:
    """An envelope for every truth that a sweep was held against. limit: the tolerance; twice the error at the
    scene's own value where none is given."""
    table = []
    for quantity in dict.fromkeys(r["quantity"] for r in found):
        swept = [r for r in found if r["quantity"] == quantity]
        cls = find_scene(swept[0]["scene"])
        axis, own = cls.axes()[field], getattr(cls(), field)
        points = [point(r, field) for r in swept]
        start = next(p for p in points if p.x == own)
        error = start.rmse
        held = envelope(points, start, limit or tolerance_of(error or 0.0), axis.log)
        factor, unit = (1, " m") if is_length(swept[0]) else (100, " %")
        table.append(
            {
                "technique": swept[0]["technique"],
                "scene": cls.__name__,
                "quantity": quantity,
                "error": "" if error is None else f"{factor * error:.3g}{unit}",
                "tolerance": f"{factor * held['tolerance']:.3g}{unit}",
                "envelope": sentence(field, held, axis.unit),
                "points": {f"{p.x:.4g}": p.rmse if not p.flaw else p.flaw for p in points},
            }
            | {k: held[k] for k in ("low", "high", "breaks_below", "breaks_above")}
        )
    return table
