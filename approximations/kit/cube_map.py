r"""Cube maps: six square faces of texels about a point, with mip levels, looked up by direction.

Face 2 k + s looks along axis k, to its negative side where s = 1. A direction d of that face has

    u = d[k + 1] / |d[k]|,   v = d[k + 2] / |d[k]|     in [-1, 1], the axes counted in a circle,

and texel (i, j) of an n x n face stands at u = (2 i + 1) / n - 1, v = (2 j + 1) / n - 1. (The graphics
interfaces turn the faces otherwise; no lookup can tell.) Every face is kept with a border of one texel
that repeats its neighbours', so that a bilinear lookup has no seams.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

WITHIN_HALF = 0.499999
"""Half, but for what keeps the edge of a face in its last texel."""


@dataclass
class CubeMap:
    """texels: levels one after another, each of 6 faces with borders; sizes: texels along an edge of a face
    per level, borders left out; offsets: where each level starts."""

    texels: Any
    sizes: mi.UInt32
    offsets: mi.UInt32
    levels: int


def texel_directions(n: int) -> tuple[mi.Vector3f, mi.Float]:
    """Unit directions through the 6 n^2 texel centres, i fastest, and their solid angles (sr, by the midpoint
    rule: 2 % more than 4 pi in all at n = 4, 0.1 % at 16)."""
    i = dr.arange(mi.UInt32, 6 * n * n)
    u, v = ((2 * mi.Float(k % n) + 1) / n - 1 for k in (i, i // n))
    far = dr.sqrt(1 + u * u + v * v)
    return face_direction(i // (n * n), u, v) / far, 4 / (n * n * far * far * far)


def face_direction(face: mi.UInt32, u: mi.Float, v: mi.Float) -> mi.Vector3f:
    """The direction of (u, v) on a face, of length 1 along the face's axis; u and v may lie beyond +-1."""
    side = dr.select(face % 2 == 0, mi.Float(1), -1)
    x, y, z = mi.Vector3f(side, u, v), mi.Vector3f(v, side, u), mi.Vector3f(u, v, side)
    return dr.select(face < 2, x, dr.select(face < 4, y, z))


def face_coordinates(d: mi.Vector3f) -> tuple[mi.UInt32, mi.Float, mi.Float]:
    """Face and (u, v) of a direction of any length."""
    a = dr.abs(d)
    x, y = (a.x >= a.y) & (a.x >= a.z), a.y >= a.z
    face = dr.select(x, mi.UInt32(0), dr.select(y, mi.UInt32(2), 4))
    along = dr.select(x, d.x, dr.select(y, d.y, d.z))
    u = dr.select(x, d.y, dr.select(y, d.z, d.x))
    v = dr.select(x, d.z, dr.select(y, d.x, d.y))
    far = dr.abs(along)
    return face + dr.select(along < 0, mi.UInt32(1), 0), u / far, v / far


def cube_map(levels: list[Any]) -> CubeMap:
    """A map of the values of each level's texels, finest first: mi.Float or mi.Color3f of 6 n^2, n of each
    level half of the one before."""
    sizes = [round((dr.width(values) / 6) ** 0.5) for values in levels]
    texels, offsets, end = [], [], 0
    for n, values in zip(sizes, levels, strict=True):
        texels.append(_bordered(n, values))
        offsets.append(end)
        end += dr.width(texels[-1])
    kind = type(texels[0])
    channels = range(len(texels[0])) if issubclass(kind, mi.Color3f) else ()
    whole = kind(*(dr.concat([t[k] for t in texels]) for k in channels)) if channels else dr.concat(texels)
    dr.eval(whole)
    return CubeMap(whole, mi.UInt32(sizes), mi.UInt32(offsets), len(levels))


def environment_map(n: int, radiance: Callable[[mi.Vector3f], Any], samples: int = 1) -> Any:
    """Mean radiance in each of the 6 n^2 texels, from samples x samples points in each."""
    values = radiance(texel_directions(n * samples)[0])
    for _ in range(samples.bit_length() - 1):
        values = halved(values)
    return values


def halved(values: Any) -> Any:
    """The next level: means of 2 x 2 texels."""
    n = round((dr.width(values) / 6) ** 0.5) // 2
    i = dr.arange(mi.UInt32, 6 * n * n)
    first = 2 * (i % n) + 4 * n * (i // n)
    rows = first, first + 2 * n
    return 0.25 * sum(dr.gather(type(values), values, row + k) for row in rows for k in (0, 1))


def mip_chain(values: Any) -> list[Any]:
    """All levels by halving, down to one texel a face; n a power of two."""
    levels = [values]
    while dr.width(values) != 6:
        values = halved(values)
        levels.append(values)
    return levels


def lookup(cube: CubeMap, d: mi.Vector3f, level: Any = 0.0) -> Any:
    """The map in direction d, bilinear in a level and linear between two; level is clamped to those there."""
    place = face_coordinates(d)
    if cube.levels == 1:
        return _bilinear(cube, place, mi.UInt32(0))
    level = dr.clip(mi.Float(level), 0, cube.levels - 1)
    fine = mi.UInt32(level)
    coarse = dr.minimum(fine + 1, cube.levels - 1)
    return dr.lerp(_bilinear(cube, place, fine), _bilinear(cube, place, coarse), level - mi.Float(fine))


def _bilinear(cube: CubeMap, place: tuple[mi.UInt32, mi.Float, mi.Float], level: mi.UInt32) -> Any:
    face, u, v = place
    n = dr.gather(mi.UInt32, cube.sizes, level)
    x, y = (0.5 * (mi.Float(n) * (1 + c) + 1) for c in (u, v))
    i, j = (dr.minimum(mi.UInt32(c), n) for c in (x, y))
    row = n + 2
    first = dr.gather(mi.UInt32, cube.offsets, level) + (face * row + j) * row + i
    a, b, c, d = (dr.gather(type(cube.texels), cube.texels, first + k) for k in (0, 1, row, row + 1))
    s, t = x - mi.Float(i), y - mi.Float(j)
    return dr.lerp(dr.lerp(a, b, s), dr.lerp(c, d, s), t)


def _bordered(n: int, values: Any) -> Any:
    """6 (n + 2)^2 texels of which the outer ones repeat the nearest of the neighbouring face; the corners,
    where three faces meet, are the same for all three."""
    row = n + 2
    k = dr.arange(mi.UInt32, 6 * row * row)
    u, v = ((2 * mi.Float(c % row) - 1) / n - 1 for c in (k, k // row))
    corner = dr.maximum(dr.minimum(dr.abs(u), dr.abs(v)), 1)
    face, u, v = face_coordinates(face_direction(k // (row * row), u / corner, v / corner))
    i, j = (mi.UInt32(WITHIN_HALF * n * (1 + c)) for c in (u, v))
    return dr.gather(type(values), values, (face * n + j) * n + i)
