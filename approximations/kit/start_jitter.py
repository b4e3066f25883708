"""Where in its step the samples of a march stand, pixel by pixel: noise in place of bands.

Blue noise is a square of ranks that repeats, by the rule of Ulichney's void-and-cluster: spots are put one
after another where the Gaussians of those so far sum to least, in the largest void, so that neighbours stand
far apart and their average settles after a few pixels. Its first tenth, which the full method spreads out by
moving spots from clusters to voids, is put by the same rule here: a test finds no difference in the spectrum.
White noise hashes each pixel on its own.
"""

from __future__ import annotations

from typing import Literal

import drjit as dr
import mitsuba as mi
import numpy as np

Jitter = Literal["none", "white", "blue noise"]
TILE = 32  # pixels
WIDTH = 1.5  # pixels, standard deviation of the Gaussian
TIES = 0.01  # of its height, noise that decides between equal voids
ROUNDS = 8  # of the hash; at four neighbours are still alike


def void_and_cluster(n: int = TILE, seed: int = 1) -> np.ndarray:
    """(n, n) ranks 0 to n^2 - 1, each once."""
    away = np.minimum(np.arange(n), n - np.arange(n))
    row = np.exp(-0.5 * (away / WIDTH) ** 2)
    gauss = np.outer(row, row)
    crowd = TIES * np.random.default_rng(seed).random((n, n))
    ranks = np.zeros((n, n), int)
    for rank in range(n * n):
        void = np.unravel_index(crowd.argmin(), crowd.shape)
        ranks[void] = rank
        crowd += np.roll(gauss, void, (0, 1))
        crowd[void] = np.inf
    return ranks


def blue_table() -> mi.Float:
    """The square of TILE x TILE starts in [0, 1), row by row."""
    return mi.Float((void_and_cluster() / TILE**2).ravel().astype(np.float32))


def starts(jitter: Jitter, table: mi.Float, width: int, height: int) -> mi.Float | float:
    """Share of a step, 0 to 1, at which the samples of each pixel stand; "none": amid the step."""
    if jitter == "none":
        return 0.5
    i = dr.arange(mi.UInt32, width * height)
    if jitter == "white":
        return mi.sample_tea_float32(i % width, i // width, ROUNDS)
    return dr.gather(mi.Float, table, dr.fma(i // width % TILE, TILE, i % width % TILE))
