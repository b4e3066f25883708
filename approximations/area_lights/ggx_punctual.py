r"""Point lights on glossy surfaces by GGX, as a deferred renderer on a phone evaluates it.

GPU Pro 7, IV.2.3.3. The source names the GGX paper (Walter et al. 2007) and no formula; it stands here as
engines of that time write it, on what its packed buffers hold. h is halfway between l and v.

    material   normals and roughness in 8 bits a number
    width      a = roughness^2
    D          a^2 / (pi ((n.h)^2 (a^2 - 1) + 1)^2)
    G          G1(n.l) G1(n.v), G1(c) = 2 / (1 + sqrt(1 + a^2 (1 / c^2 - 1)))                       (Smith)
    F          F0 + (1 - F0) (1 - v.h)^5                                                         (Schlick)
    light      L += (albedo / pi + D G F / (4 n.l n.v)) n.l I / r^2
    buffer     each light is added to a sum in rgb10: 0 to 1 in steps of 1/1023

Ambiguous or wrong:
- a may be the roughness itself (`width`).
- G is not named: Walter's paper has the separable product of Smith's G1; `masking` offers Smith's correlated
  form, Schlick's without roots, and none (G = 1: the quotient then blows up at the edge).
- D as printed subtracts numbers near 1: in half precision little is left of it for a under 0.1, and a divisor
  of 0 for a under 0.013. `sine` writes 1 - (n.h)^2 as |n x h|^2, which keeps its digits until D itself is
  over 65504, for a under 0.0022.
- A roughness of 0 is 0 / 0 in the middle of the highlight: `smoothest` bounds a from below, 0 as printed.
- A buffer that holds no more than 1 cuts highlights off, and what a light adds under half a step is lost.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    FRESNEL,
    NUMBER_FORMAT,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.ggx import (
    correlated,
    dielectric,
    distribution,
    distribution_by_sine,
    schlick,
    schlick_masking,
    separable,
)
from scenes.contract import DIRECT_RADIANCE, Scene, View
from scenes.point_lit import PointLitBall


@technique(
    source="GPU Pro 7, IV.2.3.3",
    covers=("mobile-pbr/07",),
    estimates=DIRECT_RADIANCE,
    on=(PointLitBall,),
    replaces="reflected light of point lights",
    neglects=(NUMBER_FORMAT, FRESNEL),
    claims=(
        exact_when(
            "PointLitBall",
            0.001,
            knobs={"stored": "exact", "distribution": "sine", "fresnel": "exact", "buffer": "exact"},
        ),
    ),
    stress={"PointLitBall": ("roughness", "lights")},
)
def ggx_punctual(
    view: View,
    *,
    stored: Literal["8 bit", "exact"] = "8 bit",
    width: Literal["roughness squared", "roughness"] = "roughness squared",
    smoothest: Annotated[float, Sweep(0.0, 0.002, 0.05, low=0, high=1)] = 0.002,
    distribution: Literal["printed", "sine"] = "printed",
    precision: Literal["single", "half"] = "single",
    masking: Literal["separable", "correlated", "schlick", "none"] = "separable",
    fresnel: Literal["schlick", "none", "exact"] = "schlick",
    buffer: Literal["rgb10", "exact"] = "rgb10",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    stored        normal and roughness: "8 bit", or "exact".
    width         a: the "roughness" or its square.
    smoothest     least a.
    distribution  D as "printed", or by the "sine" of the angle between n and h.
    precision     of D: "single", or "half" from n.h on.
    masking       G: Smith's "separable" or "correlated", "schlick"'s, or "none".
    fresnel       F: "schlick"'s, "none" (F0), or "exact" for a dielectric.
    buffer        where lights are summed: "rgb10", or "exact".
    """
    surface = view.surface
    n, v = surface.normal, -view.camera.direction
    roughness = dr.sqrt(surface.alpha)
    if stored == "8 bit":
        n = dr.normalize(2 * in_steps(0.5 * n + 0.5, 255) - 1)
        roughness = in_steps(roughness, 255)
    a = dr.maximum(dr.square(roughness) if width == "roughness squared" else roughness, smoothest)
    nv = dr.maximum(dr.dot(n, v), 1e-4)

    def add(i, total):
        to = dr.gather(mi.Vector3f, places, i) - mi.Vector3f(surface.position)
        l = dr.normalize(to)
        h = dr.normalize(l + v)
        vh, nl = dr.dot(v, h), dr.maximum(dr.dot(n, l), 0)
        d = density(n, h, a, distribution, precision)
        g = unmasked(nl, nv, a, masking)
        f = surface.specular if fresnel == "none" else reflectance(surface.specular, vh)
        lobe = d * g * f / (4 * nv)
        lit = (surface.albedo * dr.inv_pi * nl + dr.select(nl > 0, lobe, 0)) / dr.squared_norm(to)
        total += lit * dr.gather(mi.Color3f, powers, i)
        return i + 1, in_steps(dr.minimum(total, 1), 1023) if buffer == "rgb10" else total

    reflectance = dielectric if fresnel == "exact" else schlick
    places, powers = arrays(view)
    start = mi.UInt32(0), dr.zeros(mi.Color3f, dr.width(surface.position))
    total = dr.while_loop(start, lambda i, total: i < len(view.points), add)[1]
    return dr.select(surface.valid, total, 0)


@ggx_punctual.domain
def domain(scene: Scene) -> Domain:
    """Lobes that 8 bits of normal and roughness resolve, and lights that a buffer in steps can hold."""
    if scene.roughness < 0.1:
        return Domain(False, "8 bits of normal and roughness do not resolve so narrow a lobe")
    if scene.lights > 32:
        return Domain(False, "what one light adds is lost in the buffer's steps")
    return Domain(True)


def in_steps(x: mi.Vector3f | mi.Float, steps: int):
    """The nearest multiple of 1 / steps."""
    return dr.round(x * steps) / steps


def density(n: mi.Vector3f, h: mi.Vector3f, a: mi.Float, form: str, precision: str) -> mi.Float:
    """D (1/sr)."""
    if precision == "half":
        half, vector = dr.float16_array_t(mi.Float), dr.float16_array_t(mi.Vector3f)
        n, h, a = vector(n), vector(h), half(a)
    if form == "sine":
        return mi.Float(distribution_by_sine(n, h, a))
    return mi.Float(distribution(dr.dot(n, h), a))


def unmasked(nl: mi.Float, nv: mi.Float, a: mi.Float, form: str) -> mi.Float:
    """G, the share of the surface that both light and eye see."""
    if form == "none":
        return mi.Float(1)
    if form == "correlated":
        return correlated(nl, nv, a)
    return separable(nl, nv, a) if form == "separable" else schlick_masking(nl, nv, a)


def arrays(view: View) -> tuple[mi.Vector3f, mi.Color3f]:
    """Positions and intensities of the lights."""
    places = [mi.Vector3f(p.position) for p in view.points]
    powers = [mi.Color3f(p.intensity) for p in view.points]
    return tuple(
        kind(*(dr.concat([x[k] for x in each]) for k in range(3)))
        for kind, each in ((mi.Vector3f, places), (mi.Color3f, powers))
    )
