r"""Coloured light through stained glass, from a shadow cube that holds colours beside the opacity.

GPU Pro 7, part IV, chapter 1, section 1.5. The cube of `cubemap_shadows` has four channels; what the light
loses in a pane is read by the same lookup as the shadow:

    T = (1 - alpha(Lp, lod)) c(Lp, lod)          "straight": alpha and the colour c of what C sees
    T = tau(Lp, lod)                             "premultiplied": c (1 - alpha) is what is stored

Light through a window is the mean of tau over the disk that the light covers on it, so that tau is what may
be averaged. The product of two means is not the mean of the product: at a pane's edge the straight rule takes
the wall's colour into the light,

    T - tau = t (1 - t) (c_wall - c_pane),       t the share of the wall in a texel.

In print, and what was done here:
- No formula joins colour and alpha: `stored` has both readings, of which the first is the one described.
- That the colours have to be linear before mips are made is not said; `averaged` "encoded" makes the mips of
  values to the power of 1 / 2.2.
- The same channels are to hold reflections, which are radiance and no transmittance; that is left out.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    FILTERED_PARAMETERS,
    PENUMBRA_WIDTH,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    at_most,
    exact_when,
    technique,
)
from approximations.kit.shadow_cube import BYTE, ShadowCube, sees, shadow_cube, sun_mean
from scenes.contract import LIGHT_VISIBILITY, Scene, View
from scenes.window_room import StainedRoom

GAMMA = 2.2


@technique(
    source="GPU Pro 7, part IV, ch. 1.5",
    covers=("cubemap-shadows/04",),
    estimates=LIGHT_VISIBILITY,
    on=(StainedRoom,),
    replaces="share of each colour of the sun that a point sees through coloured panes",
    neglects=(PENUMBRA_WIDTH, FILTERED_PARAMETERS, SPATIAL_DETAIL),
    claims=(
        at_most(1),
        exact_when("StainedRoom", 0.01, knobs={"penumbra": "exact", "stored": "premultiplied"}),
    ),
    stress={"StainedRoom": ("sun_radius",)},
)
def tinted_cubemap_shadows(
    view: View,
    maps: tuple[ShadowCube, ...],
    *,
    penumbra: Literal["linear", "log", "exact"] = "linear",
    k: Annotated[float, Sweep(0.5, 2.0, low=0, high=20)] = 1.0,
) -> mi.Color3f:
    """Share of each colour of the sun that is seen, 0 to 1, one colour per pixel.

    penumbra  level of the lookup: "linear" in the distance, "log" from the footprint, or "exact": the mean of
              64 lookups of level 0 over the sun's disk.
    k         levels a metre, for "linear".
    """
    surface, sun, first = view.surface, view.sun, maps[0]
    p, n, l = surface.position, surface.normal, sun.direction
    if penumbra == "exact":
        lit = sun_mean(sun, n, lambda w: product(maps, p, w, 0.0), dr.zeros(mi.Color3f, dr.width(p)))
    else:
        lp, dist = first.corrected(p, l)
        reach = dist * dr.tan(mi.Float(sun.angular_radius))
        level = k * dist if penumbra == "linear" else first.footprint_level(lp, reach)
        lit = dr.select(dr.dot(n, l) > 0, product(maps, p, l, level), 0)
    return dr.select(surface.valid, lit, 1)


def product(maps: tuple[ShadowCube, ...], p: mi.Point3f, w: mi.Vector3f, level) -> mi.Color3f:
    """T: what is stored, or its two parts multiplied."""
    read = [m.read(p, w, level) for m in maps]
    return read[0] if len(read) == 1 else read[0] * (1 - read[1])


@tinted_cubemap_shadows.bake
def bake(
    view: View,
    *,
    stored: Literal["straight", "premultiplied"] = "straight",
    averaged: Literal["linear", "encoded"] = "linear",
    face: Annotated[int, Sweep(32, 128, low=2, high=2048)] = 512,
) -> tuple[ShadowCube, ...]:
    """Four channels of 8 bits from the middle C of the room.

    stored    colour and alpha apart ("straight"), where walls have the mean colour that the camera sees of
              them, or the transmittance tau ("premultiplied").
    averaged  mips of "linear" values, or of values "encoded" by a power.
    face      texels along a side, a power of two.
    """
    low, high = view.bounds
    centre = 0.5 * (low + high)
    w, t = sees(view.trace, centre, face)
    alpha = dr.select(dr.isfinite(t), mi.Float(1), 0)
    tau = view.transmittance(centre, w)
    if stored == "straight":
        wall = dr.sum(view.surface.albedo, axis=1) / mi.Float(dr.count(view.surface.valid))
        tau = dr.select(dr.isfinite(t), mi.Color3f(wall), tau)
    code = 1 / GAMMA if averaged == "encoded" else 1.0
    coloured = shadow_cube(dr.power(tau, code), centre, (low, high), steps=BYTE, power=1 / code)
    if stored == "premultiplied":
        return (coloured,)
    return coloured, shadow_cube(alpha, centre, (low, high), steps=BYTE)


@tinted_cubemap_shadows.domain
def domain(scene: Scene) -> Domain:
    """Rooms whose windows are in the walls of the proxy (1.4)."""
    if scene.wall_inset > 0.3:
        return Domain(False, "a wall stands far from the box")
    return Domain(True)
