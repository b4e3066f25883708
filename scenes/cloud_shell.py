"""A shell of thin cloud round the Earth, seen from the ground, from within and from above.

Positions are in metres about the point of the ground below the camera; the Earth's centre is at z = -RADIUS.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import TRANSMITTANCE, Axis, Cloud, Scene, Sun, View, scene
from scenes.mitsuba_parts import camera_rays, diffuse, direction, perspective, point_sun

KM = 1e-3  # km in a metre


@dataclass(frozen=True)
class Shell:
    """Radius of the ground, heights of base and top above it, m."""

    radius: float
    bottom: float
    top: float


@scene(
    theme="clouds",
    shows="a shell of cloud that sinks towards the horizon",
    quantities=(TRANSMITTANCE,),
    exposure=(0.0, 4.0),
)
@dataclass(frozen=True)
class CloudShell(Scene):
    """Cloud between 1.5 and 5 km above a round ground that hides what lies behind it.

    Its extinction is sigma (1 + rolls cos(2 pi x / wavelength)): upright sheets that the camera looks across,
    whose mean is sigma = optical_depth / 3500 m. The camera stands at `height` over the ground; the middle of
    the image is at `elevation`, at 12 degrees with its bottom edge level, and as far downwards from above the
    cloud.
    """

    optical_depth: Annotated[float, Axis(0.02, 2, log=True)] = 0.05  # of the mean, straight up
    height: Annotated[float, Axis(2, 9000, unit="m")] = 2.0
    elevation: Annotated[float, Axis(0, 78, unit="deg")] = 12.0
    rolls: Annotated[float, Axis(0, 1)] = 1.0
    wavelength: Annotated[float, Axis(300, 20000, log=True, unit="m")] = 600.0

    RADIUS = 6371e3  # m
    BOTTOM = 1500.0  # m
    TOP = 5000.0  # m
    FIELD_OF_VIEW = 24.0  # deg
    REACH = 5e5  # m from the camera that Mitsuba's grid of sheets covers

    @property
    def sigma(self) -> float:
        """Mean extinction, 1/m."""
        return self.optical_depth / (self.TOP - self.BOTTOM)

    def eye(self) -> tuple[list[float], list[float]]:
        """Where the camera stands and a point 10 km on that it looks at, m."""
        side = -1 if self.height > self.TOP else 1
        x, y, z = direction(side * self.elevation)
        return [0.0, 0.0, self.height], [1e4 * x, 1e4 * y, self.height + 1e4 * z]

    def sensor(self, size: int) -> dict:
        """The camera."""
        return perspective(*self.eye(), self.FIELD_OF_VIEW, size)

    def extinction(self, p: mi.Point3f) -> mi.Float:
        """Of the cloud as if it filled all space, 1/m."""
        return self.sigma * (1 + self.rolls * dr.cos(2 * dr.pi / self.wavelength * p.x))

    def span(self, o: mi.Point3f, d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
        """All of the ray: the shell is the technique's to find."""
        return dr.zeros(mi.Float, dr.width(d)), dr.full(mi.Float, dr.inf, dr.width(d))

    def view(self, size: int = 128) -> View:
        cloud = Cloud(
            self.extinction, self.span, 1.0, 0.0, 1.0, self.sigma, Shell(self.RADIUS, self.BOTTOM, self.TOP)
        )
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        return View(size, size, camera, sun=Sun(mi.Vector3f(0, 0, 1), 0.0, 1.0), cloud=cloud)

    def mitsuba(self, size: int = 128) -> dict:
        """In km. The sheets are a grid of one row, eight cells a wavelength, linear between their middles."""
        cells = math.ceil(2 * self.REACH / self.wavelength * 8)
        x = ((np.arange(cells) + 0.5) / cells * 2 - 1) * self.REACH
        sheets = 1 + self.rolls * np.cos(2 * np.pi / self.wavelength * x)
        reach = self.REACH * KM
        placed = mi.ScalarTransform4f().translate([-reach] * 3).scale(2 * reach)
        grid = mi.VolumeGrid(np.ascontiguousarray(sheets[None, None, :, None], np.float32))
        medium = {
            "type": "heterogeneous",
            "sigma_t": {
                "type": "gridvolume",
                "grid": grid,
                "use_grid_bbox": False,
                "wrap_mode": "clamp",
                "to_world": placed,
            },
            "albedo": 1.0,
            "scale": self.sigma / KM,
        }
        held, null = {"type": "ref", "id": "medium"}, {"type": "null"}
        target = [KM * x for x in self.eye()[0]], [KM * x for x in self.eye()[1]]
        sensor = perspective(*target, self.FIELD_OF_VIEW, size, near_clip=1e-4)
        if self.BOTTOM < self.height < self.TOP:
            sensor["medium"] = held
        return {
            "type": "scene",
            "medium": medium,
            "ground": {**self._sphere(0.0), "bsdf": diffuse(0.2)},
            "base": {**self._sphere(self.BOTTOM), "bsdf": null, "exterior": held},
            "top": {**self._sphere(self.TOP), "bsdf": null, "interior": held},
            "sun": point_sun([0.0, 0.0, 1.0], 1.0),
            "sensor": sensor,
        }

    def _sphere(self, height: float) -> dict:
        radius = self.RADIUS * KM
        return {"type": "sphere", "center": [0.0, 0.0, -radius], "radius": radius + height * KM}
