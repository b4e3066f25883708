r"""Light map: the irradiance on the flat surface, which the techniques of directional maps are held against.

bake    E_j = int L(w) max(n . w, 0) dw     at every luxel, all bounces
shade   L   = albedo / pi E(x)              bilinear between luxels
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi

from approximations.contract import ANGULAR_DETAIL, SPATIAL_DETAIL, Sweep, technique
from approximations.kit.gathered_light import irradiance_on
from approximations.kit.light_map import Atlas, atlas, luxels, place
from scenes.contract import RADIANCE, View
from scenes.rooms import BrickWall, ColouredRoom


@dataclass
class LightMap:
    """Irradiance (W m^-2) at every luxel."""

    grid: Atlas
    irradiance: mi.Color3f


@technique(
    source="baseline of SIGGRAPH 2006 Course 26, ch. 3.3.2 and 7.3.1",
    estimates=RADIANCE,
    on=(BrickWall, ColouredRoom),
    replaces="irradiance at every point and on the perturbed normal",
    neglects=(SPATIAL_DETAIL, ANGULAR_DETAIL),
    baseline=True,
)
def flat_light_map(view: View, map: LightMap) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel."""
    surface = view.surface
    irradiance = place(map.grid, surface.position, surface.chart).fetch(map.irradiance)
    return surface.albedo * dr.inv_pi * irradiance


@flat_light_map.bake
def bake(
    view: View,
    *,
    luxel: Annotated[float, Sweep(0.05, 0.4, low=0.02, high=4)] = 0.1016,
    paths: Annotated[int, Sweep(16, low=1, high=65536)] = 64,
) -> LightMap:
    """Irradiance at luxels that far apart (m), from 6 x 6 points of the light and so many light paths."""
    grid = atlas(view.charts, luxel)
    p, chart = luxels(grid)
    n = grid.frame(chart).n
    return LightMap(grid, irradiance_on(view, p, n, [n], 6, paths)[0])
