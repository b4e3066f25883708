r"""Irradiance in spherical harmonics: what an ambient cube is held against.

The clamped cosine is smooth, so that few bands of an environment decide its irradiance (Ramamoorthi and
Hanrahan 2001):

    L_lm = int L(w) Y_lm(w) dw,   E(n) = sum_l A_l sum_m L_lm Y_lm(n),   A = pi, 2 pi / 3, pi / 4, 0.

Three bands are nine colours, where the ambient cube has six; two are four. It does not depend on how the
axes lie. Where few bands make light negative it is taken as 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi

from approximations.contract import ANGULAR_DETAIL, Sweep, exact_when, technique
from approximations.kit.spherical_harmonics import evaluate, irradiance, project
from scenes.contract import RADIANCE, View
from scenes.environment_ball import EnvironmentBall


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
    surface, sky = view.surface, view.environment(view.camera.direction)
    arriving = dr.maximum(evaluate(harmonics.colours, surface.normal), 0)
    return dr.select(surface.valid, surface.albedo * dr.inv_pi * arriving, sky)


@sh_irradiance.bake
def bake(view: View, *, bands: Annotated[int, Sweep(1, 2, low=1, high=4)] = 3) -> Harmonics:
    """Project the environment on `bands` bands; the fourth is 0."""
    return Harmonics(irradiance(project(view.environment, bands)))
