"""Balls among lamps: where ways to shade a model under local lights are tried."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated

import mitsuba as mi

from scenes.ball import Ball, DiffuseBall
from scenes.contract import RADIANCE, Axis, PointLight, View, scene
from scenes.mitsuba_parts import direction, rgb, uniform_sky


@scene(
    theme="ambient",
    shows="a ball among point lights, near ones and far ones, in a faint glow",
    quantities=(RADIANCE,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class BallUnderLamps(DiffuseBall):
    """Lamp i stands i golden angles round the ball and gives 0.8^i times as much light as the first.

    `distance` is that of the nearest from the middle of the ball, the others are up to 1.4 times as far. All
    together give a surface at the middle that faced every one of them the irradiance pi.
    """

    lamps: Annotated[int, Axis(1, 16)] = 6
    distance: Annotated[float, Axis(1.2, 20, log=True, unit="m")] = 2.5
    ambient: Annotated[float, Axis(0, 1, unit="W/m^2/sr")] = 0.05

    TINTS = ((1.0, 0.78, 0.55), (0.55, 0.75, 1.0), (0.8, 1.0, 0.7))

    def lamp_list(self) -> list[tuple[list[float], list[float]]]:
        """Position (m) and intensity (W/sr) of each."""
        share = math.pi / sum(0.8**i for i in range(self.lamps))
        found = []
        for i in range(self.lamps):
            far = self.distance * (1 + 0.2 * (i % 3))
            toward = direction(50.0 - 100.0 * ((0.618034 * i) % 1), 240.0 + 137.508 * i)
            intensity = [share * 0.8**i * far**2 * tint for tint in self.TINTS[i % 3]]
            found.append(([far * x for x in toward], intensity))
        return found

    def lights(self) -> dict:
        lamps = {
            f"lamp{i}": {"type": "point", "position": position, "intensity": rgb(intensity)}
            for i, (position, intensity) in enumerate(self.lamp_list())
        }
        return {**lamps, "sky": uniform_sky(self.ambient)}

    def view(self, size: int = 128) -> View:
        points = tuple(PointLight(mi.Point3f(p), mi.Color3f(i)) for p, i in self.lamp_list())
        return self.seen(size, points=points, sky=self.ambient)


@scene(
    theme="ambient",
    shows="a black polished ball with one lamp, whose gloss a camera sees at every angle",
    quantities=(RADIANCE,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class PolishedBall(Ball):
    """A rough dielectric (GGX, refractive index 1.5) over black: nothing but what the surface reflects.

    The lamp is 4 m away at `lamp_angle` of azimuth from the camera, level with it to 0.3 rad; it gives a
    facing surface at the ball's middle the irradiance pi.
    """

    alpha: Annotated[float, Axis(0.05, 0.8, log=True)] = 0.35
    lamp_angle: Annotated[float, Axis(0, 150, unit="deg")] = 80.0

    INDEX = 1.5
    LAMP = 4.0  # m

    def material(self) -> dict:
        return {
            "type": "roughplastic",
            "distribution": "ggx",
            "alpha": self.alpha,
            "int_ior": self.INDEX,
            "ext_ior": 1.0,
            "diffuse_reflectance": rgb(0.0),
        }

    def lamp(self) -> tuple[list[float], float]:
        """Position (m) and intensity (W/sr)."""
        azimuth = math.degrees(math.atan2(self.EYE[1], self.EYE[0])) - self.lamp_angle
        return [self.LAMP * x for x in direction(math.degrees(0.3), azimuth)], math.pi * self.LAMP**2

    def lights(self) -> dict:
        position, intensity = self.lamp()
        return {"lamp": {"type": "point", "position": position, "intensity": rgb(intensity)}}

    def view(self, size: int = 128) -> View:
        position, intensity = self.lamp()
        seen = self.seen(size, points=(PointLight(mi.Point3f(position), mi.Color3f(intensity)),))
        f0 = ((self.INDEX - 1) / (self.INDEX + 1)) ** 2
        surface = dataclasses.replace(seen.surface, specular=mi.Color3f(f0), alpha=mi.Float(self.alpha))
        return dataclasses.replace(seen, surface=surface)
