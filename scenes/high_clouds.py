"""A thin slab of ice cloud far up, whose extinction is a picture drawn out over its thickness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import SINGLE_SCATTERING, TRANSMITTANCE, Axis, Cloud, Scene, Sun, View, scene
from scenes.mitsuba_parts import camera_rays, direction, perspective, point_sun

WAVES = ((1, 3, 0.4), (-1, 5, 1.7), (2, 1, 2.6))
"""Cycles along x and y in a tile, and phase, of the factors 1 + cos that make the streaks."""


@dataclass(frozen=True)
class Sheet:
    """Base, thickness and tile of a slab of cloud (m), its wind (m/s) and for how long it has blown (s)."""

    base: float
    thickness: float
    tile: float
    wind: tuple[float, float]
    time: float


@scene(
    theme="clouds",
    shows="streaks of high cloud between the horizon and overhead",
    quantities=(TRANSMITTANCE, SINGLE_SCATTERING),
    exposure=(0.0, 4.0),
)
@dataclass(frozen=True)
class HighClouds(Scene):
    """A slab whose base is at 8 km over flat ground, with the extinction

        sigma(p) = optical_depth / thickness prod (1 + cos(k . (p - time wind) + f))

    at every height within it: streaks up to 8 times as deep as the mean. The camera stands on the ground and
    looks up at `elevation`, along +y. The sun, a point, stands SUN_ASIDE degrees to the right of it. The ice
    absorbs nothing and scatters by a Henyey-Greenstein lobe. Mitsuba's slab ends REACH away.
    """

    optical_depth: Annotated[float, Axis(0.02, 3, log=True)] = 0.3  # mean, straight up
    elevation: Annotated[float, Axis(23, 65, unit="deg")] = 30.0
    thickness: Annotated[float, Axis(30, 3000, log=True, unit="m")] = 300.0
    time: Annotated[float, Axis(0, 3600, unit="s")] = 30.0
    sun_elevation: Annotated[float, Axis(5, 90, unit="deg")] = 40.0
    g: Annotated[float, Axis(0, 0.9)] = 0.75

    BASE = 8000.0  # m
    TILE = 8000.0  # m
    WIND = (30.0, 12.0)  # m/s
    FIELD_OF_VIEW = 40.0  # deg
    EYE = 2.0  # m
    SUN_ASIDE = 30.0  # deg
    SUN_IRRADIANCE = 1.0  # W/m^2 on a surface that faces the sun
    REACH = 6e4  # m
    CELLS = 64  # of Mitsuba's grid in a tile

    def to_sun(self) -> list[float]:
        """Unit direction to the sun."""
        return direction(self.sun_elevation, 90.0 - self.SUN_ASIDE)

    def eye(self) -> tuple[list[float], list[float]]:
        """Where the camera stands and a point 1 km on that it looks at, m."""
        x, y, z = direction(self.elevation, 90.0)
        return [0.0, 0.0, self.EYE], [1e3 * x, 1e3 * y, self.EYE + 1e3 * z]

    def sensor(self, size: int) -> dict:
        """The camera."""
        return perspective(*self.eye(), self.FIELD_OF_VIEW, size, far_clip=1e6)

    def picture(self, x: mi.Float, y: mi.Float) -> mi.Float:
        """Vertical optical depth at places (m) of the slab as it was at time 0."""
        depth = self.optical_depth
        for kx, ky, phase in WAVES:
            depth *= 1 + dr.cos(2 * dr.pi / self.TILE * (kx * x + ky * y) + phase)
        return depth

    def extinction(self, p: mi.Point3f) -> mi.Float:
        """sigma(p) at time 0, 1/m: what the picture holds before the wind moves it."""
        inside = (p.z >= self.BASE) & (p.z <= self.BASE + self.thickness)
        return dr.select(inside, self.picture(p.x, p.y) / self.thickness, 0)

    def span(self, o: mi.Point3f, d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
        """Distances (m) between which a ray from below is in the slab."""
        return (self.BASE - o.z) / d.z, (self.BASE + self.thickness - o.z) / d.z

    def view(self, size: int = 128) -> View:
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        sheet = Sheet(self.BASE, self.thickness, self.TILE, self.WIND, self.time)
        cloud = Cloud(self.extinction, self.span, 1.0, self.g, 1.0, model=sheet)
        sun = Sun(mi.Vector3f(self.to_sun()), 0.0, self.SUN_IRRADIANCE)
        return View(size, size, camera, sun=sun, cloud=cloud)

    def mitsuba(self, size: int = 128) -> dict:
        n = round(2 * self.REACH / self.TILE * self.CELLS)
        x = ((np.arange(n) + 0.5) / n * 2 - 1) * self.REACH
        at_y, at_x = (m.ravel() for m in np.meshgrid(x, x, indexing="ij"))
        wx, wy = (self.time * w for w in self.WIND)
        depth = np.array(self.picture(mi.Float(at_x - wx), mi.Float(at_y - wy)), np.float32)
        half = self.thickness / 2
        box = mi.ScalarTransform4f().translate([0, 0, self.BASE + half]).scale([self.REACH, self.REACH, half])
        medium = {
            "type": "heterogeneous",
            "sigma_t": {
                "type": "gridvolume",
                "grid": mi.VolumeGrid(np.ascontiguousarray((depth / self.thickness).reshape(1, n, n, 1))),
                "use_grid_bbox": False,
                "wrap_mode": "clamp",
                "to_world": box.translate([-1, -1, -1]).scale(2),
            },
            "albedo": 1.0,
            "phase": {"type": "hg", "g": self.g},
        }
        return {
            "type": "scene",
            "cloud": {"type": "cube", "to_world": box, "bsdf": {"type": "null"}, "interior": medium},
            "sun": point_sun(self.to_sun(), self.SUN_IRRADIANCE),
            "sensor": self.sensor(size),
        }
