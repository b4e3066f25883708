"""Light in a cloud on a grid by random walks in float64 NumPy: a second route beside Mitsuba.

Flights through the varying density are drawn with null collisions under the largest extinction; what is left
of the sun's light at a point is estimated by the product of the shares of null collisions on the way (ratio
tracking). Neither knows of voxels: the density is interpolated by SciPy.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import map_coordinates

from reference.slab_monte_carlo import phase, turn
from scenes.cloud import SUN_IRRADIANCE
from scenes.cumulus import GridCloud


class Grid:
    """A cloud's extinction: `most` (1/m) and at points (n, 3), in m; how far its box goes along rays."""

    def __init__(self, scene: GridCloud) -> None:
        self.values = scene.rainy[0] * scene.densities().astype(np.float64)
        self.most = float(self.values.max())
        self.low, self.high = np.array(scene.LOW), np.array(scene.HIGH)
        self.edge = (self.high - self.low) / scene.VOXELS

    def extinction(self, p: np.ndarray) -> np.ndarray:
        """sigma_t (n,), 1/m, with rain."""
        at = ((p - self.low) / self.edge - 0.5).T[::-1]
        return map_coordinates(self.values, at, order=1, mode="nearest")

    def span(self, p: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances (m) at which rays enter, at least 0, and leave; not before they enter."""
        with np.errstate(divide="ignore"):
            a, b = (self.low - p) / w, (self.high - p) / w
        near = np.maximum(np.minimum(a, b).max(axis=1), 0)
        return near, np.maximum(np.maximum(a, b).min(axis=1), near)


def transmittance(grid: Grid, p: np.ndarray, w: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """One unbiased estimate for each ray (n, 3), as far as the box goes."""
    t, far = grid.span(p, w)
    left, flying = np.ones(len(p)), np.arange(len(p))
    while len(flying):
        t[flying] += rng.exponential(1 / grid.most, len(flying))
        flying = flying[t[flying] < far[flying]]
        left[flying] *= 1 - grid.extinction(p[flying] + t[flying, None] * w[flying]) / grid.most
    return left


def flight(
    grid: Grid, p: np.ndarray, w: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Where rays first meet a droplet, and which of them do before they leave."""
    t, far = grid.span(p, w)
    met, flying = np.zeros(len(p), bool), np.arange(len(p))
    while len(flying):
        t[flying] += rng.exponential(1 / grid.most, len(flying))
        flying = flying[t[flying] < far[flying]]
        share = grid.extinction(p[flying] + t[flying, None] * w[flying]) / grid.most
        real = rng.random(len(flying)) < share
        met[flying[real]] = True
        flying = flying[~real]
    return p + t[:, None] * w, met


def radiance(
    scene: GridCloud,
    grid: Grid,
    p: np.ndarray,
    w: np.ndarray,
    rng: np.random.Generator,
    orders: float = math.inf,
) -> np.ndarray:
    """One estimate (n, 3) of L(p, w), W m^-2 sr^-1, for points and unit directions (n, 3), of light that was
    scattered at most `orders` times."""
    total, lane, weight, order = np.zeros((len(p), 3)), np.arange(len(p)), 1.0, 0
    sky = scene.lit_by != "sun"
    while len(lane):
        x, met = flight(grid, p, w, rng)
        if sky:
            total[lane[~met]] += weight * _sky(scene, w[~met])
        if order == orders:
            break
        p, w, lane, order = x[met], w[met], lane[met], order + 1
        weight *= scene.rainy[1]
        total[lane] += weight * _sunlight(scene, grid, p, w, rng)[:, None]
        w = turn(w, scene.g, rng)
    return total


def source_function(
    scene: GridCloud, grid: Grid, p: np.ndarray, w: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """One estimate (n, 3) of what points scatter towards where directions come from, all orders."""
    return _sunlight(scene, grid, p, w, rng)[:, None] + radiance(scene, grid, p, turn(w, scene.g, rng), rng)


def _sunlight(scene: GridCloud, grid: Grid, p: np.ndarray, w: np.ndarray, rng) -> np.ndarray:
    if scene.lit_by == "sky":
        return np.zeros(len(p))
    l = np.broadcast_to(scene.to_sun(), p.shape)
    return SUN_IRRADIANCE * phase(np.sum(w * l, axis=1), scene.g) * transmittance(grid, p, l, rng)


def _sky(scene: GridCloud, w: np.ndarray) -> np.ndarray:
    t = np.clip(0.5 + 5 * w[:, 2:], 0, 1)
    up = t * t * (3 - 2 * t)
    return (1 - up) * np.array(scene.GROUND) + up * np.array(scene.SKY)
