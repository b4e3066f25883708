"""Height fog over a ground plane: where fog and its in-scattered light are tried."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import RADIANCE, SINGLE_SCATTERING, TRANSMITTANCE, Axis, Fog, Scene, Sun, View, scene
from scenes.mitsuba_parts import (
    camera_rays,
    diffuse,
    direction,
    g_buffer,
    perspective,
    point_sun,
    ray_caster,
    uniform_sky,
)

GOLDEN_RATIO = 0.6180339887498949


@scene(
    theme="scattering",
    shows="fog that thins out with height, over objects from a few metres away to the far end",
    quantities=(RADIANCE, SINGLE_SCATTERING, TRANSMITTANCE),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class FogOverGround(Scene):
    """Isotropic grey fog of extinction density * exp(-falloff z) over diffuse ground at z = 0.

    Where the fog is cut off: it fills a box of 160 x 200 x 50 m that carries the ground as its floor. The
    camera stands inside, 20 m from the near wall and 180 m from the far one. Beyond the walls lies empty
    space lit by the same sky, from below the horizon too. Rays that meet no object leave through a wall or
    the lid, so the tail above 50 m, exp(-50 falloff) of a vertical column, is not there.

    Mitsuba's volume is linear between VOXELS voxel centres. With k = falloff * HEIGHT / VOXELS it lies above
    the exponential by at most k^2 / 8, by k^2 / 12 on average: 3e-4 at the largest falloff, about 1e-7 at
    the default. Below the lowest centre it is constant, which takes k^2 / 8 off a whole column.
    """

    density: Annotated[float, Axis(1e-3, 0.1, log=True, unit="1/m")] = 0.02
    falloff: Annotated[float, Axis(1e-5, 5, log=True, unit="1/m")] = 0.1
    camera_height: Annotated[float, Axis(0.5, 45, unit="m")] = 3.0
    sun_elevation: Annotated[float, Axis(2, 90, unit="deg")] = 35.0
    albedo: Annotated[float, Axis(0, 1)] = 0.95
    ground_albedo: Annotated[float, Axis(0, 1)] = 0.4
    sun_irradiance: Annotated[float, Axis(0, 100, unit="W/m^2")] = math.pi
    sky: Annotated[float, Axis(0, 10, unit="W/m^2/sr")] = 0.3

    LOW, HIGH = (-80.0, -20.0, 0.0), (80.0, 180.0, 50.0)  # m, corners of the fog
    HEIGHT = HIGH[2] - LOW[2]
    VOXELS = 4096
    SUN_AZIMUTH = 150.0  # deg
    FOV = 60.0  # deg
    ROWS = 12

    def boxes(self) -> dict[str, tuple[list[float], list[float]]]:
        """Centre and half size (m) of blocks and slim columns, one of each a row, all on the ground."""
        found = {}
        for row in range(self.ROWS):
            y, size = self._row(row)
            found[f"column_{row}"] = (
                [self._side(row, 0) * y, y, 2 * size],
                [0.15 * size, 0.15 * size, 2 * size],
            )
            found[f"block_{row}"] = (
                [self._side(row, 1) * y, y, 0.4 * size],
                [0.5 * size, 0.4 * size, 0.4 * size],
            )
        return found

    def balls(self) -> dict[str, tuple[list[float], float]]:
        """Centre and radius (m) of the spheres, one a row; they lie on the ground."""
        rows = ((row, *self._row(row)) for row in range(self.ROWS))
        return {f"ball_{row}": ([self._side(row, 2) * y, y, 0.5 * size], 0.5 * size) for row, y, size in rows}

    @staticmethod
    def _row(row: int) -> tuple[float, float]:
        """Distance of a row, 4 to 162 m, and the size of its objects, 0.8 to 7.4 m."""
        y = 4 * 1.4**row
        return y, 0.35 * y**0.6

    @staticmethod
    def _side(row: int, slot: int) -> float:
        """Sideways position over distance, within the picture, spread by the golden ratio."""
        return 0.95 * ((GOLDEN_RATIO * row + slot / 3) % 1) - 0.475

    def eye(self) -> tuple[list[float], list[float]]:
        """Where the camera stands and what it looks at, m."""
        return [0, 0, self.camera_height], [0, 60, 4]

    def surfaces(self) -> dict:
        """The opaque shapes, as Mitsuba dictionaries by name."""
        move, bsdf = mi.ScalarTransform4f().translate, diffuse(self.ground_albedo)
        middle = [0.5 * (a + b) for a, b in zip(self.LOW, self.HIGH, strict=True)]
        ground = {
            "type": "rectangle",
            "to_world": move([middle[0], middle[1], 0]).scale([80, 100, 1]),
            "bsdf": bsdf,
        }
        boxes = {
            name: {"type": "cube", "to_world": move(centre).scale(half), "bsdf": bsdf}
            for name, (centre, half) in self.boxes().items()
        }
        balls = {
            name: {"type": "sphere", "center": centre, "radius": radius, "bsdf": bsdf}
            for name, (centre, radius) in self.balls().items()
        }
        return {"ground": ground, **boxes, **balls}

    def medium(self) -> dict:
        """The fog: its extinction at voxel centres, linear between them."""
        z = (np.arange(self.VOXELS) + 0.5) * self.HEIGHT / self.VOXELS
        column = self.density * np.exp(-self.falloff * z)
        grid = np.broadcast_to(column[:, None, None, None], (self.VOXELS, 2, 2, 1))
        size = [b - a for a, b in zip(self.LOW, self.HIGH, strict=True)]
        return {
            "type": "heterogeneous",
            "sigma_t": {
                "type": "gridvolume",
                "grid": mi.VolumeGrid(np.ascontiguousarray(grid, np.float32)),
                "filter_type": "trilinear",
                "accel": False,
                "to_world": mi.ScalarTransform4f().translate(self.LOW).scale(size),
            },
            "albedo": self.albedo,
            "phase": {"type": "isotropic"},
        }

    def sensor(self, size: int, **more) -> dict:
        """The camera; its rays start at the near plane, so that 0.3 mm of fog are missed."""
        return perspective(*self.eye(), self.FOV, size, near_clip=3e-4, far_clip=300.0, **more)

    def mitsuba(self, size: int = 128) -> dict:
        below = 1.0  # m: the box goes on under the ground, so that no two faces coincide
        low = [*self.LOW[:2], -below]
        middle = [0.5 * (a + b) for a, b in zip(low, self.HIGH, strict=True)]
        half = [0.5 * (b - a) for a, b in zip(low, self.HIGH, strict=True)]
        inside = {"type": "ref", "id": "fog"}
        lights = {}
        if self.sun_irradiance > 0:
            lights["sun"] = point_sun(direction(self.sun_elevation, self.SUN_AZIMUTH), self.sun_irradiance)
        return {
            "type": "scene",
            "fog": self.medium(),
            "walls": {
                "type": "cube",
                "to_world": mi.ScalarTransform4f().translate(middle).scale(half),
                "bsdf": {"type": "null"},
                "interior": inside,
            },
            **self.surfaces(),
            **lights,
            "sky": uniform_sky(self.sky),
            "sensor": self.sensor(size, medium=inside),
        }

    def fog_colour(self) -> float:
        """Constant in-scattered radiance: light that reaches thin isotropic fog over open ground, times the
        fog's albedo. The sun gives E / 4 pi, the sky fills the upper half of all directions and the sunlit
        ground, rho / pi (E sin e + pi L_sky), the lower half."""
        e, sun, sky = math.radians(self.sun_elevation), self.sun_irradiance, self.sky
        ground = self.ground_albedo * (sun * math.sin(e) / math.pi + sky)
        return self.albedo * (sun / (4 * math.pi) + 0.5 * (sky + ground))

    def box_exit(self, p: mi.Point3f, w: mi.Vector3f) -> mi.Float:
        """Distance (m) from points inside along w to the walls of the fog."""
        return dr.min(dr.maximum((mi.Point3f(self.LOW) - p) / w, (mi.Point3f(self.HIGH) - p) / w))

    def view(self, size: int = 128) -> View:
        surfaces = mi.load_dict({"type": "scene", **self.surfaces()})
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        return View(
            size,
            size,
            camera,
            surface=g_buffer(surfaces, camera),
            sun=Sun(mi.Vector3f(direction(self.sun_elevation, self.SUN_AZIMUTH)), 0.0, self.sun_irradiance),
            sky=self.sky,
            fog=Fog(self.density, self.falloff, self.albedo, self.fog_colour(), self.box_exit),
            visible=ray_caster(surfaces),
        )
