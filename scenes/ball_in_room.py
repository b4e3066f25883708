"""A ball in a closed round room: where ways to light a model's dark side are tried."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated

import mitsuba as mi

from scenes.ball import DiffuseBall
from scenes.contract import DIRECT_RADIANCE, RADIANCE, Axis, PointLight, View, scene
from scenes.mitsuba_parts import diffuse, light_solver, rgb


@scene(
    theme="ambient",
    shows="a ball in a diffuse room with one lamp, whose light also comes back from the walls",
    quantities=(RADIANCE, DIRECT_RADIANCE),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class BallInRoom(DiffuseBall):
    """The room is a sphere of 6 m about the ball; the camera sees nothing but the ball.

    A lamp 3 m from the ball gives a facing surface at its middle the irradiance pi; `lamp_angle` is its
    azimuth from the camera.
    """

    room: Annotated[float, Axis(0, 0.8)] = 0.4  # albedo of the walls
    lamp_angle: Annotated[float, Axis(0, 150, unit="deg")] = 70.0

    HALF_WIDTH = 0.7
    RADIUS = 6.0  # m
    LAMP = 3.0  # m

    def lamp(self) -> tuple[list[float], float]:
        """Position (m) and intensity (W/sr)."""
        azimuth = math.atan2(self.EYE[1], self.EYE[0]) - math.radians(self.lamp_angle)
        level, up = self.LAMP * math.cos(0.4), self.LAMP * math.sin(0.4)
        return [level * math.cos(azimuth), level * math.sin(azimuth), up], math.pi * self.LAMP**2

    def walls(self) -> dict:
        """The room without the ball."""
        shell = {"type": "sphere", "radius": self.RADIUS, "flip_normals": True}
        return {"room": {**shell, "bsdf": diffuse(self.room)}}

    def surfaces(self) -> dict:
        return {**super().surfaces(), **self.walls()}

    def lights(self) -> dict:
        position, intensity = self.lamp()
        return {"lamp": {"type": "point", "position": position, "intensity": rgb(intensity)}}

    def view(self, size: int = 128) -> View:
        position, intensity = self.lamp()
        empty = mi.load_dict({"type": "scene", **self.walls(), **self.lights()})
        seen = self.seen(size, points=(PointLight(mi.Point3f(position), mi.Color3f(intensity)),))
        return dataclasses.replace(seen, gather=light_solver(empty))
