r"""Wind that leans clouds over, pushes their textures along and tears their wisps.

GPU Pro 7, II.4, 4.3.4. Clouds change with time though their textures do not, since every read is at a place
that moves. With the share h of the layer's height and the unit vector e of the wind, before any read,

    p <- p + 500 h wind                                  tops run ahead of their bases
    p <- p + 10 time (wind + (0, 0.1, 0))                all is blown along, and billows rise
    p_xy <- p_xy + (1 - h) curl                          for the second texture: wisps are torn near the base

with wind = (1, 0, 0), so that the air moves by 10 units a second and rises by 1; here the scene's wind and
updraft stand for those. It stands for advection of the density q by the wind u, dq/dt + u . grad q = 0, of
which the exact stages keep all: the air at p was at p - integral of u dt.

In print, and what was done here:
- Signs. A field that is read at p + wind t moves against the wind, leans against it, and sinks; the text has
  clouds that grow upwards. Subtracted, all three are as described (`sense`; "printed" is print).
- The axis. The 0.1 is added to y, while the height is z where it is used: billows drift sideways
  (`upward="y"`).
- Two textures scroll at speeds of their own, says the text, without values; the listing moves both by one.
  `detail_speed` is the speed of the second over that of the first.
- Which p the weather map and the height profile are read at is not said. The listing is handed the weather,
  and so by default both stand still; "exact" takes them along.
- The lean is the same at all times, 500 m from base to top. Shear goes on leaning what it moves: by the gain
  of the wind times the time, 500 m after 100 s of a gain of 5 m/s. "exact" leans so.

What comes of it. After 60 s the rmse is 0.071 where the mean density is 0.063, and it is 0.082 had nothing
moved: billows move, but clouds stay where the map has them. With map and profile taken along it is 0.022, for
the lean is 200 m too long at the top, and 0.004 after 100 s, when the lean is right. From 0.022 the updraft
along y makes 0.030, a second texture half as fast again 0.025, and print's signs 0.113. In the first ten
seconds the lean makes the whole worse than no wind. Without curl, all else exact, the rmse is 0.005. Without
shear and updraft, a scroll without lean that takes map and profile along is exact at any time.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    MOTION,
    NO_MODEL,
    PRINTED_SLIP,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.cloud_sampler import covered, worn
from scenes.blown_field import BlownField, Wind
from scenes.contract import DENSITY, Scene, View

LEAST = 1e-6  # m/s, of a wind that has a direction
EXACT = {"lean": "exact", "weather": "exact"}


@technique(
    source="GPU Pro 7, II.4, sec. 4.3.4",
    covers=("cloudscapes/07",),
    estimates=DENSITY,
    on=(BlownField,),
    replaces="advection of the density by a wind that grows with height",
    neglects=(MOTION, NO_MODEL, PRINTED_SLIP),
    claims=(
        exact_when("BlownField", 1e-3, knobs=EXACT),
        exact_when("BlownField", 1e-3, fields={"time": 600.0, "shear": 20.0}, knobs=EXACT),
    ),
    stress={"BlownField": ("time", "speed")},
)
def cloud_wind(
    view: View,
    *,
    lean: Literal["constant", "exact"] = "constant",
    weather: Literal["still", "exact"] = "still",
    sense: Literal["downwind", "printed"] = "downwind",
    upward: Literal["height", "y"] = "height",
    top_offset: Annotated[float, Sweep(0.0, low=0, high=5000)] = 500.0,
    detail_speed: Annotated[float, Sweep(1.5, low=0, high=4)] = 1.0,
    curl: Annotated[float, Sweep(1.0, low=0, high=20)] = 1.0,
) -> mi.Float:
    """Density, 0 to 1, one number per probe.

    lean          of the top over the base: `top_offset` at all times, or what shear has made so far
    weather       whether weather map and height profile stay where they are or go with the air
    sense         of all that is moved: with the wind, or as printed
    upward        the axis that the updraft is added to
    top_offset    m, of a constant lean
    detail_speed  of the second texture over that of the first
    curl          factor on how far wisps are torn aside
    """
    wind, p = view.cloud.model, view.camera.origin
    model, side = wind.model, 1 if sense == "downwind" else -1
    leaned = p - side * _lean(wind, p, lean, top_offset)
    drift = wind.time * mi.Vector3f(*wind.base, wind.updraft)
    if upward == "y":
        drift = mi.Vector3f(drift.x, drift.y + drift.z, 0)
    first, second = (leaned - side * speed * drift for speed in (1, detail_speed))
    at = first if weather == "exact" else p
    here = model.weather(at.x, at.y)
    h = _share(wind, at)
    low = covered(first / model.tile, h, here.coverage, here.type)
    return worn(low, second / model.detail_tile, h, curl * model.curl / model.detail_tile, model.erosion)


@cloud_wind.domain
def domain(scene: Scene) -> Domain:
    """A sky that is watched for a while, in a breeze."""
    if scene.time * scene.speed > 1000:
        return Domain(False, "clouds have been blown out of the weather that they stand in")
    return Domain(True)


def _share(wind: Wind, p: mi.Point3f) -> mi.Float:
    """Share of the layer's height, 0 to 1."""
    model = wind.model
    return dr.clip((p.z - model.base) / (model.top - model.base), 0, 1)


def _lean(wind: Wind, p: mi.Point3f, how: str, top_offset: float) -> mi.Vector3f:
    """How far the air at p is ahead of that at the base (m)."""
    if how == "exact":
        model = wind.model
        middle = p.z - 0.5 * wind.updraft * wind.time
        passed = wind.time * (middle - model.base) / (model.top - model.base)
        return mi.Vector3f(passed * wind.gain[0], passed * wind.gain[1], 0)
    x, y = wind.base
    ahead = top_offset * _share(wind, p) / max(math.hypot(x, y), LEAST)
    return mi.Vector3f(ahead * x, ahead * y, 0)
