r"""Phong highlights with a Fresnel rim: what a model's gloss gives back of local lights.

SIGGRAPH 2006 Course 26, section 7.4.5. The highlight of each local light is a power of a cosine, held down
where a surface is seen from the front and let through at the silhouette:

    spec = F(n.v) max(r.v, 0)^e [n.l > 0],   r = 2 (n.l) n - l,   L = I / d^2 / pi spec.

1 / pi is the convention of the time: a light of unit colour gives a white surface the radiance 1. It stands
for a rough dielectric, D G F(v.h) / (4 n.l n.v) n.l.

In print, and what was done here:
- There is no formula. The text asks for low exponents, dim masks, and a Fresnel term that strongly favours
  the rim; (1 - n.v)^2 is the later public material system's, whose ramp with its own defaults is the same. A
  mask is a factor on everything and is left out.
- Nothing is said of energy: as e grows the highlight shrinks and does not get brighter. `norm` offers the
  factors that keep the lobe's integral, (e + 1) / 2, or the light reflected at the front, (e + 2) / 2.
- The exponent is painted by hand, 1 to 150 there; `lobe="fitted"` takes it from the GGX width a,
  e = (1 / a^2 - 1) / 2.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    FRESNEL,
    LINEAR_IN_LIGHT,
    SHAPE_OF_LOBE,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from scenes.contract import RADIANCE, Scene, View
from scenes.lamps import PolishedBall


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 7.4.5",
    covers=("source-shading/07",),
    estimates=RADIANCE,
    on=(PolishedBall,),
    replaces="reflection of point lights by a rough dielectric",
    neglects=(SHAPE_OF_LOBE, FRESNEL),
    claims=(
        LINEAR_IN_LIGHT,
        exact_when("PolishedBall", 1e-3, knobs={"lobe": "exact", "fresnel": "exact"}),
    ),
    stress={"PolishedBall": ("alpha", "lamp_angle")},
)
def phong_rim(
    view: View,
    *,
    lobe: Literal["phong", "fitted", "exact"] = "phong",
    exponent: Annotated[float, Sweep(1, 40, 1000, low=1, high=1000)] = 5.0,
    norm: Literal["none", "lobe", "reflectance"] = "none",
    fresnel: Literal["squared", "schlick", "exact"] = "squared",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    lobe       the power of a cosine with the painted `exponent`, with one "fitted" to the roughness, or
               "exact": GGX with Smith's masking, which has no exponent and needs no `norm`.
    norm       factor on the power: "none", (e + 1) / 2 ("lobe"), (e + 2) / 2 ("reflectance").
    fresnel    (1 - n.v)^2, Schlick's term of n.v from the surface's F0, or "exact": Fresnel's equations at
               the half vector.
    """
    surface, v = view.surface, -view.camera.direction
    n = surface.normal
    nv = dr.clip(dr.dot(n, v), 0, 1)
    e = 0.5 / dr.square(surface.alpha) - 0.5 if lobe == "fitted" else mi.Float(exponent)
    brighter = {"none": 1.0, "lobe": 0.5 * (e + 1), "reflectance": 0.5 * (e + 2)}[norm]
    light = mi.Color3f(0)
    for lamp in view.points:
        toward = lamp.position - surface.position
        far = dr.norm(toward)
        l = toward / far
        nl, h = dr.dot(n, l), dr.normalize(l + v)
        if lobe == "exact":
            local = mi.Frame3f(n).to_local
            ggx = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, surface.alpha)
            m = local(h)
            spec = dr.pi * ggx.eval(m) * ggx.G(local(v), local(l), m) / (4 * nv)
        else:
            r = 2 * nl * n - l
            spec = brighter * dr.power(dr.maximum(dr.dot(r, v), 0), e)
        spec = dr.select((nl > 0) & (nv > 0), spec, 0) * dr.inv_pi / dr.square(far)
        light += lamp.intensity * spec * rim(fresnel, nv, dr.dot(v, h), surface.specular)
    return dr.select(surface.valid, light, 0)


def rim(kind: str, nv: mi.Float, vh: mi.Float, f0: mi.Color3f) -> mi.Color3f:
    """Share of a highlight that is let through."""
    if kind == "exact":
        root = dr.sqrt(f0.x)
        return mi.Color3f(mi.fresnel(vh, (1 + root) / (1 - root))[0])
    if kind == "schlick":
        return dr.lerp(f0, mi.Color3f(1), dr.power(1 - nv, 5))
    return mi.Color3f(dr.square(1 - nv))


@phong_rim.domain
def domain(scene: Scene) -> Domain:
    """Broad highlights (7.4.5 wants low exponents)."""
    if scene.alpha < 0.2:
        return Domain(False, "a surface this smooth has a narrow highlight, for which exponents are too low")
    return Domain(True)
