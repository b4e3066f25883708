"""Area lights as flat shapes in their own plane, and sums over all of their points.

A flat light has a centre c, unit axes x and y, half extents a and b along them, and m, the unit normal of its
plane that points *away* from what it lights. A receiver at p stands (c - p) . m in front of it, and a point
of the plane has coordinates (x, y) from the centre.

A sphere is a disk that faces the receiver and fills the same cone, R / sqrt(1 - R^2 / d^2) in radius, which
is exact; a tube is a rectangle that faces the receiver, which is not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy.special import roots_legendre, roots_sh_legendre

from scenes.contract import AreaLight

NODES = 24
"""Gauss points to a side of a light in `integrate`."""


@dataclass
class FlatLight:
    """See the head of the module; towards: c - p; round: a disk of radius a = b."""

    towards: mi.Vector3f
    x: mi.Vector3f
    y: mi.Vector3f
    m: mi.Vector3f
    a: mi.Float
    b: mi.Float
    round: bool

    @property
    def ahead(self) -> mi.Float:
        """Distance from the receiver to the plane, positive where it is lit (m)."""
        return dr.dot(self.towards, self.m)

    @property
    def area(self) -> mi.Float:
        """m^2."""
        return (dr.pi if self.round else 4) * self.a * self.b

    def solid_angle(self) -> mi.Float:
        """Of a rectangle (sr); a disk counts as a square of its area, 1 % short at one radius away.

        Two triangles, tan(Omega / 2) = a . (b x c) / (1 + a . b + b . c + c . a) each.
        """
        k = 0.5 * dr.sqrt(dr.pi) if self.round else 1.0
        s, t = k * self.a * self.x, k * self.b * self.y
        corners = (self.towards + s + t, self.towards - s + t, self.towards - s - t, self.towards + s - t)
        a, b, c, d = (dr.normalize(corner) for corner in corners)
        return _triangle(a, b, c) + _triangle(a, c, d)

    def at(self, q: mi.Point2f) -> mi.Vector3f:
        """From the receiver to a point of the plane."""
        return self.towards + q.x * self.x + q.y * self.y

    def where(self, w: mi.Vector3f, least: float = 0.01) -> tuple[mi.Point2f, mi.Float]:
        """Where a unit direction from the receiver meets the plane, and at what distance (m).

        A direction whose cosine with m is under `least` goes as far as if it were `least`.
        """
        t = self.ahead / dr.maximum(dr.dot(w, self.m), least)
        q = t * w - self.towards
        return mi.Point2f(dr.dot(q, self.x), dr.dot(q, self.y)), t

    def nearest(self, q: mi.Point2f) -> mi.Point2f:
        """The point of the shape that is nearest to a point of its plane."""
        if self.round:
            return q * dr.minimum(1, self.a * dr.rsqrt(dr.maximum(dr.squared_norm(q), 1e-12)))
        return mi.Point2f(dr.clip(q.x, -self.a, self.a), dr.clip(q.y, -self.b, self.b))

    def texture_coordinates(self, q: mi.Point2f) -> mi.Point2f:
        """(s, t) in [0, 1]^2 of a point of a rectangle."""
        return 0.5 + 0.5 * mi.Point2f(q.x / self.a, q.y / self.b)


def flat_light(light: AreaLight, p: mi.Point3f) -> FlatLight:
    """The light as receivers at p see it."""
    u, v = mi.Vector3f(light.u), mi.Vector3f(light.v)
    towards = mi.Vector3f(light.centre) - mi.Vector3f(p)
    a, b = dr.norm(u), dr.norm(v)
    if light.shape == "sphere":
        m = _unit(towards)
        frame = mi.Frame3f(m)
        widened = a * dr.rsqrt(dr.maximum(1 - dr.square(a) / dr.squared_norm(towards), 1e-3))
        return FlatLight(towards, frame.s, frame.t, m, widened, widened, True)
    x, y = u / a, v / b
    if light.shape == "tube":
        m = _unit(towards - dr.dot(towards, x) * x)
        return FlatLight(towards, x, dr.cross(m, x), m, a, b, False)
    return FlatLight(towards, x, y, dr.cross(y, x), a, b, light.shape == "disk")


def projected_area(light: AreaLight, w: mi.Vector3f) -> mi.Float:
    """The area (m^2) that a far receiver sees along unit directions w towards the light."""
    u, v = mi.Vector3f(light.u), mi.Vector3f(light.v)
    if light.shape == "sphere":
        return dr.pi * dr.squared_norm(u)
    if light.shape == "tube":
        return 4 * dr.norm(v) * dr.norm(dr.cross(u, w))
    return (dr.pi if light.shape == "disk" else 4) * dr.maximum(dr.dot(dr.cross(v, u), w), 0)


def integrate(light: FlatLight, f: Callable[[mi.Vector3f, mi.Point2f], mi.Color3f]) -> mi.Color3f:
    """int f(w, q) dw over the directions w to the light's points q, NODES x NODES Gauss points in its plane
    (in radius and angle for a disk). To 1e-3 where f is no narrower than a tenth of the light."""
    node, weight = roots_sh_legendre(NODES) if light.round else roots_legendre(NODES)
    node, weight = mi.Float(node.astype(np.float32)), mi.Float(weight.astype(np.float32))

    def add(i, total):
        j, k = i // NODES, i % NODES
        s, t = dr.gather(mi.Float, node, j), dr.gather(mi.Float, node, k)
        share = dr.gather(mi.Float, weight, j)
        if light.round:
            radius, angle = dr.sqrt(s), dr.two_pi * mi.Float(k) / NODES
            s, t, share = radius * dr.cos(angle), radius * dr.sin(angle), share / NODES
        else:
            share *= 0.25 * dr.gather(mi.Float, weight, k)
        q = mi.Point2f(light.a * s, light.b * t)
        to = light.at(q)
        r = dr.norm(to)
        w = to / r
        solid_angle = light.area * share * dr.dot(w, light.m) / dr.square(r)
        return i + 1, total + dr.maximum(solid_angle, 0) * f(w, q)

    start = mi.UInt32(0), dr.zeros(mi.Color3f, dr.width(light.towards))
    return dr.while_loop(start, lambda i, total: i < NODES * NODES, add)[1]


def _triangle(a: mi.Vector3f, b: mi.Vector3f, c: mi.Vector3f) -> mi.Float:
    volume = dr.abs(dr.dot(a, dr.cross(b, c)))
    return 2 * dr.atan2(volume, 1 + dr.dot(a, b) + dr.dot(b, c) + dr.dot(c, a))


def _unit(v: mi.Vector3f) -> mi.Vector3f:
    return v * dr.rsqrt(dr.maximum(dr.squared_norm(v), 1e-12))
