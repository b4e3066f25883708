"""A ball before a parallel camera: all normals that a camera sees, and nothing that hides anything."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import mitsuba as mi

from scenes.contract import Axis, Scene, View
from scenes.mitsuba_parts import camera_rays, diffuse, g_buffer, orthographic, ray_caster, ray_tracer


@dataclass(frozen=True)
class Ball(Scene):
    """A ball of radius 1 m at the origin; subclasses add its material and the light."""

    EYE = (1.4, -4.0, 1.6)  # m
    HALF_WIDTH = 1.05  # m

    def surfaces(self) -> dict:
        return {"ball": {"type": "sphere", "radius": 1.0, "bsdf": self.material()}}

    def material(self) -> dict:
        """The ball's reflection."""
        raise NotImplementedError

    def lights(self) -> dict:
        """The sources of light as Mitsuba dictionaries by name."""
        raise NotImplementedError

    def sensor(self, size: int) -> dict:
        """The camera."""
        return orthographic(list(self.EYE), [0, 0, 0], self.HALF_WIDTH, size)

    def mitsuba(self, size: int = 128) -> dict:
        return {"type": "scene", **self.surfaces(), **self.lights(), "sensor": self.sensor(size)}

    def seen(self, size: int, **light: Any) -> View:
        """The view under some light."""
        surfaces = mi.load_dict({"type": "scene", **self.surfaces()})
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        return View(
            size,
            size,
            camera,
            surface=g_buffer(surfaces, camera),
            visible=ray_caster(surfaces),
            trace=ray_tracer(surfaces),
            **light,
        )


@dataclass(frozen=True)
class DiffuseBall(Ball):
    """A ball that obeys Lambert's law."""

    albedo: Annotated[float, Axis(0, 1)] = 0.8

    def material(self) -> dict:
        return diffuse(self.albedo)
