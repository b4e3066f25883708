r"""Percentage-closer soft shadows: the width of the filter follows from the distance of the casters.

R. Fernando, "Percentage-closer soft shadows", SIGGRAPH 2005 sketches. One depth map from the light's middle;
caster, receiver and light are taken to be parallel. z is depth along the light's axis, (a, b) = (tan, tan)
across it, l a point of the light:

    search   z_b = mean depth of what is stored nearer than the receiver, over taps (1/z_s - 1/z_r) l
    width    a caster at z_b hides l from the receiver where the tap (1/z_b - 1/z_r) l finds it
    filter   V = share of such taps at which nothing stored lies nearer than the receiver

so that on the receiver the penumbra is light size x (z_r - z_b) / z_b wide. It is exact for one straight edge
parallel to the light; several casters at different depths share one z_b.

The sketch takes the near plane of the light's frustum for z_s; here it is a share `search` of the receiver's
depth, behind which casters must lie. Its taps are a square lattice; here they are best candidates in a disk
of the light's area, or in the light's own shape.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    HIDDEN_GEOMETRY,
    SAMPLING,
    SHAPE_OF_VISIBILITY,
    SPATIAL_DETAIL,
    Sweep,
    at_most,
    exact_when,
    technique,
)
from approximations.kit.point_sets import best_candidates
from approximations.kit.sampling import random_turn
from approximations.kit.shadow_map import ShadowMaps, bounds, filtered, light_point, moved, render
from scenes.contract import LIGHT_VISIBILITY, View
from scenes.shadow_casters import HalfPlane, PoleAndBars


@dataclass
class LightPoints:
    """Points l of the light about its middle (m) for the search and for the filter; an angle per pixel."""

    search: mi.Vector2f
    filter: mi.Vector2f
    turn: mi.Float


@technique(
    source="peer: R. Fernando, Percentage-closer soft shadows, SIGGRAPH 2005",
    estimates=LIGHT_VISIBILITY,
    on=(PoleAndBars, HalfPlane),
    replaces="share of an area light that a point sees",
    neglects=(SHAPE_OF_VISIBILITY, HIDDEN_GEOMETRY, SAMPLING, SPATIAL_DETAIL),
    claims=(
        at_most(1),
        exact_when("HalfPlane", 0.012, knobs={"kernel": "exact", "filter_taps": 512, "map_size": 2048}),
    ),
    stress={"PoleAndBars": ("light_size", "gap")},
    baseline=True,
)
def percentage_closer_soft_shadows(
    view: View,
    points: LightPoints,
    *,
    blockers: Literal["map", "exact"] = "map",
    search: Annotated[float, Sweep(0.25, 0.5, 0.8, low=0.01, high=0.99)] = 0.5,
    map_size: Annotated[int, Sweep(256, 1024, low=16, high=4096)] = 1024,
    bias: Annotated[float, Sweep(0.05, 0.2, low=0, high=5)] = 0.05,
    receiver: Literal["constant", "plane"] = "plane",
) -> mi.Float:
    """Share of the light that is seen, 0 to 1, one number per pixel.

    blockers  z_b from the shadow map, or "exact": from rays to the points of the light.
    search    z_s over the receiver's depth.
    map_size  texels along a side of the shadow map.
    bias      m along the light's axis.
    receiver  depth held against the taps: the point's own, or that of its tangent plane.
    """
    surface, light = view.surface, view.lights[0]
    p, n = surface.position, surface.normal
    maps = render(view.trace, light.centre, light.u, *bounds(surface), size=map_size)
    if blockers == "exact":
        found, z_b = ray_blockers(view, points.search)
    else:
        found, z_b = map_blockers(maps, view, points, search, bias, receiver == "plane")
    z_r = maps.at(mi.UInt32(0)).project(p)[1]
    width = dr.maximum(dr.rcp(z_b) - dr.rcp(z_r), 0)
    lit = filtered(
        maps, p, n, points.filter, points.turn, width, bias=bias, plane=receiver == "plane", bilinear=True
    )
    faces = dr.dot(n, light.centre - p) > 0
    return dr.select(surface.valid, dr.select(faces, dr.select(found, lit, 1), 0), 1)


@percentage_closer_soft_shadows.bake
def bake(
    view: View,
    *,
    kernel: Literal["disk", "exact"] = "disk",
    blocker_taps: Annotated[int, Sweep(4, 16, low=1, high=256)] = 16,
    filter_taps: Annotated[int, Sweep(8, 32, low=1, high=1024)] = 32,
) -> LightPoints:
    """Taps within a "disk" of the light's area that turns from pixel to pixel, or within the "exact" shape of
    the light, which stands still."""
    light = view.lights[0]
    half = np.array([dr.norm(light.u)[0], dr.norm(light.v)[0]])
    shape = "square" if light.shape == "rectangle" else "disk"
    turn = random_turn(view.width * view.height, seed=1)
    if kernel == "exact":
        turn = turn * 0
    else:
        half = np.sqrt(half[0] * half[1] * (4 / np.pi if shape == "square" else 1)) * np.ones(2)
        shape = "disk"
    taps = (half * best_candidates(m, shape, seed=s) for s, m in ((1, blocker_taps), (2, filter_taps)))
    return LightPoints(*(mi.Vector2f(t.T.astype(np.float32)) for t in taps), turn)


def map_blockers(
    maps: ShadowMaps, view: View, points: LightPoints, search: float, bias: float, plane: bool
) -> tuple[mi.Bool, mi.Float]:
    """Whether anything stored lies nearer than the receiver within the search, and its mean depth z_b."""
    zero, p, n = mi.UInt32(0), view.surface.position, view.surface.normal
    frustum = maps.at(zero)
    ab, z_r = frustum.project(p)
    width = (1 / search - 1) / z_r

    def tap(i, count, total):
        at = moved(ab, width, dr.gather(mi.Vector2f, points.search, i), points.turn)
        stored = frustum.fetch(at, zero)
        nearer = stored < (frustum.plane(p, n, at) if plane else z_r) - bias
        return i + 1, count + dr.select(nearer, mi.Float(1), 0), total + dr.select(nearer, stored, 0)

    return _mean(tap, dr.width(points.search), dr.width(p))


def ray_blockers(view: View, points: mi.Vector2f) -> tuple[mi.Bool, mi.Float]:
    """The same from rays to points of the light, which see casters that the map's eye does not."""
    light, p, n = view.lights[0], view.surface.position, view.surface.normal
    unit = replace(light, u=dr.normalize(light.u), v=dr.normalize(light.v))
    axis = dr.cross(unit.u, unit.v)

    def ray(i, count, total):
        start = p + 1e-3 * n
        towards = light_point(unit, dr.gather(mi.Vector2f, points, i)) - start
        far = dr.norm(towards)
        t = view.trace(start, towards / far)
        z = dr.dot(start + t / far * towards - light.centre, axis)
        blocked = t < far
        return i + 1, count + dr.select(blocked, mi.Float(1), 0), total + dr.select(blocked, z, 0)

    return _mean(ray, dr.width(points), dr.width(p))


def _mean(tap, taps: int, lanes: int) -> tuple[mi.Bool, mi.Float]:
    start = (mi.UInt32(0), dr.zeros(mi.Float, lanes), dr.zeros(mi.Float, lanes))
    _, count, total = dr.while_loop(start, lambda i, count, total: i < taps, tap)
    return count > 0, total / dr.maximum(count, 1)
