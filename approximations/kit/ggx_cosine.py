"""The GGX lobe towards one direction, cosine included."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi


def ggx_cosine(n: mi.Vector3f, v: mi.Vector3f, w: mi.Vector3f, alpha: mi.Float) -> mi.Float:
    """f n.w (1/sr) for a reflectance of 1: D G1(n.v) G1(n.w) / (4 n.v), Smith's masking, no Fresnel.

    n, v to the eye and w to the light are unit; alpha in (0, 1]. With h halfway between v and w,
        D = alpha^2 / (pi (alpha^2 (n.h)^2 + |n x h|^2)^2),
        G1(c) = 2 c / (c + sqrt(c^2 + alpha^2 (1 - c^2))).
    """
    h = dr.normalize(v + w)
    a2 = dr.square(alpha)
    spread = a2 * dr.square(dr.dot(n, h)) + dr.squared_norm(dr.cross(n, h))
    d = a2 * dr.inv_pi / dr.square(spread)
    nw, nv = dr.maximum(dr.dot(n, w), 0), dr.maximum(dr.dot(n, v), 1e-4)
    return d * nw / (_smith(nw, a2) * _smith(nv, a2))


def _smith(c: mi.Float, a2: mi.Float) -> mi.Float:
    return c + dr.sqrt(a2 + (1 - a2) * c * c)
