"""Threshold lines for a technique from its records in a run: the published error, widened as
thresholds/README.md says. Which of them to keep is decided by what they catch."""

from __future__ import annotations

import json
import math
from typing import Any

from compare.task import PATH_TRACER, find_measured
from scenes.contract import find_scene

WIDER, BIAS_ROOM, BIAS_SHARE = 1.08, 0.015, 0.06
ROUNDING, ROUNDING_WIDER = 1e-4, 3.0
JUDGED = ("default", "knob:", "ladder:", "threshold")


def lines(records: list[dict], technique: str) -> list[str]:
    """One TOML line for the rmse and one for the bias of every setting that was measured."""
    found = []
    for r in records:
        judged = any(role.startswith(JUDGED) for role in r["roles"])
        if r["technique"] != technique or r["technique"] == PATH_TRACER or not judged or not r["errors"]:
            continue
        head = {"technique": technique, "scene": r["scene"], "quantity": r["quantity"]}
        declared = find_measured(technique)
        plain, defaults = declared.settings({}), find_scene(r["scene"])().fields()
        knobs = {k: v for k, v in r["knobs"].items() if v != plain[k]}
        fields = {k: v for k, v in r["fields"].items() if v != defaults[k]}
        tail = {k: v for k, v in (("knobs", knobs), ("fields", fields)) if v}
        tail["pays"] = declared.neglects[0].name
        for metric, bounds in (("rmse", rmse_bounds(r["errors"])), ("bias", bias_bounds(r["errors"]))):
            if bounds:
                found.append(f"    {toml({**head, 'metric': metric, **bounds, **tail})},")
    return found


def rmse_bounds(errors: dict) -> dict[str, float]:
    """at_most."""
    high = errors["rmse"]["high"]
    wider = ROUNDING_WIDER if high < ROUNDING else WIDER
    return {"at_most": up(high * wider)} if high > 0 else {}


def bias_bounds(errors: dict) -> dict[str, float]:
    """at_least and at_most."""
    e = errors["bias"]
    room = max(BIAS_ROOM, BIAS_SHARE * abs(e["value"]))
    return {"at_least": float(f"{e['low'] - room:.3g}"), "at_most": float(f"{e['high'] + room:.3g}")}


def up(x: float) -> float:
    """Rounded up to three digits."""
    unit = 10.0 ** (math.floor(math.log10(x)) - 2)
    return float(f"{math.ceil(x / unit - 1e-9) * unit:.3g}")


def toml(value: Any) -> str:
    """An inline TOML value."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {toml(v)}" for k, v in value.items()) + " }"
    return json.dumps(value)
