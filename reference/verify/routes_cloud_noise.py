r"""Noise and density of clouds, put together again in NumPy from the points and vectors of the lattice.

Worley noise: all feature points of a tile in a k-d tree that repeats, instead of the 27 cells about a point.
Perlin noise: vectors from a list of the 12 edges and weights by a product over corners. Hashes are written
out here as well (TEA, four rounds).
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.spatial import cKDTree

from reference.closed_form.cloud_noise import noise_on_plane
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE, name
from scenes.contract import DENSITY
from scenes.noise_tile import NoiseTile

EDGES = np.array(
    [
        [[(1, 1, 0), (0, 1, 1), (1, 0, 1)], [(1, -1, 0), (0, 1, -1), (-1, 0, 1)]],
        [[(-1, 1, 0), (0, -1, 1), (1, 0, -1)], [(-1, -1, 0), (0, -1, -1), (-1, 0, -1)]],
    ]
)
"""Vectors to the middles of a cube's edges, by the signs of the first and of the second part and the turn."""
WITHIN = 1e-12


@check(
    "route",
    claim="noise of clouds is what nearest points of a tree and vectors of a list say",
    routes=("k-d tree and list", "closed form"),
    scenes=("NoiseTile",),
)
def noise_against_tree(seed: int) -> list[Comparison]:
    """All channels, beyond the tile's faces too, and coarser noise."""
    found = []
    for fields in (
        *({"channel": c} for c in "RGBA"),
        {"span": 3.0},
        {"cells": 3, "channel": "R"},
        {"cells": 3, "channel": "A"},
    ):
        scene = NoiseTile(**fields)
        q, c = scene.points(SIZE).T, scene.cells
        if scene.channel == "R":
            w = octave_sum(q, (c, 4 * c, 7 * c))
            image = w + perlin_sum(q, c) * (1 - w)
        elif scene.channel == "A":
            image = 0.75 * worley(q, 4 * c) + 0.25 * worley(q, 8 * c)
        else:
            k = c * (1 if scene.channel == "G" else 2)
            image = octave_sum(q, (k, 2 * k, 4 * k))
        image = image.reshape(SIZE, SIZE, 1)
        label = f"{name(scene, DENSITY)} {fields}"
        exact = noise_on_plane(scene, SIZE)
        found.append(Comparison(label, Sampled.exact(image), Sampled.exact(exact), WITHIN))
    return found


def octave_sum(q: np.ndarray, cells: tuple[int, int, int], seed: int = 0) -> np.ndarray:
    """Three Worley octaves by 5/8, 1/4 and 1/8 at points (n, 3) in tiles."""
    return sum(a * worley(q, n, seed) for a, n in zip((0.625, 0.25, 0.125), cells, strict=True))


def perlin_sum(q: np.ndarray, cells: int) -> np.ndarray:
    """Three Perlin octaves in [0, 1] at points (n, 3) in tiles."""
    total = sum(perlin(q, f * cells) / f for f in (1, 2, 4))
    return 0.5 + 0.5 * total / 1.75


def worley(q: np.ndarray, cells: int, seed: int = 0) -> np.ndarray:
    """max(1 - F1, 0), F1 in cells, at points (n, 3) in tiles."""
    nearest, _ = _tree(cells, seed).query(q % 1.0)
    return np.maximum(1 - nearest * cells, 0)


@functools.lru_cache(maxsize=16)
def _tree(cells: int, seed: int) -> cKDTree:
    corner = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    a, b = _drawn(corner, cells, seed + 101)
    within = np.stack([a & 0xFFFF, a >> 16, b & 0xFFFF], axis=-1) / 65536
    return cKDTree((corner + within) / cells, boxsize=1.0)


def perlin(q: np.ndarray, cells: int, seed: int = 0) -> np.ndarray:
    """Gradient noise at points (n, 3) in tiles."""
    whole = np.floor(q * cells).astype(int)
    t = q * cells - whole
    total = np.zeros(len(q))
    for corner in np.ndindex(2, 2, 2):
        bits, _ = _drawn((whole + corner) % cells, cells, seed)
        edge = EDGES[(bits >> 16) & 1, (bits >> 17) & 1, bits % 3]
        s = np.abs(1 - np.array(corner) - t)
        share = s**3 * (10 + s * (6 * s - 15))
        total += share.prod(axis=1) * (edge * (t - corner)).sum(axis=1)
    return total


def _drawn(corner: np.ndarray, period: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Two words for each lattice point (n, 3): four rounds of the Tiny Encryption Algorithm."""
    word = 0xFFFFFFFF
    a = corner.astype(np.int64) @ np.array([1, 1 << 10, 1 << 20])
    b = np.full_like(a, seed * 4096 + period)
    for turn in range(1, 5):
        s = (0x9E3779B9 * turn) & word
        a = (a + (((b << 4) + 0xA341316C) ^ (b + s) ^ ((b >> 5) + 0xC8013EA4))) & word
        b = (b + (((a << 4) + 0xAD90777D) ^ (a + s) ^ ((a >> 5) + 0x7E95761E))) & word
    return a, b
