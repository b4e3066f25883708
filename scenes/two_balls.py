"""Two balls of cloud side by side: bulges, and between them the crease that "powder" was made for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi

from scenes.cloud import SUN_IRRADIANCE, SunlitCloud
from scenes.contract import RADIANCE, SINGLE_SCATTERING, Axis, scene
from scenes.mitsuba_parts import orthographic, point_sun


@scene(
    theme="clouds",
    shows="two balls of cloud that touch, with a crease between two bulges",
    quantities=(RADIANCE, SINGLE_SCATTERING),
    exposure=(0.0, 4.0),
)
@dataclass(frozen=True)
class TwoBalls(SunlitCloud):
    """Balls of radius 1 m, each of optical depth `optical_depth` (without rain) across.

    gap        clear air between them, m. They touch at 0 and never overlap, so that each has its own surface.
    turn       of the line through their middles, which lie at z = 0: at 0 they stand side by side before the
               camera, and as it grows the left one comes forward until at 90 it hides the other.
    sun_angle  0 behind the camera, 90 overhead, 180 behind the cloud.

    A parallel camera looks along +y and sees one bulge at each side. The crease is where the right ball goes
    out of sight behind the left one, by default at x = 0.134 m. At the height of the middles, by walks,

        sun_angle                           0       45      90
        crease, x = 0.12, over bulge        0.81    0.93    1.30    +- 0.04
        free limb, x = -1.83, over bulge    0.37    0.41    0.62    +- 0.02

    of the radiance in front of the left ball's middle: a crease is at most a fifth darker than a bulge, while
    a limb with clear air behind it lacks two fifths and more.

    Mitsuba lifts rays off a surface that they leave by about 1e-4 m: within 1.4 cm of where the balls touch,
    2e-4 of the face of a ball, a ray may come out of one and be taken to be past the other's surface.
    """

    gap: Annotated[float, Axis(0, 2, unit="m")] = 0.0
    turn: Annotated[float, Axis(0, 90, unit="deg")] = 30.0
    sun_angle: Annotated[float, Axis(0, 180, unit="deg")] = 45.0

    @property
    def sigma_t(self) -> float:
        return self.optical_depth / 2

    def to_sun(self) -> list[float]:
        a = math.radians(self.sun_angle)
        return [0.0, -math.cos(a), math.sin(a)]

    def middles(self) -> tuple[list[float], list[float]]:
        """Middles of the left ball and of the right one, m."""
        a, far = math.radians(self.turn), 1 + self.gap / 2
        right = [far * math.cos(a), far * math.sin(a), 0.0]
        return [-x for x in right], right

    def sensor(self, size: int) -> dict:
        return orthographic([0, -6, 0], [0, 0, 0], self.half_width, size)

    @property
    def half_width(self) -> float:
        """How far the camera sees to each side, m."""
        return 2.1 + self.gap / 2

    def mitsuba(self, size: int = 128) -> dict:
        sigma_t, albedo = self.rainy
        phase = {"type": "hg", "g": self.g}
        medium = {"type": "homogeneous", "sigma_t": sigma_t, "albedo": albedo, "phase": phase}
        whole = {"type": "scene", "medium": medium}
        for name, middle in zip(("left", "right"), self.middles(), strict=True):
            held = {"type": "ref", "id": "medium"}
            ball = {"type": "sphere", "center": middle, "radius": 1.0}
            whole[name] = {**ball, "bsdf": {"type": "null"}, "interior": held}
        return {**whole, "sun": point_sun(self.to_sun(), SUN_IRRADIANCE), "sensor": self.sensor(size)}

    def inside(self, p: mi.Point3f) -> mi.Bool:
        left, right = (dr.squared_norm(p - mi.Point3f(c)) <= 1 for c in self.middles())
        return left | right

    def bounds(self) -> tuple[list[float], list[float]]:
        left, right = self.middles()
        pairs = list(zip(left, right, strict=True))
        return [min(p) - 1 for p in pairs], [max(p) + 1 for p in pairs]

    def span(self, o: mi.Point3f, d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
        """Distances (m) between which the ray o + t d, t >= 0, meets cloud, with the clear air between the
        balls; both 0 where it misses."""
        near, far = mi.Float(dr.inf), mi.Float(0)
        for c in self.middles():
            middle = dr.dot(mi.Point3f(c) - o, d)
            half = dr.safe_sqrt(1 - dr.squared_norm(o + middle * d - mi.Point3f(c)))
            hit = (half > 0) & (middle + half > 0)
            near = dr.minimum(near, dr.select(hit, dr.maximum(middle - half, 0), dr.inf))
            far = dr.maximum(far, dr.select(hit, middle + half, 0))
        return dr.select(far > 0, near, 0), far
