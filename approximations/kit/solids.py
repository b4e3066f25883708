"""Signed distance (m) from balls and boxes, positive outside, in Dr.Jit arrays.

box   with q = |p| - half in the box's own axes: |max(q, 0)| + min(max(q_x, q_y, q_z), 0)
ball  |p| - R
union the least of them: exact outside; where solids overlap only a bound
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import drjit as dr
import mitsuba as mi

from scenes.contract import Solid


def local_point(solid: Solid, p: mi.Point3f) -> mi.Vector3f:
    """p in the solid's own axes, from its centre."""
    from_centre = p - mi.Point3f(solid.centre)
    return mi.Vector3f(*(dr.dot(mi.Vector3f(axis), from_centre) for axis in solid.axes))


def distance_to(solid: Solid, p: mi.Point3f) -> mi.Float:
    """From one solid."""
    q = local_point(solid, p)
    if solid.shape == "ball":
        return dr.norm(q) - solid.half[0]
    q = dr.abs(q) - mi.Vector3f(solid.half)
    return dr.norm(dr.maximum(q, 0)) + dr.minimum(dr.max(q), 0)


def distance_to_all(solids: Sequence[Solid], p: mi.Point3f) -> mi.Float:
    """From the union of solids."""
    return functools.reduce(dr.minimum, (distance_to(s, p) for s in solids))


def share_inside(solids: Sequence[Solid], p: mi.Point3f, cell: float, n: int) -> mi.Float:
    """Share of n x n x n even points of the cells round p (edge `cell`, m) that lie inside, 0 to 1."""

    corner = p - 0.5 * cell

    def count(i: mi.UInt32, found: mi.Float) -> tuple[mi.UInt32, mi.Float]:
        at = mi.Vector3f(i % n, (i // n) % n, i // (n * n)) + 0.5
        inside = distance_to_all(solids, corner + cell / n * at) < 0
        return i + 1, found + dr.select(inside, mi.Float(1), 0)

    _, found = dr.while_loop(
        (mi.UInt32(0), dr.zeros(mi.Float, dr.width(p))), lambda i, found: i < n**3, count
    )
    return found / n**3
