"""Uniform fog: the baseline that height fog is held against.

The density at the camera's height, everywhere: T = exp(-b exp(-c O_z) |d|), L = T L_surface + (1 - T) C_fog.
It is height fog with c d_z -> 0.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    HEIGHT_PROFILE,
    INSCATTERED_LIGHT,
    INTERREFLECTION,
    LINEAR_IN_LIGHT,
    MEDIUM_SHADOWS,
    MULTIPLE_SCATTERING,
    OCCLUSION,
    technique,
)
from approximations.scattering.height_fog import blend, fogged_length, unfogged_surface
from scenes.contract import RADIANCE, SINGLE_SCATTERING, View
from scenes.fog import FogOverGround


@technique(
    source="baseline of SIGGRAPH 2006 Course 26, ch. 6.4",
    estimates=RADIANCE,
    also=(SINGLE_SCATTERING,),
    on=(FogOverGround,),
    replaces="light scattered by the fog, and the fog's shade on what it holds",
    neglects=(
        HEIGHT_PROFILE,
        INSCATTERED_LIGHT,
        MEDIUM_SHADOWS,
        MULTIPLE_SCATTERING,
        OCCLUSION,
        INTERREFLECTION,
    ),
    claims=(LINEAR_IN_LIGHT,),
    baseline=True,
)
def uniform_fog(view: View) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel."""
    fog = view.fog
    tau = fog.b * dr.exp(-fog.c * view.camera.origin.z) * fogged_length(view)
    return blend(tau, unfogged_surface(view), fog.colour)
