"""Ground that hides the sky from itself, laid out in one chart so that light can be baked into a map."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import DIRECT_RADIANCE, RADIANCE, Axis, View, scene
from scenes.mitsuba_parts import diffuse, mesh, perspective
from scenes.sunlit import Sunlit


@dataclass(frozen=True)
class Charted(Sunlit):
    """A sunlit surface with one chart."""

    def chart(self, uv: mi.Point2f) -> tuple[mi.Point3f, mi.Vector3f]:
        """Position and unit normal at texture coordinates in [0, 1]^2."""
        raise NotImplementedError

    def view(self, size: int = 128) -> View:
        return replace(super().view(size), chart=self.chart)


@scene(
    theme="ambient",
    shows="fractal hills, which hide the sky from the sides",
    quantities=(RADIANCE, DIRECT_RADIANCE),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class Terrain(Charted):
    """A square of 10 m of hills whose heights have a standard deviation of `amplitude`.

    Sums of cosines of wavelengths 8 m to 0.5 m, their height in proportion to the wavelength, on a mesh of 96
    cells a side with smooth normals.
    """

    amplitude: Annotated[float, Axis(0, 1.5, unit="m")] = 0.5
    light_elevation: Annotated[float, Axis(2, 90, unit="deg")] = 30.0

    HALF = 5.0  # m
    CELLS = 96
    OCTAVES = 5

    def heights(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """z (m) at x and y."""
        random = np.random.default_rng(5)
        z = np.zeros(np.broadcast(x, y).shape)
        for octave in range(self.OCTAVES):
            for angle, phase in random.uniform(0, 2 * np.pi, (4, 2)):
                k = 2 * np.pi * 2**octave / 8.0
                z += 0.5**octave * np.cos(k * (x * np.cos(angle) + y * np.sin(angle)) + phase)
        return self.amplitude * z / math.sqrt(2 * sum(0.25**octave for octave in range(self.OCTAVES)))

    def surfaces(self) -> dict:
        n = self.CELLS + 1
        side = np.linspace(-self.HALF, self.HALF, n)
        y, x = np.meshgrid(side, side, indexing="ij")
        z, step = self.heights(x, y), 1e-3
        up = np.ones_like(z)
        slope_x = (self.heights(x + step, y) - self.heights(x - step, y)) / (2 * step)
        slope_y = (self.heights(x, y + step) - self.heights(x, y - step)) / (2 * step)
        normals = np.stack([-slope_x, -slope_y, up], axis=-1).reshape(-1, 3)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        positions = np.stack([x, y, z], axis=-1).reshape(-1, 3)
        corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
        lower, upper = [0, 1, n], [n + 1, n, 1]  # cells are cut from their +x to their +y corner
        faces = np.concatenate([corner[:, None] + lower, corner[:, None] + upper])
        uv = 0.5 + 0.5 * positions[:, :2] / self.HALF
        return {"hills": {**mesh(positions, faces, uv, normals), "bsdf": diffuse(self.albedo)}}

    def chart(self, uv: mi.Point2f) -> tuple[mi.Point3f, mi.Vector3f]:
        inside = dr.clip(2 * uv - 1, -1 + 1e-5, 1 - 1e-5) * self.HALF
        above = mi.Point3f(inside.x, inside.y, 10 * (1 + self.amplitude))
        si = mi.load_dict({"type": "scene", **self.surfaces()}).ray_intersect(
            mi.Ray3f(above, mi.Vector3f(0, 0, -1))
        )
        p, n = si.p, mi.Vector3f(si.sh_frame.n)
        dr.eval(p, n)
        return p, n

    def sensor(self, size: int) -> dict:
        return perspective([0, -7.0, 6.5], [0, 0.2, -0.3], 42, size)


@scene(
    theme="ambient",
    shows="a trench, whose visible sky is a band and not a cap",
    quantities=(RADIANCE, DIRECT_RADIANCE),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class Canyon(Charted):
    """A trench 1 m deep and `width` wide along y, with upright walls and level ground to both sides.

    The chart is the cross-section unfolded: RIM, wall, floor, wall, RIM along u, 2 ALONG along v; what lies
    beyond has coordinates beyond [0, 1].
    """

    width: Annotated[float, Axis(0.1, 10, log=True, unit="m")] = 1.0
    light_elevation: Annotated[float, Axis(2, 90, unit="deg")] = 55.0

    DEPTH = 1.0  # m
    RIM, ALONG = 1.0, 3.0  # m, of the chart
    FAR = 100.0  # m, where ground and trench end

    def corners(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x, z and arc length (m, 0 at the chart's edge) of the section's six corners from left to right."""
        half = 0.5 * self.width
        x = np.array([-self.FAR, -half, -half, half, half, self.FAR])
        z = self.DEPTH * np.array([1, 1, 0, 0, 1, 1])
        s = np.concatenate([[0], np.cumsum(np.hypot(np.diff(x), np.diff(z)))])
        return x, z, s - (s[1] - self.RIM)

    def around(self) -> float:
        """Arc length of the chart, m."""
        return 2 * (self.RIM + self.DEPTH) + self.width

    def surfaces(self) -> dict:
        x, z, s = self.corners()
        strips = {}
        for i, name in enumerate(("left ground", "left wall", "floor", "right wall", "right ground")):
            at = [(i, -1), (i + 1, -1), (i, 1), (i + 1, 1)]
            positions = np.array([[x[k], side * self.FAR, z[k]] for k, side in at])
            uv = np.array(
                [[s[k] / self.around(), 0.5 + 0.5 * side * self.FAR / self.ALONG] for k, side in at]
            )
            faces = np.array([[0, 1, 2], [3, 2, 1]])
            strips[name.replace(" ", "_")] = {**mesh(positions, faces, uv), "bsdf": diffuse(self.albedo)}
        return strips

    def chart(self, uv: mi.Point2f) -> tuple[mi.Point3f, mi.Vector3f]:
        x, z, s = self.corners()
        along, y = uv.x * self.around(), (2 * uv.y - 1) * self.ALONG
        p, n = mi.Point3f(0, y, 0), dr.zeros(mi.Vector3f, dr.width(uv))
        for i in range(5):
            share = (along - float(s[i])) / float(s[i + 1] - s[i])
            here = (share >= 0) & (share <= 1)
            p.x = dr.select(here, dr.lerp(float(x[i]), float(x[i + 1]), share), p.x)
            p.z = dr.select(here, dr.lerp(float(z[i]), float(z[i + 1]), share), p.z)
            n = dr.select(here, mi.Vector3f(float(np.sign(z[i] - z[i + 1])), 0, float(z[i] == z[i + 1])), n)
        return p, n

    def sensor(self, size: int) -> dict:
        return perspective([0, -1.6, 3.4], [0, 0.1, 0.5], 42, size)


