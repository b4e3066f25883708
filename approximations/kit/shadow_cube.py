r"""Shadow cubes: what the boundary of a room lets in, by direction from one point C, and how it is read.

A fragment V0 that looks along L leaves the proxy box [low, high] at

    far = max((high - V0) / L, (low - V0) / L),   dist = min(far.x, far.y, far.z),
    P   = V0 + dist L,                            Lp = P - C,

and the cube is read in the direction Lp. A texel of level m covers 2 h 2^m / N on the wall at P, N being the
texels along a face and h the largest component of Lp.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from approximations.kit.cube_map import CubeMap, cube_map, lookup, mip_chain, texel_directions
from approximations.kit.sampling import GOLDEN_ANGLE
from scenes.contract import Sun

BYTE = 255
"""Steps of 8 bits."""
LEAST = 1e-6
"""Of a component of L: no fragment divides 0 by 0 in the plane of a wall."""


@dataclass
class ShadowCube:
    """The map, C, the proxy's corners (m), and N."""

    cube: CubeMap
    centre: mi.Point3f
    low: mi.Point3f
    high: mi.Point3f
    face: int

    def corrected(self, p: mi.Point3f, w: mi.Vector3f) -> tuple[mi.Vector3f, mi.Float]:
        """Lp and dist (m) of fragments p that look along unit directions w."""
        safe = dr.select(dr.abs(w) < LEAST, LEAST, w)
        far = dr.maximum((self.high - p) / safe, (self.low - p) / safe)
        dist = dr.minimum(far.x, dr.minimum(far.y, far.z))
        return p + dist * w - self.centre, dist

    def footprint_level(self, lp: mi.Vector3f, radius: mi.Float) -> mi.Float:
        """log2(r N / h): the level whose texels are as wide as a disk of radius r (m) at P."""
        h = dr.max(dr.abs(lp))
        return dr.log2(dr.maximum(radius, 1e-12) * self.face / h)

    def read(self, p: mi.Point3f, w: mi.Vector3f, level: Any = 0.0) -> Any:
        """The map at a level, corrected."""
        return lookup(self.cube, self.corrected(p, w)[0], level)


def sees(trace: Callable, centre: mi.Point3f, face: int) -> tuple[mi.Vector3f, mi.Float]:
    """Directions of the texels and the distance (m) that C sees along them."""
    w = texel_directions(face)[0]
    t = trace(dr.zeros(mi.Point3f, dr.width(w)) + centre, w)
    dr.eval(w, t)
    return w, t


def walls_box(centre: mi.Point3f, w: mi.Vector3f, t: mi.Float) -> tuple[mi.Point3f, mi.Point3f]:
    """Corners of the box round all that C sees."""
    hit = dr.isfinite(t)
    p = centre + w * dr.select(hit, t, 0)
    low = mi.Point3f(*(dr.min(dr.select(hit, c, dr.inf)) for c in p))
    high = mi.Point3f(*(dr.max(dr.select(hit, c, -dr.inf)) for c in p))
    return low, high


def shadow_cube(
    texels: Any, centre: mi.Point3f, box: tuple[Any, Any], *, steps: int | None, power: float = 1.0
) -> ShadowCube:
    """With all mips, in so many even steps (None for float32) and raised to a power, which decodes."""
    levels = mip_chain(texels)
    if steps:
        levels = [dr.power(dr.round(level * steps) / steps, power) for level in levels]
    face = round((dr.width(texels) / 6) ** 0.5)
    return ShadowCube(cube_map(levels), centre, *box, face)


def sun_directions(sun: Sun, count: int) -> Callable[[mi.UInt32], mi.Vector3f]:
    """i -> a unit direction to the sun, evenly over its disk for i < count."""
    frame, reach = mi.Frame3f(sun.direction), dr.tan(mi.Float(sun.angular_radius))

    def to(i: mi.UInt32) -> mi.Vector3f:
        r, phi = reach * dr.sqrt((mi.Float(i) + 0.5) / count), mi.Float(i) * GOLDEN_ANGLE
        return dr.normalize(frame.to_world(mi.Vector3f(r * dr.cos(phi), r * dr.sin(phi), 1)))

    return to


def sun_mean(
    sun: Sun, n: mi.Vector3f, value: Callable[[mi.Vector3f], Any], zero: Any, count: int = 64
) -> Any:
    """Mean of value(w) over the sun's disk, nothing from below the horizon of the normals n."""
    to = sun_directions(sun, count)

    def add(i, total):
        w = to(i)
        return i + 1, total + dr.select(dr.dot(n, w) > 0, value(w), 0)

    _, total = dr.while_loop((mi.UInt32(0), zero), lambda i, total: i < count, add)
    return total / count
