"""A floor under one area light: where area-light techniques are tried.

The camera is parallel and sheared, so that its pixels are an even grid on a square of the floor whatever the
elevation of the view, and it starts just above the floor, so that the light never hides what it lights.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import DIRECT_RADIANCE, AreaLight, Axis, Scene, View, scene
from scenes.mitsuba_parts import area_light, camera_rays, diffuse, film, g_buffer, glossy

HALF = 2.0  # m, half the side of the square of floor that is seen
LIFT = 0.002  # m, from the floor to where camera rays start, along them

# fmt: off
PATTERN = (
    "................",
    "..rrrrrrrrrrrr..",
    "..rrrrrrrrrrrr..",
    "..rr............",
    "..rr......bb....",
    "..rr......bb....",
    "..rr............",
    "..ggggggggg.....",
    "..ggggggggg.....",
    "..gg............",
    "..gg........w...",
    "..gg.......www..",
    "..gg........w...",
    "..gg............",
    "..gg............",
    "................",
)
# fmt: on
COLOURS = {".": (0.1, 0.1, 0.1), "r": (2, 0.4, 0.2), "g": (0.3, 1.6, 0.3), "b": (0.2, 0.4, 4), "w": (4, 4, 4)}


def pattern() -> np.ndarray:
    """Factors on the light's radiance, (16, 16, 3), row 0 at t = 1: an F with a dot and a star."""
    return np.array([[COLOURS[c] for c in row] for row in PATTERN], np.float64)


@dataclass(frozen=True)
class LitFloor(Scene):
    """A floor at z = 0 and one light of half extent `size`, whose middle is `height` above it.

    disk, rectangle, textured: face the floor at tilt 0, the camera's side (-y) at 90 degrees, then upwards
    tube: lies level at tilt 0 and stands at 90 degrees; a sixth as thick as long
    Where a light dips below the floor, its lower part lights nothing, and the floor inside it is black.
    """

    shape: Literal["sphere", "disk", "rectangle", "tube", "textured"] = "rectangle"
    size: Annotated[float, Axis(0.02, 20, log=True, unit="m")] = 0.6
    height: Annotated[float, Axis(0.01, 4, log=True, unit="m")] = 0.9
    tilt: Annotated[float, Axis(0, 130, unit="deg")] = 20.0
    albedo: Annotated[float, Axis(0, 0.5)] = 0.3
    radiance: Annotated[float, Axis(0.1, 100, log=True, unit="W/m^2/sr")] = 3.0

    AT = (0.2, 0.7)  # m, the middle of the light over the floor
    TURN = math.radians(25.0)  # of the light about the vertical

    def light(self) -> AreaLight:
        """The light without its texture."""
        t = math.radians(self.tilt)
        across = np.array([math.cos(self.TURN), math.sin(self.TURN), 0.0])
        ahead = np.array([-math.sin(self.TURN), math.cos(self.TURN), 0.0])
        up = np.array([0.0, 0.0, 1.0])
        u, v = self.size * across, self.size * (math.sin(t) * up - math.cos(t) * ahead)
        if self.shape in ("rectangle", "textured"):
            v = 0.5 * v
        if self.shape == "tube":
            u, v = self.size * (math.cos(t) * across + math.sin(t) * up), self.size / 6 * ahead
        shape = "rectangle" if self.shape == "textured" else self.shape
        return AreaLight(shape, np.array([*self.AT, self.height]), u, v, self.radiance)

    def reflection(self) -> dict:
        """The floor's BSDF."""
        return diffuse(self.albedo)

    def surfaces(self) -> dict:
        floor = {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(200)}
        return {"floor": {**floor, "bsdf": self.reflection()}}

    def elevation(self) -> float:
        """Of the camera above the floor, degrees."""
        return 90.0

    def sensor(self, size: int) -> dict:
        """The camera: x to the right, y away from it."""
        e = math.radians(self.elevation())
        forward = np.array([0.0, math.cos(e), -math.sin(e)])
        columns = [[-HALF, 0, 0], [0, HALF, 0], forward, -LIFT * forward]
        to_world = np.vstack([np.column_stack(columns), [0, 0, 0, 1]])
        return {
            "type": "orthographic",
            "near_clip": 0.5 * LIFT,
            "far_clip": 1e3,
            "to_world": mi.ScalarTransform4f(to_world),
            "film": film(size),
        }

    def mitsuba(self, size: int = 128) -> dict:
        texture = pattern() if self.shape == "textured" else None
        light = area_light(self.light(), texture)
        return {"type": "scene", **self.surfaces(), "light": light, "sensor": self.sensor(size)}

    def view(self, size: int = 128) -> View:
        surfaces = mi.load_dict({"type": "scene", **self.surfaces()}, optimize=False)
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        hit, light = g_buffer(surfaces, camera), self.light()
        hit = dataclasses.replace(
            hit, valid=hit.valid & ~_inside(light, hit.position), albedo=mi.Color3f(self.albedo)
        )
        c, u, v = (mi.Vector3f(x) for x in (light.centre, light.u, light.v))
        texture = _lookup(pattern()) if self.shape == "textured" else None
        light = AreaLight(light.shape, mi.Point3f(c), u, v, light.radiance, texture)
        return View(size, size, camera, surface=hit, lights=(light,))


