r"""Spherical caps in float64: areas and irradiance of what caps share, by geometry rather than by rays.

A cap is (a, r): unit axis a, shape (..., 3), and angular radius r (rad, 0 < r < pi), shape (...). d is the
angle between two axes, n the normal of the receiver. Shapes broadcast. Areas are in sr; irradiance is
for unit radiance (W m^-2 per W m^-2 sr^-1), so an open hemisphere gives pi.
"""

from __future__ import annotations

import numpy as np

Cap = tuple[np.ndarray, np.ndarray]


def cap_area(r: np.ndarray) -> np.ndarray:
    """4 pi sin(r / 2)^2."""
    return 4 * np.pi * np.sin(0.5 * np.asarray(r, np.float64)) ** 2


def lens_area(r0: np.ndarray, r1: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Area that two caps share, r0 + r1 + d <= 2 pi: two sectors less the kite between the axes.

    The axes and a corner of the lens span a triangle of sides r0, r1, d, half perimeter s and excess E;
    f0 and f1 are its angles at the axes:
        tan(f0 / 2)^2 = sin(s - r0) sin(s - d) / (sin s sin(s - r1)),
        tan(E / 4)^2 = tan(s / 2) tan((s - r0) / 2) tan((s - r1) / 2) tan((s - d) / 2),
        area = f0 / pi cap(r0) + f1 / pi cap(r1) - 2 E.
    """
    r0, r1, d = np.broadcast_arrays(*(np.asarray(x, np.float64) for x in (r0, r1, d)))
    s = 0.5 * (r0 + r1 + d)
    partial = (s > r0) & (s > r1) & (s > d)
    b0, b1, bd = (np.where(partial, s - side, 1.0) for side in (r0, r1, d))
    s = np.where(partial, s, 1.0)
    f0 = 2 * np.arctan(np.sqrt(np.sin(b0) * np.sin(bd) / (np.sin(s) * np.sin(b1))))
    f1 = 2 * np.arctan(np.sqrt(np.sin(b1) * np.sin(bd) / (np.sin(s) * np.sin(b0))))
    tangents = np.tan(0.5 * s) * np.tan(0.5 * b0) * np.tan(0.5 * b1) * np.tan(0.5 * bd)
    lens = (f0 * cap_area(r0) + f1 * cap_area(r1)) / np.pi - 8 * np.arctan(np.sqrt(tangents))
    return np.where(partial, lens, np.where(d > np.maximum(r0, r1), 0, cap_area(np.minimum(r0, r1))))


def half_plane_share(x: np.ndarray) -> np.ndarray:
    """Share of a small disk that a straight edge leaves visible when the edge has crossed 1 - x of its
    diameter: (acos t - t sqrt(1 - t^2)) / pi with t = 1 - 2 x, 0 <= x <= 1."""
    t = 1 - 2 * np.asarray(x, np.float64)
    return (np.arccos(t) - t * np.sqrt(1 - t * t)) / np.pi


def vector_irradiance(*caps: Cap) -> np.ndarray:
    """Phi = int w dw over the directions that lie in every cap, (..., 3); a receiver gets n . Phi.

    By Stokes, Phi = 1/2 oint w x dw round the boundary. On the circle of cap (a, r), with rho(phi) the
    unit tangent at a towards azimuth phi, an arc of it adds
        1/2 [sin(r)^2 a (phi_1 - phi_0) - sin r cos r int rho dphi].
    Every circle is cut where another crosses it, and the arcs inside all other caps count; a cap inside all
    others counts whole, pi sin(r)^2 a, and nothing does where two are apart. Two caps make a lens, a cap and
    the hemisphere about n a cap on the horizon, hemispheres alone a polygon.
    """
    caps = tuple((np.asarray(a, np.float64), np.asarray(r, np.float64)) for a, r in caps)
    shape = np.broadcast_shapes(*(np.broadcast_shapes(a.shape[:-1], r.shape) for a, r in caps))
    caps = tuple((np.broadcast_to(a, (*shape, 3)), np.broadcast_to(r, shape)) for a, r in caps)
    total, cut = np.zeros((*shape, 3)), np.ones(shape, bool)
    for i, (a, r) in enumerate(caps):
        whole = np.ones(shape, bool)
        for b, q in caps[:i] + caps[i + 1 :]:
            d = np.arccos(np.clip(_dot(a, b), -1, 1))
            whole &= d + r < q
            cut &= d < r + q
        total += np.where((whole & cut)[..., None], np.pi * np.sin(r)[..., None] ** 2 * a, 0)
        cut &= ~whole
    total[cut] = _by_arcs(tuple((a[cut], r[cut]) for a, r in caps))
    return total


def _by_arcs(caps: tuple[Cap, ...]) -> np.ndarray:
    """Phi (n, 3) of caps (n, 3), (n)."""
    total = np.zeros_like(caps[0][0])
    for i, (a, r) in enumerate(caps):
        others = caps[:i] + caps[i + 1 :]
        u, v = _tangents(a)
        ends = [np.full(r.shape, -np.pi), np.full(r.shape, np.pi)]
        for b, q in others:
            ends += _crossings(a, r, u, v, b, q)
        cuts = np.sort(np.stack(ends), axis=0)
        sin, cos = np.sin(r)[..., None], np.cos(r)[..., None]
        for low, high in zip(cuts[:-1, ..., None], cuts[1:, ..., None], strict=True):
            middle = 0.5 * (low + high)
            w = cos * a + sin * (np.cos(middle) * u + np.sin(middle) * v)
            inside = np.ones(r.shape, bool)
            for b, q in others:
                inside &= _dot(w, b) > np.cos(q)
            rho = (np.sin(high) - np.sin(low)) * u + (np.cos(low) - np.cos(high)) * v
            arc = 0.5 * (sin * sin * a * (high - low) - sin * cos * rho)
            total += np.where(inside[..., None], arc, 0)
    return total


def horizon_irradiance(theta: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Irradiance of a round light of radius s <= pi/2, theta from the normal, less what is below the horizon.

    pi sin(s)^2 cos(theta) while it is all above; where the horizon cuts it, with
    fa = acos(-cot theta cot s) and fn = acos(cos s / sin theta),
        fa sin(s)^2 cos(theta) - sin s cos s sin(theta) sin(fa) + fn.
    """
    theta, s = np.broadcast_arrays(np.asarray(theta, np.float64), np.asarray(s, np.float64))
    cut = np.abs(theta - 0.5 * np.pi) < s
    t = np.where(cut, theta, 0.5 * np.pi)
    fa = np.arccos(np.clip(-np.cos(t) * np.cos(s) / (np.sin(t) * np.sin(s)), -1, 1))
    fn = np.arccos(np.clip(np.cos(s) / np.sin(t), -1, 1))
    partial = fa * np.sin(s) ** 2 * np.cos(t) - np.sin(s) * np.cos(s) * np.sin(t) * np.sin(fa) + fn
    whole = np.where(theta < 0.5 * np.pi, np.pi * np.sin(s) ** 2 * np.cos(theta), 0)
    return np.where(cut, partial, whole)


def openness_beside_sphere(x: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Cosine-weighted share of the sky at x from where a sphere rests on a plane:
    1 - (R / sqrt(x^2 + R^2))^3, 0 at the contact and 1 far away."""
    x, radius = np.asarray(x, np.float64), np.asarray(radius, np.float64)
    return 1 - (radius / np.hypot(x, radius)) ** 3


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", a, b)


def _tangents(a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """u, v with u x v = a."""
    least = np.eye(3)[np.argmin(np.abs(a), axis=-1)]
    u = np.cross(least, a)
    u /= np.linalg.norm(u, axis=-1, keepdims=True)
    return u, np.cross(a, u)


def _crossings(
    a: np.ndarray, r: np.ndarray, u: np.ndarray, v: np.ndarray, b: np.ndarray, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Azimuths in [-pi, pi] at which the circle (a, r) crosses (b, q); pi and pi where it does not."""
    bu, bv = _dot(b, u), _dot(b, v)
    side = np.cos(q) - np.cos(r) * _dot(a, b)
    reach = np.sin(r) * np.hypot(bu, bv)
    crosses = np.abs(side) < reach
    half = np.arccos(np.where(crosses, side, 0) / np.where(crosses, reach, 1))
    towards = np.arctan2(bv, bu)
    ends = (np.angle(np.exp(1j * (towards + sign * half))) for sign in (-1, 1))
    return tuple(np.where(crosses, end, np.pi) for end in ends)
