"""Rows of `lightproof list`: techniques, scenes, covered sections of sources."""

from __future__ import annotations

from compare.gate import load_thresholds
from compare.task import all_measured
from scenes.contract import all_scenes


def list_techniques() -> list[dict]:
    """One row per technique."""
    return [
        {
            "name": t.name,
            "theme": t.theme,
            "estimates": t.estimates.name,
            "scenes": [s.__name__ for s in t.on],
            "knobs": {k: default for k, (_, default) in t.knobs().items()},
            "source": t.source,
        }
        for t in all_measured().values()
    ]


def list_scenes() -> list[dict]:
    """One row per scene."""
    return [
        {
            "name": name,
            "theme": s.theme,
            "shows": s.shows,
            "quantities": [q.name for q in s.quantities],
            "fields": {
                k: {"default": getattr(s(), k)}
                | ({"low": a.low, "high": a.high, "unit": a.unit} if (a := s.axes().get(k)) else {})
                for k in s.field_types()
            },
        }
        for name, s in all_scenes().items()
    ]


def list_sources() -> list[dict]:
    """One row per catalog id that a technique covers."""
    thresholds = load_thresholds()
    found: dict[str, dict] = {}
    for t in all_measured().values():
        for section in t.covers:
            row = found.setdefault(section, {"id": section, "techniques": [], "scenes": [], "thresholds": 0})
            row["techniques"].append(t.name)
            row["scenes"] = sorted({*row["scenes"], *(s.__name__ for s in t.on)})
            row["thresholds"] += sum(th.technique == t.name for th in thresholds)
    return [found[k] for k in sorted(found)]
