"""Charts as SVG text: Altair drawn by vl-convert, without a browser or a network.

Every colour is a name that the page's style sheet defines for light and for dark.
"""

from __future__ import annotations

import itertools
import math
import re
from typing import Any

import altair as alt
import vl_convert
from markupsafe import Markup

from compare.summary import interval_text, pareto
from reports.data import label, show

COLOURS = {
    "#010101": "ink",
    "#020202": "muted",
    "#030303": "grid",
    "#040404": "accent",
    "#050505": "tracer",
    "#060606": "front",
    "#070707": "knob-1",
    "#080808": "knob-2",
    "#090909": "knob-3",
    "#0a0a0a": "knob-4",
    "#0b0b0b": "knob-5",
    "#0c0c0c": "better",
    "#0d0d0d": "worse",
    "#0e0e0e": "paper",
    "#0f0f0f": "ghost",
}
INK, MUTED, GRID, ACCENT, TRACER, FRONT, *KNOBS, BETTER, WORSE, PAPER, GHOST = COLOURS
DEEPEST = 1e-4
"""Errors under this share of the largest stand on the lower edge of a chart, with their value."""
PLAIN = ",.4~r"
CHARACTER = 6.1
"""Width of a character of a label, px."""


CONFIG = {
    "background": "transparent",
    "font": "sans-serif",
    "view": {"stroke": None},
    "axis": {
        "domain": False,
        "ticks": False,
        "gridColor": GRID,
        "labelColor": MUTED,
        "titleColor": MUTED,
        "labelFontSize": 11,
        "titleFontSize": 11,
        "titleFontWeight": "normal",
        "labelPadding": 6,
        "titlePadding": 8,
    },
    "text": {"fontSize": 11},
}


def svg(chart: dict | alt.TopLevelMixin, name: str) -> Markup:
    """The chart, or its specification, as inline SVG with its own ids and the page's colours."""
    spec = chart if isinstance(chart, dict) else chart.to_dict(validate=False)
    drawn = vl_convert.vegalite_to_svg(spec | {"config": CONFIG})
    drawn = re.sub(r' xmlns(:\w+)?="[^"]*"', "", drawn, count=2)
    drawn = re.sub(r'(id="|url\(#)(clip|gradient)', rf"\1{name}-\2", drawn)
    for code, colour in COLOURS.items():
        drawn = drawn.replace(f'"{code}"', f'"var(--{colour})"')
    return Markup(drawn)


def overlay(layers: list[alt.Chart], width: float, height: float) -> dict:
    """The specification of one chart with all layers. Altair's own copies each of them many times over."""
    parts = [layer.to_dict(validate=False) for layer in layers]
    return {
        "$schema": parts[0]["$schema"],
        "width": width,
        "height": height,
        "datasets": {k: v for part in parts for k, v in part.get("datasets", {}).items()},
        "layer": [
            {k: v for k, v in part.items() if k not in ("$schema", "config", "datasets")} for part in parts
        ],
    }


class LogScale:
    """A log axis of a decade or more with some room round all values, and ticks at 1, 2, 5 or decades."""

    def __init__(self, values: list[float], pixels: float, room: float = 1.5) -> None:
        good = [v for v in values if v > 0 and math.isfinite(v)] or [0.01, 1.0]
        middle = math.sqrt(min(good) * max(good))
        self.low = min(min(good) / room, middle / math.sqrt(10))
        self.high = max(max(good) * room, middle * math.sqrt(10))
        self.pixels = pixels

    def at(self, value: float) -> float:
        """Pixels from the low end."""
        return self.pixels * math.log(value / self.low) / math.log(self.high / self.low)

    def value(self, pixels: float) -> float:
        """The value so many pixels from the low end."""
        return self.low * (self.high / self.low) ** (pixels / self.pixels)

    def clip(self, value: float) -> float:
        """The nearest value on the axis."""
        return min(max(value, self.low), self.high)

    def ticks(self) -> list[float]:
        """Round values, about one every 50 px."""
        decades = math.log10(self.high / self.low)
        steps = (1, 2, 5) if decades <= 2 else (1, 3) if decades <= 3.5 else (1,)
        powers = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        every = 1 if decades <= 7 else 2
        return [
            m * 10.0**p
            for p in powers
            for m in steps
            if self.low <= m * 10.0**p <= self.high and p % every == 0
        ]

    def encode(self, channel: type, field: str, title: str, **axis: Any) -> Any:
        """The encoding of a field on this axis."""
        return channel(
            f"{field}:Q",
            scale=alt.Scale(type="log", domain=[self.low, self.high], nice=False),
            axis=alt.Axis(values=self.ticks(), format="~r", title=title, **axis),
        )


