"""A clear sky with clouds drifting over it: light from directions, without the sun's disk."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import Axis, Scene
from scenes.mitsuba_parts import direction

BRIGHTNESS = 5.0  # takes the clear sky's radiance near 1
CLOUD = 1.1  # W m^-2 sr^-1, away from the sun
GROUND = (0.26, 0.22, 0.17)  # W m^-2 sr^-1, below the horizon
OCTAVES = 6


@dataclass(frozen=True)
class Sky(Scene):
    """Mitsuba's clear sky (Hosek and Wilkie) of turbidity 3 behind a layer of clouds of noise.

    The clouds are whiter than the sky, brighter around the sun, and thin out towards the horizon.
    """

    sun_elevation: Annotated[float, Axis(2, 88, unit="deg")] = 25.0
    sun_azimuth: Annotated[float, Axis(0, 360, unit="deg")] = 150.0
    sun_irradiance: Annotated[float, Axis(0, 20, unit="W/m^2")] = 5.0
    cloudiness: Annotated[float, Axis(0, 1)] = 0.5

    def toward_sun(self) -> list[float]:
        """Unit vector."""
        return direction(self.sun_elevation, self.sun_azimuth)

    def sky(self, w: mi.Vector3f) -> mi.Color3f:
        """Radiance (W m^-2 sr^-1) from unit directions, z up, without the sun's disk."""
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(w))
        si.wi = mi.Vector3f(-w.x, -w.y, -dr.maximum(w.z, 1e-3))
        clear = BRIGHTNESS * _clear_sky(tuple(self.toward_sun())).eval(si)
        glow = dr.exp(6 * (dr.dot(w, mi.Vector3f(self.toward_sun())) - 1))
        clouds = mi.Color3f(CLOUD * (0.6 + 2 * glow))
        return dr.select(w.z > 0, dr.lerp(clear, clouds, self.cover(w)), mi.Color3f(GROUND))

    def cover(self, w: mi.Vector3f) -> mi.Float:
        """Share of the clear sky that clouds hide, 0 to 1."""
        at = mi.Point2f(w.x, w.y) / (dr.maximum(w.z, 0) + 0.15)
        random, noise = np.random.default_rng(3), mi.Float(0)
        for octave in range(OCTAVES):
            for angle, phase in random.uniform(0, 2 * np.pi, (5, 2)):
                k = mi.Vector2f(float(np.cos(angle)), float(np.sin(angle))) * 1.7 * 2**octave
                noise += 0.6**octave * dr.cos(dr.dot(k, at) + float(phase))
        thickness = 0.6 * noise + 6 * self.cloudiness - 3
        low = dr.clip(w.z / 0.25, 0, 1)
        return 0.95 * low / (1 + dr.exp(-2 * thickness)) * min(10 * self.cloudiness, 1)


@functools.lru_cache(maxsize=4)
def _clear_sky(toward: tuple[float, float, float]) -> mi.Emitter:
    return mi.load_dict(
        {"type": "sunsky", "sun_direction": list(toward), "turbidity": 3.0, "albedo": 0.3, "sun_scale": 0.0}
    )
