"""An area light as a point light at its centre: Lambert and GGX towards one direction, inverse square.

With w the unit way to the centre, r the distance and A the area that the light shows along w,

    L_o = (albedo / pi n.w + specular f n.w) L A / r^2.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    HORIZON_CLIPPING,
    LINEAR_IN_LIGHT,
    REPRESENTATIVE_POINT,
    exact_when,
    technique,
)
from approximations.kit.ggx_cosine import ggx_cosine
from approximations.kit.light_shapes import projected_area
from scenes.area_lit import AreaLitPlane, DiffuseAreaLitPlane, RoundLitPlane
from scenes.contract import DIRECT_RADIANCE, View

SMOOTHEST = 1e-3  # alpha of the highlight of a mirror


@technique(
    source="point lights, the least that any renderer has",
    estimates=DIRECT_RADIANCE,
    on=(AreaLitPlane, RoundLitPlane, DiffuseAreaLitPlane),
    replaces="integral of reflected light over an area light",
    neglects=(REPRESENTATIVE_POINT, HORIZON_CLIPPING),
    claims=(LINEAR_IN_LIGHT, exact_when("DiffuseAreaLitPlane", 0.001, fields={"size": 0.02})),
    stress={"AreaLitPlane": ("size",)},
    baseline=True,
)
def centre_point(view: View) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel. The picture of a light counts as
    its value in the middle."""
    surface = view.surface
    n, v = surface.normal, -view.camera.direction
    total = dr.zeros(mi.Color3f, dr.width(surface.position))
    for light in view.lights:
        to = mi.Vector3f(light.centre) - mi.Vector3f(surface.position)
        w = dr.normalize(to)
        reflected = surface.albedo * dr.inv_pi * dr.maximum(dr.dot(n, w), 0)
        if surface.specular is not None:
            alpha = dr.maximum(surface.alpha, SMOOTHEST)
            reflected += surface.specular * ggx_cosine(n, v, w, alpha)
        colour = light.radiance * (light.texture(mi.Point2f(0.5)) if light.texture else mi.Color3f(1))
        total += colour * reflected * projected_area(light, w) / dr.squared_norm(to)
    return dr.select(surface.valid, total, 0)
