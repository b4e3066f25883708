"""Shadow maps: depth of the first surface on a grid as a light point sees it, and comparisons with it.

A map's frustum is a square pyramid with its apex in the light point that just holds the visible receivers, so
that it holds every caster between. z is measured along its axis (m), (a, b) = (tan, tan) across it. What is
stored of z is float32, or what a depth texture of so many bits holds of

    Z = far / (far - near) (1 - near / z), rounded to a multiple of 1 / (2^bits - 1).

Many maps of one light share one array, so that all of them are drawn by one kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from scenes.contract import AreaLight, Surface

LEVELS = {16: 65535.0, 24: 16777215.0}


@dataclass
class ShadowMaps:
    """One frustum a map: eye (m), unit axes s, t across and w along, tangent of the half opening."""

    eye: mi.Point3f
    s: mi.Vector3f
    t: mi.Vector3f
    w: mi.Vector3f
    tangent: mi.Float
    size: int
    depth: mi.Float  # z in m, size^2 values a map, row by row

    def at(self, k: mi.UInt32) -> ShadowMaps:
        """The frustum of map k for every lane; the depths stay all of them."""
        eye, s, t, w = (dr.gather(mi.Vector3f, mi.Vector3f(x), k) for x in (self.eye, self.s, self.t, self.w))
        return ShadowMaps(eye, s, t, w, dr.gather(mi.Float, self.tangent, k), self.size, self.depth)

    def project(self, p: mi.Point3f) -> tuple[mi.Point2f, mi.Float]:
        """(a, b) and z of a point."""
        d = mi.Vector3f(p) - self.eye
        z = dr.dot(d, self.w)
        return mi.Point2f(dr.dot(d, self.s), dr.dot(d, self.t)) / z, z

    def plane(self, p: mi.Point3f, n: mi.Vector3f, ab: mi.Point2f) -> mi.Float:
        """z at which the view line through (a, b) meets the plane through p of normal n."""
        along = self.w + ab.x * self.s + ab.y * self.t
        return dr.dot(n, p - self.eye) / dr.dot(n, along)

    def fetch(self, ab: mi.Point2f, k: mi.UInt32) -> mi.Float:
        """z that map k stores at the texel of (a, b), infinite outside the map."""
        texel = mi.Point2i(dr.floor(self._texels(ab)))
        inside = dr.all((texel >= 0) & (texel < self.size))
        index = k * self.size**2 + mi.UInt32(texel.y) * self.size + mi.UInt32(texel.x)
        return dr.select(inside, dr.gather(mi.Float, self.depth, index, inside), dr.inf)

    def fetch_four(self, ab: mi.Point2f, k: mi.UInt32) -> list[tuple[mi.Float, mi.Float]]:
        """z of the four texels round (a, b) and their bilinear weights."""
        x = self._texels(ab)
        e = x - dr.round(x)  # from where the four meet
        step = self.tangent / self.size
        across, down = (0.5 - e.x, 0.5 + e.x), (0.5 - e.y, 0.5 + e.y)
        return [
            (self.fetch(ab + step * mi.Vector2f(i, j), k), across[i > 0] * down[j > 0])
            for i in (-1, 1)
            for j in (-1, 1)
        ]

    def _texels(self, ab: mi.Point2f) -> mi.Point2f:
        return (0.5 * ab / self.tangent + 0.5) * self.size


def bounds(surface: Surface) -> tuple[mi.Point3f, mi.Float]:
    """Centre and radius (m) of a ball round the visible points."""
    low = dr.min(dr.select(surface.valid, surface.position, dr.inf), axis=1)
    high = dr.max(dr.select(surface.valid, surface.position, low), axis=1)
    centre = 0.5 * (low + high)
    return mi.Point3f(centre), dr.max(dr.select(surface.valid, dr.norm(surface.position - centre), 0))


def render(
    trace: Callable,
    eye: mi.Point3f,
    up: mi.Vector3f,
    centre: mi.Point3f,
    radius: mi.Float,
    *,
    size: int,
    bits: int | None = None,
    near: float = 0.1,
) -> ShadowMaps:
    """One map of size x size texels for every eye, all of a ball of receivers; bits of its depth, None for
    float32. s runs along `up`, as far as that lies across the axis. near: m, where the depth range begins."""
    d = mi.Vector3f(centre) - eye
    reach = dr.norm(d)
    w = d / reach
    s = dr.normalize(up - dr.dot(up, w) * w)
    t = dr.cross(w, s)
    sine = dr.minimum(radius / reach, 0.98)
    tangent = sine * dr.rsqrt(1 - sine * sine)
    dr.eval(eye, s, t, w, tangent)
    maps = ShadowMaps(mi.Point3f(eye), s, t, w, tangent, size, mi.Float(0))

    i = dr.arange(mi.UInt32, dr.width(eye) * size * size)
    each = maps.at(i // (size * size))
    ab = (2 * mi.Vector2f(i % size + 0.5, i // size % size + 0.5) / size - 1) * each.tangent
    along = each.w + ab.x * each.s + ab.y * each.t
    far = dr.gather(mi.Float, reach + radius, i // (size * size))
    z = dr.minimum(trace(each.eye, dr.normalize(along)) * dr.rcp(dr.norm(along)), far)
    if bits:
        levels = LEVELS[bits]
        stored = dr.round(far / (far - near) * (1 - near / dr.maximum(z, near)) * levels) / levels
        z = near * far / (far - stored * (far - near))
    maps.depth = z
    dr.eval(z)
    return maps


def light_point(light: AreaLight, shares: mi.Vector2f) -> mi.Point3f:
    """centre + x u + y v, for shares (x, y) of the light's half axes."""
    along, across = mi.Vector3f(shares.x), mi.Vector3f(shares.y)
    return mi.Point3f(dr.fma(along, light.u, dr.fma(across, light.v, mi.Vector3f(light.centre))))


