r"""A light map of one bounce, with ambient occlusion for the others.

SIGGRAPH 2006 Course 26, section 3.3.2. Full global illumination took too long to bake, so that a final
gather (direct light and its first bounce) was combined with ambient occlusion, tone-mapped to fit:

    E_0(x) = direct irradiance,
    E_1(x) = E_0(x) + int albedo / pi E_0(x') cos dw       x' what is met along w
    AO(x)  = int [nothing within reach along w] cos dw / pi,
    T      = g AO^c,
    E      = E_1 + T,                                      L = albedo / pi E.

T stands for the second bounce and all later ones. It has no colour, so that no wall tints another beyond the
first bounce, and is there in unlit corners too.

In print, and what was done here:
- The text says that occlusion darkens creases, yet that it is added. `combine` offers E_1 + T ("add", as the
  formula stands), E_1 - (g - T) ("darken", cut at 0) and E_1 AO^c ("multiply"). "none" is E_1 alone, and
  "exact" all bounces by light paths.
- Range and curve of the tone mapping are the artist's: `gain` g is in units of the mean of E_1, `curve` is c.
- The reach of the occlusion rays is not given; in a closed room it must end.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    INTERREFLECTION,
    NO_MODEL,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.gathered_light import LIFT, from_lights, irradiance_on
from approximations.kit.light_map import Atlas, atlas, luxels, place, seen_along
from approximations.kit.sampling import hemisphere_direction, random_turn
from scenes.contract import RADIANCE, Scene, View
from scenes.rooms import ColouredRoom

LIGHT_EDGE = 6
"""The light is sampled at 6 x 6 points."""


@dataclass
class GatheredMap:
    """Irradiance (W m^-2) at every luxel."""

    grid: Atlas
    irradiance: mi.Color3f


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 3.3.2",
    covers=("rain/05",),
    estimates=RADIANCE,
    on=(ColouredRoom,),
    replaces="irradiance of all bounces",
    neglects=(INTERREFLECTION, NO_MODEL, SPATIAL_DETAIL),
    claims=(exact_when("ColouredRoom", 0.06, knobs={"combine": "exact"}),),
    stress={"ColouredRoom": ("saturation",)},
)
def gathered_lightmap(view: View, map: GatheredMap) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel."""
    surface = view.surface
    irradiance = place(map.grid, surface.position, surface.chart).fetch(map.irradiance)
    return surface.albedo * dr.inv_pi * irradiance


@gathered_lightmap.bake
def bake(
    view: View,
    *,
    combine: Literal["add", "darken", "multiply", "none", "exact"] = "add",
    gain: Annotated[float, Sweep(0.1, 0.6, low=0, high=10)] = 0.3,
    curve: Annotated[float, Sweep(3.0, low=0.1, high=10)] = 1.0,
    reach: Annotated[float, Sweep(0.25, low=0.01, high=100)] = 1.0,
    luxel: Annotated[float, Sweep(0.4, low=0.02, high=4)] = 0.1016,
    rays: Annotated[int, Sweep(16, low=4, high=65536)] = 64,
) -> GatheredMap:
    """The combined map.

    combine  how gathered light and occlusion make one.
    gain     g over the mean of the gathered irradiance.
    curve    c, by which occlusion is raised.
    reach    of occlusion rays, m.
    luxel    distance of luxels, m.
    rays     for gathering and for occlusion, at every luxel.
    """
    grid = atlas(view.charts, luxel)
    p, chart = luxels(grid)
    n = grid.frame(chart).n
    if combine == "exact":
        return GatheredMap(grid, irradiance_on(view, p, n, [n], LIGHT_EDGE, rays)[0])
    direct = from_lights(view, p, n, LIGHT_EDGE).on(n)
    dr.eval(direct)
    lit = dataclasses.replace(view, gather=lambda x, w, seed: seen_along(view, grid, direct, x, w))
    gathered = irradiance_on(lit, p, n, [n], LIGHT_EDGE, rays)[0]
    occlusion = dr.power(openness(view, p, n, rays, reach), curve)
    level = gain * dr.mean(dr.mean(gathered, axis=1))
    found = {
        "add": gathered + level * occlusion,
        "darken": dr.maximum(gathered + level * (occlusion - 1), 0),
        "multiply": gathered * occlusion,
        "none": gathered,
    }[combine]
    dr.eval(found)
    return GatheredMap(grid, found)


def openness(view: View, p: mi.Point3f, n: mi.Vector3f, rays: int, reach: float) -> mi.Float:
    """AO of points: cosine-weighted share of directions in which nothing is met within reach."""
    lane = dr.arange(mi.UInt32, rays * dr.width(p))
    normal = dr.gather(mi.Vector3f, mi.Vector3f(n), lane // rays)
    turn = dr.gather(mi.Float, random_turn(dr.width(p), 2), lane // rays)
    local = hemisphere_direction(lane % rays, rays, turn)
    start = dr.gather(mi.Point3f, mi.Point3f(p + LIFT * n), lane // rays)
    free = view.trace(start, mi.Frame3f(normal).to_world(local)) > reach
    return dr.block_sum(dr.select(free, 2 * local.z, 0), rays) / rays


@gathered_lightmap.domain
def domain(scene: Scene) -> Domain:
    """Grey streets in the rain (3.3.2): what later bounces carry has little colour."""
    if scene.saturation * scene.albedo > 0.6:
        return Domain(False, "later bounces are strongly coloured, occlusion is grey")
    return Domain(True)
