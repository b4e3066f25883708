"""The noise that clouds are carved from, on a slanted plane through its tile."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import DENSITY, Axis, Camera, Scene, View, scene


@dataclass(frozen=True)
class Recipe:
    """Which channel of the shape noise is asked for, 0 to 3, and the cells of its coarsest octave a tile."""

    channel: int
    cells: int


@scene(
    theme="clouds",
    shows="one channel of the noise that clouds are carved from, on a slanted plane",
    quantities=(DENSITY,),
    exposure=(-1.0, 1.0),
)
@dataclass(frozen=True)
class NoiseTile(Scene):
    """A plane through a cube of noise with an edge of 1 m, which repeats in all directions.

    channel  R: Perlin noise swollen by Worley noise; G, B, A: sums of ever finer Worley octaves.
    cells    a tile along an edge, of the coarsest octave; the finest has eight times as many.
    span     tiles from edge to edge of the image.
    """

    channel: Literal["R", "G", "B", "A"] = "R"
    cells: Annotated[int, Axis(2, 32, log=True)] = 8
    span: Annotated[float, Axis(0.05, 4, log=True)] = 1.0

    MIDDLE = (0.37, 0.61, 0.53)  # m
    ACROSS = (2 / 3, 2 / 3, -1 / 3)  # unit vectors of the plane
    DOWN = (1 / math.sqrt(2), -1 / math.sqrt(2), 0.0)

    def points(self, size: int) -> np.ndarray:
        """(3, size size) float64, m: middles of pixels, row by row from the top."""
        at = (np.arange(size) + 0.5) / size - 0.5
        down, across = (self.span * x.ravel() for x in np.meshgrid(at, at, indexing="ij"))
        parts = zip(self.MIDDLE, self.ACROSS, self.DOWN, strict=True)
        return np.stack([m + across * a + down * d for m, a, d in parts])

    def probes(self, size: int = 128) -> View:
        """The points as origins of the camera's rays."""
        points = mi.Point3f(self.points(size).astype(np.float32))
        ahead = mi.Vector3f(0, 0, 1)
        camera = Camera(points, dr.repeat(ahead, size * size), ahead, 0.0, math.inf)
        return View(size, size, camera, noise=Recipe("RGBA".index(self.channel), self.cells))