def moved(ab: mi.Point2f, width: mi.Float, v: mi.Vector2f, turn: mi.Float) -> mi.Point2f:
    """(a, b) + width R(turn) v."""
    z = mi.Complex2f(v.x, v.y) * mi.Complex2f(dr.cos(turn), dr.sin(turn))
    return mi.Point2f(dr.fma(width, z.real, ab.x), dr.fma(width, z.imag, ab.y))


def filtered(
    maps: ShadowMaps,
    p: mi.Point3f,
    n: mi.Vector3f,
    offsets: mi.Vector2f,
    turn: mi.Float,
    width: mi.Float,
    *,
    bias: float,
    plane: bool = False,
    bilinear: bool = False,
) -> mi.Float:
    """Percentage-closer filtering with map 0: the share of taps (a, b) + width R(turn) offset at which
    nothing stored lies nearer than the receiver by more than `bias` (m).

    plane: the receiver's depth at a tap is that of its tangent plane, not its own. bilinear: four texels a
    tap are compared, with weights.
    """
    zero = mi.UInt32(0)
    frustum = maps.at(zero)
    ab, z = frustum.project(p)
    taps = dr.width(offsets)

    def tap(i, lit):
        at = moved(ab, width, dr.gather(mi.Vector2f, offsets, i), turn)
        least = (frustum.plane(p, n, at) if plane else z) - bias
        if bilinear:
            seen = sum(dr.select(stored >= least, w, 0) for stored, w in frustum.fetch_four(at, zero))
        else:
            seen = dr.select(frustum.fetch(at, zero) >= least, mi.Float(1), 0)
        return i + 1, lit + seen

    start = (mi.UInt32(0), dr.zeros(mi.Float, dr.width(p)))
    _, lit = dr.while_loop(start, lambda i, lit: i < taps, tap)
    return lit / taps
