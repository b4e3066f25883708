"""Directions and random numbers for bakes."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

GOLDEN_ANGLE = 2.399963229728653  # rad, pi (3 - sqrt 5)


def random_turn(n: int, seed: int) -> mi.Float:
    """One uniform angle in [0, 2 pi) per point, from a seed."""
    rng = mi.PCG32(size=n, initstate=seed)
    return 2 * dr.pi * rng.next_float32()


def hemisphere_direction(i: mi.UInt32, count: int, turn: mi.Float) -> mi.Vector3f:
    """Direction i of `count` spread evenly over the hemisphere about +z (a Fibonacci spiral), turned."""
    z = (mi.Float(i) + 0.5) / count
    r, phi = dr.sqrt(1 - z * z), mi.Float(i) * GOLDEN_ANGLE + turn
    return mi.Vector3f(r * dr.cos(phi), r * dr.sin(phi), z)
