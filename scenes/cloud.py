"""Sunlit clouds of one density: a layer and a ball, lit by a sun that is a point, before a black sky.

The medium scatters by a Henyey-Greenstein lobe of mean cosine g. Rain has two physical readings:
"denser" multiplies the extinction by the precipitation p; "absorbing" keeps the scattering and adds
absorption until the extinction is p times as large, so that the albedo becomes albedo / p. A technique
is given the cloud without its rain, and p.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from scenes.contract import (
    RADIANCE,
    SINGLE_SCATTERING,
    SOURCE_FUNCTION,
    Axis,
    Camera,
    Cloud,
    Scene,
    Sun,
    View,
    scene,
)
from scenes.mitsuba_parts import camera_rays, direction, orthographic, perspective, point_sun

SUN_IRRADIANCE = 1.0  # W/m^2 on a surface that faces the sun


@dataclass(frozen=True)
class SunlitCloud(Scene):
    """What layer and ball share. Subclasses give the shape, the way to the sun and the camera."""

    optical_depth: Annotated[float, Axis(0.1, 200, log=True)] = 16.0
    albedo: Annotated[float, Axis(0.9, 1)] = 1.0
    g: Annotated[float, Axis(-0.5, 0.95)] = 0.85
    precipitation: Annotated[float, Axis(1, 9)] = 1.0
    rain: Literal["denser", "absorbing"] = "denser"

    @property
    def sigma_t(self) -> float:
        """Extinction without rain, 1/m."""
        raise NotImplementedError

    @property
    def rainy(self) -> tuple[float, float]:
        """Extinction (1/m) and albedo with rain."""
        absorbing = self.precipitation if self.rain == "absorbing" else 1.0
        return self.sigma_t * self.precipitation, self.albedo / absorbing

    def to_sun(self) -> list[float]:
        """Unit direction to the sun."""
        raise NotImplementedError

    def shape(self) -> dict:
        """The cloud's outline as a Mitsuba shape."""
        raise NotImplementedError

    def sensor(self, size: int) -> dict:
        """The camera."""
        raise NotImplementedError

    def inside(self, p: mi.Point3f) -> mi.Bool:
        """Whether points lie in the cloud."""
        raise NotImplementedError

    def span(self, o: mi.Point3f, d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
        """Distances (m) between which the ray o + t d, t >= 0, is in the cloud; both 0 where it misses."""
        raise NotImplementedError

    def bounds(self) -> tuple[list[float], list[float]]:
        """Lower and upper corner of the cloud, m; infinite along axes on which nothing changes."""
        raise NotImplementedError

    def mitsuba(self, size: int = 128) -> dict:
        sigma_t, albedo = self.rainy
        medium = {
            "type": "homogeneous",
            "sigma_t": sigma_t,
            "albedo": albedo,
            "phase": {"type": "hg", "g": self.g},
        }
        return {
            "type": "scene",
            "cloud": {**self.shape(), "bsdf": {"type": "null"}, "interior": medium},
            "sun": point_sun(self.to_sun(), SUN_IRRADIANCE),
            "sensor": self.sensor(size),
        }

    def view(self, size: int = 128) -> View:
        return self._view(size, camera_rays(mi.load_dict(self.sensor(size)), size))

    def _view(self, size: int, camera: Camera) -> View:
        cloud = Cloud(
            extinction=lambda p: dr.select(self.inside(p), mi.Float(self.sigma_t), 0),
            span=self.span,
            albedo=self.albedo,
            g=self.g,
            precipitation=self.precipitation,
        )
        sun = Sun(mi.Vector3f(self.to_sun()), 0.0, SUN_IRRADIANCE)
        return View(size, size, camera, sun=sun, cloud=cloud, bounds=self.bounds())


@scene(
    theme="clouds",
    shows="a flat layer of cloud, seen from above or below in many directions at once",
    quantities=(RADIANCE, SINGLE_SCATTERING, SOURCE_FUNCTION),
    exposure=(0.0, 4.0),
)
@dataclass(frozen=True)
class CloudSlab(SunlitCloud):
    """A layer 1 m thick, 0 <= z <= 1, of vertical optical depth `optical_depth` without rain.

    For Mitsuba it ends at least `HALF_WIDTH / 2` from the origin. The sun at 2 degrees reaches any depth
    within 29 m of where it enters, the camera's rays are in the layer within 5 m of the axis, and light
    that walks sideways dies off over at most a few metres: the edges are out of sight by hundreds of
    metres. The box stands off centre because rays slip through between the two triangles of a face, which
    meet on its diagonal: 3 in a million through the origin.
    """

    optical_depth: Annotated[float, Axis(0.1, 200, log=True)] = 32.0
    sun_elevation: Annotated[float, Axis(2, 90, unit="deg")] = 60.0
    seen: Literal["above", "below"] = "above"

    HALF_WIDTH = 1000.0  # m
    CAMERA_GAP = 1.0  # m between the camera and the layer
    FIELD_OF_VIEW = 120.0  # deg across the image; 68 deg off the vertical in its corners
    FIRST_PROBE = 0.02  # optical depth of the top row of probes
    LAST_PROBE = 0.999  # optical depth of the bottom row over that of the layer

    @property
    def sigma_t(self) -> float:
        return self.optical_depth

    def to_sun(self) -> list[float]:
        return direction(self.sun_elevation)

    def shape(self) -> dict:
        w = self.HALF_WIDTH
        to_world = mi.ScalarTransform4f().translate([0.5 * w, 0, 0.5]).scale([w, w, 0.5])
        return {"type": "cube", "to_world": to_world}

    def sensor(self, size: int) -> dict:
        eye = 1 + self.CAMERA_GAP if self.seen == "above" else -self.CAMERA_GAP
        return perspective([0, 0, eye], [0, 0, 0.5], self.FIELD_OF_VIEW, size)

    def inside(self, p: mi.Point3f) -> mi.Bool:
        return (p.z >= 0) & (p.z <= 1)

    def bounds(self) -> tuple[list[float], list[float]]:
        return [-math.inf, -math.inf, 0.0], [math.inf, math.inf, 1.0]

    def span(self, o: mi.Point3f, d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
        bottom, top = -o.z / d.z, (1 - o.z) / d.z
        near, far = dr.maximum(dr.minimum(bottom, top), 0), dr.maximum(bottom, top)
        hit = far > near
        return dr.select(hit, near, 0), dr.select(hit, far, 0)

    def probes(self, size: int) -> View:
        """Points and directions for the source function, in `camera`: origin is the point x, direction
        the unit vector from eye to sample.

        Row i of n: x lies under the top by the vertical optical depth (without rain)
        d = FIRST (LAST / FIRST)^(i / (n - 1)), with FIRST = 0.02 and LAST = 0.999 optical_depth.
        Column j: the cosine c between that direction and the way to the sun runs evenly from -1 (seen
        from the sun's side) to 1 (seen against the sun). Directions turn through the vertical plane of
        the sun, downwards from the sun: w = c l + sqrt(1 - c^2) u with u = (sin e, 0, -cos e).
        """
        i = dr.arange(mi.UInt32, size * size)
        row, column = mi.Float(i // size) / (size - 1), mi.Float(i % size) / (size - 1)
        last = self.LAST_PROBE * self.optical_depth
        depth = self.FIRST_PROBE * dr.power(last / self.FIRST_PROBE, row)
        c = 2 * column - 1
        l = mi.Vector3f(self.to_sun())
        u = mi.Vector3f(l.z, 0, -l.x)
        point = mi.Point3f(0, 0, 1 - depth / self.sigma_t)
        camera = Camera(point, c * l + dr.safe_sqrt(1 - c * c) * u, -l, 0.0, math.inf)
        return self._view(size, camera)


@scene(
    theme="clouds",
    shows="a ball of cloud with limbs, a lit side and a dark side",
    quantities=(RADIANCE, SINGLE_SCATTERING),
    exposure=(0.0, 4.0),
)
@dataclass(frozen=True)
class CloudSphere(SunlitCloud):
    """A ball of radius 1 m round the origin, of optical depth `optical_depth` (without rain) across.

    A parallel camera looks along +y. At `sun_angle` 0 the sun is behind the camera, at 90 it stands at
    -x, at 180 behind the ball.
    """

    sun_angle: Annotated[float, Axis(0, 180, unit="deg")] = 90.0

    HALF_WIDTH = 1.1  # m that the camera sees to each side

    @property
    def sigma_t(self) -> float:
        return self.optical_depth / 2

    def to_sun(self) -> list[float]:
        a = math.radians(self.sun_angle)
        return [-math.sin(a), -math.cos(a), 0.0]

    def shape(self) -> dict:
        return {"type": "sphere"}

    def sensor(self, size: int) -> dict:
        return orthographic([0, -3, 0], [0, 0, 0], self.HALF_WIDTH, size)

    def inside(self, p: mi.Point3f) -> mi.Bool:
        return dr.squared_norm(p) <= 1

    def bounds(self) -> tuple[list[float], list[float]]:
        return [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]

    def span(self, o: mi.Point3f, d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
        middle = -dr.dot(o, d)
        half = dr.safe_sqrt(1 - dr.squared_norm(o + middle * d))
        far = middle + half
        hit = (half > 0) & (far > 0)
        return dr.select(hit, dr.maximum(middle - half, 0), 0), dr.select(hit, far, 0)
