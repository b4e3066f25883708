"""Clouds of varying density, each a grid in a box: what is marched is what the truth is rendered from."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.cloud import SUN_IRRADIANCE, SunlitCloud
from scenes.cloud_density import CloudModel, Weather, density
from scenes.contract import (
    RADIANCE,
    SINGLE_SCATTERING,
    SOURCE_FUNCTION,
    SUN_TRANSMITTANCE,
    TRANSMITTANCE,
    Axis,
    Camera,
    Cloud,
    Sun,
    View,
    scene,
)
from scenes.mitsuba_parts import camera_rays, environment_light, perspective, point_sun


@dataclass(frozen=True)
class GridCloud(SunlitCloud):
    """A box of cloud under a sun that is a point, a sky, or both. Subclasses say which clouds and from where.

    optical_depth  without rain, of the thickest vertical column.
    sun_azimuth    0 behind the camera, 90 to its left, 180 behind the cloud.
    lit_by         sky: radiance SKY from above the horizon and GROUND from below, W m^-2 sr^-1, also behind
                   the cloud.

    Densities are evaluated in double precision at the middles of VOXELS cells, kept in 1/4096, and between
    them trilinear for the technique and for Mitsuba alike.
    """

    optical_depth: Annotated[float, Axis(0.1, 200, log=True)] = 40.0
    sun_elevation: Annotated[float, Axis(2, 90, unit="deg")] = 45.0
    sun_azimuth: Annotated[float, Axis(0, 180, unit="deg")] = 90.0
    lit_by: Literal["sun", "sky", "both"] = "sun"

    LOW = (0.0, 0.0, 0.0)  # m, corners of the box
    HIGH = (1.0, 1.0, 1.0)
    VOXELS = (1, 1, 1)  # along x, y, z
    FIELD_OF_VIEW = 45.0
    SKY = (0.030, 0.045, 0.080)
    GROUND = (0.040, 0.040, 0.035)
    ROWS = 256

    def model(self) -> CloudModel:
        """What the density is modelled with."""
        raise NotImplementedError

    def eye(self) -> tuple[list[float], list[float]]:
        """Where the camera stands and what it looks at, m."""
        raise NotImplementedError

    def densities(self) -> np.ndarray:
        """(nz, ny, nx) float32 in [0, 1]."""
        return _densities(type(self), self._shape_fields())

    def _shape_fields(self) -> tuple:
        """The fields that the density depends on, as (name, value)."""
        return ()

    @property
    def sigma_t(self) -> float:
        """Extinction where the density is 1, 1/m, without rain."""
        cell = (self.HIGH[2] - self.LOW[2]) / self.VOXELS[2]
        return self.optical_depth / (float(self.densities().sum(axis=0).max()) * cell)

    def to_sun(self) -> list[float]:
        e, a = math.radians(self.sun_elevation), math.radians(self.sun_azimuth)
        return [-math.sin(a) * math.cos(e), -math.cos(a) * math.cos(e), math.sin(e)]

    def sky(self, w: Any) -> mi.Color3f:
        """Radiance from unit directions, W m^-2 sr^-1, turning over 12 degrees at the horizon."""
        t = dr.clip(0.5 + 5 * w.z, 0, 1)
        return dr.lerp(mi.Color3f(self.GROUND), mi.Color3f(self.SKY), t * t * (3 - 2 * t))

    def inside(self, p: Any) -> mi.Bool:
        """Whether points lie in the box."""
        return dr.all((p >= mi.Point3f(self.LOW)) & (p <= mi.Point3f(self.HIGH)))

    def bounds(self) -> tuple[list[float], list[float]]:
        return list(self.LOW), list(self.HIGH)

    def span(self, o: mi.Point3f, d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
        low, high = (mi.Point3f(self.LOW) - o) / d, (mi.Point3f(self.HIGH) - o) / d
        near = dr.maximum(dr.max(dr.minimum(low, high)), 0)
        far = dr.min(dr.maximum(low, high))
        hit = far > near
        return dr.select(hit, near, 0), dr.select(hit, far, 0)

    def shape(self) -> dict:
        """The box, as Mitsuba has it."""
        return {"type": "cube", "to_world": self._cube().scale(0.5).translate([1, 1, 1])}

    def _cube(self) -> mi.ScalarTransform4f:
        size = [(b - a) for a, b in zip(self.LOW, self.HIGH, strict=True)]
        return mi.ScalarTransform4f().translate(list(self.LOW)).scale(size)

    def sensor(self, size: int) -> dict:
        eye, target = self.eye()
        return perspective(eye, target, self.FIELD_OF_VIEW, size, far_clip=1e6)

    def mitsuba(self, size: int = 128) -> dict:
        sigma_t, albedo = self.rainy
        grid = mi.VolumeGrid(np.ascontiguousarray(self.densities()[..., None]))
        medium = {
            "type": "heterogeneous",
            "sigma_t": {
                "type": "gridvolume",
                "grid": grid,
                "use_grid_bbox": False,
                "wrap_mode": "clamp",
                "to_world": self._cube(),
            },
            "albedo": albedo,
            "scale": sigma_t,
            "phase": {"type": "hg", "g": self.g},
        }
        whole = {"type": "scene", "medium": medium}
        held = {"type": "ref", "id": "medium"}
        whole["cloud"] = {**self.shape(), "bsdf": {"type": "null"}, "interior": held}
        sensor = self.sensor(size)
        eye = self.eye()[0]
        if all(a < x < b for a, x, b in zip(self.LOW, eye, self.HIGH, strict=True)):
            sensor["medium"] = held
        if self.lit_by != "sky":
            whole["sun"] = point_sun(self.to_sun(), SUN_IRRADIANCE)
        if self.lit_by != "sun":
            whole["sky"] = environment_light(self.sky, self.ROWS)
        return {**whole, "sensor": sensor}

    def extinction(self) -> Callable[[mi.Point3f], mi.Float]:
        """sigma_t(p), 1/m, without rain: trilinear, 0 outside the box."""
        texture = _texture(type(self), self._shape_fields())
        low, size = mi.Point3f(self.LOW), mi.Vector3f(self.HIGH) - mi.Vector3f(self.LOW)
        sigma_t = self.sigma_t

        def extinction(p: mi.Point3f) -> mi.Float:
            inside = self.inside(p)
            return dr.select(inside, sigma_t * texture.eval((p - low) / size, inside)[0], 0)

        return extinction

    def _view(self, size: int, camera: Camera) -> View:
        cloud = Cloud(
            extinction=self.extinction(),
            span=self.span,
            albedo=self.albedo,
            g=self.g,
            precipitation=self.precipitation,
            model=self.model(),
            sigma_t=self.sigma_t,
        )
        irradiance = SUN_IRRADIANCE if self.lit_by != "sky" else 0.0
        sun = Sun(mi.Vector3f(self.to_sun()), 0.0, irradiance)
        sky = self.sky if self.lit_by != "sun" else None
        return View(size, size, camera, sun=sun, environment=sky, cloud=cloud, bounds=self.bounds())

    def view(self, size: int = 128) -> View:
        return self._view(size, camera_rays(mi.load_dict(self.sensor(size)), size))

    def probes(self, size: int = 128) -> View:
        """Points in the cloud on the camera's rays, in `camera`: origin is the point, direction runs from eye
        to sample. Each stands where its ray has lost PROBE_SHARE of all the light that it loses. The rays are
        taken evenly, row by row, from PROBE_RAYS times as many a side: those that lose PROBE_SHARE of what
        the one that loses most does."""
        rays = self.PROBE_RAYS * size
        seen = camera_rays(mi.load_dict(self.sensor(rays)), rays)
        extinction = self.extinction()
        near, far = self.span(seen.origin, seen.direction)
        step = (far - near) / self.PROBE_STEPS

        def until(most: mi.Float) -> tuple[mi.Float, mi.Float]:
            """The last step within an optical depth, and the depth of all steps."""

            def march(i, depth, t):
                here = near + (mi.Float(i) + 0.5) * step
                depth += extinction(seen.origin + here * seen.direction) * step
                return i + 1, depth, dr.select(depth < most, here, t)

            start = (mi.UInt32(0), dr.zeros(mi.Float, rays * rays), mi.Float(near))
            _, depth, t = dr.while_loop(start, lambda i, depth, t: i < self.PROBE_STEPS, march)
            return t, depth

        loss = 1 - dr.exp(-until(mi.Float(dr.inf))[1])
        t, _ = until(-dr.log(1 - self.PROBE_SHARE * loss))
        point = mi.Point3f(seen.origin + t * seen.direction)
        through = dr.compress(loss >= self.PROBE_SHARE * dr.max(loss))
        even = dr.uint64_array_t(mi.UInt32)(dr.arange(mi.UInt32, size * size)) * len(through) // size**2
        chosen = dr.gather(mi.UInt32, through, mi.UInt32(even))
        point, direction = (dr.gather(type(a), a, chosen) for a in (point, seen.direction))
        dr.eval(point, direction)
        return self._view(size, Camera(point, direction, seen.forward, 0.0, math.inf))

    PROBE_STEPS = 256
    PROBE_RAYS = 2
    PROBE_SHARE = 0.5


@functools.lru_cache(maxsize=4)
def _densities(kind: type[GridCloud], fields: tuple) -> np.ndarray:
    cloud = kind(**dict(fields))
    nx, ny, nz = kind.VOXELS
    i = dr.arange(mi.UInt32, nx * ny * nz)
    wide = dr.float64_array_t(mi.Float)
    at = [wide(n) + 0.5 for n in (i % nx, (i // nx) % ny, i // (nx * ny))]
    edge = [(b - a) / n for a, b, n in zip(kind.LOW, kind.HIGH, kind.VOXELS, strict=True)]
    p = mi.Point3d(*(a + x * e for a, x, e in zip(kind.LOW, at, edge, strict=True)))
    values = np.array(density(cloud.model(), p)).reshape(nz, ny, nx)
    return (np.round(values * 4096) / 4096).astype(np.float32)


@functools.lru_cache(maxsize=4)
def _texture(kind: type[GridCloud], fields: tuple) -> mi.Texture3f:
    values = _densities(kind, fields)
    return mi.Texture3f(mi.TensorXf(values[..., None]), use_accel=False, wrap_mode=dr.WrapMode.Clamp)


@scene(
    theme="clouds",
    shows="one fair-weather cloud, from beside, below, above or within",
    quantities=(RADIANCE, SINGLE_SCATTERING, SOURCE_FUNCTION, SUN_TRANSMITTANCE, TRANSMITTANCE),
    exposure=(0.0, 4.0),
)
@dataclass(frozen=True)
class Cumulus(GridCloud):
    """A cloud about 2.5 km across and 1.5 km high over a flat base at 1.15 km: three heaps in the weather
    map, each with its place, radius (m) and coverage in the middle."""

    seen: Literal["beside", "below", "above", "within"] = "beside"

    LOW = (-1600.0, -1600.0, 1100.0)
    HIGH = (1600.0, 1600.0, 2900.0)
    VOXELS = (96, 96, 54)
    FIELD_OF_VIEW = 38.0
    HEAPS = ((0.0, 0.0, 1400.0, 0.60), (-700.0, 200.0, 900.0, 0.48), (800.0, -200.0, 900.0, 0.46))
    TYPE = 0.92

    def model(self) -> CloudModel:
        def weather(x: Any, y: Any) -> Weather:
            coverage = 0 * x
            for at_x, at_y, radius, most in self.HEAPS:
                away = (x - at_x) ** 2 + (y - at_y) ** 2
                coverage = dr.maximum(coverage, most * (1 - away / radius**2))
            return Weather(coverage, 0 * x, self.TYPE)

        return CloudModel(base=1150.0, top=2850.0, weather=weather, tile=3500.0, detail_tile=600.0)

    def eye(self) -> tuple[list[float], list[float]]:
        return {
            "beside": ([0.0, -4600.0, 1700.0], [0.0, 0.0, 1900.0]),
            "below": ([0.0, -1400.0, 0.0], [0.0, -100.0, 1900.0]),
            "above": ([0.0, -3000.0, 4700.0], [0.0, 0.0, 1800.0]),
            "within": ([0.0, -400.0, 1800.0], [0.0, 0.0, 1900.0]),
        }[self.seen]
