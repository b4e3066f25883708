"""The noises that clouds are modelled from, each a function of space that repeats in the unit cube.

Gradient noise after Perlin (2002) and cellular noise after Worley (1996), by hashes of lattice points, so
that no table bounds the period. Points in single or double precision give values in the same; what is drawn
at a lattice point does not depend on it.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

ROUNDS = 4  # of the hash, XTEA


def perlin(p: Any, frequency: int, seed: int = 0) -> Any:
    """Gradient noise of `frequency` cells a unit length, mean 0, within [-1, 1].

    At each lattice point stands one of the 12 vectors to the edges of a cube; their products with the way
    from there are blended by 6 t^5 - 15 t^4 + 10 t^3.
    """
    cell, t = _split(p, frequency)
    fade = t * t * t * (t * (t * 6 - 15) + 10)
    total = type(t.x)(0)
    for corner in range(8):
        at = [(corner >> axis) & 1 for axis in range(3)]
        bits, _ = _drawn([cell[i] + at[i] for i in range(3)], frequency, seed)
        away = [t[i] - at[i] for i in range(3)]
        share = type(t.x)(1)
        for axis in range(3):
            share *= fade[axis] if at[axis] else 1 - fade[axis]
        total += share * _along_an_edge(bits, away)
    return total


def worley(p: Any, cells: int, seed: int = 0) -> Any:
    """1 - F1, at least 0: F1 is the distance to the nearest feature point over the edge of a cell, of which
    there are `cells` a unit length, each with one feature point at random."""
    cell, t = _split(p, cells)

    def nearer(k: Any, nearest: Any) -> tuple[Any, Any]:
        steps = [type(k)(k % 3) - 1, type(k)((k // 3) % 3) - 1, type(k)(k // 9) - 1]
        a, b = _drawn([cell[i] + steps[i] for i in range(3)], cells, seed + 101)
        float_type = type(t.x)
        feature = [float_type(n) / 65536 for n in (a & 0xFFFF, a >> 16, b & 0xFFFF)]
        away = [float_type(steps[i]) + feature[i] - t[i] for i in range(3)]
        return k + 1, dr.minimum(nearest, away[0] ** 2 + away[1] ** 2 + away[2] ** 2)

    start = (mi.Int32(0), dr.full(type(t.x), dr.inf, dr.width(t)))
    _, squared = dr.while_loop(start, lambda k, nearest: k < 27, nearer)
    return dr.maximum(1 - dr.sqrt(squared), 0)


def _split(p: Any, cells: int) -> tuple[list[Any], Any]:
    """The cell that a point lies in, as integers, and where in it, in [0, 1)."""
    whole = dr.floor(p * cells)
    return [mi.Int32(whole[i]) for i in range(3)], p * cells - whole


def _drawn(lattice: list[Any], period: int, seed: int) -> tuple[Any, Any]:
    """Two random words for each lattice point."""
    x, y, z = (mi.UInt32(((n % period) + period) % period) for n in lattice)
    return mi.sample_tea_32(x + (y << 10) + (z << 20), mi.UInt32(seed * 4096 + period), ROUNDS)


def _along_an_edge(bits: Any, d: list[Any]) -> Any:
    """Product of d with the vector that the bits choose among (+-1, +-1, 0) and its turns."""
    turn = bits % 3
    u = dr.select(turn == 0, d[0], dr.select(turn == 1, d[1], d[2]))
    v = dr.select(turn == 0, d[1], dr.select(turn == 1, d[2], d[0]))
    return dr.select((bits & 0x10000) == 0, u, -u) + dr.select((bits & 0x20000) == 0, v, -v)
