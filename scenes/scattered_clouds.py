"""Many small clouds in a layer, each two soft balls in a hull that a cheap look takes for cloud."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import TRANSMITTANCE, Axis, Cloud, Scene, Sun, View, scene
from scenes.mitsuba_parts import camera_rays, direction, perspective, point_sun

REPEAT = 8  # cells, a power of two, after which clouds come again along each axis


@dataclass(frozen=True)
class Hulls:
    """extinction(p): 1/m at points in m, as great as it can be wherever a cloud might be, 0 elsewhere."""

    extinction: Callable[[Any], Any]


@functools.cache
def table() -> np.ndarray:
    """(REPEAT^3, 8) float32, x fastest: of each cell's cloud the middle (x, y, z) and the hull's radius in
    edges of a cell, the unit vector from the middle to a ball, and the least cover with which it is there."""
    rng, n = np.random.default_rng(16), REPEAT**3
    radius = rng.uniform(0.3, ScatteredClouds.LARGEST, n)
    middle = 0.5 + (0.5 - radius[:, None]) * rng.uniform(-1, 1, (n, 3))
    axis = rng.normal(size=(n, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    return np.column_stack([middle, radius, axis, rng.random(n)]).astype(np.float32)


@scene(
    theme="clouds",
    shows="a layer of many small clouds with clear air between and within them",
    quantities=(TRANSMITTANCE,),
    exposure=(0.0, 4.0),
)
@dataclass(frozen=True)
class ScatteredClouds(Scene):
    """Cubic cells of edge `spacing` fill a layer about 2 km thick over a base at 1.5 km, endless to all
    sides; a share `cover` of them holds a cloud, somewhere in its cell and turned somehow.

    A cloud of the hull's radius R has two balls of radius r = BALL R, AWAY R to both sides of its middle,
    with the density 1 - (distance / r)^2; between them and round them the hull is clear. `optical_depth` is
    that of the middle of the largest ball. The camera stands on the ground and looks up at `elevation`, so
    turned that no row of cells runs along a ray. Mitsuba's layer is a grid that ends REACH cells away.
    """

    optical_depth: Annotated[float, Axis(0.1, 50, log=True)] = 2.0
    spacing: Annotated[float, Axis(100, 2000, log=True, unit="m")] = 500.0
    cover: Annotated[float, Axis(0, 1)] = 0.8
    elevation: Annotated[float, Axis(23, 65, unit="deg")] = 35.0

    BASE = 1500.0  # m
    THICKNESS = 2000.0  # m
    LARGEST = 0.48  # radius of a hull in edges of a cell
    BALL, AWAY = 0.42, 0.55
    EYE = 2.0  # m
    AZIMUTH = 68.0  # deg from +x to +y
    FIELD_OF_VIEW = 40.0  # deg
    REACH = 32  # cells
    VOXELS = 6  # of Mitsuba's grid along an edge of a cell

    @property
    def layers(self) -> int:
        """Cells on top of each other."""
        return max(1, round(self.THICKNESS / self.spacing))

    @property
    def top(self) -> float:
        """Height of the end of the layer, m."""
        return self.BASE + self.layers * self.spacing

    @property
    def sigma_t(self) -> float:
        """Extinction amid a ball, 1/m."""
        return self.optical_depth / (4 / 3 * self.BALL * self.LARGEST * self.spacing)

    def eye(self) -> tuple[list[float], list[float]]:
        """Where the camera stands and a point 1 km on that it looks at, m."""
        x, y, z = direction(self.elevation, self.AZIMUTH)
        return [0.0, 0.0, self.EYE], [1e3 * x, 1e3 * y, self.EYE + 1e3 * z]

    def sensor(self, size: int) -> dict:
        """The camera."""
        return perspective(*self.eye(), self.FIELD_OF_VIEW, size, far_clip=1e6)

    def _cloud_at(self, p: mi.Point3f) -> tuple[mi.Vector3f, mi.Float, mi.Vector3f]:
        """Of the cell that a point lies in: the way from the cloud's middle to the point (edges of a cell),
        the hull's radius, 0 without a cloud, and the vector to a ball."""
        q = (p - mi.Point3f(0, 0, self.BASE)) / self.spacing
        whole = dr.floor(q)
        cell = mi.Vector3i(whole) & (REPEAT - 1)
        at = mi.UInt32(cell.x + REPEAT * (cell.y + REPEAT * cell.z))
        rows = mi.Float(table().ravel())
        middle = dr.gather(mi.Vector4f, rows, 2 * at)
        axis = dr.gather(mi.Vector4f, rows, 2 * at + 1)
        there = (axis.w < self.cover) & (whole.z >= 0) & (whole.z < self.layers)
        away = mi.Vector3f(q - whole) - middle.xyz
        return away, dr.select(there, middle.w, 0), axis.xyz

    def extinction(self, p: mi.Point3f) -> mi.Float:
        """sigma(p), 1/m."""
        away, radius, axis = self._cloud_at(p)
        along = dr.abs(dr.dot(away, axis))
        offset = self.AWAY * radius
        squared = dr.squared_norm(away) - 2 * along * offset + offset * offset
        ball = dr.maximum(self.BALL * radius, 1e-6)
        return self.sigma_t * dr.maximum(1 - squared / (ball * ball), 0)

    def hull(self, p: mi.Point3f) -> mi.Float:
        """Extinction amid a ball (1/m) in all of a hull."""
        away, radius, _ = self._cloud_at(p)
        return dr.select(dr.squared_norm(away) < radius * radius, mi.Float(self.sigma_t), 0)

    def span(self, o: mi.Point3f, d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
        """Distances (m) between which a ray from below is in the layer."""
        return (self.BASE - o.z) / d.z, (self.top - o.z) / d.z

    def view(self, size: int = 128) -> View:
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        cloud = Cloud(self.extinction, self.span, 1.0, 0.0, 1.0, self.sigma_t, Hulls(self.hull))
        return View(size, size, camera, sun=Sun(mi.Vector3f(0, 0, 1), 0.0, 1.0), cloud=cloud)

    def mitsuba(self, size: int = 128) -> dict:
        nx, nz = 2 * self.REACH * self.VOXELS, self.layers * self.VOXELS
        edge, reach, half = self.spacing / self.VOXELS, self.REACH * self.spacing, (self.top - self.BASE) / 2
        i = dr.arange(mi.UInt32, nx * nx * nz)
        p = edge * (mi.Point3f(i % nx, (i // nx) % nx, i // (nx * nx)) + 0.5)
        grid = np.array(self.extinction(p + mi.Point3f(-reach, -reach, self.BASE)), np.float32)
        box = mi.ScalarTransform4f().translate([0, 0, self.BASE + half]).scale([reach, reach, half])
        medium = {
            "type": "heterogeneous",
            "sigma_t": {
                "type": "gridvolume",
                "grid": mi.VolumeGrid(np.ascontiguousarray(grid.reshape(nz, nx, nx, 1))),
                "use_grid_bbox": False,
                "wrap_mode": "clamp",
                "to_world": box.translate([-1, -1, -1]).scale(2),
            },
            "albedo": 1.0,
        }
        return {
            "type": "scene",
            "cloud": {"type": "cube", "to_world": box, "bsdf": {"type": "null"}, "interior": medium},
            "sun": point_sun([0.0, 0.0, 1.0], 1.0),
            "sensor": self.sensor(size),
        }
