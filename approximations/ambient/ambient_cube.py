r"""Ambient cube: the irradiance on every normal from six colours.

SIGGRAPH 2006 Course 26, section 7.4.1 and its listing. One colour C_k faces each half axis of the world; a
normal blends the three that it leans to by the squares of its components, which sum to 1:

    E(n) = n_x^2 C[+x or -x] + n_y^2 C[+y or -y] + n_z^2 C[+z or -z].

A constant E is returned exactly, and so is one that is quadratic along the axes. A linear one,
E = a + b . n, becomes a + sum b_k n_k |n_k|: at a diagonal of the axes 0.577 of its slope is left, so that
the answer depends on how the world's axes lie.

In print, and what was done here:
- How the six colours are got is said only as "from a low-resolution irradiance map": `fill` takes E at the
  six axes, or fits all normals by least squares.
- The six are for indirect light; the main lights are added apart (see two_lights_folded).
- The section calls nine SH colours "the first two orders"; nine are three bands (see sh_irradiance).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import ANGULAR_DETAIL, Domain, Sweep, exact_when, technique
from approximations.kit.cube_map import environment_map, texel_directions
from scenes.contract import RADIANCE, Scene, View
from scenes.environment_ball import EnvironmentBall

HALF_AXES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
"""+x, -x, +y, -y, +z, -z: the order of the six colours."""
NORMALS = 8
"""Texels along an edge of the low-resolution irradiance map that is fitted."""


@dataclass
class AmbientCube:
    """Irradiance (W m^-2) on surfaces that face +x, -x, +y, -y, +z, -z: 72 bytes as float32."""

    colours: list[mi.Color3f]


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 7.4.1",
    covers=("source-shading/03",),
    estimates=RADIANCE,
    on=(EnvironmentBall,),
    replaces="irradiance of an environment",
    neglects=(ANGULAR_DETAIL,),
    claims=(
        exact_when("EnvironmentBall", 1e-3, fields={"contrast": 0.0}),
        exact_when("EnvironmentBall", 1e-3, fields={"contrast": 0.0}, knobs={"fill": "least squares"}),
    ),
    stress={"EnvironmentBall": ("sharpness", "turn")},
)
def ambient_cube(view: View, cube: AmbientCube) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel."""
    irradiance = evaluate_cube(cube.colours, view.surface.normal)
    sky = view.environment(view.camera.direction)
    return dr.select(view.surface.valid, view.surface.albedo * dr.inv_pi * irradiance, sky)


def evaluate_cube(colours: list[mi.Color3f], n: mi.Vector3f) -> mi.Color3f:
    """The listing: six colours weighted by the squares of a unit normal."""
    return sum(
        n[axis] * n[axis] * dr.select(n[axis] < 0, colours[2 * axis + 1], colours[2 * axis])
        for axis in range(3)
    )


@ambient_cube.bake
def bake(
    view: View,
    *,
    fill: Literal["axes", "least squares"] = "axes",
    probe: Annotated[int, Sweep(4, 16, low=2, high=64)] = 32,
) -> AmbientCube:
    """The six colours of an environment captured in a cube map.

    fill    E on the six half axes, or the colours that fit E on all normals best.
    probe   texels along an edge of the cube map.
    """
    w, solid_angle = texel_directions(probe)
    captured = environment_map(probe, view.environment, samples=4) * solid_angle
    if fill == "axes":
        colours = irradiance_map(captured, w, HALF_AXES)
    else:
        normals, weight = texel_directions(NORMALS)
        normals = np.array(normals, np.float64).T
        colours = fitted_colours(irradiance_map(captured, w, normals), normals, np.array(weight, np.float64))
    cube = AmbientCube([mi.Color3f(*c) for c in colours.tolist()])
    dr.make_opaque(cube.colours)
    return cube


def irradiance_map(captured: mi.Color3f, w: mi.Vector3f, normals: np.ndarray) -> np.ndarray:
    """E (m, 3) on m normals from radiance times solid angle in directions w."""
    cosine = np.maximum(normals @ np.array(w, np.float64), 0)
    return cosine @ np.array(captured, np.float64).T


def fitted_colours(irradiance: np.ndarray, normals: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The six values (6, c) that fit E (m, c) on unit normals (m, 3), each of that weight, best."""
    halves = np.stack([np.maximum(normals, 0), np.minimum(normals, 0)], axis=2)
    root = np.sqrt(weight)[:, None]
    return np.linalg.lstsq(root * np.square(halves).reshape(-1, 6), root * irradiance, rcond=None)[0]


@ambient_cube.domain
def domain(scene: Scene) -> Domain:
    """Indirect light; what comes from one side in a beam is a main light and added apart (7.4.1)."""
    if scene.sharpness * scene.contrast > 10:
        return Domain(False, "a light this narrow is one of the main lights, which are added apart")
    return Domain(True)
