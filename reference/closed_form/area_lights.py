r"""Irradiance from glowing shapes of unit radiance, in float64: Lambert's contour integral.

By Stokes, light of radiance 1 from a region bounded by C gives a receiver at p of unit normal n

    E = 1/2 n . oint_C (r x dr) / |r|^2,    r from p to the contour, counterclockwise as the receiver sees it.

    polygon   an edge a -> b adds 1/2 angle(a, b) n . (a x b) / |a x b|            (Lambert 1760)
    disk      an arc has an elementary integral, see `_arc`
    sphere    a cap: `caps.horizon_irradiance`
    tube      the side of a cylinder as a prism of many flat strips: not closed, but as near as one likes

What lies below the receiver's horizon is cut off. All receivers lie in one plane z = const with n = +z, so
that a shape is cut once. p has the shape (k, 3), results (k,); lengths in m, irradiance in W m^-2 for a
radiance of 1 W m^-2 sr^-1, so that a light that fills the sky gives pi.
"""

from __future__ import annotations

import math

import numpy as np

from reference.closed_form.caps import horizon_irradiance
from reference.truth import closed_form
from scenes.area_lit import HALF, DiffuseAreaLitPlane
from scenes.contract import DIRECT_RADIANCE

UP = np.array([0.0, 0.0, 1.0])


@closed_form(DiffuseAreaLitPlane, DIRECT_RADIANCE)
def diffuse_floor(scene: DiffuseAreaLitPlane, size: int) -> np.ndarray:
    """albedo / pi L E (size, size, 1); 0 inside a sphere."""
    light, p = scene.light(), floor_points(size)
    e = SHAPES[light.shape](p, light.centre, light.u, light.v)
    return (scene.albedo / math.pi * light.radiance * e).reshape(size, size, 1)


def floor_points(size: int) -> np.ndarray:
    """Centres of size x size samples on the floor (size^2, 3), row by row from the far side."""
    s = ((2 * np.arange(size) + 1) / size - 1) * HALF
    x, y = np.meshgrid(s, -s)
    return np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)