TOP_TITLE: dict[str, Any] = {
    "titleAngle": 0,
    "titleAlign": "left",
    "titleAnchor": "end",
    "titleBaseline": "bottom",
}


def layer(rows: list[dict]) -> alt.Chart:
    """A chart of plain rows, as a tuple since Altair copies lists over and over."""
    return alt.Chart(alt.Data(values=tuple(rows)))


def error_scale(relative: bool) -> tuple[float, str]:
    """Factor and unit in which an error is drawn."""
    return (100.0, "RMS error, % of the mean truth") if relative else (1.0, "RMS error, absolute")


def point(r: dict, relative: bool, text: str, group: str) -> dict:
    """A measurement as a point of error against cost."""
    factor, _ = error_scale(relative)
    e, c = r["errors"]["rmse"], r["costs"]["frame_ms"]
    unit = " %" if relative else ""
    said = f"{interval_text(e, factor, unit)} at {interval_text(c)} ms"
    return {
        "x": c["value"],
        "x_low": c["low"],
        "x_high": c["high"],
        "y": factor * e["value"],
        "y_low": factor * e["low"],
        "y_high": factor * e["high"],
        "text": text,
        "group": group,
        "said": said,
    }


def cost_chart(case: dict, records: dict[str, dict], name: str) -> tuple[Markup, list[str]] | None:
    """Error against cost on log axes: settings by knob, rivals, path tracing, the front.

    Returns the SVG and the knobs in the order of their colours; None where there is nothing to compare.
    """
    relative, width, height = case["relative"], 560, 330
    good = [s for s in case["settings"] if (r := records[s["key"]])["status"] == "ok" and r["errors"]]
    knobs = list(dict.fromkeys(k for s in good if len(s["changed"]) == 1 for k in s["changed"]))
    points = []
    for s in good:
        changed = s["changed"]
        group = "default" if not changed else next(iter(changed)) if len(changed) == 1 else "several"
        text = case["technique"] if not changed else several(changed, records[s["key"]])
        if group in knobs:
            text = show(changed[group]) if not isinstance(changed[group], bool) else label(changed)
        points.append(point(records[s["key"]], relative, text, group) | {"full": s["label"]})
    for key in case["rivals"]:
        r = records[key]
        points.append(point(r, relative, r["technique"], "rival") | {"full": r["technique"]})
    for key in case["path_tracer"]:
        spp = records[key]["knobs"]["spp"]
        text = f"{spp} spp"
        points.append(point(records[key], relative, text, "tracer") | {"full": f"path tracer, {text}"})
    if not good or len(points) < 2:
        return None
    x = LogScale([v for p in points for v in (p["x"], p["x_low"], p["x_high"])], width)
    floor = DEEPEST * max(p["y"] for p in points)
    y = LogScale([v for p in points for v in (p["y"], p["y_high"]) if v >= floor], height)
    colours = {"default": ACCENT, "rival": MUTED, "tracer": TRACER, "several": INK}
    colours |= {k: KNOBS[i % len(KNOBS)] for i, k in enumerate(knobs)}
    for p in points:
        p["below"] = p["y"] < y.low
        p["text"] += f" \u2193 {p['y']:.2g}" if p["below"] else ""
        p |= {"colour": colours[p["group"]], "said": f"{p['full']}: {p['said']}"}
        for k in ("x", "x_low", "x_high"):
            p[k] = x.clip(p[k])
        for k in ("y", "y_low", "y_high"):
            p[k] = y.clip(p[k])
    front = [points[i] for i in pareto([(p["x"], p["y"]) for p in points])]
    labels = place_labels(points, front, x, y)

    X = x.encode(alt.X, "x", "frame time, ms")
    Y = y.encode(alt.Y, "y", error_scale(relative)[1], titleX=-34, titleY=-6, **TOP_TITLE)
    colour = alt.Color("colour:N", scale=None)
    bars = layer([p for p in points if not p["below"]])
    layers = [
        layer(front)
        .mark_line(interpolate="step-after", color=FRONT, strokeDash=[4, 4], strokeWidth=1.5)
        .encode(X, Y),
        layer([p for p in points if p["group"] == "tracer"])
        .mark_line(color=TRACER, strokeWidth=1.2, opacity=0.6)
        .encode(X, Y),
        bars.mark_rule(strokeWidth=1, opacity=0.45)
        .encode(X, Y, alt.X2("x_high:Q"), color=colour)
        .transform_calculate(x="datum.x_low"),
        bars.mark_rule(strokeWidth=1, opacity=0.45)
        .encode(X, Y, alt.Y2("y_high:Q"), color=colour)
        .transform_calculate(y="datum.y_low"),
    ]
    shapes = {"tracer": ("square", 34), "rival": ("diamond", 60), "default": ("circle", 130)}
    for group in ("tracer", "rival", "several", *knobs, "default"):
        shape, area = shapes.get(group, ("circle", 46))
        layers.append(
            layer([p for p in points if p["group"] == group])
            .mark_point(shape=shape, size=area, filled=True, opacity=1, stroke=PAPER, strokeWidth=1)
            .encode(X, Y, alt.Description("said:N"), color=colour)
        )
    layers.append(
        layer(labels)
        .mark_rule(strokeWidth=0.7, opacity=0.6)
        .encode(x.encode(alt.X, "x", "frame time, ms"), Y, alt.X2("lx:Q"), alt.Y2("ly:Q"), color=colour)
    )
    LX, LY = (
        x.encode(alt.X, "lx", "frame time, ms"),
        y.encode(alt.Y, "ly", error_scale(relative)[1], titleX=-34, titleY=-6, **TOP_TITLE),
    )
    for align in ("left", "right", "center"):
        for bold in (True, False):
            chosen = [p for p in labels if p["align"] == align and (p["group"] == "default") == bold]
            if chosen:
                layers.append(
                    layer(chosen)
                    .mark_text(align=align, baseline="middle", fontWeight="bold" if bold else "normal")
                    .encode(LX, LY, alt.Text("text:N"), color=colour)
                )
    return svg(overlay(layers, width, height), name), knobs


