r"""The parts of a GGX reflection, f = D G F / (4 n.l n.v), as functions of cosines.

Walter, Marschner, Li and Torrance, "Microfacet Models for Refraction through Rough Surfaces" (2007). alpha
is the width of the lobe, h the unit vector halfway between l and v. Cosines and alpha may be numbers or
arrays of any float type, in (0, 1].
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi


def distribution(nh: Any, alpha: Any) -> Any:
    """D = a^2 / (pi ((n.h)^2 (a^2 - 1) + 1)^2), 1/sr, as it is mostly printed.

    The sum loses its digits near n.h = 1: in float32 for alpha under 0.01, in float16 under 0.2, where its
    square is 0 for alpha under 0.013.
    """
    a2 = dr.square(alpha)
    return a2 * dr.inv_pi / dr.square(nh * nh * (a2 - 1) + 1)


def distribution_by_sine(n: mi.Vector3f, h: mi.Vector3f, alpha: Any) -> Any:
    """The same with 1 - (n.h)^2 = |n x h|^2, which keeps its digits.

    As k k / pi, k = a / (a^2 (n.h)^2 + |n x h|^2), so that float16 holds it wherever it holds the result.
    """
    along = alpha * dr.dot(n, h)
    k = alpha / (dr.square(along) + dr.squared_norm(dr.cross(n, h)))
    return k * dr.inv_pi * k


def masking(c: Any, alpha: Any) -> Any:
    """Smith's G1 = 2 / (1 + sqrt(1 + a^2 (1 / c^2 - 1))), written so that c may be 0."""
    a2 = dr.square(alpha)
    return 2 * c / (c + dr.sqrt(a2 + (1 - a2) * c * c))


def separable(nl: Any, nv: Any, alpha: Any) -> Any:
    """G = G1(n.l) G1(n.v): masking and shadowing taken to be independent. Mitsuba's, too."""
    return masking(nl, alpha) * masking(nv, alpha)


def correlated(nl: Any, nv: Any, alpha: Any) -> Any:
    """G = 1 / (1 + Lambda(n.l) + Lambda(n.v)): what is low is masked and shadowed at once (Heitz 2014)."""
    a2 = dr.square(alpha)
    toward_light = nv * dr.sqrt(a2 + (1 - a2) * nl * nl)
    toward_eye = nl * dr.sqrt(a2 + (1 - a2) * nv * nv)
    return 2 * nl * nv / dr.maximum(toward_light + toward_eye, 1e-12)


def schlick_masking(nl: Any, nv: Any, alpha: Any) -> Any:
    """G of c / (c (1 - k) + k) for l and v, k = a / 2, which has no roots (Schlick 1994)."""
    k = 0.5 * alpha
    return (nl / (nl * (1 - k) + k)) * (nv / (nv * (1 - k) + k))


def schlick(f0: Any, vh: Any) -> Any:
    """Fresnel reflectance F0 + (1 - F0) (1 - v.h)^5."""
    return f0 + (1 - f0) * dr.power(dr.clip(1 - vh, 0, 1), 5)


def dielectric(f0: Any, vh: Any) -> Any:
    """Fresnel's reflectance of unpolarised light from outside a dielectric that reflects F0 head on.

    With the index m = (1 + sqrt F0) / (1 - sqrt F0), c = v.h and g = sqrt(m^2 - 1 + c^2),
        F = 1/2 ((g - c) / (g + c))^2 (1 + ((c (g + c) - 1) / (c (g - c) + 1))^2).
    """
    root = dr.sqrt(f0)
    m = (1 + root) / (1 - root)
    g = dr.sqrt(m * m - 1 + vh * vh)
    near, far = g - vh, g + vh
    return 0.5 * dr.square(near / far) * (1 + dr.square((vh * far - 1) / (vh * near + 1)))
