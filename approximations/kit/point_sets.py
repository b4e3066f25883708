"""Sets of sample points that keep apart, made ahead of time in NumPy.

Mitchell's best candidates: of many random points the one farthest from all that were taken is taken next, so
that every prefix of the set is spread over the shape too. Distances run across opposite sides of the square
or cube, which keeps its edges from being crowded; what lies outside a disk or ball is left out. The first
point is the middle.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from approximations.kit.sampling import GOLDEN_ANGLE

Shape = Literal["square", "disk", "ball"]
CANDIDATES = 64
SHARE = {"square": 1.0, "disk": 0.7, "ball": 0.4}
"""Of points that lie in the shape, a little less than they are."""


def best_candidates(n: int, shape: Shape, seed: int) -> np.ndarray:
    """(n, 2 or 3) points of [-1, 1]^2, of the unit disk or of the unit ball, float64."""
    rng, dimensions = np.random.default_rng(seed), 3 if shape == "ball" else 2
    points = np.full((int(np.ceil((n + 8) / SHARE[shape])), dimensions), 0.5)
    for k in range(1, len(points)):
        candidates = rng.random((CANDIDATES, dimensions))
        distance, _ = cKDTree(points[:k], boxsize=1).query(candidates)
        points[k] = candidates[distance.argmax()]
    return _shaped(points, shape)[:n]


def random_points(n: int, shape: Shape, seed: int) -> np.ndarray:
    """As many independent points of the same shapes."""
    return _shaped(np.random.default_rng(seed).random((8 * n, 3 if shape == "ball" else 2)), shape)[:n]


def _shaped(points: np.ndarray, shape: Shape) -> np.ndarray:
    points = 2 * points - 1
    return points if shape == "square" else points[np.linalg.norm(points, axis=1) < 1]


def spiral(n: int) -> np.ndarray:
    """(n, 2) even points of the unit disk, for averages that stand for the whole disk."""
    i = np.arange(0.5, n)
    return np.sqrt(i / n)[:, None] * np.stack([np.cos(GOLDEN_ANGLE * i), np.sin(GOLDEN_ANGLE * i)], axis=1)


def lattice(n: int) -> np.ndarray:
    """(m^2, 2) centres of the cells of [-1, 1]^2 cut in m x m, m the whole root of n."""
    m = int(np.sqrt(n))
    middles = (2 * np.arange(0.5, m) / m) - 1
    return np.array([(x, y) for y in middles for x in middles])
