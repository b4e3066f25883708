"""An upright section through a cloud's density: what a sampler of cloud textures has to find."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any

import mitsuba as mi
import numpy as np

from scenes.cloud_density import CloudModel, Weather, density
from scenes.contract import DENSITY, Axis, Camera, Cloud, View, scene
from scenes.cumulus import Cumulus
from scenes.section import Section


@scene(
    theme="clouds",
    shows="a cumulus cut through from base to top: its density without its light",
    quantities=(DENSITY,),
    exposure=(-1.0, 1.0),
)
@dataclass(frozen=True)
class DensitySection(Section):
    """The cloud of `Cumulus` cut at y = Y, 3200 m across and from 1100 to 2900 m above the ground.

    cover          factor on the coverage of the weather map, which reaches 0.6
    type           of all of the map: 0 stratus, 0.5 stratocumulus, 1 cumulus
    precipitation  of all of the map
    """

    cover: Annotated[float, Axis(0.4, 1.6)] = 1.0
    type: Annotated[float, Axis(0, 1)] = Cumulus.TYPE
    precipitation: Annotated[float, Axis(0, 1)] = 0.0

    Y = 40.0  # m

    def model(self) -> CloudModel:
        """Cumulus' own, under another weather."""
        whole = Cumulus().model()

        def weather(x: Any, y: Any) -> Weather:
            coverage = self.cover * whole.weather(x, y).coverage
            return Weather(coverage, self.precipitation + 0 * x, self.type)

        return replace(whole, weather=weather)

    def points(self, size: int) -> np.ndarray:
        """(3, size size) float64, m: middles of pixels, row by row from the top."""
        at = (np.arange(size) + 0.5) / size
        (left, _, bottom), (right, _, top) = Cumulus.LOW, Cumulus.HIGH
        z, x = np.meshgrid(top - (top - bottom) * at, left + (right - left) * at, indexing="ij")
        return np.stack([x.ravel(), np.full(size * size, self.Y), z.ravel()])

    def values(self, size: int) -> np.ndarray:
        return np.array(density(self.model(), mi.Point3d(self.points(size)))).reshape(size, size, 1)

    def given(self, size: int, camera: Camera) -> View:
        model = self.model()
        cloud = Cloud(
            extinction=lambda p: density(model, p),
            span=Cumulus().span,
            albedo=1.0,
            g=0.85,
            precipitation=1.0,
            sigma_t=1.0,
            model=model,
        )
        return View(size, size, camera, cloud=cloud)