def several(changed: dict, r: dict) -> str:
    """A short name for a setting that changes more than one knob."""
    stages = (r.get("ladder") or {}).get("of", [])
    if set(changed.values()) == {"exact"} and set(changed) <= set(stages):
        return "all stages exact" if len(changed) == len(stages) else f"{len(changed)} stages exact"
    return label(changed)


def place_labels(points: list[dict], front: list[dict], x: LogScale, y: LogScale) -> list[dict]:
    """Labels beside their points where they cover no point, line or other label; further out with a
    leader, else left away (the table has them all)."""
    boxes = [(x.at(p["x"]) - 5, y.at(p["y"]) - 5, x.at(p["x"]) + 5, y.at(p["y"]) + 5) for p in points]
    boxes += [(x.at(p["x_low"]), y.at(p["y"]) - 3, x.at(p["x_high"]), y.at(p["y"]) + 3) for p in points]
    for p, q in itertools.pairwise(front):
        boxes.append((x.at(p["x"]), y.at(p["y"]) - 2, x.at(q["x"]), y.at(p["y"]) + 2))
        boxes.append((x.at(q["x"]) - 2, y.at(q["y"]), x.at(q["x"]) + 2, y.at(p["y"])))
    rank = {"default": 0, "rival": 1, "tracer": 3}
    placed, seen = [], set()
    for p in sorted(points, key=lambda p: rank.get(p["group"], 2)):
        if (p["text"], round(x.at(p["x"])), round(y.at(p["y"]))) in seen:
            continue
        seen.add((p["text"], round(x.at(p["x"])), round(y.at(p["y"]))))
        wide = CHARACTER * len(p["text"]) * (1.1 if p["group"] == "default" else 1.0)
        for reach in (9, 20, 34, 50):
            spot = next((s for s in _spots(p, wide, reach, x, y) if _free(s[2], boxes, x, y)), None)
            if spot:
                align, (px, py), box = spot
                boxes.append(box)
                far = reach > 9
                placed.append(p | {"align": align, "lx": x.value(px), "ly": y.value(py)})
                if not far:
                    placed[-1]["x"], placed[-1]["y"] = x.value(px), y.value(py)
                break
    return placed


def _spots(p: dict, wide: float, reach: float, x: LogScale, y: LogScale):
    px, py = x.at(p["x"]), y.at(p["y"])
    d = 0.8 * reach
    for align, dx, dy in (
        ("left", reach, 0),
        ("right", -reach, 0),
        ("center", 0, reach + 4),
        ("center", 0, -reach - 4),
        ("left", d, d),
        ("left", d, -d),
        ("right", -d, d),
        ("right", -d, -d),
    ):
        cx, cy = px + dx, py + dy
        left = cx - {"left": 0, "right": wide, "center": wide / 2}[align]
        yield align, (cx, cy), (left - 2, cy - 7, left + wide + 2, cy + 7)


