r"""The reference model of distance-field sky light: rays to the sky.

SIGGRAPH 2006 Course 26, chapter 9.3. With V = 1 where a ray reaches the sky,

    uniform  I = 2 / n sum V(w_i) n . w_i    w_i uniform over the hemisphere about the normal
    cosine   I = 1 / n sum V(w_i)            w_i of density n . w / pi

In print, and what was done here:
- How rays are spread is not said. Here they are random, so that the error falls as 1 / sqrt(n).
- "Sky" may be the whole hemisphere about the normal (ambient occlusion) or the world's upper half alone:
  `sky="upper"`. Over a floor that hides the rest they are the same.
- Rays may go on by reflection; for the share of the sky they end at the first surface.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import INTERREFLECTION, SAMPLING, Domain, Sweep, exact_when, technique
from scenes.contract import SKY_VISIBILITY, Scene, View
from scenes.fields import BallOverFloor, Groove


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 9.3",
    covers=("sdf-sky-light/01",),
    estimates=SKY_VISIBILITY,
    on=(BallOverFloor, Groove),
    replaces="the cosine-weighted share of the sky that a point sees",
    neglects=(SAMPLING, INTERREFLECTION),
    claims=(exact_when("BallOverFloor", 0.01, knobs={"rays": 64}),),
    baseline=True,
)
def ray_cast_sky(view: View, share: mi.Float) -> mi.Float:
    """Share of the sky, 0 to 1, one number per pixel."""
    return dr.select(view.surface.valid, share, 1)


@ray_cast_sky.bake
def bake(
    view: View,
    *,
    rays: Annotated[int, Sweep(4, 16, 64, low=1, high=65536)] = 16,
    density: Literal["cosine", "uniform"] = "cosine",
    sky: Literal["hemisphere", "upper"] = "hemisphere",
) -> mi.Float:
    """rays: for each point; density: of their directions; sky: what shines."""
    p, n = view.surface.position, view.surface.normal
    frame = mi.Frame3f(n)
    random = mi.PCG32(size=view.width * view.height, initstate=1)
    warp = (
        mi.warp.square_to_cosine_hemisphere if density == "cosine" else mi.warp.square_to_uniform_hemisphere
    )

    def cast(i: mi.UInt32, found: mi.Float, random: mi.PCG32) -> tuple[mi.UInt32, mi.Float, mi.PCG32]:
        local = warp(mi.Point2f(random.next_float32(), random.next_float32()))
        w = frame.to_world(local)
        seen = view.visible(p, n, w)
        if sky == "upper":
            seen &= w.z > 0
        value = mi.Float(1) if density == "cosine" else 2 * local.z
        return i + 1, found + dr.select(seen, value, 0), random

    _, found, _ = dr.while_loop(
        (mi.UInt32(0), dr.zeros(mi.Float, dr.width(n)), random), lambda i, found, random: i < rays, cast
    )
    share = found / rays
    dr.eval(share)
    return share


@ray_cast_sky.domain
def domain(scene: Scene) -> Domain:
    """Any scene."""
    return Domain(True)
