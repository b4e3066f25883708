r"""Sky light from a few coefficients, looked up along the bent normal.

SIGGRAPH 2006 Course 26, chapter 2, section 2.2.

    project  c_lm = int L(w) Y_lm(w) dw                     per frame, L_SH = sum c_lm Y_lm
    bake     b  = normalize(int V w dw),                    the bent normal
             AO = int V max(n . w, 0) dw / pi               the openness
    sky      colour = L_SH(b)                               as printed
    sun      one colour E_sun per frame, shadow mapped: E_sun V_sun max(n . l, 0)
    light    albedo (colour + E_sun V_sun max(n . l, 0) / pi)

In print, and what was done here:
- The sky's colour along b stands for the irradiance over pi: for its mean over the hemisphere, weighted by a
  cosine. Nothing is said of the openness nor of that mean. `ambient` offers the colour as printed, times the
  openness, and times the openness with the mean taken (bands scaled by 1, 2/3, 1/4, 0).
- "Third order" may mean 9 coefficients (the default) or 16: `bands`.
- What the sky is below the horizon is not said; it is mirrored here.
- The shadow map is taken to be perfect: one ray to the sun.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    ANGULAR_DETAIL,
    COSINE_OVER_LIGHT,
    OCCLUSION,
    SHAPE_OF_VISIBILITY,
    Domain,
    Sweep,
    technique,
)
from approximations.kit.spherical_harmonics import evaluate, irradiance, mirrored, project
from approximations.kit.visible_sky import mean_over_visible, visible_sky
from scenes.contract import DIRECT_RADIANCE, Scene, View
from scenes.wall_under_sky import WallUnderSky


@dataclass
class SkyLight:
    """c_lm of the frame; per point the bent normal, the openness, and 2 mean V cos Y_lm for the exact sum."""

    coefficients: list[mi.Color3f]
    bent: mi.Vector3f
    openness: mi.Float
    transfer: list[mi.Float]


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 2.2",
    covers=("sky-video/02",),
    estimates=DIRECT_RADIANCE,
    on=(WallUnderSky,),
    replaces="visibility times light of the sky; the sun's light with its shadow",
    neglects=(OCCLUSION, COSINE_OVER_LIGHT, SHAPE_OF_VISIBILITY, ANGULAR_DETAIL),
    stress={"WallUnderSky": ("gap", "sun_elevation")},
)
def bent_normal_sky(
    view: View,
    light: SkyLight,
    *,
    ambient: Literal["printed", "open", "convolved", "exact"] = "printed",
    shadow: Literal["mapped", "none"] = "mapped",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    ambient  the sky's irradiance over pi: "printed" L_SH(b), "open" times AO, "convolved" AO E_SH(b) / pi, or
             "exact": int V L_SH cos dw / pi from coefficients of V cos that are baked at each point.
    shadow   of the sun: "mapped", or "none".
    """
    surface, sun, b = view.surface, view.sun, light.bent
    if ambient == "exact":
        colour = sum(c * t for c, t in zip(light.coefficients, light.transfer, strict=True))
    elif ambient == "convolved":
        colour = light.openness * dr.inv_pi * evaluate(irradiance(light.coefficients), b)
    else:
        colour = evaluate(light.coefficients, b) * (light.openness if ambient == "open" else 1)
    cosine = dr.maximum(dr.dot(surface.normal, sun.direction), 0)
    if shadow == "mapped":
        lifted = surface.position + 1e-4 * surface.normal
        cosine = dr.select(dr.isinf(view.trace(lifted, sun.direction)), cosine, 0)
    leaving = surface.albedo * (dr.maximum(colour, 0) + dr.inv_pi * sun.irradiance * cosine)
    return dr.select(surface.valid, leaving, view.environment(view.camera.direction))


@bent_normal_sky.bake
def bake(
    view: View,
    *,
    bands: Literal[3, 4] = 3,
    rays: Annotated[int, Sweep(16, 256, low=4, high=65536)] = 64,
) -> SkyLight:
    """Project the sky; cast `rays` over the hemisphere of every point. A bent normal takes 12 bytes."""
    coefficients = project(mirrored(view.environment), bands)
    p, n = view.surface.position, view.surface.normal
    seen = visible_sky(view, p, n, rays)
    transfer = mean_over_visible(
        view, p, n, rays, lambda w: [2 * dr.dot(n, w) * y for y in dr.sh_eval(w, bands - 1)]
    )
    bent = dr.select(seen.share > 0, dr.normalize(seen.direction), n)
    dr.eval(bent, seen.openness, transfer)
    return SkyLight(coefficients, bent, seen.openness, transfer)


@bent_normal_sky.domain
def domain(scene: Scene) -> Domain:
    """Open ground and trees by daylight (2.2)."""
    if scene.gap < 0.1:
        return Domain(False, "beside a wall most of the sky is hidden, which the printed rule leaves out")
    if scene.sun_elevation < 5:
        return Domain(False, "at sunset a narrow glow stands on the horizon, which few bands miss")
    return Domain(True)