@scene(
    theme="ambient",
    shows="ground under leaves: light comes through many small holes",
    quantities=(RADIANCE, DIRECT_RADIANCE),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class Foliage(Charted):
    """`leaves` disks of radius 0.25 m, tilted at random, hang 1 to 2 m above a square of 4 m of a plane."""

    leaves: Annotated[int, Axis(0, 200)] = 80
    light_elevation: Annotated[float, Axis(2, 90, unit="deg")] = 65.0
    light_radius: Annotated[float, Axis(0.005, 1.2, log=True, unit="rad")] = 0.1

    HALF = 2.0  # m
    LEAF = 0.25  # m
    PLANE = 100.0  # m, half the side of the ground

    def surfaces(self) -> dict:
        random = np.random.default_rng(11)
        shapes = {
            "ground": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale([self.PLANE, self.PLANE, 1]),
                "bsdf": diffuse(self.albedo),
            }
        }
        for i in range(self.leaves):
            x, y, tilt, azimuth, z = random.uniform(
                [-self.HALF, -self.HALF, 0, 0, 1], [self.HALF, self.HALF, 60, 360, 2]
            )
            shapes[f"leaf_{i}"] = {
                "type": "disk",
                "to_world": mi.ScalarTransform4f()
                .translate([x, y, z])
                .rotate([0, 0, 1], azimuth)
                .rotate([1, 0, 0], tilt)
                .scale(self.LEAF),
                "bsdf": {"type": "twosided", "bsdf": diffuse(self.albedo)},
            }
        return shapes

    def view(self, size: int = 128) -> View:
        seen = super().view(size)
        p = seen.surface.position
        uv = 0.5 + 0.5 * mi.Point2f(p.x, p.y) / self.HALF
        return replace(seen, surface=replace(seen.surface, uv=uv))

    def chart(self, uv: mi.Point2f) -> tuple[mi.Point3f, mi.Vector3f]:
        p = (2 * uv - 1) * self.HALF
        return mi.Point3f(p.x, p.y, 0), mi.Vector3f(0, 0, 1) + dr.zeros(mi.Vector3f, dr.width(uv))

    def sensor(self, size: int) -> dict:
        return perspective([0, -1.5, 0.95], [0, -0.1, 0], 62, size)
