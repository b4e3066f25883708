"""Exponential integrals, which plane layers of a medium are full of."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

SMALL = (-0.57721566, 0.99999193, -0.24991055, 0.05519968, -0.00976004, 0.00107857)
LARGE_OVER = (0.2677737343, 8.6347608925, 18.0590169730, 8.5733287401, 1.0)
LARGE_UNDER = (3.9584969228, 21.0996530827, 25.6329561486, 9.5733223454, 1.0)


def e2(t: mi.Float) -> mi.Float:
    """E2(t) = int_0^1 e^(-t/m) dm, from 1 at t = 0 down to 0: what a plane layer of optical depth t >= 0 lets
    through of light that comes from all sides alike, per unit radiance and solid angle.

    E2 = e^-t - t E1, with E1 by the polynomial (t <= 1) and the quotient (t > 1) of Abramowitz and Stegun,
    5.1.53 and 5.1.56: within 1e-6.
    """
    x = dr.maximum(t, 1e-12)
    small = _polynomial(SMALL, x) - dr.log(x)
    large = dr.exp(-x) * _polynomial(LARGE_OVER, x) / (x * _polynomial(LARGE_UNDER, x))
    return dr.exp(-x) - x * dr.select(x <= 1, small, large)


def _polynomial(coefficients: tuple[float, ...], x: mi.Float) -> mi.Float:
    total = mi.Float(0)
    for c in reversed(coefficients):
        total = total * x + c
    return total