def _free(box: tuple, others: list[tuple], x: LogScale, y: LogScale) -> bool:
    if box[0] < 0 or box[1] < 0 or box[2] > x.pixels or box[3] > y.pixels:
        return False
    return all(box[2] <= o[0] or o[2] <= box[0] or box[3] <= o[1] or o[3] <= box[1] for o in others)


def ladder_chart(case: dict, records: dict[str, dict], name: str) -> Markup | None:
    """Error of every rung as a bar; what the stage before took away as a ghost, what it added as an edge; for
    radiance a tick at what one gain leaves."""
    if not case["ladder"]:
        return None
    factor, title = error_scale(case["relative"])
    unit = " %" if case["relative"] else ""
    rows, last = [], None
    for i, rung in enumerate(case["ladder"]):
        errors = records[rung["key"]]["errors"]
        e = errors["rmse"]
        value = factor * e["value"]
        change = "" if last is None else f"  ({value - last:+.3g})".replace("-", "\u2212")
        rows.append(
            {
                "order": i,
                "rung": "as asked" if rung["stage"] is None else f"+ {rung['stage']} exact",
                "value": value,
                "low": factor * e["low"],
                "high": factor * e["high"],
                "last": value if last is None else last,
                "edge": max(value, value if last is None else last, factor * e["high"]),
                "text": f"{interval_text(e, factor, unit)}{change}",
                "colour": WORSE if last is not None and value > last else GHOST,
                "shape": factor * errors["rmse_gain"]["value"] if "rmse_gain" in errors else None,
            }
        )
        last = value
    top = 1.45 * max(r["edge"] for r in rows) or 1.0
    scale = alt.Scale(domain=[0, top], nice=False)
    Y = alt.Y(
        "rung:N",
        sort=[r["rung"] for r in rows],
        axis=alt.Axis(title=None, labelColor=INK, labelLimit=220, grid=False),
    )
    X = alt.X("value:Q", scale=scale, axis=alt.Axis(title=title, tickCount=5, format=PLAIN))
    base = layer(rows)
    layers = [
        base.mark_bar(height=20, color=ACCENT).encode(X, Y, alt.Description("text:N")),
        base.mark_bar(height=20, opacity=1).encode(
            alt.X("last:Q", scale=scale), Y, alt.X2("value:Q"), color=alt.Color("colour:N", scale=None)
        ),
        base.mark_rule(strokeWidth=1.5, color=INK).encode(alt.X("low:Q", scale=scale), Y, alt.X2("high:Q")),
        base.transform_filter("datum.shape != null")
        .mark_tick(thickness=2, height=20, color=PAPER)
        .encode(alt.X("shape:Q", scale=scale), Y),
        base.mark_text(align="left", dx=7, color=INK).encode(
            alt.X("edge:Q", scale=scale), Y, alt.Text("text:N")
        ),
    ]
    return svg(overlay(layers, 380, 34 * len(rows)), name)


