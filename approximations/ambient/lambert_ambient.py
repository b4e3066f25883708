r"""Lambert's law with ambient light from a probe: what half Lambert is held against.

    L = albedo / pi (sum I max(n . l, 0) / d^2 + E_probe(n))

E_probe is what walls send to the model's middle, gathered offline without the model: "none" of it, its mean
radiance from all round times pi ("constant"), or an ambient cube.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.ambient.ambient_cube import HALF_AXES, AmbientCube, evaluate_cube, irradiance_map
from approximations.ambient.two_lights_folded import arriving
from approximations.contract import ANGULAR_DETAIL, OCCLUSION, SPATIAL_DETAIL, Sweep, technique
from approximations.kit.cube_map import texel_directions
from scenes.ball_in_room import BallInRoom
from scenes.contract import RADIANCE, View

PROBE = 8
"""Texels along an edge of the cube map in which light is gathered."""


@technique(
    source="baselines of SIGGRAPH 2006 Course 26, ch. 7.4.1 and 7.4.4",
    estimates=RADIANCE,
    on=(BallInRoom,),
    replaces="light that the walls send back",
    neglects=(SPATIAL_DETAIL, ANGULAR_DETAIL, OCCLUSION),
    stress={"BallInRoom": ("room",)},
    baseline=True,
)
def lambert_ambient(view: View, cube: AmbientCube) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel."""
    surface = view.surface
    irradiance = evaluate_cube(cube.colours, surface.normal)
    irradiance += sum(arriving(light, surface.position, surface.normal) for light in view.points)
    return dr.select(surface.valid, surface.albedo * dr.inv_pi * irradiance, 0)


@lambert_ambient.bake
def bake(
    view: View,
    *,
    ambient: Literal["none", "constant", "cube"] = "constant",
    paths: Annotated[int, Sweep(4, low=1, high=4096)] = 64,
) -> AmbientCube:
    """Irradiance from the walls at the model's middle, from `paths` light paths in each of 384 directions."""
    w, solid_angle = texel_directions(PROBE)
    middle, repeat = mi.Point3f(0), np.repeat(np.arange(dr.width(w)), paths).astype(np.uint32)
    one_each = view.gather(middle, dr.gather(mi.Vector3f, w, mi.UInt32(repeat)), 1)
    captured = mi.Color3f(np.array(one_each).reshape(3, -1, paths).mean(axis=2)) * solid_angle
    colours = irradiance_map(captured, w, HALF_AXES)
    if ambient == "constant":
        colours = np.repeat(colours.mean(axis=0, keepdims=True), 6, axis=0)
    cube = AmbientCube([mi.Color3f(*c) * (ambient != "none") for c in colours.tolist()])
    dr.make_opaque(cube.colours)
    return cube
