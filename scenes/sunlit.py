"""Opaque scenes under a round sun and a uniform sky: where ambient and area-light techniques are tried."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import mitsuba as mi

from scenes.contract import DIRECT_RADIANCE, RADIANCE, Axis, Scene, Sun, View, scene
from scenes.mitsuba_parts import (
    camera_rays,
    diffuse,
    direction,
    g_buffer,
    perspective,
    ray_caster,
    ray_tracer,
    round_sun,
    uniform_sky,
)


@dataclass(frozen=True)
class Sunlit(Scene):
    """Diffuse surfaces of one albedo, a sun of irradiance `sun_irradiance`, a sky of radiance `sky`."""

    light_radius: Annotated[float, Axis(0.005, 1.2, log=True, unit="rad")] = 0.27
    light_elevation: Annotated[float, Axis(2, 90, unit="deg")] = 45.0
    light_azimuth: Annotated[float, Axis(0, 360, unit="deg")] = 200.0
    albedo: Annotated[float, Axis(0, 0.9)] = 0.5
    sun_irradiance: Annotated[float, Axis(0, 100, unit="W/m^2")] = math.pi
    sky: Annotated[float, Axis(0, 10, unit="W/m^2/sr")] = 0.2

    def sensor(self, size: int) -> dict:
        """The camera."""
        raise NotImplementedError

    def mitsuba(self, size: int = 128) -> dict:
        lights = {}
        if self.sun_irradiance > 0:
            toward = direction(self.light_elevation, self.light_azimuth)
            lights["sun"] = round_sun(toward, self.light_radius, self.sun_irradiance)
        lights["sky"] = uniform_sky(self.sky)
        return {"type": "scene", **self.surfaces(), **lights, "sensor": self.sensor(size)}

    def view(self, size: int = 128) -> View:
        surfaces = mi.load_dict({"type": "scene", **self.surfaces()})
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        toward = mi.Vector3f(direction(self.light_elevation, self.light_azimuth))
        return View(
            size,
            size,
            camera,
            surface=g_buffer(surfaces, camera),
            sun=Sun(toward, self.light_radius, self.sun_irradiance),
            sky=self.sky,
            visible=ray_caster(surfaces),
            trace=ray_tracer(surfaces),
        )


@scene(
    theme="ambient",
    shows="a round light over a sphere that hides part of it from the plane below",
    quantities=(RADIANCE, DIRECT_RADIANCE),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class SphereOverPlane(Sunlit):
    """A sphere of radius 1 m whose lowest point hangs `gap` above a plane."""

    gap: Annotated[float, Axis(0, 2, unit="m")] = 0.0

    def surfaces(self) -> dict:
        return {
            "plane": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale(200),
                "bsdf": diffuse(self.albedo),
            },
            "sphere": {
                "type": "sphere",
                "center": [0, 0, 1 + self.gap],
                "radius": 1.0,
                "bsdf": diffuse(self.albedo),
            },
        }

    def sensor(self, size: int) -> dict:
        return perspective([0, -6.5, 5.5], [0.7, 0, 0.5 + 0.4 * self.gap], 42, size)


@scene(
    theme="ambient",
    shows="a V-shaped valley, whose visibility is a lune and not a cap",
    quantities=(RADIANCE, DIRECT_RADIANCE),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class Valley(Sunlit):
    """Two walls of 2 m that meet in the y axis and rise at `slope` to both sides, long as a prism.

    The visible sky of a point is the lune between its own wall and the other wall's upper edge.
    """

    slope: Annotated[float, Axis(5, 80, unit="deg")] = 45.0
    light_elevation: Annotated[float, Axis(2, 90, unit="deg")] = 30.0
    light_azimuth: Annotated[float, Axis(0, 360, unit="deg")] = 160.0

    WALL = 2.0  # m, from the bottom to the edge
    LENGTH = 200.0  # m to each side of the origin

    def surfaces(self) -> dict:
        return {"left": self._wall(-1), "right": self._wall(1)}

    def _wall(self, side: int) -> dict:
        a = math.radians(self.slope)
        along = (side * math.cos(a), 0.0, math.sin(a))
        normal = (-side * math.sin(a), 0.0, math.cos(a))
        middle = [0.5 * self.WALL * x for x in along]
        to_world = mi.ScalarTransform4f(
            [
                [0.5 * self.WALL * along[i], side * self.LENGTH * (i == 1), normal[i], middle[i]]
                for i in range(3)
            ]
            + [[0, 0, 0, 1]]
        )
        return {"type": "rectangle", "to_world": to_world, "bsdf": diffuse(self.albedo)}

    def sensor(self, size: int) -> dict:
        return perspective([0, -1.5, 5.0], [0, 0.1, 0.6], 38, size)
