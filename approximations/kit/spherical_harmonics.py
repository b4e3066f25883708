r"""Real spherical harmonics: projection, sums, and what a clamped cosine makes of them.

    c_lm = int L(w) Y_lm(w) dw,    L_SH(w) = sum c_lm Y_lm(w),    E(n) = sum A_l c_lm Y_lm(n)

Coefficients stand in the order l^2 + l + m; `bands` bands, l = 0 to bands - 1, have bands^2 of them. The
basis is Dr.Jit's. Source of A_l: Ramamoorthi and Hanrahan 2001.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

COSINE = (math.pi, 2 * math.pi / 3, math.pi / 4, 0.0)
"""A_l of bands 0 to 3: the clamped cosine's share of each band."""


def evaluate(coefficients: list[Any], w: mi.Vector3f) -> Any:
    """L_SH at unit directions."""
    last_band = math.isqrt(len(coefficients)) - 1
    return sum(c * y for c, y in zip(coefficients, dr.sh_eval(w, last_band), strict=True))


def irradiance(coefficients: list[Any]) -> list[Any]:
    """The coefficients of E by normal, up to 4 bands."""
    return [COSINE[math.isqrt(i)] * c for i, c in enumerate(coefficients)]


def project(radiance: Callable[[mi.Vector3f], mi.Color3f], bands: int, rows: int = 64) -> list[mi.Color3f]:
    """Coefficients of a function of direction, by Gauss's rule in z and 2 rows even azimuths."""
    nodes, weights = (mi.Float(x) for x in np.polynomial.legendre.leggauss(rows))
    row, column = dr.meshgrid(dr.arange(mi.UInt32, rows), dr.arange(mi.UInt32, 2 * rows))
    z, azimuth = dr.gather(mi.Float, nodes, row), (dr.pi / rows) * mi.Float(column)
    s = dr.safe_sqrt(1 - z * z)
    w = mi.Vector3f(s * dr.cos(azimuth), s * dr.sin(azimuth), z)
    weighted = radiance(w) * dr.gather(mi.Float, weights, row) * (dr.pi / rows)
    dr.eval(weighted)
    coefficients = [dr.sum(weighted * y, axis=1) for y in dr.sh_eval(w, bands - 1)]
    dr.make_opaque(coefficients)
    return coefficients


def mirrored(radiance: Callable[[mi.Vector3f], Any]) -> Callable[[mi.Vector3f], Any]:
    """The sky above, repeated below the horizon."""
    return lambda w: radiance(mi.Vector3f(w.x, w.y, dr.abs(w.z)))
