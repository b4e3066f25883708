r"""Radiosity normal mapping: baked light of three directions, so that bumps respond to it.

SIGGRAPH 2006 Course 26, section 7.3.1. A light map that knows the irradiance of the flat surface alone shows
no normal map. Here every luxel holds the irradiance on three surfaces that lean from the true one, bounced
light included, and a pixel blends the three by its own normal. With z the surface's normal,

    b_0 = (sqrt(2/3), 0, 1/sqrt 3),   b_1, b_2 = (-1/sqrt 6, +-1/sqrt 2, 1/sqrt 3),
    bake    E_i = int L(w) max(b_i . w, 0) dw    over the hemisphere above the surface,
    shade   E(n) = sum_i w_i(n) E_i,             L = albedo / pi E(n).

The three are orthonormal and lean 54.7 deg. Light from one direction inside their common octant is returned
exactly by w_i = n . b_i, since then sum (n . b_i)(b_i . l) = n . l; whatever comes from elsewhere is not.

In print, and what was done here:
- The basis is only drawn; b_0 ... b_2 are what its authors published elsewhere.
- The weights are not given. `weights` offers max(n . b_i, 0), the first public form ("clamped", taken here);
  its square, the later one; and the square over its sum. Under a constant sky a flat surface gets 1.37 with
  the first and 0.79 with the others, where 1 is right: of what a surface that faces b_i would get under a
  whole sky, 21 % comes from below the wall.
- Bumps neither shade nor light each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    ANGULAR_DETAIL,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.gathered_light import irradiance_on
from approximations.kit.light_map import Atlas, atlas, luxels, place
from scenes.contract import RADIANCE, Scene, View
from scenes.rooms import BrickWall

BASIS = (
    (math.sqrt(2 / 3), 0.0, 1 / math.sqrt(3)),
    (-1 / math.sqrt(6), 1 / math.sqrt(2), 1 / math.sqrt(3)),
    (-1 / math.sqrt(6), -1 / math.sqrt(2), 1 / math.sqrt(3)),
)
"""Tangent space: along the chart's u, along its v, off the surface."""
LIGHT_EDGE = 6
"""The light is sampled at 6 x 6 points."""


@dataclass
class DirectionalMaps:
    """Irradiance (W m^-2) on b_0, b_1, b_2 at every luxel; `exact`: on the normal of every pixel."""

    grid: Atlas
    irradiance: list[mi.Color3f]
    exact: mi.Color3f | None = None


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 7.3.1",
    covers=("source-shading/01",),
    estimates=RADIANCE,
    on=(BrickWall,),
    replaces="irradiance on the perturbed normal",
    neglects=(ANGULAR_DETAIL, SPATIAL_DETAIL),
    claims=(exact_when("BrickWall", 0.06, knobs={"basis": "exact"}),),
    stress={"BrickWall": ("tilt",)},
)
def radiosity_normal_mapping(
    view: View,
    maps: DirectionalMaps,
    *,
    weights: Literal["clamped", "squared", "normalised"] = "clamped",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    weights  w_i: max(n . b_i, 0), its square, or the square over the sum of squares.
    """
    surface = view.surface
    if maps.exact is not None:
        return surface.albedo * dr.inv_pi * maps.exact
    n = maps.grid.frame(surface.chart).to_local(surface.normal)
    w = basis_weights(n, weights)
    at = place(maps.grid, surface.position, surface.chart)
    irradiance = sum(w[i] * at.fetch(maps.irradiance[i]) for i in range(3))
    return surface.albedo * dr.inv_pi * irradiance


def basis_weights(n: mi.Vector3f, weights: str) -> list[mi.Float]:
    """w_i of unit normals in tangent space."""
    w = [dr.maximum(dr.dot(n, mi.Vector3f(b)), 0) for b in BASIS]
    if weights == "clamped":
        return w
    w = [dr.square(x) for x in w]
    if weights == "squared":
        return w
    total = dr.maximum(sum(w), 1e-6)
    return [x / total for x in w]


@radiosity_normal_mapping.bake
def bake(
    view: View,
    *,
    basis: Literal["three", "exact"] = "three",
    luxel: Annotated[float, Sweep(0.05, 0.4, low=0.02, high=4)] = 0.1016,
    paths: Annotated[int, Sweep(16, low=8, high=65536)] = 128,
) -> DirectionalMaps:
    """Irradiance on the basis at every luxel of the charts in sight, direct and bounced.

    basis  three directions a luxel, or "exact": the normal of every pixel, there.
    luxel  distance of luxels, m (4 inches).
    paths  light paths that are gathered for each luxel; an 8th of them for each pixel where exact.
    """
    surface, grid = view.surface, atlas(view.charts, luxel)
    if basis == "exact":
        n = grid.frame(surface.chart).n
        exact = irradiance_on(view, surface.position, n, [surface.normal], 2, paths // 8)[0]
        return DirectionalMaps(grid, [], exact)
    p, chart = luxels(grid)
    frame = grid.frame(chart)
    leaning = [frame.to_world(b) for b in BASIS]
    return DirectionalMaps(grid, irradiance_on(view, p, frame.n, leaning, LIGHT_EDGE, paths))


@radiosity_normal_mapping.domain
def domain(scene: Scene) -> Domain:
    """Static light on surfaces with bumps shallower than the basis's lean (7.3.1)."""
    if scene.tilt > 54.7:
        return Domain(False, "normals lean further than the basis, of which two directions then fall away")
    return Domain(True)
