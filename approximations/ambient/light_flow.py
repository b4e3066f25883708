r"""Light flow: shadows made by moving a volume along the light and blurring it.

SIGGRAPH 2006 Course 26, chapter 9.9, proposed as an extension of the distance field. I is a volume of light,
D the unit direction of its flow.

    start      I_0 = share of each cell that is free, 1 in the open and 0 inside bodies, blurred
    direction  D away from the mean of the lights, from constant and linear spherical harmonics without
               occlusion, kept in a coarser volume
    flow       I_t+1(x) = (1 - m) I_t(x) + m blur(I_t)(x - h D(x))
    read       I one cell off the surface, where N . L > 0, as the share of the light that arrives

In print, and what was done here:
- The step above is put together from words: zoom the volume along the directions, blur, blend with itself,
  again and again. Blended with what it was a step before, as written, I forgets the bodies: in the limit all
  is light that flowed in from the border. That it "converges" to streaks holds where the bodies stay: blended
  with the start, I = (1 - m) I_0(x) + m blur(I_t)(x - h D), streaks that fade behind bodies; or cut where
  they are, I = I_0(x) blur(I_t)(x - h D), whose shadows do not fade.
- h, m, the blur, the number of steps and the volumes' sizes are not given.
- Opposite lights cancel in the mean direction; where it vanishes nothing flows.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy import ndimage

from approximations.contract import (
    ANGULAR_DETAIL,
    NO_MODEL,
    PENUMBRA_WIDTH,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    technique,
)
from approximations.kit.solids import share_inside
from approximations.kit.volume import (
    Grid,
    Volume,
    as_volume,
    blurred,
    cell_centres,
    grid_over,
    look_up,
    look_up_all,
    on_grid,
)
from scenes.contract import LIGHT_VISIBILITY, Scene, View
from scenes.fields import SolidsUnderLamp


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 9.9",
    covers=("sdf-sky-light/08",),
    estimates=LIGHT_VISIBILITY,
    on=(SolidsUnderLamp,),
    replaces="the share of a light that a point sees",
    neglects=(NO_MODEL, PENUMBRA_WIDTH, ANGULAR_DETAIL, SPATIAL_DETAIL),
    stress={"SolidsUnderLamp": ("lamp_radius",)},
)
def light_flow(view: View, light: Volume) -> mi.Float:
    """Share of the light, 0 to 1, one number per pixel."""
    surface = view.surface
    p, n = surface.position, surface.normal
    cell = light.span.x / light.texture.shape[2]
    faces = dr.dot(n, mi.Point3f(view.lights[0].centre) - p) > 0
    return dr.select(surface.valid, dr.select(faces, look_up(light, p + cell * n), 0), 1)


@light_flow.bake
def bake(
    view: View,
    *,
    blend: Literal["itself", "start", "cut"] = "start",
    m: Annotated[float, Sweep(0.8, 0.95, low=0, high=1)] = 0.8,
    sigma: Annotated[float, Sweep(0, 0.3, low=0, high=8)] = 0.3,
    steps: Annotated[int, Sweep(8, 32, low=1, high=1024)] = 32,
    direction: Literal["coarse", "exact"] = "coarse",
    resolution: Annotated[int, Sweep(32, 48, low=8, high=256)] = 48,
) -> Volume:
    """The volume of light, 0 to 1.

    blend       with the volume of the step before, with the start, or cut by the start
    m           weight of what flowed, in the first two
    sigma       Gaussian blur of each step, cells
    steps       of h = one cell each
    direction   from a volume of 8 cells along the longest edge, or from each cell's own place
    resolution  cells along the longest edge
    """
    grid = grid_over(view.bounds, resolution)
    free = blurred(1 - on_grid(grid, share_inside(view.solids, cell_centres(grid), grid.cell, 2)), sigma)
    upstream = np.indices(grid.shape) - np.moveaxis(_flow(view, grid, direction), -1, 0)[::-1]
    light = free
    for _ in range(steps):
        moved = ndimage.map_coordinates(blurred(light, sigma), upstream, order=1, mode="nearest")
        if blend == "cut":
            light = free * moved
        else:
            light = m * moved + (1 - m) * (light if blend == "itself" else free)
    return as_volume(grid, light)


def _flow(view: View, grid: Grid, direction: str) -> np.ndarray:
    """D at the cells of a grid, (nz, ny, nx, 3): away from the lights' mean, by their power over distance
    squared."""

    def mean_of_lights(p: mi.Point3f) -> mi.Vector3f:
        away = [p - mi.Point3f(light.centre) for light in view.lights]
        return sum((a / dr.power(dr.norm(a), 3) for a in away), mi.Vector3f(0))

    coarse = grid_over(view.bounds, 8)
    centres = cell_centres(grid)
    if direction == "exact":
        found = mean_of_lights(centres)
    else:
        found = on_grid(coarse, dr.normalize(mean_of_lights(cell_centres(coarse))))
        found = mi.Vector3f(*look_up_all(as_volume(coarse, found), centres))
    return on_grid(grid, found / dr.maximum(dr.norm(found), 1e-6))


@light_flow.domain
def domain(scene: Scene) -> Domain:
    """One lamp, whose penumbras are about as wide as the blur."""
    if scene.lamp_radius > 0.3:
        return Domain(False, "the blur of the steps does not follow the size of the lamp")
    return Domain(True)
