"""What a table or a page says of a run: one row per technique, scene and quantity, and the path tracer
beside it at the same cost."""

from __future__ import annotations

import math

import numpy as np

from compare.run import path_tracer_curve
from scenes.contract import QUANTITIES


def defaults(records: list[dict]) -> list[dict]:
    """The records of techniques at the setting asked for, in the order of theme, technique and scene."""
    chosen = [r for r in records if "default" in r["roles"] and r["kind"] == "technique"]
    return sorted(chosen, key=lambda r: (r.get("theme", ""), r["technique"], r["scene"], r["quantity"]))


def interval_text(e: dict | None, scale: float = 1.0, unit: str = "") -> str:
    """value +- half width, or < 2 floor where unresolved."""
    if e is None:
        return "none"
    value, half = scale * e["value"], scale * (e["high"] - e["low"]) / 2
    if not e["resolved"]:
        return f"< {2 * scale * e['floor']:.3g}{unit} (unresolved)"
    if half == 0:
        return f"{value:.3g}{unit}"
    digits = max(0, min(9, 1 - math.floor(math.log10(half)))) if half > 0 else 3
    return f"{value:.{digits}f}{unit} \u00b1 {half:.{digits}f}"


def error_at_cost(curve: list[dict], cost: float) -> float | None:
    """The path tracer's rmse at a frame cost (ms), read off its curve in log-log; beyond the first
    point, the first point's (a frame has at least one sample). None without a curve."""
    points = [(r["costs"]["frame_ms"]["value"], r["errors"]["rmse"]["value"]) for r in curve if r["errors"]]
    points = [(c, e) for c, e in points if c > 0 and e > 0]
    if not points:
        return None
    c, e = np.log(np.array(points)).T
    c = np.maximum.accumulate(c)
    if cost >= math.exp(c[-1]):
        return float(math.exp(e[-1] - 0.5 * (math.log(cost) - c[-1])))
    return float(math.exp(np.interp(math.log(cost), c, e)))


def cost_at_error(curve: list[dict], error: float) -> float | None:
    """The path tracer's frame cost (ms) for an rmse, by its 1/sqrt law beyond the last point."""
    points = sorted(
        (r["errors"]["rmse"]["value"], r["costs"]["frame_ms"]["value"]) for r in curve if r["errors"]
    )
    points = [(e, c) for e, c in points if e > 0 and c > 0]
    if not points or error <= 0:
        return None
    e, c = np.log(np.array(points)).T
    x = math.log(error)
    if x < e[0]:
        return math.exp(c[0] + 2 * (e[0] - x))
    return math.exp(c[-1]) if x > e[-1] else float(math.exp(np.interp(x, e, c)))


def pareto(points: list[tuple[float, float]]) -> list[int]:
    """Indices of the (cost, error) points that no other beats in both, by rising cost."""
    best, front = math.inf, []
    for i in sorted(range(len(points)), key=lambda i: points[i]):
        if points[i][1] < best:
            best = points[i][1]
            front.append(i)
    return front


def is_length(record: dict) -> bool:
    """Whether a record's figures are lengths."""
    quantity = QUANTITIES.get(record["quantity"])
    return quantity is not None and quantity.kind == "length"


def overview(records: list[dict]) -> list[dict]:
    """Rows for the table: error with interval, cost, and path tracing at the same cost."""
    rows = []
    for r in defaults(records):
        row = {"technique": r["technique"], "scene": r["scene"], "quantity": r["quantity"]}
        if r["status"] != "ok" or r["errors"] is None:
            found = "; ".join(f"{f['kind']}: {f['text']}" for f in r["findings"])
            rows.append(row | {"rmse": r["status"], "findings": found})
            continue
        e, c = r["errors"], r["costs"]
        curve = path_tracer_curve(records, r)
        relative = "gain" in e
        instead = error_at_cost(curve, c["frame_ms"]["value"])
        needed = cost_at_error(curve, e["rmse"]["value"])
        ms = c["frame_ms"]["value"]
        rows.append(
            row
            | {
                "rmse": interval_text(e["rmse"], 100 if relative else 1, " %" if relative else ""),
                "bias": interval_text(e["bias"]) if is_length(r) else interval_text(e["bias"], 100, " %"),
                "shape": interval_text(e.get("rmse_gain"), 100, " %") if relative else "",
                "flip": interval_text(e["flip"]) if "flip" in e else "",
                "frame ms": f"{ms:.3g}",
                "bake ms": f"{c['bake_ms']:.3g}" if c["bake_ms"] is not None else "",
                "op/px": "" if c["operations_per_pixel"] is None else f"{c['operations_per_pixel']:.0f}",
                "path tracer, same ms": f"{100 * instead:.3g} %" if instead else "",
                "path tracer, same error": f"{needed / ms:.3g} x ms" if needed else "",
                "findings": ", ".join(f["kind"] for f in r["findings"]),
            }
        )
    return rows
