"""The chart of `lightproof needs`: what an image loses with each thing that is dropped, and the tolerance."""

from __future__ import annotations

import re
from pathlib import Path

import altair as alt
import vl_convert

from compare.loss import DROPPED, NEEDED
from compare.metrics import MEANS
from reference.store import CannotWrite
from reports.build import TEMPLATES
from reports.charts import ACCENT, BETTER, GHOST, INK, MUTED, PAPER, WORSE, LogScale, layer, svg

WIDTH, ROW, CURVE = 460, 26, 240
"""Pixels: width of a panel, height of a row and of the curve."""
DEEPEST = 0.02
"""Losses under this share of the tolerance stand on the lower edge."""
SCALE = 2.0
"""Pixels of the PNG for one of the SVG."""
COLOUR = {DROPPED: BETTER, NEEDED: WORSE}


def save(answer: dict, folder: Path) -> tuple[Path, Path]:
    """Write needs.svg and needs.png of an answer of `compare.needs` into a folder. Raises CannotWrite."""
    drawn = standalone(str(svg(chart(answer), "needs")))
    paths = folder / "needs.svg", folder / "needs.png"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        paths[0].write_text(drawn)
        paths[1].write_bytes(vl_convert.svg_to_png(drawn, scale=SCALE))
    except OSError as error:
        raise CannotWrite(f"cannot write to {folder}: {error.strerror}; choose another folder") from error
    return paths


def chart(answer: dict) -> alt.VConcatChart:
    """A panel of rows, the full transport and the least among them, and below it loss against depth."""
    rows = [r for r in answer["reductions"] if r["loss"]]
    curve = [r for r in rows if r["depth"] is not None]
    bars = [named("nothing", answer["full"])] if answer["full"]["loss"] else []
    bars += [named(r["drops"][0], r) for r in rows if r not in curve]
    if answer["least"] and answer["least"]["drops"]:
        bars += [named("least: " + " + ".join(short(answer["least"])), answer["least"])]
    tolerance = answer["tolerance"]
    values = [v for r in rows for v in (r["loss"]["value"], r["loss"]["high"])]
    scale = LogScale([v for v in values if v >= DEEPEST * tolerance] + [tolerance or 1.0], WIDTH)
    scale.low = min(scale.low, DEEPEST * tolerance) if tolerance else scale.low
    title = f"{answer['scene']}: {answer['metric']} lost, {MEANS[answer['metric']]}"
    panels = [row_panel(bars, tolerance, scale)] if bars else []
    panels += [curve_panel(curve, tolerance, scale)] if curve else []
    bar = (
        "floors of noise" if answer["full"]["loss"] and answer["full"]["loss"]["floor"] else "95 % intervals"
    )
    key = f"green can be dropped, red is needed, grey is not settled; bars: {bar}; 0 stands on the lower edge"
    heading = alt.TitleParams(
        title,
        subtitle=key,
        subtitleColor=MUTED,
        anchor="start",
        color=INK,
        fontSize=12,
        fontWeight="normal",
        offset=14,
    )
    return alt.vconcat(*panels, spacing=34).properties(title=heading)


def short(row: dict) -> list[str]:
    """What is dropped in few words: the depth that is kept, or the family."""
    return [re.sub(r".*\(beyond (depth \d+)\)", r"\1", d).split(" (")[0] for d in row["drops"]]


def named(name: str, row: dict) -> dict:
    """A row of the chart."""
    e = row["loss"]
    said = f"{e['value']:.3g} ({e['low']:.3g} to {e['high']:.3g})"
    colour = COLOUR.get(row["verdict"], MUTED)
    return {"name": name, "depth": row["depth"], **e, "said": said, "colour": colour}


def placed(rows: list[dict], scale: LogScale) -> list[dict]:
    """The rows with their values brought onto the axis."""
    return [r | {k: scale.clip(r[k]) for k in ("value", "low", "high")} for r in rows]


def row_panel(rows: list[dict], tolerance: float, scale: LogScale) -> alt.LayerChart:
    """One row for each thing that is dropped: its loss, the interval, the tolerance as a line."""
    axis = alt.Axis(title=None, labelColor=INK, labelLimit=320, grid=True, gridColor=GHOST, gridOpacity=0.35)
    Y = alt.Y("name:N", sort=[r["name"] for r in rows], axis=axis)
    X = scale.encode(alt.X, "value", "loss")
    base, colour = layer(placed(rows, scale)), alt.Color("colour:N", scale=None)
    return alt.layer(
        layer([{"value": tolerance, "text": "tolerance"}] if tolerance else [])
        .mark_rule(color=ACCENT, strokeDash=[5, 4], strokeWidth=1.5)
        .encode(X),
        base.mark_rule(strokeWidth=3, opacity=0.55).encode(
            scale.encode(alt.X, "low", ""), Y, x2="high:Q", color=colour
        ),
        base.mark_point(size=56, filled=True, opacity=1, stroke=PAPER, strokeWidth=1).encode(
            X, Y, color=colour, description="said:N"
        ),
        base.mark_text(align="left", dx=8, color=INK, x=WIDTH).encode(Y, text="said:N"),
    ).properties(width=WIDTH, height=ROW * len(rows))


def curve_panel(rows: list[dict], tolerance: float, scale: LogScale) -> alt.LayerChart:
    """Loss against the depth at which paths end."""
    drawn = placed([named(str(r["depth"]), r) for r in rows], scale)
    x = LogScale([r["depth"] for r in rows], WIDTH, 1.15)
    depths = [r["depth"] for r in rows]
    X = alt.X(
        "depth:Q",
        scale=alt.Scale(type="log", domain=[x.low, x.high], nice=False),
        axis=alt.Axis(
            title=f"{rows[0]['family']}: Mitsuba's max_depth", values=depths, format="d", grid=False
        ),
    )
    Y = scale.encode(alt.Y, "value", "loss")
    base, colour = layer(drawn), alt.Color("colour:N", scale=None)
    layers = [
        base.mark_line(color=MUTED, strokeWidth=1.2, opacity=0.7).encode(X, Y),
        base.mark_rule(strokeWidth=3, opacity=0.55).encode(
            X, scale.encode(alt.Y, "low", ""), y2="high:Q", color=colour
        ),
        base.mark_point(size=56, filled=True, opacity=1, stroke=PAPER, strokeWidth=1).encode(
            X, Y, color=colour, description="said:N"
        ),
    ]
    if tolerance:
        line = layer([{"value": tolerance, "text": f"tolerance {tolerance:g}"}])
        layers = [
            line.mark_rule(color=ACCENT, strokeDash=[5, 4], strokeWidth=1.5).encode(Y),
            line.mark_text(color=ACCENT, align="right", baseline="bottom", x=WIDTH - 4, dy=-3).encode(
                Y, text="text:N"
            ),
            *layers,
        ]
    return alt.layer(*layers).properties(width=WIDTH, height=CURVE)


def standalone(drawn: str) -> str:
    """The SVG as a file of its own: on paper, in the light colours of the page's style sheet."""
    style = (TEMPLATES / "style.css").read_text()
    light = dict(re.findall(r"--([\w-]+): (#\w+);", style.split("@media")[0]))
    drawn = re.sub(r"var\(--([\w-]+)\)", lambda m: light[m[1]], drawn)
    opened = re.sub(
        r"<svg",
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"',
        drawn,
        count=1,
    )
    return re.sub(
        r"(<svg[^>]*>)", rf'\1<rect width="100%" height="100%" fill="{light["paper"]}"/>', opened, count=1
    )
