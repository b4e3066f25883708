"""The density that clouds are modelled with, after GPU Pro 7, II.4.3, evaluated without textures.

The chapter keeps its noises in small textures of 8 bits; here every octave is computed where it is asked for,
in the precision of the points (double for what truths are made of), so that what the textures cost can be
measured. Readings of what print leaves open, with the formulas, stand in `approximations.kit.cloud_model`;
this field follows the defaults there. It is written apart from it, and a test holds the two together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr

from scenes.cloud_noise import perlin, worley

STRATUS = (0.02, 0.05, 0.09, 0.11)
STRATOCUMULUS = (0.02, 0.2, 0.48, 0.625)
CUMULUS = (0.01, 0.0625, 0.78, 1.0)
"""Heights between which each type of cloud grows in and fades out, as shares of the layer."""
FBM = (0.625, 0.25, 0.125)


@dataclass(frozen=True)
class Weather:
    """What the weather map says of a column: coverage, precipitation and type, each in [0, 1]; type 0 is
    stratus, 0.5 stratocumulus, 1 cumulus."""

    coverage: Any
    precipitation: Any
    type: Any


@dataclass(frozen=True)
class CloudModel:
    """What an artist gives of clouds. weather(x, y): the map at a place, in m.

    base, top: of the layer, m. tile: edge of the cube in which the first texture repeats, m; detail_tile: of
    the second. erosion: how much of the detail is taken off. curl: how far wisps are torn aside, m.
    """

    base: float
    top: float
    weather: Callable[[Any, Any], Weather]
    tile: float = 6000.0
    detail_tile: float = 750.0
    erosion: float = 0.2
    curl: float = 40.0


def density(model: CloudModel, p: Any) -> Any:
    """In [0, 1], at points in m, z up; 0 outside the layer."""
    h = (p.z - model.base) / (model.top - model.base)
    weather = raining(model.weather(p.x, p.y))
    shape, *octaves = low_frequency(p / model.tile)
    base = (shape + 1 - fbm(octaves)) / (2 - fbm(octaves)) * profile(h, weather.type)
    covered = dr.maximum(base - (1 - weather.coverage), 0)
    torn = p + (1 - dr.clip(h, 0, 1)) * model.curl * curl(p / model.detail_tile)
    detail = fbm(high_frequency(torn / model.detail_tile))
    m = model.erosion * dr.lerp(detail, 1 - detail, dr.clip(10 * h, 0, 1))
    return dr.select((h > 0) & (h < 1), dr.clip((covered - m) / (1 - m), 0, 1), 0)


def raining(weather: Weather) -> Weather:
    """Rain grows the tallest clouds and covers at least 0.7 of the sky."""
    rain = weather.precipitation
    return Weather(dr.maximum(weather.coverage, 0.7 * rain), rain, weather.type + rain * (1 - weather.type))


def profile(h: Any, type: Any) -> Any:
    """How dense a type of cloud is at the share h of the layer's height."""
    shares = (
        dr.clip(1 - 2 * type, 0, 1),
        1 - 2 * dr.abs(type - 0.5),
        dr.clip(2 * type - 1, 0, 1),
    )
    return sum(
        share * (_smoothstep(a, b, h) - _smoothstep(c, d, h))
        for share, (a, b, c, d) in zip(shares, (STRATUS, STRATOCUMULUS, CUMULUS), strict=True)
    )


def low_frequency(q: Any) -> list[Any]:
    """Perlin-Worley noise and three sums of Worley octaves, at points in units of the tile."""
    w = {cells: worley(q, cells) for cells in (8, 16, 32, 56, 64)}
    p = 0.5 + 0.5 * sum(a * perlin(q, f) for a, f in ((1, 8), (0.5, 16), (0.25, 32))) / 1.75
    billows = fbm([w[8], w[32], w[56]])
    return [
        billows + p * (1 - billows),
        fbm([w[8], w[16], w[32]]),
        fbm([w[16], w[32], w[64]]),
        0.75 * w[32] + 0.25 * w[64],
    ]


def high_frequency(q: Any) -> list[Any]:
    """Three sums of Worley octaves, at points in units of the tile."""
    w = {cells: worley(q, cells, seed=1) for cells in (2, 4, 8, 16)}
    return [
        fbm([w[2], w[4], w[8]]),
        fbm([w[4], w[8], w[16]]),
        0.75 * w[8] + 0.25 * w[16],
    ]


def fbm(octaves: list[Any]) -> Any:
    """Three octaves weighed by 5/8, 1/4 and 1/8."""
    return sum(weight * octave for weight, octave in zip(FBM, octaves, strict=True))


def curl(q: Any) -> Any:
    """Curl of a plane potential, Perlin noise of 4 cells, by differences: no sources, and about 1 in size."""
    step, plane = 1 / 1024, type(q)(q.x, q.y, 0)
    right, up = type(q)(step, 0, 0), type(q)(0, step, 0)
    dx = (perlin(plane + right, 4, 2) - perlin(plane - right, 4, 2)) / (2 * step)
    dy = (perlin(plane + up, 4, 2) - perlin(plane - up, 4, 2)) / (2 * step)
    return type(q)(dy, -dx, 0) / 4


def _smoothstep(a: float, b: float, x: Any) -> Any:
    t = dr.clip((x - a) / (b - a), 0, 1)
    return t * t * (3 - 2 * t)
