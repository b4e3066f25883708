r"""Noise and density of clouds, put together again in NumPy from the points and vectors of the lattice.

Worley noise: all feature points of a tile in a k-d tree that repeats, instead of the 27 cells about a point.
Perlin noise: vectors from a list of the 12 edges and weights by a product over corners. Hashes are written
out here as well (TEA, four rounds).
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.spatial import cKDTree

from reference.closed_form.cloud_density import density_in_section
from reference.closed_form.cloud_noise import noise_on_plane
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE, name
from scenes.contract import DENSITY
from scenes.cumulus import Cumulus
from scenes.density_section import DensitySection
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


@check(
    "route",
    claim="the modelled density of a cloud is what nearest points of a tree and its recipe say",
    routes=("k-d tree and list", "closed form"),
    scenes=("DensitySection",),
)
def density_against_tree(seed: int) -> list[Comparison]:
    """Types and weathers, at the section's probes."""
    found = []
    for fields in ({}, {"type": 0.3, "cover": 1.5}, {"precipitation": 0.5}, {"type": 0.0, "cover": 1.6}):
        scene = DensitySection(**fields)
        image = modelled(scene, scene.points(SIZE).T).reshape(SIZE, SIZE, 1)
        exact = density_in_section(scene, SIZE)
        label = f"{name(scene, DENSITY)} {fields}"
        found.append(Comparison(label, Sampled.exact(image), Sampled.exact(exact), WITHIN))
    return found


def modelled(scene: DensitySection, p: np.ndarray) -> np.ndarray:
    """Density at points (n, 3) in m: the share of a perfect cover that is left when what the weather spares
    and what detail wears are taken off, written with 1 - R instead of R throughout."""
    model = scene.model()
    h = (p[:, 2] - model.base) / (model.top - model.base)
    inside = (h > 0) & (h < 1)
    h = np.clip(h, 0, 1)
    away = [np.hypot(p[:, 0] - x, p[:, 1] - y) / r for x, y, r, _ in Cumulus.HEAPS]
    heaps = [heap[3] * (1 - d**2) for heap, d in zip(Cumulus.HEAPS, away, strict=True)]
    rain = scene.precipitation
    cover = np.maximum(scene.cover * np.max([*heaps, np.zeros(len(p))], axis=0), 0.7 * rain)
    kind = 1 - (1 - scene.type) * (1 - rain)

    q = p / model.tile
    spared = (1 - perlin_sum(q, 8)) * (1 - octave_sum(q, (8, 32, 56)))
    wide = (
        octave_sum(q, (8, 16, 32)),
        octave_sum(q, (16, 32, 64)),
        0.75 * worley(q, 32) + 0.25 * worley(q, 64),
    )
    f = np.array([5, 2, 1]) @ np.stack(wide) / 8
    base = (1 - spared / (2 - f)) * grown(h, kind)
    left = np.maximum(base + cover - 1, 0)

    at = p / model.detail_tile
    torn = at + ((1 - h) * model.curl / model.detail_tile)[:, None] * curl(at)
    octaves = [octave_sum(torn, c, 1) for c in ((2, 4, 8), (4, 8, 16))]
    octaves.append(0.75 * worley(torn, 8, 1) + 0.25 * worley(torn, 16, 1))
    detail = np.array([5, 2, 1]) @ np.stack(octaves) / 8
    turned = np.minimum(10 * h, 1)
    worn = model.erosion * (detail + turned * (1 - 2 * detail))
    return np.where(inside, np.clip(1 - (1 - left) / (1 - worn), 0, 1), 0)


def grown(h: np.ndarray, kind: float) -> np.ndarray:
    """Height profile of a type in [0, 1], between the two whole types that it lies between."""
    decks = np.array([(0.02, 0.05, 0.09, 0.11), (0.02, 0.2, 0.48, 0.625), (0.01, 0.0625, 0.78, 1.0)])
    below = min(int(2 * kind), 1)
    profiles = [_ramp(h, a, b) - _ramp(h, c, d) for a, b, c, d in decks[below : below + 2]]
    return profiles[0] + (2 * kind - below) * (profiles[1] - profiles[0])


def _ramp(h: np.ndarray, low: float, high: float) -> np.ndarray:
    """The cubic from 0 to 1 that is level at both ends."""
    return np.polyval([-2, 3, 0, 0], np.clip((h - low) / (high - low), 0, 1))


def curl(q: np.ndarray, step: float = 1 / 1024) -> np.ndarray:
    """Of a plane potential, points (n, 3) in tiles: by differences over two steps, as the model has it."""
    right, up = np.array([step, 0, 0]), np.array([0, step, 0])
    plane = q * [1, 1, 0]

    def rise(along: np.ndarray) -> np.ndarray:
        return (perlin(plane + along, 4, 2) - perlin(plane - along, 4, 2)) / (8 * step)

    return np.stack([rise(up), -rise(right), np.zeros(len(q))], axis=-1)


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
