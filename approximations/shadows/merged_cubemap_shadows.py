r"""Shadows of a room from its cube map, shadows of what moves from a shadow map.

GPU Pro 7, part IV, chapter 1, sections 1.8 and 1.9. What moves is drawn into a shadow map, the room is not;
each of the two says how much of the light it lets through, and

    V = V_room V_moving.

That is exact for a point light, whose factors are 0 or 1 (and so is their minimum). For a light of some size
the product takes the two shadows to be independent: where both hide the same part of the light it is too
dark, where they hide different parts it is too bright. The minimum is right only where one hides all that the
other does.

In print, and what was done here:
- No formula joins the two ("an easy calculation"): `combine` offers the product and the minimum.
- The shadow map has 512^2 texels; how it is filtered is not said: here four texels are compared and weighted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    PENUMBRA_WIDTH,
    SHAPE_OF_VISIBILITY,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    at_most,
    exact_when,
    technique,
)
from approximations.kit.shadow_cube import BYTE, ShadowCube, sees, shadow_cube, sun_mean
from scenes.contract import LIGHT_VISIBILITY, Scene, View
from scenes.window_room import BallRoom

BIAS = 0.02
"""m: how far behind the first surface the map still calls a point lit."""


@dataclass
class ParallelMap:
    """Depth of what moves along the sun's rays (m, from the plane through the middle, towards the sun), on a
    square of half side `reach` about the middle."""

    frame: mi.Frame3f
    middle: mi.Point3f
    reach: mi.Float
    size: int
    height: mi.Float

    def lit(self, p: mi.Point3f) -> mi.Float:
        """Share of the four nearest texels that hold nothing nearer to the sun than p."""
        d = self.frame.to_local(p - self.middle)
        at = 0.5 * self.size * (mi.Point2f(d.x, d.y) / self.reach + 1) - 0.5
        corner = dr.floor(at)
        f = at - corner
        share = mi.Float(0)
        for i, x in enumerate((1 - f.x, f.x)):
            for j, y in enumerate((1 - f.y, f.y)):
                share += (
                    x * y * dr.select(self.fetch(corner.x + i, corner.y + j) <= d.z + BIAS, mi.Float(1), 0)
                )
        return share

    def fetch(self, i: mi.Float, j: mi.Float) -> mi.Float:
        """A texel's height, below everything outside the map."""
        inside = (dr.minimum(i, j) >= 0) & (dr.maximum(i, j) < self.size)
        index = mi.UInt32(dr.select(inside, j * self.size + i, 0))
        return dr.select(inside, dr.gather(mi.Float, self.height, index), -dr.inf)


def draw(view: View, size: int) -> ParallelMap:
    """What moves, as the sun sees it."""
    low, high = view.moving_bounds
    frame, middle, reach = mi.Frame3f(view.sun.direction), 0.5 * (low + high), 0.5 * dr.norm(high - low)
    i = dr.arange(mi.UInt32, size * size)
    x, y = ((2 * mi.Float(c) + 1) / size - 1 for c in (i % size, i // size))
    o = middle + reach * frame.to_world(mi.Vector3f(x, y, 1))
    down = dr.zeros(mi.Vector3f, size * size) - view.sun.direction
    height = reach - view.moving(o, down)
    dr.eval(height)
    return ParallelMap(frame, middle, reach, size, height)


@technique(
    source="GPU Pro 7, part IV, ch. 1.8-1.9",
    covers=("cubemap-shadows/05",),
    estimates=LIGHT_VISIBILITY,
    on=(BallRoom,),
    replaces="share of the sun that a point sees past moving objects and through a window",
    neglects=(PENUMBRA_WIDTH, SHAPE_OF_VISIBILITY, SPATIAL_DETAIL),
    claims=(at_most(1 + 1e-6), exact_when("BallRoom", 0.01, knobs={"combine": "exact", "face": 512})),
    stress={"BallRoom": ("aside",)},
)
def merged_cubemap_shadows(
    view: View,
    room: ShadowCube,
    *,
    combine: Literal["multiply", "min", "exact"] = "multiply",
    still: Literal["linear", "log", "exact"] = "linear",
    moving: Literal["map", "exact"] = "map",
    k: Annotated[float, Sweep(0.5, low=0, high=20)] = 1.0,
    map_size: Annotated[int, Sweep(32, 128, low=2, high=4096)] = 512,
) -> mi.Float:
    """Share of the sun that is seen, 0 to 1, one number per pixel.

    combine   of the two factors: their product ("multiply"), their "min", or "exact": the mean of the product
              of hard shadows over the sun's disk, whatever the factors.
    still     V_room: level of the cube "linear" in the distance or "log" from the footprint, or "exact": the
              mean of 64 hard lookups over the sun's disk.
    moving    V_moving: from the shadow "map", or "exact": from 64 rays to the sun's disk.
    k         levels a metre, for "linear".
    map_size  texels along a side of the shadow map.
    """
    surface, sun = view.surface, view.sun
    p, n, l = surface.position, surface.normal, sun.direction
    lifted, zero = p + 1e-3 * n, dr.zeros(mi.Float, dr.width(p))

    def open_room(w: mi.Vector3f, level=0.0) -> mi.Float:
        return 1 - room.read(p, w, level)

    def unhidden(w: mi.Vector3f) -> mi.Float:
        return dr.select(dr.isinf(view.moving(lifted, w)), mi.Float(1), 0)

    if combine == "exact":
        return dr.select(surface.valid, sun_mean(sun, n, lambda w: open_room(w) * unhidden(w), zero), 1)

    if still == "exact":
        static = sun_mean(sun, n, open_room, zero)
    else:
        lp, dist = room.corrected(p, l)
        reach = dist * dr.tan(mi.Float(sun.angular_radius))
        level = k * dist if still == "linear" else room.footprint_level(lp, reach)
        static = dr.select(dr.dot(n, l) > 0, open_room(l, level), 0)
    dynamic = draw(view, map_size).lit(p) if moving == "map" else sun_mean(sun, l, unhidden, zero)
    both = static * dynamic if combine == "multiply" else dr.minimum(static, dynamic)
    return dr.select(surface.valid, both, 1)


@merged_cubemap_shadows.bake
def bake(view: View, *, face: Annotated[int, Sweep(128, low=2, high=2048)] = 512) -> ShadowCube:
    """8-bit opacity of the room without what moves, from its middle.

    face  texels along a side, a power of two.
    """
    low, high = view.bounds
    centre = 0.5 * (low + high)
    _, t = sees(view.trace, centre, face)
    return shadow_cube(dr.select(dr.isfinite(t), mi.Float(1), 0), centre, (low, high), steps=BYTE)


@merged_cubemap_shadows.domain
def domain(scene: Scene) -> Domain:
    """Small objects that move through a room whose walls are near its box (1.8)."""
    if scene.sun_radius > 5:
        return Domain(False, "the ball's own penumbra is wider than its shadow map can tell")
    return Domain(True)
