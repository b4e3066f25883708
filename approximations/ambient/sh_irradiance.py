r"""Irradiance in spherical harmonics: what an ambient cube is held against.

The clamped cosine is smooth, so that few bands of an environment decide its irradiance (Ramamoorthi and
Hanrahan 2001):

    L_lm = int L(w) Y_lm(w) dw,   E(n) = sum_l A_l sum_m L_lm Y_lm(n),
    A    = pi, 2 pi / 3, pi / 4, 0, -pi / 24 for l = 0 to 4.

Three bands are nine colours, where the ambient cube has six; two are four. It does not depend on how the
axes lie. Where few bands make light negative it is taken as 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi

from approximations.contract import ANGULAR_DETAIL, Sweep, exact_when, technique
from approximations.kit.cube_map import environment_map, texel_directions
from scenes.contract import RADIANCE, View
from scenes.environment_ball import EnvironmentBall

COSINE = (math.pi, 2 * math.pi / 3, math.pi / 4, 0.0, math.pi / -24)
"""A_l of bands 0 to 4."""
PROBE = 32
"""Texels along an edge of the cube map that is projected."""


@dataclass
class Harmonics:
    """A_l L_lm in the order l^2 + l + m, W m^-2: 108 bytes for three bands as float32."""

    colours: list[mi.Color3f]


@technique(
    source="Ramamoorthi and Hanrahan, An Efficient Representation for Irradiance Environment Maps, 2001",
    estimates=RADIANCE,
    on=(EnvironmentBall,),
    replaces="irradiance of an environment",
    neglects=(ANGULAR_DETAIL,),
    claims=(exact_when("EnvironmentBall", 1e-3, fields={"contrast": 0.0}),),
    stress={"EnvironmentBall": ("sharpness", "turn")},
    baseline=True,
)
def sh_irradiance(view: View, harmonics: Harmonics) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel."""
    irradiance = dr.maximum(evaluate_harmonics(harmonics.colours, view.surface.normal), 0)
    sky = view.environment(view.camera.direction)
    return dr.select(view.surface.valid, view.surface.albedo * dr.inv_pi * irradiance, sky)


def evaluate_harmonics(colours: list[mi.Color3f], n: mi.Vector3f) -> mi.Color3f:
    """The sum over all bands there at unit normals."""
    last_band = round(len(colours) ** 0.5) - 1
    return sum(c * y for c, y in zip(colours, dr.sh_eval(n, last_band), strict=True))


@sh_irradiance.bake
def bake(view: View, *, bands: Annotated[int, Sweep(2, 5, low=1, high=5)] = 3) -> Harmonics:
    """Project an environment captured in a cube map."""
    w, solid_angle = texel_directions(PROBE)
    captured = environment_map(PROBE, view.environment, samples=4) * solid_angle
    cosine = [a for l, a in enumerate(COSINE[:bands]) for _ in range(2 * l + 1)]
    basis = dr.sh_eval(w, bands - 1)
    harmonics = Harmonics([a * dr.sum(captured * y, axis=1) for a, y in zip(cosine, basis, strict=True)])
    dr.make_opaque(harmonics.colours)
    return harmonics
