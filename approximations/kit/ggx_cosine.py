"""The GGX lobe towards one direction, cosine included."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from approximations.kit.ggx import distribution_by_sine, separable


def ggx_cosine(n: mi.Vector3f, v: mi.Vector3f, w: mi.Vector3f, alpha: mi.Float) -> mi.Float:
    """f n.w = D G1(n.v) G1(n.w) / (4 n.v) for a reflectance of 1, 1/sr; 0 where w comes from below n.

    n, v to the eye and w to the light are unit; alpha in (0, 1].
    """
    nw, nv = dr.maximum(dr.dot(n, w), 0), dr.maximum(dr.dot(n, v), 1e-4)
    h = dr.normalize(v + w)
    return distribution_by_sine(n, h, alpha) * separable(nw, nv, alpha) / (4 * nv)
