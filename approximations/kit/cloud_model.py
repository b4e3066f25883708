"""What cloud models share: noise composed and packed into small textures, remaps, height profiles.

GPU Pro 7, II.4, 4.3.1 to 4.3.4. Octaves are those of `scenes.cloud_noise`; P is Perlin noise brought to
[0, 1], w_n Worley noise of n cells, W a sum of Worley octaves weighed by 5/8, 1/4 and 1/8.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.cloud_noise import perlin, worley

STORAGE = {"8 bits": 8, "16 bits": 16, "exact": 0}
WEIGHTS = (0.625, 0.25, 0.125)
PROFILES = (
    (0.02, 0.05, 0.09, 0.11),  # stratus
    (0.02, 0.2, 0.48, 0.625),  # stratocumulus
    (0.01, 0.0625, 0.78, 1.0),  # cumulus
)
"""Heights, as shares of the layer, between which each type grows in and fades out; print has curves only."""


def remap(v: Any, low: Any, high: Any, to_low: Any, to_high: Any) -> Any:
    """v brought from [low, high] to [to_low, to_high], not clamped (4.3.4)."""
    return to_low + (v - low) / (high - low) * (to_high - to_low)


def octave_sum(first: Any, second: Any, third: Any) -> Any:
    """Three octaves weighed by 5/8, 1/4 and 1/8."""
    return WEIGHTS[0] * first + WEIGHTS[1] * second + WEIGHTS[2] * third


def perlin_sum(q: Any, cells: int) -> Any:
    """Three octaves of Perlin noise, each half the amplitude of the one before, brought to [0, 1]."""
    total = perlin(q, cells) + 0.5 * perlin(q, 2 * cells) + 0.25 * perlin(q, 4 * cells)
    return remap(total, -1.75, 1.75, 0, 1)


def shape_noise(q: Any, cells: int = 8, first: str = "dilated") -> list[Any]:
    """The four channels of the first texture at points in tiles; `first` as in `packed_noise`."""
    w1, w2, w4, w7, w8 = (worley(q, n * cells) for n in (1, 2, 4, 7, 8))
    p, w = perlin_sum(q, cells), octave_sum(w1, w4, w7)
    red = {
        "dilated": lambda: remap(p, 0, 1, w, 1),
        "printed": lambda: remap(p, w, 1, 0, 1),
        "product": lambda: w * p,
        "perlin": lambda: p,
        "billows": lambda: dr.abs(2 * p - 1),
    }[first]()
    return [red, octave_sum(w1, w2, w4), octave_sum(w2, w4, w8), 0.75 * w4 + 0.25 * w8]


def detail_noise(q: Any) -> list[Any]:
    """The three channels of the second texture at points in tiles."""
    w2, w4, w8, w16 = (worley(q, n, seed=1) for n in (2, 4, 8, 16))
    return [octave_sum(w2, w4, w8), octave_sum(w4, w8, w16), 0.75 * w8 + 0.25 * w16]


def curl_noise(q: Any) -> list[Any]:
    """x and y of the curl of a plane potential, Perlin noise of 4 cells, over 4, at points in tiles."""
    d = 1 / 1024

    def potential(x: Any, y: Any) -> Any:
        return perlin(type(q)(x, y, 0), 4, 2)

    along_x = potential(q.x + d, q.y) - potential(q.x - d, q.y)
    along_y = potential(q.x, q.y + d) - potential(q.x, q.y - d)
    return [along_y / (8 * d), -along_x / (8 * d)]


def in_bits(values: np.ndarray, storage: str, low: float = 0.0, high: float = 1.0) -> np.ndarray:
    """Values as a texture of so many bits holds them over [low, high], beyond which it clips; "exact" leaves
    them alone."""
    if storage == "exact":
        return values
    steps = 2 ** STORAGE[storage] - 1
    return low + np.round(steps * np.clip((values - low) / (high - low), 0, 1)) / steps * (high - low)


def packed(noise: Callable[[Any], list[Any]], size: int, storage: str) -> Any:
    """A texture of size^3 voxels that repeats, with the noise at their middles in its channels."""
    i = dr.arange(mi.UInt32, size**3)
    middles = (mi.Point3f(i % size, (i // size) % size, i // (size * size)) + 0.5) / size
    texels = in_bits(np.stack([np.array(c) for c in noise(middles)], axis=-1), storage)
    return _texture(mi.Texture3f, texels.reshape(size, size, size, -1))


def packed_curl(size: int, storage: str) -> Any:
    """A square texture that repeats, of size^2 texels, with curl noise over [-2, 2]."""
    i = dr.arange(mi.UInt32, size**2)
    middles = mi.Point3f((mi.Float(i % size) + 0.5) / size, (mi.Float(i // size) + 0.5) / size, 0)
    texels = in_bits(np.stack([np.array(c) for c in curl_noise(middles)], axis=-1), storage, -2.0, 2.0)
    return _texture(mi.Texture2f, texels.reshape(size, size, 2))


def _texture(kind: Any, texels: np.ndarray) -> Any:
    tensor = mi.TensorXf(np.ascontiguousarray(texels, np.float32))
    return kind(tensor, use_accel=False, wrap_mode=dr.WrapMode.Repeat)


def bytes_of(size: int, channels: int, bits: int) -> int:
    """Memory of a cube of texels without mips."""
    return math.ceil(size**3 * channels * bits / 8)


def profile(h: Any, type: Any, blend: str = "functions") -> Any:
    """Density over height h in [0, 1] (4.3.2) for a type in [0, 1]: stratus 0, stratocumulus 0.5, cumulus 1.

    Each of the three is smoothstep(a, b, h) - smoothstep(c, d, h). Between two of them either their values
    are mixed ("functions") or their heights a, b, c and d ("parameters").
    """
    shares = (dr.clip(1 - 2 * type, 0, 1), 1 - dr.abs(2 * type - 1), dr.clip(2 * type - 1, 0, 1))
    if blend == "functions":
        return sum(s * _trapezium(h, *heights) for s, heights in zip(shares, PROFILES, strict=True))
    mixed = (
        sum(s * x for s, x in zip(shares, column, strict=True)) for column in zip(*PROFILES, strict=True)
    )
    return _trapezium(h, *mixed)


def _trapezium(h: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    return _smoothstep(h, a, b) - _smoothstep(h, c, d)


def _smoothstep(x: Any, low: Any, high: Any) -> Any:
    t = dr.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)
