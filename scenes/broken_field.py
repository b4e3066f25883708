"""Broken clouds as far as one can see, cut level: what a map of the weather has to tell apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.cloud_density import CloudModel, Weather, density
from scenes.contract import DENSITY, Axis, Camera, Cloud, View, scene
from scenes.section import Section

WAVES = ((0.043, 0.011, 0.4), (-0.021, 0.061, 1.7), (0.083, 0.047, 2.6), (-0.109, 0.089, 4.1))
"""Cycles a km along x and y, and phase, of the waves of the coverage: none of them fits into 60 km."""
TYPE = (0.033, -0.027, 1.0)
"""The same of the type's."""
MIDDLE = 30e3  # m, of the map and of the section, along x and y
ACROSS = (0.8253356, 0.5646425)  # unit vector from ahead of the front to behind it
RAIN = 5e3  # m from the front to the middle of the rain, and half the breadth of its band


def weather(x: Any, y: Any, cover: float, front: float, rain: float) -> Weather:
    """At places (m): C = cover + min(cover, 1 - cover) (0.6 w + 0.4 s), w a mean of waves and s a step,
    each from -1 to 1; s rises over `front` (m). Rain falls behind the front, at most `rain`."""
    waves = sum(wave(x, y, *w) for w in WAVES) / len(WAVES)
    s = ACROSS[0] * (x - MIDDLE) + ACROSS[1] * (y - MIDDLE)
    t = dr.clip(0.5 + s / front, 0, 1)
    step = 2 * t * t * (3 - 2 * t) - 1
    band = dr.maximum(1 - ((s - RAIN) / RAIN) ** 2, 0)
    coverage = cover + min(cover, 1 - cover) * (0.6 * waves + 0.4 * step)
    return Weather(coverage, rain * band * band, 0.55 + 0.4 * wave(x, y, *TYPE))


def wave(x: Any, y: Any, kx: float, ky: float, phase: float) -> Any:
    """Of kx and ky cycles a km, -1 to 1, at places in m."""
    return dr.cos(2e-3 * dr.pi * (kx * x + ky * y) + phase)


@scene(
    theme="clouds",
    shows="a front of rain and the broken clouds before it, from above and cut level",
    quantities=(DENSITY,),
    exposure=(-1.0, 1.0),
)
@dataclass(frozen=True)
class BrokenField(Section):
    """A level section at the share `height` of a layer between 1500 and 4000 m, a square of edge `extent`
    about (30, 30) km, y to the top.

    cover   mean coverage, which swings up to 1 or down to 0 about it
    front   breadth of the line over which clouds close up
    rain    most precipitation behind that line
    """

    cover: Annotated[float, Axis(0, 1)] = 0.4
    front: Annotated[float, Axis(3, 10e3, log=True, unit="m")] = 300.0
    rain: Annotated[float, Axis(0, 1)] = 0.8
    extent: Annotated[float, Axis(4e3, 240e3, log=True, unit="m")] = 40e3
    height: Annotated[float, Axis(0.03, 0.9)] = 0.3

    BASE, TOP = 1500.0, 4000.0  # m

    def model(self) -> CloudModel:
        """Of the whole layer."""
        return CloudModel(self.BASE, self.TOP, lambda x, y: weather(x, y, self.cover, self.front, self.rain))

    def points(self, size: int) -> np.ndarray:
        """(3, size size) float64, m: middles of pixels, row by row from the top."""
        at = self.extent * ((np.arange(size) + 0.5) / size - 0.5)
        y, x = np.meshgrid(MIDDLE - at, MIDDLE + at, indexing="ij")
        z = np.full(size * size, self.BASE + self.height * (self.TOP - self.BASE))
        return np.stack([x.ravel(), y.ravel(), z])

    def values(self, size: int) -> np.ndarray:
        return np.array(density(self.model(), mi.Point3d(self.points(size)))).reshape(size, size, 1)

    def given(self, size: int, camera: Camera) -> View:
        model = self.model()
        return View(size, size, camera, cloud=layer(model, model))


def layer(model: CloudModel, told: Any) -> Cloud:
    """A layer of cloud without end, of extinction 1/m where the density is 1; `told`: what a technique knows
    of how it is modelled."""

    def span(o: mi.Point3f, d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
        bottom, top = (model.base - o.z) / d.z, (model.top - o.z) / d.z
        near, far = dr.maximum(dr.minimum(bottom, top), 0), dr.maximum(bottom, top)
        return dr.select(far > near, near, 0), dr.select(far > near, far, 0)

    return Cloud(lambda p: density(model, p), span, 1.0, 0.85, 1.0, sigma_t=1.0, model=told)
