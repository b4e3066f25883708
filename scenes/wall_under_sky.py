"""A ball beside a wall under a sky that differs from one direction to the next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import mitsuba as mi

from scenes.contract import DIRECT_RADIANCE, RADIANCE, Axis, Sun, View, scene
from scenes.mitsuba_parts import (
    camera_rays,
    diffuse,
    environment_light,
    g_buffer,
    perspective,
    point_sun,
    ray_caster,
    ray_tracer,
)
from scenes.sky import Sky


@scene(
    theme="ambient",
    shows="a ball by a wall, each open to another part of a coloured sky",
    quantities=(RADIANCE, DIRECT_RADIANCE),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class WallUnderSky(Sky):
    """A ball of radius 0.5 m on a plane, `gap` away from a wall `height` high that faces +x.

    The sun is a point; the sky of the environment has no disk in it.
    """

    gap: Annotated[float, Axis(0, 2, unit="m")] = 0.3
    height: Annotated[float, Axis(0, 6, unit="m")] = 2.0
    albedo: Annotated[float, Axis(0, 0.9)] = 0.5
    sun_irradiance: Annotated[float, Axis(0, 20, unit="W/m^2")] = 1.5
    sun_azimuth: Annotated[float, Axis(0, 360, unit="deg")] = 60.0
    sun_elevation: Annotated[float, Axis(2, 88, unit="deg")] = 35.0

    RADIUS = 0.5  # m
    HALF = 3.0  # m, of the wall along y
    PLANE = 100.0  # m, half the side of the ground
    ROWS = 256

    def surfaces(self) -> dict:
        at = mi.ScalarTransform4f()
        wall = at.translate([-self.RADIUS - self.gap, 0, 0.5 * self.height]).rotate([0, 1, 0], 90)
        shapes = {
            "plane": {"type": "rectangle", "to_world": at.scale([self.PLANE, self.PLANE, 1])},
            "ball": {"type": "sphere", "center": [0, 0, self.RADIUS], "radius": self.RADIUS},
        }
        if self.height > 0:
            to_world = wall.scale([0.5 * self.height, self.HALF, 1])
            shapes["wall"] = {"type": "rectangle", "to_world": to_world}
        return {name: {**shape, "bsdf": diffuse(self.albedo)} for name, shape in shapes.items()}

    def sensor(self, size: int) -> dict:
        return perspective([2.6, -3.2, 2.0], [-0.2, 0.05, 0.55], 40, size)

    def mitsuba(self, size: int = 128) -> dict:
        lights = {"sky": environment_light(self.sky, self.ROWS)}
        if self.sun_irradiance > 0:
            lights["sun"] = point_sun(self.toward_sun(), self.sun_irradiance)
        return {"type": "scene", **self.surfaces(), **lights, "sensor": self.sensor(size)}

    def view(self, size: int = 128) -> View:
        surfaces = mi.load_dict({"type": "scene", **self.surfaces()})
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        return View(
            size,
            size,
            camera,
            surface=g_buffer(surfaces, camera),
            sun=Sun(mi.Vector3f(self.toward_sun()), 0.0, self.sun_irradiance),
            environment=self.sky,
            visible=ray_caster(surfaces),
            trace=ray_tracer(surfaces),
        )