def sphere(p: np.ndarray, centre: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A ball of radius |u|; 0 inside."""
    towards = centre - p
    far, radius = np.linalg.norm(towards, axis=1), np.linalg.norm(u)
    outside = far > radius
    far = np.where(outside, far, 2 * radius)
    theta = np.arccos(np.clip(towards[:, 2] / far, -1, 1))
    return np.where(outside, horizon_irradiance(theta, np.arcsin(radius / far)), 0)


def rectangle(p: np.ndarray, centre: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Half edges u and v; glows on the side of u x v."""
    corners = centre + np.array([u + v, v - u, -u - v, u - v])
    return np.where((p - centre) @ np.cross(u, v) > 0, np.abs(polygon(p, corners)), 0)


def polygon(p: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """A flat polygon, corners (m, 3) in order; negative where they run clockwise as seen from p."""
    kept = clip(corners, p[0, 2])
    if len(kept) < 3:
        return np.zeros(len(p))
    return sum(edge(a - p, b - p) for a, b in zip(kept, np.roll(kept, -1, axis=0), strict=True))


def clip(corners: np.ndarray, floor: float) -> np.ndarray:
    """The part of a polygon above z = floor."""
    kept = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        za, zb = a[2] - floor, b[2] - floor
        if za > 0:
            kept.append(a)
        if za * zb < 0:
            kept.append(a + za / (za - zb) * (b - a))
    return np.array(kept)


def edge(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """1/2 angle(a, b) n . (a x b) / |a x b|; 0 where an edge points at the receiver."""
    m = np.cross(a, b)
    sine = np.linalg.norm(m, axis=1)
    angle = np.arctan2(sine, np.einsum("ij,ij->i", a, b))
    return 0.5 * angle * m[:, 2] / np.where(sine > 0, sine, 1)


def disk(p: np.ndarray, centre: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Radii u and v, |u| = |v|; glows on the side of u x v. Below the floor its chord replaces the arc."""
    rise, height = math.hypot(u[2], v[2]), centre[2] - p[0, 2]
    if height <= -rise:
        return np.zeros(len(p))
    top = math.atan2(v[2], u[2])
    half = math.pi if height >= rise else math.acos(-height / rise)
    e = _arc(p, centre, u, v, top - half, top + half)
    if half < math.pi:
        last, first = (centre + math.cos(t) * u + math.sin(t) * v for t in (top + half, top - half))
        e = e + edge(last - p, first - p)
    return np.where((p - centre) @ np.cross(u, v) > 0, np.abs(e), 0)


def _arc(
    p: np.ndarray, centre: np.ndarray, u: np.ndarray, v: np.ndarray, start: float, end: float
) -> np.ndarray:
    """1/2 n . int (r x dr) / |r|^2 along c + cos(t) u + sin(t) v, t from start to end <= start + 2 pi.

    With q = c - p and R = |u| = |v|: |r|^2 = D + K cos(t - t0), and n . (r x r') is a + b cos + d sin of the
    same angle s = t - t0, so that the integral is, with I = int ds / (D + K cos s),
        b / K (s - D I) + a I - d / K log(D + K cos s).
    """
    q = centre - p
    qu, qv = q @ u, q @ v
    squared = u @ u
    big, small, t0 = (q * q).sum(axis=1) + squared, 2 * np.hypot(qu, qv), np.arctan2(qv, qu)
    cos, sin = np.cos(t0), np.sin(t0)
    along_u, along_v = np.cross(q, u)[:, 2], np.cross(q, v)[:, 2]
    a = np.cross(u, v)[2]
    b = cos * along_v - sin * along_u
    d = -sin * along_v - cos * along_u
    root = np.sqrt(np.maximum(big**2 - small**2, 1e-300))

    def at(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        s = t - t0
        turns = np.round(s / (2 * np.pi))
        half = 0.5 * s - np.pi * turns
        inverse = 2 / root * np.arctan2((big - small) * np.sin(half), root * np.cos(half))
        return s, inverse + 2 * np.pi * turns / root, np.log(big + small * np.cos(s))

    (s0, i0, l0), (s1, i1, l1) = at(start), at(end)
    k = np.where(small > 1e-9 * big, small, 1)
    bent = b / k * (s1 - s0 - big * (i1 - i0)) - d / k * (l1 - l0)
    flat = (b * (np.sin(s1) - np.sin(s0)) - d * (np.cos(s1) - np.cos(s0))) / big
    return 0.5 * (np.where(small > 1e-9 * big, bent, flat) + a * (i1 - i0))


def tube(p: np.ndarray, centre: np.ndarray, u: np.ndarray, v: np.ndarray, strips: int = 400) -> np.ndarray:
    """The side of a cylinder of half axis u and radius |v|; 0 inside.

    A prism of `strips` rectangles that touch it and have its area.
    """
    radius = np.linalg.norm(v)
    across = v / radius
    other = np.cross(u / np.linalg.norm(u), across)
    phi = (np.arange(strips) + 0.5) * 2 * np.pi / strips
    half = radius * np.pi / strips
    total = np.zeros(len(p))
    for t in phi:
        out = math.cos(t) * across + math.sin(t) * other
        aside = -math.sin(t) * across + math.cos(t) * other
        total += rectangle(p, centre + radius * out, half * aside, u)
    d = p - centre
    along = d @ u / (u @ u)
    inside = (np.abs(along) < 1) & (np.linalg.norm(d - along[:, None] * u, axis=1) < radius)
    return np.where(inside, 0, total)


SHAPES = {"sphere": sphere, "disk": disk, "rectangle": rectangle, "tube": tube}
"""Irradiance of each shape of AreaLight: f(p, centre, u, v)."""
