"""Operating envelopes: on each axis of a scene, the interval in which a technique stays within tolerance, and
what breaks first outside it.

A sweep gives points from one end of the axis to the other. From the scene's own value the envelope goes
to both sides, up to where the rmse crosses the tolerance (interpolated between two points, on the axis's own
scale and in log error) or to the last point before one that gave no figure, or a flaw.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

FACTOR, FLOOR = 2.0, 0.01
"""The tolerance where none is named: twice the error at the scene's own value, and at least so much."""
FLAWS = {"NaN", "infinity", "negative", "above 1"}


@dataclass(frozen=True)
class Point:
    """A measured value of a field. rmse: None where it gave no figure; flaw: what is wrong with the image."""

    x: float
    rmse: float | None
    flaw: str = ""


def point(record: dict, field: str) -> Point:
    """From a record."""
    x = record["fields"][field]
    if record["status"] != "ok":
        return Point(x, None, record["status"])
    flaws = ", ".join(f["kind"] for f in record["findings"] if f["kind"] in FLAWS)
    return Point(x, record["errors"] and record["errors"]["rmse"]["value"], flaws)


def tolerance_of(rmse: float) -> float:
    """Of a technique whose error is `rmse` at the scene's own value."""
    return max(FACTOR * rmse, FLOOR)


def envelope(points: list[Point], start: Point, tolerance: float, log: bool = False) -> dict[str, Any]:
    """low and high, and what breaks below and above: "" where the end of the axis is reached, else the flaw,
    or "error" for a crossing. points: of the sweep, in any order; start: at the scene's own value."""
    below = sorted((p for p in points if p.x < start.x), key=lambda p: -p.x)
    above = sorted((p for p in points if p.x > start.x), key=lambda p: p.x)
    low, breaks_below = _walk(start, below, tolerance, log)
    high, breaks_above = _walk(start, above, tolerance, log)
    return {
        "low": low,
        "high": high,
        "tolerance": tolerance,
        "breaks_below": breaks_below,
        "breaks_above": breaks_above,
    }


def _walk(start: Point, points: list[Point], tolerance: float, log: bool) -> tuple[float, str]:
    if start.flaw or start.rmse is None or start.rmse > tolerance:
        return start.x, start.flaw or "error"
    last = start
    for p in points:
        if p.flaw or p.rmse is None:
            return last.x, p.flaw or "no figure"
        if p.rmse > tolerance:
            return _crossing(last, p, tolerance, log and min(last.x, p.x) > 0), "error"
        last = p
    return last.x, ""


def _crossing(inside: Point, outside: Point, tolerance: float, log: bool) -> float:
    e0, e1, t = (math.log(max(e, 1e-12)) for e in (inside.rmse, outside.rmse, tolerance))
    share = (t - e0) / (e1 - e0)
    if log:
        return inside.x * (outside.x / inside.x) ** share
    return inside.x + share * (outside.x - inside.x)


def sentence(field: str, found: dict[str, Any], unit: str = "1") -> str:
    """The envelope in words: the interval, and what breaks on either side."""
    unit = "" if unit == "1" else f" {unit}"
    said = f"{field} {found['low']:.3g} to {found['high']:.3g}{unit}"
    sides = [f"{word}: {found[key]}" for word, key in (("below", "breaks_below"), ("above", "breaks_above"))]
    broken = [s for s in sides if not s.endswith(": ")]
    return said + (f" ({'; '.join(broken)})" if broken else " (whole axis)")
