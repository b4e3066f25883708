"""Clouds that wind carries off and shears, cut upright: what textures pushed along have to keep up with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import mitsuba as mi
import numpy as np

from scenes.broken_field import layer, wave
from scenes.cloud_density import CloudModel, Weather, density
from scenes.contract import DENSITY, Axis, Camera, View, scene
from scenes.section import Section

WAVES = ((0.24, 0.07, 0.3), (-0.11, 0.19, 1.1))
"""Cycles a km along x and y, and phase, of the waves of coverage."""
COVER, SWING = 0.35, 0.25
"""Mean coverage, and how far the waves take it from there."""
TYPE = 0.92


def weather(x: Any, y: Any) -> Weather:
    """Heaps of cumulus that stand 4 km apart, at places in m."""
    heaps = sum(wave(x, y, *w) for w in WAVES) / len(WAVES)
    return Weather(COVER + SWING * heaps, 0 * x, TYPE)


@dataclass(frozen=True)
class Wind:
    """Clouds as they were at first (`model`), and the air that moves them: wind at their base and what it
    gains up to their top (x, y), updraft, all in m/s, and for how long it has blown (s)."""

    model: CloudModel
    base: tuple[float, float]
    gain: tuple[float, float]
    updraft: float
    time: float


@scene(
    theme="clouds",
    shows="a field of clouds that the wind has carried along, cut upright",
    quantities=(DENSITY,),
    exposure=(-1.0, 1.0),
)
@dataclass(frozen=True)
class BlownField(Section):
    """An upright section along x, 8 km across and as high as the layer, at y = 0.

    The air moves by the wind u(z) = (speed + shear h) DIRECTION + updraft up, with h = 0 at the layer's base
    and 1 at its top, and takes the density with it: dq/dt + u . grad q = 0, from the model's at time 0.
    """

    time: Annotated[float, Axis(0, 1200, unit="s")] = 60.0
    speed: Annotated[float, Axis(0, 60, unit="m/s")] = 10.0
    shear: Annotated[float, Axis(0, 40, unit="m/s")] = 5.0
    updraft: Annotated[float, Axis(0, 4, unit="m/s")] = 1.0

    DIRECTION = (0.96, 0.28)
    BASE, TOP = 1500.0, 4000.0  # m
    ACROSS = 8e3  # m

    def wind(self) -> Wind:
        """Clouds and the air that moves them."""
        model = CloudModel(self.BASE, self.TOP, weather)
        base, gain = (tuple(u * c for c in self.DIRECTION) for u in (self.speed, self.shear))
        return Wind(model, base, gain, self.updraft, self.time)

    def points(self, size: int) -> np.ndarray:
        """(3, size size) float64, m: middles of pixels, row by row from the top."""
        at = (np.arange(size) + 0.5) / size
        z, x = np.meshgrid(self.TOP - (self.TOP - self.BASE) * at, self.ACROSS * (at - 0.5), indexing="ij")
        return np.stack([x.ravel(), np.zeros(size * size), z.ravel()])

    def origins(self, p: np.ndarray) -> np.ndarray:
        """(3, n), m: where the air at points p was at time 0. It came up from z - updraft t, and so felt the
        wind at the height between on average."""
        z = p[2] - self.updraft * self.time
        h = ((z + p[2]) / 2 - self.BASE) / (self.TOP - self.BASE)
        along = (self.speed + self.shear * h) * self.time
        return np.stack([p[0] - along * self.DIRECTION[0], p[1] - along * self.DIRECTION[1], z])

    def values(self, size: int) -> np.ndarray:
        origins = mi.Point3d(self.origins(self.points(size)))
        return np.array(density(self.wind().model, origins)).reshape(size, size, 1)

    def given(self, size: int, camera: Camera) -> View:
        wind = self.wind()
        return View(size, size, camera, cloud=layer(wind.model, wind))
