"""The noise that clouds are carved from, on a slanted plane through its tile."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import mitsuba as mi
import numpy as np

from scenes.cloud_noise import perlin, worley
from scenes.contract import DENSITY, Axis, Camera, View, scene
from scenes.section import Section


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
class NoiseTile(Section):
    """A plane through a cube of noise with an edge of 1 m, which repeats in all directions.

    channel  R: Perlin noise swollen by Worley noise; G, B, A: sums of ever finer Worley octaves.
    cells    a tile along an edge, of the coarsest octave; the finest has eight times as many.
    span     tiles from edge to edge of the image.

    With N_n and w_n Perlin and Worley octaves of n cells, W = (5 w_a + 2 w_b + w_c) / 8 and c the cells
    of the coarsest, P = (1 + (4 N_c + 2 N_2c + N_4c) / 7) / 2 and R is 1 - (1 - P) (1 - W), W of c, 4c
    and 7c: of the readings of "Perlin-Worley" the one that stays between 0 and 1.
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

    def values(self, size: int) -> np.ndarray:
        q, c = mi.Point3d(self.points(size)), self.cells

        def octaves(*cells: int) -> np.ndarray:
            return np.array([5, 2, 1]) @ [np.array(worley(q, n)) for n in cells] / 8

        if self.channel == "R":
            n = np.array([4, 2, 1]) @ [np.array(perlin(q, f)) for f in (c, 2 * c, 4 * c)] / 7
            image = 1 - (0.5 - 0.5 * n) * (1 - octaves(c, 4 * c, 7 * c))
        elif self.channel == "A":
            image = np.array([0.75, 0.25]) @ [np.array(worley(q, n)) for n in (4 * c, 8 * c)]
        else:
            k = c if self.channel == "G" else 2 * c
            image = octaves(k, 2 * k, 4 * k)
        return image.reshape(size, size, 1)

    def given(self, size: int, camera: Camera) -> View:
        return View(size, size, camera, noise=Recipe("RGBA".index(self.channel), self.cells))