def stress_chart(
    field: str, points: list[dict], case: dict, records: dict[str, dict], axis: dict, name: str
) -> Markup | None:
    """Error against a field of the scene, with intervals; hollow outside the domain, a cross where no
    figure came."""
    factor, title = error_scale(case["relative"])
    width, height = 270, 170
    rows, lost = [], []
    for p in points:
        r = records[p["key"]]
        if r["status"] != "ok" or not r["errors"]:
            why = r["status"] if r["status"] != "ok" else ", ".join(f["kind"] for f in r["findings"])
            lost.append({"x": p["x"], "said": f"{field} {p['x']:.4g}: {why}", "text": "\u00d7"})
            continue
        e = r["errors"]["rmse"]
        inside = (r.get("domain") or {"inside": True})["inside"]
        rows.append(
            {
                "x": p["x"],
                "value": factor * e["value"],
                "low": factor * e["low"],
                "high": factor * e["high"],
                "fill": ACCENT if inside else PAPER,
                "said": f"{field} {p['x']:.4g}: {interval_text(e, factor, ' %' if case['relative'] else '')}"
                + ("" if inside else f" (outside: {r['domain']['reason']})"),
            }
        )
    if not rows and not lost:
        return None
    xs = [p["x"] for p in points]
    log_x = axis.get("log", False) and min(xs) > 0
    unit = axis.get("unit", "1")
    x_title = field if unit == "1" else f"{field}, {unit}"
    low, high = min(xs), max(xs)
    if low == high:
        low, high = (low / 2, 2 * high) if log_x else (low - 0.5, high + 0.5)
    x_scale = alt.Scale(type="log" if log_x else "linear", domain=[low, high], nice=False, padding=8)
    ticks = [t for t in LogScale(xs, width, 1.0).ticks() if low <= t <= high] if log_x else alt.Undefined
    x_axis = alt.Axis(title=x_title, grid=False, tickCount=5, format="~r" if log_x else PLAIN, values=ticks)
    X = alt.X("x:Q", scale=x_scale, axis=x_axis)
    values = [r["value"] for r in rows]
    log_y = bool(values) and min(values) > 0 and max(values) > 20 * min(values)
    if log_y:
        y = LogScale([v for r in rows for v in (r["value"], r["high"])], height, 1.3)
        for r in rows:
            r |= {"low": y.clip(r["low"]), "high": y.clip(r["high"])}
        y_scale = alt.Scale(type="log", domain=[y.low, y.high], nice=False)
        y_axis = alt.Axis(values=y.ticks(), format="~r", title=title, titleX=-28, titleY=-6, **TOP_TITLE)
        top = y.high
    else:
        top = 1.15 * max((r["high"] for r in rows), default=1.0) or 1.0
        y_scale = alt.Scale(domain=[0, top], nice=False)
        y_axis = alt.Axis(tickCount=4, format=PLAIN, title=title, titleX=-28, titleY=-6, **TOP_TITLE)
    Y = alt.Y("value:Q", scale=y_scale, axis=y_axis)
    base = layer(rows)
    default = case["fields"].get(field)
    layers = []
    if isinstance(default, (int, float)) and low <= default <= high:
        layers.append(layer([{"x": default}]).mark_rule(color=FRONT, strokeDash=[2, 3]).encode(X))
    layers += [
        base.mark_line(color=ACCENT, strokeWidth=1.5, opacity=0.6).encode(X, Y),
        base.mark_rule(color=ACCENT, strokeWidth=1.5).encode(
            X, alt.Y("low:Q", scale=y_scale), alt.Y2("high:Q")
        ),
        base.mark_point(size=46, filled=True, opacity=1, stroke=ACCENT, strokeWidth=1.5).encode(
            X, Y, alt.Description("said:N"), fill=alt.Fill("fill:N", scale=None)
        ),
        layer([p | {"value": top} for p in lost])
        .mark_text(color=WORSE, fontSize=18, fontWeight="bold", baseline="top")
        .encode(X, Y, alt.Text("text:N"), alt.Description("said:N")),
    ]
    return svg(overlay(layers, width, height), name)


def overview_chart(rows: list[dict], relative: bool, name: str) -> Markup | None:
    """Every technique's error on one log line each, and path tracing at the same cost beside it."""
    chosen = [r for r in rows if r["figures"] and r["relative"] == relative]
    factor, title = error_scale(relative)
    drawn = [
        {
            "row": r["anchor"],
            "named": f"{r['technique']} \u00b7 {r['scene']} \u00b7 {r['quantity'].replace('_', ' ')}",
            "error": factor * r["figures"]["rmse"]["sort"],
            "tracer": factor * (r["path_tracer_error"] or 0),
            "said": f"{r['figures']['rmse']['text']} \u00b1 {r['figures']['rmse']['half'] or 0}",
            "instead": f"path tracer at the same cost: {r['path_tracer_error_text']}",
        }
        for r in chosen
    ]
    if not drawn:
        return None
    x = LogScale([v for d in drawn for v in (d["error"], d["tracer"])], 860, 1.15)
    for d in drawn:
        d["error"] = x.clip(d["error"])
        d["from"], d["to"] = d["error"], d["tracer"] or d["error"]
    Y = alt.Y("row:N", sort=[d["row"] for d in drawn], axis=None)
    X = x.encode(alt.X, "error", title)
    with_tracer = [d for d in drawn if d["tracer"]]
    base = layer(drawn)
    layers = [
        layer(with_tracer)
        .mark_rule(color=GHOST, strokeWidth=3)
        .encode(x.encode(alt.X, "from", title), Y, alt.X2("to:Q")),
        layer(with_tracer)
        .mark_point(shape="square", size=42, color=TRACER, filled=True, opacity=1)
        .encode(x.encode(alt.X, "tracer", title), Y, alt.Description("instead:N")),
        base.mark_point(size=80, filled=True, opacity=1, color=ACCENT).encode(
            X, Y, alt.Description("said:N")
        ),
        base.mark_text(align="right", color=INK, x=-14).encode(Y, alt.Text("named:N")),
    ]
    return svg(overlay(layers, 860, max(24 * len(drawn), 40)), name)
