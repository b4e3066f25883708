"""Volumes: grids of cubic cells over a box, mips, blur, number formats, trilinear lookup.

Values are NumPy arrays (nz, ny, nx) or (nz, ny, nx, channels), taken at the centres of the cells; the cell of
index 0 touches the lower corner. Lookups beyond the outermost centres are clamped to them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy import ndimage


@dataclass(frozen=True)
class Grid:
    """low: lower corner (m); cell: edge of a cell (m); shape: cells along z, y and x."""

    low: tuple[float, float, float]
    cell: float
    shape: tuple[int, int, int]


@dataclass
class Volume:
    """A grid's values as a texture, and where it stands: lower corner and edges, m."""

    texture: mi.Texture3f
    low: mi.Point3f
    span: mi.Vector3f


def grid_over(bounds: tuple[Any, Any], resolution: int) -> Grid:
    """Cubic cells from the lower corner on, `resolution` of them along the box's longest edge."""
    low, high = (tuple(float(x) for x in corner) for corner in bounds)
    cell = max(b - a for a, b in zip(low, high, strict=True)) / resolution
    counts = [math.ceil((b - a) / cell - 1e-6) for a, b in zip(low, high, strict=True)]
    return Grid(low, cell, (counts[2], counts[1], counts[0]))


def cell_centres(grid: Grid) -> mi.Point3f:
    """One point per cell, x fastest."""
    nz, ny, nx = grid.shape
    i = dr.arange(mi.UInt32, nx * ny * nz)
    cell = mi.Vector3f(i % nx, (i // nx) % ny, i // (nx * ny)) + 0.5
    return mi.Point3f(grid.low) + grid.cell * cell


def on_grid(grid: Grid, values: mi.Float | mi.Vector3f) -> np.ndarray:
    """Values of one lane per cell as an array of the grid's shape, vectors with their components last."""
    array = np.array(values)
    return array.reshape(grid.shape) if array.ndim == 1 else array.T.reshape(*grid.shape, len(array))


def as_volume(grid: Grid, values: np.ndarray | mi.Float) -> Volume:
    """The values, an array or one lane per cell, as a trilinear texture."""
    lanes = values if isinstance(values, mi.Float) else mi.Float(np.ravel(values).astype(np.float32))
    texels = mi.TensorXf(lanes, (*grid.shape, dr.width(lanes) // math.prod(grid.shape)))
    texture = mi.Texture3f(texels, use_accel=False, wrap_mode=dr.WrapMode.Clamp)
    nz, ny, nx = grid.shape
    return Volume(texture, mi.Point3f(grid.low), grid.cell * mi.Vector3f(nx, ny, nz))


def look_up(volume: Volume, p: mi.Point3f) -> mi.Float:
    """Trilinear value of the first channel at p."""
    return look_up_all(volume, p)[0]


def look_up_all(volume: Volume, p: mi.Point3f) -> list[mi.Float]:
    """Trilinear values of all channels at p."""
    return volume.texture.eval((p - volume.low) / volume.span)


def blurred(values: np.ndarray, sigma: float) -> np.ndarray:
    """Separable Gaussian blur of `sigma` cells, 0 for none; beyond its faces a volume goes on as it ends."""
    return ndimage.gaussian_filter(values, sigma, mode="nearest") if sigma else values


def halved(grid: Grid, values: np.ndarray) -> tuple[Grid, np.ndarray]:
    """The next mip: means over 2 x 2 x 2 cells. An odd last layer counts twice."""
    rest = values.shape[3:]
    padded = np.pad(values, [*((0, n % 2) for n in grid.shape), *[(0, 0)] * len(rest)], mode="edge")
    nz, ny, nx = (n // 2 for n in padded.shape[:3])
    means = padded.reshape(nz, 2, ny, 2, nx, 2, *rest).mean(axis=(1, 3, 5))
    return Grid(grid.low, 2 * grid.cell, (nz, ny, nx)), means


def stored(values: np.ndarray, reach: float, bits: int) -> np.ndarray:
    """Values from -reach to reach as integers of so many bits hold them, 0 among them; 32 leaves them alone.

    The listing's form: of 8 bits the 255 steps from 1 to 255, 128 for 0."""
    if bits == 32:
        return values
    steps = 2 ** (bits - 1) - 1
    return reach * np.round(steps * np.clip(values / reach, -1, 1)) / steps