@scene(
    theme="area_lights",
    shows="a light of any size and shape over a floor that reflects it",
    quantities=(DIRECT_RADIANCE,),
    exposure=(-3.0, 1.0),
)
@dataclass(frozen=True)
class AreaLitPlane(LitFloor):
    """A floor of diffuse `albedo` and `specular` times GGX of width roughness^2, a mirror at 0, seen by a
    parallel camera from `view_elevation`."""

    roughness: Annotated[float, Axis(0, 1)] = 0.4
    view_elevation: Annotated[float, Axis(1, 90, unit="deg")] = 40.0
    specular: Annotated[float, Axis(0, 0.5)] = 0.3
    albedo: Annotated[float, Axis(0, 0.5)] = 0.1

    def reflection(self) -> dict:
        return glossy(self.albedo, self.specular, self.roughness**2)

    def elevation(self) -> float:
        return self.view_elevation

    def view(self, size: int = 128) -> View:
        seen = super().view(size)
        gloss = {"specular": mi.Float(self.specular), "alpha": mi.Float(self.roughness**2)}
        return dataclasses.replace(seen, surface=dataclasses.replace(seen.surface, **gloss))


@scene(
    theme="area_lights",
    shows="a ball or a tube of light over a floor that reflects it",
    quantities=(DIRECT_RADIANCE,),
    exposure=(-3.0, 1.0),
)
@dataclass(frozen=True)
class RoundLitPlane(AreaLitPlane):
    """The same floor under a light without corners, of half extent `size`."""

    shape: Literal["sphere", "tube"] = "sphere"
    size: Annotated[float, Axis(0.02, 0.85, log=True, unit="m")] = 0.4


@scene(
    theme="area_lights",
    shows="a picture that glows, over a floor that reflects it",
    quantities=(DIRECT_RADIANCE,),
    exposure=(-3.0, 1.0),
)
@dataclass(frozen=True)
class PictureLitPlane(AreaLitPlane):
    """The same floor under a rectangle with a coloured picture on it."""

    shape: Literal["textured"] = "textured"
    radiance: Annotated[float, Axis(0.1, 100, log=True, unit="W/m^2/sr")] = 6.0


@scene(
    theme="area_lights",
    shows="the irradiance of a light of any size and shape",
    quantities=(DIRECT_RADIANCE,),
    exposure=(-3.0, 1.0),
)
@dataclass(frozen=True)
class DiffuseAreaLitPlane(LitFloor):
    """A diffuse floor seen from above."""

    shape: Literal["sphere", "disk", "rectangle"] = "rectangle"
    albedo: Annotated[float, Axis(0, 1)] = 0.5


def _inside(light: AreaLight, p: mi.Point3f) -> mi.Bool:
    """Points inside a sphere or a tube."""
    d = mi.Vector3f(p) - mi.Vector3f(light.centre)
    if light.shape == "sphere":
        return dr.squared_norm(d) < float(light.u @ light.u)
    if light.shape == "tube":
        u = mi.Vector3f(light.u)
        along = dr.dot(d, u) / dr.squared_norm(u)
        return (dr.abs(along) < 1) & (dr.squared_norm(d - along * u) < float(light.v @ light.v))
    return mi.Bool(False)


def _lookup(texels: np.ndarray):
    """Bilinear lookup at (s, t), clamped at the edges."""
    tensor = mi.TensorXf(np.ascontiguousarray(texels[::-1], np.float32))
    texture = mi.Texture2f(tensor, use_accel=False, wrap_mode=dr.WrapMode.Clamp)
    return lambda st: mi.Color3f(texture.eval(st))
