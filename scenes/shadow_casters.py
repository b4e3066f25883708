"""Casters between one area light and the ground: where shadow maps and their filters are tried."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import mitsuba as mi
import numpy as np

from scenes.contract import DIRECT_RADIANCE, LIGHT_VISIBILITY, AreaLight, Axis, Scene, View, scene
from scenes.mitsuba_parts import (
    area_light,
    camera_rays,
    diffuse,
    direction,
    g_buffer,
    orthographic,
    perspective,
    ray_caster,
    ray_tracer,
)


@dataclass(frozen=True)
class ShadowCasters(Scene):
    """One light of half size `light_size` (m), a square or a disk, above diffuse surfaces of one albedo."""

    light_size: Annotated[float, Axis(0.02, 3, log=True, unit="m")] = 0.5
    light_shape: Literal["rectangle", "disk"] = "rectangle"
    albedo: Annotated[float, Axis(0, 0.9)] = 0.5
    radiance: Annotated[float, Axis(0, 1000, unit="W/m^2/sr")] = 300.0

    def sensor(self, size: int) -> dict:
        """The camera."""
        raise NotImplementedError

    def light(self) -> AreaLight:
        """The one light, in plain numbers."""
        raise NotImplementedError

    def mitsuba(self, size: int = 128) -> dict:
        return {
            "type": "scene",
            **self.surfaces(),
            "light": area_light(self.light()),
            "sensor": self.sensor(size),
        }

    def view(self, size: int = 128) -> View:
        surfaces = mi.load_dict({"type": "scene", **self.surfaces()}, optimize=False)
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        light = self.light()
        return View(
            size,
            size,
            camera,
            surface=g_buffer(surfaces, camera),
            lights=(
                AreaLight(
                    light.shape,
                    mi.Point3f(light.centre),
                    mi.Vector3f(light.u),
                    mi.Vector3f(light.v),
                    light.radiance,
                ),
            ),
            visible=ray_caster(surfaces),
            trace=ray_tracer(surfaces),
        )

    def box(self, centre: tuple[float, float, float], half: tuple[float, float, float]) -> dict:
        """An upright box of the scene's albedo; half edges in m."""
        to_world = mi.ScalarTransform4f().translate(centre).scale(half)
        return {"type": "cube", "to_world": to_world, "bsdf": diffuse(self.albedo)}


@scene(
    theme="shadows",
    shows="a pole, a fence and a ball, whose shadows are sharp at the contact and soft far from it",
    quantities=(LIGHT_VISIBILITY, DIRECT_RADIANCE),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class PoleAndBars(ShadowCasters):
    """Casters up to 2 m high whose lowest points hang `gap` above a plane of 12 m. The light stands 8 m from
    the middle of the plane and faces it."""

    light_elevation: Annotated[float, Axis(15, 85, unit="deg")] = 50.0
    light_azimuth: Annotated[float, Axis(0, 360, unit="deg")] = 200.0
    gap: Annotated[float, Axis(0, 1, unit="m")] = 0.0

    DISTANCE = 8.0  # m
    BARS = 5

    def light(self) -> AreaLight:
        toward = np.array(direction(self.light_elevation, self.light_azimuth))
        along = np.cross([0.0, 0.0, 1.0], toward)
        u = self.light_size * along / np.linalg.norm(along)
        return AreaLight(self.light_shape, self.DISTANCE * toward, u, np.cross(u, toward), self.radiance)

    def surfaces(self) -> dict:
        fence = {
            f"bar_{i}": self.box((0.3 * i - 0.9, -0.6, 0.5 + self.gap), (0.04, 0.04, 0.5))
            for i in range(self.BARS)
        } | {
            f"rail_{i}": self.box((-0.3, -0.6, z + self.gap), (0.64, 0.02, 0.04))
            for i, z in enumerate((0.3, 0.9))
        }
        return {
            "plane": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale(6),
                "bsdf": diffuse(self.albedo),
            },
            "pole": self.box((-0.9, 0.6, 1.0 + self.gap), (0.05, 0.05, 1.0)),
            "ball": {
                "type": "sphere",
                "center": [0.9, 0.3, 0.4 + self.gap],
                "radius": 0.4,
                "bsdf": diffuse(self.albedo),
            },
            **fence,
        }

    def sensor(self, size: int) -> dict:
        return perspective([0.5, -4.5, 5.5], [0.4, 0.2, 0.3], 32, size)


@scene(
    theme="shadows",
    shows="the straight edge of a wide sheet over a plane, whose penumbra has a closed form",
    quantities=(LIGHT_VISIBILITY,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class HalfPlane(ShadowCasters):
    """A horizontal sheet `height` above the plane z = 0 that ends at x = 0, under a horizontal light 4 m
    above the plane whose middle is over the edge.

    The penumbra is light_size height / (LIGHT - height) wide to each side of x = 0.
    """

    height: Annotated[float, Axis(0.02, 2, log=True, unit="m")] = 1.0

    LIGHT = 4.0  # m above the plane
    REACH = 100.0  # m, of sheet and plane

    def light(self) -> AreaLight:
        u, v = np.array([0.0, self.light_size, 0.0]), np.array([self.light_size, 0.0, 0.0])
        return AreaLight(self.light_shape, np.array([0.0, 0.0, self.LIGHT]), u, v, self.radiance)

    def surfaces(self) -> dict:
        sheet = mi.ScalarTransform4f().translate([-self.REACH, 0, self.height]).scale(self.REACH)
        return {
            "plane": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale(self.REACH),
                "bsdf": diffuse(self.albedo),
            },
            "sheet": {"type": "rectangle", "to_world": sheet, "bsdf": diffuse(self.albedo)},
        }

    def sensor(self, size: int) -> dict:
        a = math.radians(40)
        return orthographic([20 * math.cos(a), 0, 20 * math.sin(a)], [0, 0, 0], 1.0, size)
