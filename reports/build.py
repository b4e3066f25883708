"""The page of a run: index.html, complete in itself, and report.json, the data that it shows."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import jinja2
from altair.utils.schemapi import debug_mode
from markupsafe import Markup

from compare.metrics import MEANS
from reference.store import CannotWrite
from reports import charts
from reports.data import figures, gather, label
from reports.images import Shelf, viewer

HERE = Path(__file__).resolve().parent
TEMPLATES = HERE / "templates"


def build(folder: Path, target: Path | None = None) -> Path:
    """Write the page of a run into `target`, by default reports/out/<run>; the path of index.html.

    Raises BadInput where the folder holds no run, CannotWrite where nothing can be written.
    """
    folder = Path(folder)
    target = Path(target) if target else default_target(folder)
    data = gather(folder)
    html = render(data, folder)
    text = json.dumps(plain(data), indent=1, allow_nan=False, default=str) + "\n"
    write(target / "report.json", text)
    write(target / "index.html", html)
    return target / "index.html"


def default_target(folder: Path) -> Path:
    """reports/out/<run> in a checkout; inside the run where the package is installed elsewhere."""
    if (HERE.parent / "pyproject.toml").is_file() and os.access(HERE, os.W_OK):
        return HERE / "out" / folder.resolve().name
    return folder / "report"


def write(path: Path, text: str) -> None:
    """Write a file in one step: a reader sees the whole of the old one or of the new one."""
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(text, encoding="utf-8", errors="replace")
        partial.replace(path)
    except OSError as error:
        raise CannotWrite(
            f"cannot write {path}: {error.strerror}; choose another folder with --out"
        ) from error


def plain(value: Any) -> Any:
    """The same data with numbers that JSON lacks as null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def render(data: dict, folder: Path) -> str:
    """The HTML text."""
    known, shelf = data["records"], Shelf(folder)
    with debug_mode(False):
        for technique in data["techniques"]:
            technique["drawn"] = [drawing(case, data, shelf) for case in technique["cases"]]
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "number": number,
        "rough": rough,
        "words": words,
        "label": label,
        "unit": unit,
        "tolerance": tolerance,
    }
    page = environment.get_template("index.html").render(
        data=data,
        run=data["run"],
        known=known,
        figures={key: figures(r) for key, r in known.items()},
        overview_charts=[
            drawn
            for relative in (True, False)
            if (drawn := charts.overview_chart(data["overview"], relative, f"overview-{relative}"))
        ],
        means=MEANS,
        style=Markup((TEMPLATES / "style.css").read_text()),
        script=Markup((TEMPLATES / "viewer.js").read_text()),
        images=shelf.packed,
        numbers={key: i + 1 for i, key in enumerate(known)},
        truth_numbers={name: i + 1 for i, name in enumerate(data["truths"])},
    )
    for technique in data["techniques"]:
        del technique["drawn"]
    return page


def drawing(case: dict, data: dict, shelf: Shelf) -> dict:
    """Charts and viewer of a case."""
    known, anchor = data["records"], case["anchor"]
    head = known[case["head"]]
    axes = data["axes"].get(case["scene"], {})
    cost = charts.cost_chart(case, known, f"{anchor}-cost")
    stress = [
        charts.stress_chart(field, points, case, known, axes.get(field, {}), f"{anchor}-stress-{i}")
        for i, (field, points) in enumerate(case["stress"].items())
    ]
    return {
        "cost": cost[0] if cost else None,
        "knobs": cost[1] if cost else [],
        "ladder": charts.ladder_chart(case, known, f"{anchor}-ladder"),
        "stress": [drawn for drawn in stress if drawn],
        "viewer": viewer(case, head, nearest_tracer(case, known), shelf),
    }


def nearest_tracer(case: dict, known: dict[str, dict]) -> dict | None:
    """The path tracer's measurement whose frame cost is nearest to the technique's."""
    head = known[case["head"]]
    curve = [known[key] for key in case["path_tracer"]]
    if not curve or not head["costs"]:
        return None
    cost = math.log(max(head["costs"]["frame_ms"]["value"], 1e-9))
    return min(curve, key=lambda r: abs(math.log(max(r["costs"]["frame_ms"]["value"], 1e-9)) - cost))


def tolerance(envelopes: dict[str, dict], relative: bool) -> str:
    """The tolerance of a case's envelopes."""
    value = next(iter(envelopes.values()))["tolerance"]
    return f"{100 * value:.3g} %" if relative else f"{value:.3g}"


def number(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits; thousands apart."""
    if value is None:
        return ""
    if abs(value) >= 10**digits:
        return f"{value:,.0f}".replace(",", "\u202f")
    return f"{value:.{digits}g}"


def rough(value: float) -> str:
    """Two significant digits, for what is read off a curve."""
    return number(float(f"{value:.2g}"))


def unit(name: str) -> str:
    """A unit with raised exponents."""
    return name.replace("^-2", "\u207b\u00b2").replace("^-1", "\u207b\u00b9")


def words(name: str) -> str:
    """A name in code as words."""
    return name.replace("_", " ").replace("rgb", "RGB")
