r"""Soft shadows of a room's openings from one static cube map.

GPU Pro 7, part IV, chapter 1, sections 1.4 to 1.7. The light is outside a room, the room's walls hide it.
Once and for all lights, six faces are drawn from a point C of the room:

    bake      alpha(w) = 1 where C sees a surface along w, 0 where it looks out; all mips by 2 x 2 means
    lookup    P = where V0 + t L leaves the proxy box, Lp = P - C          (`approximations.kit.shadow_cube`)
    level     lod = k |P - V0|
    share     V = 1 - alpha(Lp, lod)

It is exact for a point light and walls that lie in the box, but for texels. A wall delta within the box
moves a shadow by delta (tan a - tan b) along it, a and b being the angles of Lp and L with its normal;
whatever stands in the room is taken to hang on its walls.

The level stands for the size of the light. A sun of angular radius r needs the mean of alpha over a disk of
radius |P - V0| tan r; the level of such texels grows by the logarithm of the distance,

    lod = log2(|P - V0| tan(r) N / h),

so that k fits one distance, one sun and one size of face. What is read is a square tent on the texels' grid.

In print, and what was done here:
- alpha is opacity in the formulas and "how much light can reach" in the text; here it is opacity.
- k is chosen by eye. The other reading, distance over the room's diagonal times the levels, is "normalised";
  the rule of the footprint is "log", the mean over the footprint "exact".
- What a light behind the surface does is not said: here it gives nothing.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    NUMBER_FORMAT,
    PENUMBRA_WIDTH,
    SHAPE_OF_VISIBILITY,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    at_most,
    exact_when,
    technique,
)
from approximations.kit.cube_map import lookup
from approximations.kit.shadow_cube import BYTE, ShadowCube, sees, shadow_cube, sun_mean, walls_box
from scenes.contract import LIGHT_VISIBILITY, Scene, View
from scenes.window_room import PillarRoom, WindowRoom


@technique(
    source="GPU Pro 7, part IV, ch. 1.4-1.7",
    covers=("cubemap-shadows/01", "cubemap-shadows/02", "cubemap-shadows/03"),
    estimates=LIGHT_VISIBILITY,
    on=(WindowRoom, PillarRoom),
    replaces="share of the sun that a point sees through the openings of a room",
    neglects=(SHAPE_OF_VISIBILITY, PENUMBRA_WIDTH, SPATIAL_DETAIL, NUMBER_FORMAT),
    claims=(
        at_most(1),
        exact_when("WindowRoom", 0.01, knobs={"proxy": "exact", "penumbra": "exact", "storage": "exact"}),
    ),
    stress={
        "WindowRoom": ("wall_inset", "sun_radius", "sun_elevation", "wall_thickness"),
        "PillarRoom": ("pillar_gap",),
    },
)
def cubemap_shadows(
    view: View,
    shadows: ShadowCube,
    *,
    correction: Literal["none", "box"] = "box",
    penumbra: Literal["hard", "linear", "normalised", "log", "exact"] = "linear",
    k: Annotated[float, Sweep(0.5, 2.0, low=0, high=20)] = 1.0,
) -> mi.Float:
    """Share of the sun that is seen, 0 to 1, one number per pixel.

    correction  direction of the lookup: Lp from the proxy "box", or L itself ("none").
    penumbra    level of the lookup: 0 ("hard"), "linear" in the distance, "normalised" by the room's
                diagonal, "log" from the footprint; "exact": the mean of 64 hard lookups over the sun's disk.
    k           levels a metre, for "linear".
    """
    surface, sun = view.surface, view.sun
    p, n, l = surface.position, surface.normal, sun.direction
    if penumbra == "exact":
        lit = sun_mean(sun, n, lambda w: open_share(shadows, p, w, correction, 0.0), dr.zeros(mi.Float))
    else:
        level = lod(shadows, p, sun, penumbra, k)
        lit = dr.select(dr.dot(n, l) > 0, open_share(shadows, p, l, correction, level), 0)
    return dr.select(surface.valid, lit, 1)


def lod(shadows: ShadowCube, p: mi.Point3f, sun, penumbra: str, k: float) -> mi.Float:
    """Level of detail of the lookup."""
    lp, dist = shadows.corrected(p, sun.direction)
    if penumbra == "linear":
        return k * dist
    if penumbra == "normalised":
        return dist / dr.norm(shadows.high - shadows.low) * shadows.cube.levels
    if penumbra == "log":
        return shadows.footprint_level(lp, dist * dr.tan(mi.Float(sun.angular_radius)))
    return mi.Float(0)


def open_share(shadows: ShadowCube, p: mi.Point3f, w: mi.Vector3f, correction: str, level) -> mi.Float:
    """1 - alpha."""
    towards = shadows.corrected(p, w)[0] if correction == "box" else mi.Vector3f(w)
    return 1 - lookup(shadows.cube, towards, level)


@cubemap_shadows.bake
def bake(
    view: View,
    *,
    face: Annotated[int, Sweep(8, 32, 128, low=2, high=2048)] = 512,
    proxy: Literal["given", "exact"] = "given",
    storage: Literal["8 bit", "exact"] = "8 bit",
) -> ShadowCube:
    """Opacity from the middle C of the room.

    face     texels along a side, a power of two.
    proxy    the room's box as given, or "exact": the box round all that C sees, whose sides are the walls.
    storage  of alpha and its mips: "8 bit", or "exact": float32.
    """
    low, high = view.bounds
    centre = 0.5 * (low + high)
    w, t = sees(view.trace, centre, face)
    box = walls_box(centre, w, t) if proxy == "exact" else (low, high)
    alpha = dr.select(dr.isfinite(t), mi.Float(1), 0)
    return shadow_cube(alpha, centre, box, steps=BYTE if storage == "8 bit" else None)


@cubemap_shadows.domain
def domain(scene: Scene) -> Domain:
    """Rooms whose walls are near their box, with nothing that casts shadows inside (1.9)."""
    if isinstance(scene, PillarRoom):
        return Domain(False, "the pillar stands away from the walls")
    if scene.wall_inset > 0.3:
        return Domain(False, "a wall stands far from the box")
    if scene.sun_radius > 5:
        return Domain(False, "the penumbra is wider than a few texels of a coarse level tell")
    return Domain(True)
