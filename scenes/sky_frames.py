"""A picture of the whole sky, as a time-lapse film of it would hold frame by frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from scenes.contract import RADIANCE, Camera, Sun, View, scene
from scenes.mitsuba_parts import camera_rays, environment_light, orthographic
from scenes.sky import Sky


@scene(
    theme="ambient",
    shows="a sky with clouds and the sun's disk, seen all round in a polished ball",
    quantities=(RADIANCE,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class SkyFrames(Sky):
    """A light probe: a mirror ball of radius 1 m from above, whose middle square shows equal solid angles.

    The horizon is the circle that touches the sides of the image; beyond it, in the corners, is the ground.
    The sun is 6 times as wide as it looks from Earth, as haze and a lens smear it.
    """

    SUN_RADIUS = 0.03  # rad
    ROWS = 512

    def sun(self) -> Sun:
        """The disk in front of the sky."""
        return Sun(mi.Vector3f(self.toward_sun()), self.SUN_RADIUS, self.sun_irradiance)

    def radiance(self, w: mi.Vector3f) -> mi.Color3f:
        """Sky and sun's disk from unit directions, W m^-2 sr^-1."""
        sun = self.sun()
        inside = dr.dot(w, sun.direction) > math.cos(self.SUN_RADIUS)
        return self.sky(w) + dr.select(inside, mi.Float(sun.radiance), 0)

    def surfaces(self) -> dict:
        return {"ball": {"type": "sphere", "bsdf": {"type": "conductor", "material": "none"}}}

    def sensor(self, size: int) -> dict:
        """From above, turned so that no axis of the sky runs along the rows of pixels."""
        return orthographic([1e-3, 6e-3, 10], [0, 0, 0], math.sqrt(0.5), size)

    def mitsuba(self, size: int = 128) -> dict:
        sky = environment_light(self.radiance, self.ROWS)
        return {"type": "scene", **self.surfaces(), "sky": sky, "sensor": self.sensor(size)}

    def view(self, size: int = 128) -> View:
        """The camera's rays are those that leave the ball."""
        seen = camera_rays(mi.load_dict(self.sensor(size)), size)
        across = seen.origin - seen.direction * dr.dot(seen.origin, seen.direction)
        n = across - seen.direction * dr.sqrt(1 - dr.squared_norm(across))
        away = seen.direction - 2 * dr.dot(seen.direction, n) * n
        camera = Camera(mi.Point3f(n), away, seen.forward, seen.near, seen.far)
        return View(size, size, camera, sun=self.sun(), environment=self.sky)
