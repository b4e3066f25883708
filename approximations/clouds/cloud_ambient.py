r"""Light of the sky and the ground in a cloud, from a height or from two vertical depths.

GPU Pro 7, chapter II.4, section 4.4.6, gives a cloud no light but the sun's, although its pictures have lit
shadow sides. What users of the method add to the source function is one of these, the same in all directions:

    S = c (L_ground + h (L_sky - L_ground)),  c = 1/2, h = height in the layer as a share   "height"
    S = (L_sky E2(k tau_up) + L_ground E2(k tau_down)) / 2                                  "plane"
    E2(t) = int_0^1 e^(-t/m) dm

tau_up and tau_down are the optical depths straight up and down to where the cloud ends. "plane" is light that
is scattered once and evenly, in a layer that goes on for ever to all sides: exact, for k = 1, for g = 0 and
that layer, but for all further orders. A sky that is even comes out too dark: with L on all sides and no
absorption every order together gives S = L everywhere, while "plane" gives L only at an edge of no depth and
"height" c L. Hence k (`depth`): with "similar" k = 1 - g, the depth that counts once light that is scattered
forwards is taken as not scattered at all (van de Hulst's similarity), closer to the truth deep inside.

L_sky and L_ground are the radiances from straight up and straight down. Rain multiplies both depths.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    LINEAR_IN_LIGHT,
    MULTIPLE_SCATTERING,
    NO_MODEL,
    PHASE_FUNCTION,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    technique,
)
from approximations.kit.cloud_march import light_depth
from scenes.contract import SOURCE_FUNCTION, Scene, View
from scenes.cumulus_sky import CumulusUnderSky

COSINES = 32  # of the directions over which E2 is summed


@technique(
    source="GPU Pro 7, II.4, sec. 4.4.6, and what is added to it in use",
    covers=("cloudscapes/13",),
    estimates=SOURCE_FUNCTION,
    on=(CumulusUnderSky,),
    replaces="the light of sky and ground that a point in a cloud scatters towards the eye",
    neglects=(MULTIPLE_SCATTERING, PHASE_FUNCTION, SPATIAL_DETAIL, NO_MODEL),
    claims=(LINEAR_IN_LIGHT,),
    stress={"CumulusUnderSky": ("optical_depth",)},
)
def cloud_ambient(
    view: View,
    *,
    model: Literal["height", "plane"] = "height",
    share: Annotated[float, Sweep(0.5, 1.0, low=0.0, high=1.0)] = 0.5,
    depth: Literal["own", "similar"] = "own",
    steps: Annotated[int, Sweep(4, 16, low=1, high=1024)] = 16,
) -> mi.Color3f:
    """Source function (W m^-2 sr^-1) of the sky's light at the probes, the camera's origins.

    model  of the list above.
    share  c, of "height".
    depth  of "plane": the cloud's own, or that of the similar cloud which scatters evenly.
    steps  samples of each of the two vertical marches of "plane".
    """
    cloud, x = view.cloud, mi.Point3f(view.camera.origin)
    up = mi.Vector3f(0, 0, 1)
    sky, ground = view.environment(up), view.environment(-up)
    if model == "height":
        h = dr.clip((x.z - cloud.model.base) / (cloud.model.top - cloud.model.base), 0, 1)
        return share * dr.lerp(ground, sky, h)
    k = cloud.precipitation * (1 - cloud.g if depth == "similar" else 1)
    above, below = (_e2(k * light_depth(view, x, steps, towards=w)) for w in (up, -up))
    return 0.5 * (sky * above + ground * below)


@cloud_ambient.domain
def domain(scene: Scene) -> Domain:
    """Clouds thick enough to shade themselves, in the light of the sky."""
    if scene.lit_by != "sky":
        return Domain(False, "sunlight, which the term is added to and does not hold")
    return Domain(True)


def _e2(t: mi.Float) -> mi.Float:
    """int_0^1 e^(-t/m) dm at optical depths t >= 0, by COSINES samples m = u^2 amid even steps of u."""

    def add(i, total):
        u = (mi.Float(i) + 0.5) / COSINES
        return i + 1, total + 2 * u * dr.exp(-t / (u * u))

    start = (mi.UInt32(0), dr.zeros(mi.Float, dr.width(t)))
    _, total = dr.while_loop(start, lambda i, total: i < COSINES, add)
    return total / COSINES
