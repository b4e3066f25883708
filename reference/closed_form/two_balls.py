"""Light scattered once in two balls of cloud: one smooth integral along each chord, in float64.

The camera looks along +y, so that a pixel is a line (x, z). It meets the left ball first, then the right one.
At a point p of the ball about c, with c' the middle of the other,

    L   = albedo f E_sun sum int e^(-sigma (in(p) + out(p) + across(p))) sigma dy
    in  = way through cloud from the eye to p
    out = -(p - c) . l + sqrt(1 - |p - c|^2 + ((p - c) . l)^2),  way out of the ball towards the sun
    across = 2 sqrt(max(D, 0)) if (c' - p) . l > 0 else 0,  D = 1 - |p - c'|^2 + ((p - c') . l)^2

D is a quadratic in y. Between its roots and the ends of the chord the integrand is smooth but for square
roots at the ends, which y = low + length (1 - cos(pi u)) / 2 takes away, and a composite Gauss rule
in u does the rest.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.polynomial.legendre import leggauss

from reference.truth import closed_form
from scenes.cloud import SUN_IRRADIANCE
from scenes.contract import SINGLE_SCATTERING
from scenes.two_balls import TwoBalls

PANELS, NODES = 12, 8  # of the Gauss rule on each piece of a chord, up to an optical depth of 64


@closed_form(TwoBalls, SINGLE_SCATTERING)
def once_scattered_by_two_balls(scene: TwoBalls, size: int) -> np.ndarray:
    """(size, size, 1), W m^-2 sr^-1, at the centres of size x size samples."""
    sigma, albedo = scene.rainy
    l, g = scene.to_sun(), scene.g
    across = scene.half_width * ((np.arange(size) + 0.5) * 2 / size - 1)
    wide = dr.float64_array_t(mi.Float)
    x, z = (wide(a.ravel()) for a in np.meshgrid(across, -across))
    left, right = scene.middles()
    total, before = dr.zeros(wide, size * size), dr.zeros(wide, size * size)
    for own, other in ((left, right), (right, left)):
        half = dr.safe_sqrt(1 - (x - own[0]) ** 2 - (z - own[2]) ** 2)
        low, high = own[1] - half, own[1] + half
        first, second = (dr.clip(y, low, high) for y in _tangents(x, z, other, l))
        for start, end in ((low, first), (first, second), (second, high)):
            total += _piece(x, z, start, end, before - low, own, other, l, sigma)
        before = before + 2 * half
    lobe = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * l[1]) ** 1.5)
    return SUN_IRRADIANCE * albedo * lobe * np.array(total).reshape(size, size, 1)


def _tangents(x: Any, z: Any, other: list[float], l: list[float]) -> tuple[Any, Any]:
    """Where on the line the sun's ray grazes the other ball, in order; 0 and 0 where nowhere."""
    qx, qy, qz = x - other[0], -other[1], z - other[2]
    along = qx * l[0] + qy * l[1] + qz * l[2]
    a, b = l[1] ** 2 - 1, along * l[1] - qy
    c = 1 - (qx * qx + qy * qy + qz * qz) + along * along
    if a > -1e-12:
        return dr.zeros(type(x), dr.width(x)), dr.zeros(type(x), dr.width(x))
    square = b * b - a * c
    root = dr.safe_sqrt(square)
    return tuple(dr.select(square > 0, (b + s * root) / -a, 0) for s in (-1, 1))


def _piece(
    x: Any,
    z: Any,
    start: Any,
    end: Any,
    ahead: Any,
    own: list[float],
    other: list[float],
    l: list[float],
    sigma: float,
) -> Any:
    """The integral from y = start to end; the way in is y + ahead."""
    wide = type(x)
    node, weight = leggauss(NODES)
    u = ((np.arange(PANELS)[:, None] + (node + 1) / 2) / PANELS).ravel()
    share = wide((1 - np.cos(np.pi * u)) / 2)
    measure = wide(np.pi * np.sin(np.pi * u) / 2 * np.tile(weight, PANELS) / (2 * PANELS))
    length = end - start

    def turn(i, total):
        y = start + length * dr.gather(wide, share, i)
        px, py, pz = x - own[0], y - own[1], z - own[2]
        along = px * l[0] + py * l[1] + pz * l[2]
        out = dr.safe_sqrt(1 - px * px - py * py - pz * pz + along * along) - along
        px, py, pz = x - other[0], y - other[1], z - other[2]
        along = px * l[0] + py * l[1] + pz * l[2]
        chord = 2 * dr.safe_sqrt(1 - px * px - py * py - pz * pz + along * along)
        way = y + ahead + out + dr.select(along < 0, chord, 0)
        return i + 1, total + length * dr.gather(wide, measure, i) * sigma * dr.exp(-sigma * way)

    n = PANELS * NODES
    state = (mi.UInt32(0), dr.zeros(wide, dr.width(x)))
    return dr.while_loop(state, lambda i, total: (i < n) & (length > 0), turn)[1]
