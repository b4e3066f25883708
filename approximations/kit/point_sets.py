"""Sets of sample points that keep apart, made ahead of time in NumPy.

Mitchell's best candidates: of many random points the one farthest from all that were taken is taken next, so
that every prefix of the set is spread over the shape too. The first point is the middle.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.spatial.distance import cdist

CANDIDATES = 64


def best_candidates(n: int, shape: Literal["square", "disk", "ball"], seed: int) -> np.ndarray:
    """(n, 2 or 3) points of [-1, 1]^2, of the unit disk or of the unit ball, float64."""
    rng = np.random.default_rng(seed)
    points = np.zeros((n, 3 if shape == "ball" else 2))
    for k in range(1, n):
        candidates = rng.uniform(-1, 1, (2 * CANDIDATES, points.shape[1]))
        if shape != "square":
            candidates = candidates[np.linalg.norm(candidates, axis=1) < 1]
        points[k] = candidates[cdist(candidates, points[:k]).min(axis=1).argmax()]
    return points


def spiral(n: int) -> np.ndarray:
    """(n, 2) even points of the unit disk, for averages that stand for the whole disk."""
    i = np.arange(n)
    radius, turn = np.sqrt((i + 0.5) / n), np.pi * (3 - np.sqrt(5)) * i
    return radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def lattice(n: int) -> np.ndarray:
    """(m^2, 2) centres of the cells of [-1, 1]^2 cut in m x m, m the whole root of n."""
    m = int(np.sqrt(n))
    i = (2 * np.arange(m) + 1) / m - 1
    return np.stack(np.meshgrid(i, i), axis=-1).reshape(-1, 2)
