"""Puffs of cloud over hills, in the last frame of a camera that has turned and flown while the wind blew."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import TRANSMITTANCE, Axis, Cloud, Scene, Sun, View, scene
from scenes.mitsuba_parts import camera_rays, diffuse, direction, perspective, point_sun, ray_tracer

PUFFS = (
    (-1700, 2300, 2200, 560),
    (-420, 2500, 2750, 620),
    (820, 2650, 2100, 480),
    (2050, 2500, 2700, 640),
    (150, 3700, 1950, 420),
    (-1300, 3900, 2850, 600),
    (1500, 4300, 2600, 660),
    (-2900, 4100, 2300, 680),
    (3300, 4600, 2150, 600),
    (-300, 5600, 2500, 700),
    (-2100, 6200, 2100, 580),
    (2000, 6600, 2850, 640),
    (-4200, 6800, 2700, 720),
    (4500, 7200, 2400, 700),
    (500, 8200, 2150, 620),
    (-1700, 9000, 2700, 740),
)
"""Middle and radius of every puff in the last frame, m; none touches another."""

HILLS = ((-110, 420, 60, 80), (35, 520, 75, 70), (190, 470, 60, 110))
"""Middle and radius of balls that stick out of the ground, m."""


@dataclass(frozen=True)
class Flight:
    """How camera and clouds came to be where they are in the last frame.

    eye: m, now. heading, elevation: of the middle of the image, rad, the heading from +x towards +y.
    field_of_view: across the image, rad. turn: of the heading in a frame, rad. travel, wind: ways
    (m) that the camera and the clouds go in a frame.
    """

    eye: tuple[float, float, float]
    heading: float
    elevation: float
    field_of_view: float
    turn: float
    travel: tuple[float, float, float]
    wind: tuple[float, float, float]

    def place(self, ago: int) -> list[float]:
        """Where the camera stood some frames ago, m."""
        return [x - ago * step for x, step in zip(self.eye, self.travel, strict=True)]

    def axes(self, ago: int) -> tuple[list[float], list[float], list[float]]:
        """Unit vectors forwards, to the right and down of the camera some frames ago."""
        a, e = self.heading - ago * self.turn, self.elevation
        forward = [math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)]
        right = [math.sin(a), -math.cos(a), 0.0]
        down = [math.sin(e) * math.cos(a), math.sin(e) * math.sin(a), -math.cos(e)]
        return forward, right, down

    def blown(self, ago: int) -> list[float]:
        """From where a piece of cloud was some frames ago to where it is now, m."""
        return [ago * x for x in self.wind]


@scene(
    theme="clouds",
    shows="drifting puffs of cloud behind hills, from a camera that turns and flies",
    quantities=(TRANSMITTANCE,),
    exposure=(0.0, 4.0),
)
@dataclass(frozen=True)
class MovingClouds(Scene):
    """The transmittance of the last frame, to the hills or through all clouds.

    In a puff of radius R about c the extinction is 15 optical_depth / (16 R) (1 - |p - c|^2 / R^2)^2. Camera
    and clouds move evenly from frame to frame and end where they are always seen: what the fields of motion
    change is the past, and the truth is the same for all of them.
    """

    optical_depth: Annotated[float, Axis(0.1, 20, log=True)] = 3.0  # through the middle of a puff
    turn: Annotated[float, Axis(0, 6, unit="deg")] = 0.5  # of the camera to the left, a frame
    travel: Annotated[float, Axis(0, 60, unit="m")] = 4.0  # of the camera to the right, a frame
    wind: Annotated[float, Axis(0, 200, unit="m")] = 4.0  # a frame

    BASE, TOP = 1500.0, 3500.0  # m, heights between which all puffs are
    ELEVATION = 30.0  # deg
    FIELD_OF_VIEW = 40.0  # deg
    EYE = (0.0, 0.0, 2.0)  # m
    WIND = (0.0, -1.0, 0.0)
    CELLS = 32  # along an edge of Mitsuba's grid of a puff

    def eye(self) -> tuple[list[float], list[float]]:
        """Where the camera stands in the last frame and a point 1 km on that it looks at, m."""
        return list(self.EYE), [
            o + 1e3 * x for o, x in zip(self.EYE, direction(self.ELEVATION, 90.0), strict=True)
        ]

    def sensor(self, size: int) -> dict:
        """The camera of the last frame."""
        return perspective(*self.eye(), self.FIELD_OF_VIEW, size)

    def flight(self) -> Flight:
        """The motion."""
        return Flight(
            self.EYE,
            0.5 * math.pi,
            math.radians(self.ELEVATION),
            math.radians(self.FIELD_OF_VIEW),
            math.radians(self.turn),
            (self.travel, 0.0, 0.0),
            tuple(self.wind * x for x in self.WIND),
        )

    def extinction(self, p: mi.Point3f) -> mi.Float:
        """In the last frame, 1/m."""
        total = mi.Float(0)
        for *centre, radius in PUFFS:
            inner = dr.maximum(1 - dr.squared_norm((p - mi.Point3f(centre)) * (1 / radius)), 0)
            total += 0.9375 * self.optical_depth / radius * inner * inner
        return total

    def span(self, o: mi.Point3f, d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
        """Distances (m) between which a ray from below is at the heights of the clouds, both 0 where it does
        not rise."""
        rises = d.z > 1e-3
        return tuple(dr.select(rises, (h - o.z) / d.z, 0) for h in (self.BASE, self.TOP))

    def surfaces(self) -> dict:
        return {
            f"hill_{i}": {"type": "sphere", "center": [x, y, z], "radius": r, "bsdf": diffuse(0.2)}
            for i, (x, y, z, r) in enumerate(HILLS)
        }

    def view(self, size: int = 128) -> View:
        cloud = Cloud(self.extinction, self.span, 1.0, 0.0, 1.0, model=self.flight())
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        hills = ray_tracer(mi.load_dict({"type": "scene", **self.surfaces()}))
        sun = Sun(mi.Vector3f(0, 0, 1), 0.0, 1.0)
        return View(size, size, camera, sun=sun, cloud=cloud, trace=hills)

    def mitsuba(self, size: int = 128) -> dict:
        """Every puff a ball of its own medium, whose grid is linear between the middles of its cells."""
        x = (np.arange(self.CELLS) + 0.5) / self.CELLS * 2 - 1
        inner = np.maximum(1 - sum(m**2 for m in np.meshgrid(x, x, x)), 0) ** 2
        puffs = {}
        for i, (*centre, radius) in enumerate(PUFFS):
            medium = {
                "type": "heterogeneous",
                "sigma_t": {
                    "type": "gridvolume",
                    "grid": mi.VolumeGrid(np.ascontiguousarray(inner[..., None], np.float32)),
                    "use_grid_bbox": False,
                    "wrap_mode": "clamp",
                    "to_world": mi.ScalarTransform4f()
                    .translate([c - radius for c in centre])
                    .scale(2 * radius),
                },
                "albedo": 1.0,
                "scale": 0.9375 * self.optical_depth / radius,
            }
            puffs[f"puff_{i}"] = {
                "type": "sphere",
                "center": list(centre),
                "radius": radius,
                "bsdf": {"type": "null"},
                "interior": medium,
            }
        return {
            "type": "scene",
            **self.surfaces(),
            **puffs,
            "sun": point_sun([0.0, 0.0, 1.0], 1.0),
            "sensor": self.sensor(size),
        }
