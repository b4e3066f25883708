r"""Ball and tube lights by the point nearest to the mirror direction, and a highlight dimmed to match.

Karis, "Real Shading in Unreal Engine 4" (SIGGRAPH 2013 course), area lights. c0 and c1 are the ends of a tube
of radius R seen from p (equal for a ball), r the mirror direction, n the normal.

    line       the point c_t = c0 + t (c1 - c0) nearest to the ray along r, t clamped to [0, 1]:
               t = (r.c0 r.e - c0.e) / (e.e - (r.e)^2), e = c1 - c0
    ball       the point of the ball about c_t nearest to the ray: w = normalize(c_t + g min(1, R / |g|)),
               g = (r . c_t) r - c_t
    dimming    D is as wide as before but meets more of the light: its share falls by (alpha / alpha')^2 for
               the radius and alpha / alpha'' for the length,
               alpha' = min(1, alpha + k R / |c_t|), alpha'' = min(1, alpha + k |e| / |c_t|)
    light      a point light of intensity I at w, a tube's spread over its length:
               E_0 = 2 I / (|c0| |c1| + c0 . c1), which is I / d^2 for a ball
               L_o = (albedo / pi cos + specular f n.w (alpha / alpha')^2 alpha / alpha'') E_0
               cos = (n.c0 / |c0| + n.c1 / |c1|) / 2, not under 0

Intensity is what a receiver beside the light sees of it: L pi R^2 and, for a tube, L 2 R |e|.

Ambiguous: k is 1/2 in some accounts and 1/3 in others (`widening`). The dimming holds for a light that fills
the highlight; on a floor that is rough next to the light it darkens what was right (`dimming` "none").
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    COSINE_OVER_LIGHT,
    HORIZON_CLIPPING,
    LINEAR_IN_LIGHT,
    REPRESENTATIVE_POINT,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.ggx_cosine import ggx_cosine
from scenes.area_lit import RoundLitPlane
from scenes.contract import DIRECT_RADIANCE, AreaLight, Scene, View

SMOOTHEST = 1e-3  # alpha of the highlight of a mirror


@technique(
    source="Karis, Real Shading in Unreal Engine 4, SIGGRAPH 2013 course Physically Based Shading",
    estimates=DIRECT_RADIANCE,
    on=(RoundLitPlane,),
    replaces="integral of reflected light over a ball or a tube",
    neglects=(REPRESENTATIVE_POINT, HORIZON_CLIPPING, COSINE_OVER_LIGHT),
    claims=(LINEAR_IN_LIGHT, exact_when("RoundLitPlane", 0.03, fields={"size": 0.02, "roughness": 1.0})),
    stress={"RoundLitPlane": ("roughness", "height")},
    baseline=True,
)
def most_representative_point(
    view: View,
    *,
    widening: Annotated[float, Sweep(1 / 3, 0.5, low=0, high=1)] = 0.5,
    dimming: Literal["widened", "none"] = "widened",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    widening  k, how much the light's extent over its distance adds to alpha.
    dimming   of the highlight: as if its lobe were "widened", or "none".
    """
    surface = view.surface
    n, v = surface.normal, -view.camera.direction
    mirror = 2 * dr.dot(n, v) * n - v
    alpha = dr.maximum(surface.alpha, SMOOTHEST)
    total = dr.zeros(mi.Color3f, dr.width(surface.position))
    for light in view.lights:
        c0, c1, radius, intensity = capsule(light, surface.position)
        on_line = nearest_to_ray(c0, c1, mirror)
        gap = dr.dot(mirror, on_line) * mirror - on_line
        to = on_line + gap * dr.minimum(1, radius * dr.rsqrt(dr.maximum(dr.squared_norm(gap), 1e-12)))
        d0, d1, d = dr.norm(c0), dr.norm(c1), dr.norm(on_line)
        gloss = ggx_cosine(n, v, dr.normalize(to), alpha)
        if dimming == "widened":
            across = alpha / dr.minimum(1, alpha + widening * radius / d)
            along = alpha / dr.minimum(1, alpha + widening * dr.norm(c1 - c0) / d)
            gloss *= across * across * along
        lambert = 0.5 * dr.maximum(dr.dot(n, c0) / d0 + dr.dot(n, c1) / d1, 0)
        facing = 2 * intensity / (d0 * d1 + dr.dot(c0, c1))
        total += facing * (surface.albedo * dr.inv_pi * lambert + surface.specular * gloss)
    return dr.select(surface.valid, total, 0)


@most_representative_point.domain
def domain(scene: Scene) -> Domain:
    """Balls and tubes above the horizon and smaller than their distance."""
    if scene.size > scene.height:
        return Domain(False, "the light is larger than its distance")
    return Domain(True)


def capsule(light: AreaLight, p: mi.Point3f) -> tuple[mi.Vector3f, mi.Vector3f, mi.Float, mi.Color3f]:
    """Ends of the axis seen from p, radius (m), intensity (W/sr)."""
    c, u, v = mi.Vector3f(light.centre) - mi.Vector3f(p), mi.Vector3f(light.u), mi.Vector3f(light.v)
    if light.shape == "sphere":
        radius = dr.norm(u)
        return c, c, radius, mi.Color3f(light.radiance * dr.pi * dr.square(radius))
    radius = dr.norm(v)
    return c - u, c + u, radius, mi.Color3f(light.radiance * 4 * radius * dr.norm(u))


def nearest_to_ray(c0: mi.Vector3f, c1: mi.Vector3f, r: mi.Vector3f) -> mi.Vector3f:
    """The point of the segment from c0 to c1 that is nearest to the ray from the origin along r."""
    e = c1 - c0
    re = dr.dot(r, e)
    across = dr.maximum(dr.squared_norm(e) - dr.square(re), 1e-12)
    t = (dr.dot(r, c0) * re - dr.dot(c0, e)) / across
    return c0 + dr.clip(t, 0, 1) * e
