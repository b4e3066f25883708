"""Constant ambient: the baseline that occlusion techniques are held against.

The sun as if it were a point and nothing hid it, and the whole sky from everywhere:
L = albedo / pi (E_sun max(n . l, 0) + pi L_sky).
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from approximations.contract import INTERREFLECTION, LINEAR_IN_LIGHT, OCCLUSION, technique
from scenes.contract import DIRECT_RADIANCE, RADIANCE, View
from scenes.sunlit import SphereOverPlane, Valley
from scenes.terrain import Canyon, Foliage, Terrain


@technique(
    source="baseline of SIGGRAPH 2006 Course 26, ch. 8.4.4",
    estimates=RADIANCE,
    also=(DIRECT_RADIANCE,),
    on=(SphereOverPlane, Valley, Terrain, Canyon, Foliage),
    replaces="visibility times direct light of a round sun and a uniform sky",
    neglects=(OCCLUSION, INTERREFLECTION),
    claims=(LINEAR_IN_LIGHT,),
    baseline=True,
)
def constant_ambient(view: View) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel."""
    surface, sun = view.surface, view.sun
    irradiance = sun.irradiance * dr.maximum(dr.dot(surface.normal, sun.direction), 0) + dr.pi * view.sky
    return dr.select(surface.valid, surface.albedo * dr.inv_pi * irradiance, view.sky)
