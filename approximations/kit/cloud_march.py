"""Marches that techniques for clouds share: towards a light for its depth, and along the view ray.

GPU Pro 7, II.4, sections 4.4.2 and 4.5. Both take even steps with one sample amid each.
"""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import mitsuba as mi

from scenes.contract import View


def light_depth(
    view: View,
    x: mi.Point3f,
    steps: int,
    active: mi.Bool | bool = True,
    towards: mi.Vector3f | None = None,
) -> mi.Float:
    """Optical depth from points x (m) to where the cloud ends towards the sun, or along other unit vectors,
    without rain, by `steps` samples; 0 where not active."""
    cloud, l = view.cloud, view.sun.direction if towards is None else towards
    _, way_out = cloud.span(x, l)
    h = way_out / steps

    def march(i, total):
        return i + 1, total + cloud.extinction(x + (mi.Float(i) - 0.5) * h * l)

    start = (mi.UInt32(1), dr.zeros(mi.Float, dr.width(x)))
    _, total = dr.while_loop(start, lambda i, total: active & (i <= steps), march)
    return h * total


def view_march(view: View, steps: int, source: Callable[[mi.Point3f, mi.Bool], mi.Float]) -> mi.Float:
    """int T sigma source dt along the camera's rays, T the transmittance from the eye, without rain.

    source(x, active): what a point sends to the eye, asked for where the cloud has any density. Over a step
    of optical depth a it is taken as constant, L += T source (1 - e^-a), T *= e^-a, which solves the transfer
    equation as the steps shrink.
    """
    cloud, o, w = view.cloud, view.camera.origin, view.camera.direction
    near, far = cloud.span(o, w)
    ds = (far - near) / steps

    def march(i, through, gathered):
        x = o + (near + (mi.Float(i) - 0.5) * ds) * w
        a = cloud.extinction(x) * ds
        kept = dr.exp(-a)
        lit = dr.select(a > 0, source(x, a > 0), 0)
        return i + 1, through * kept, gathered + through * (1 - kept) * lit

    start = (mi.UInt32(1), dr.ones(mi.Float, dr.width(near)), dr.zeros(mi.Float, dr.width(near)))
    _, _, gathered = dr.while_loop(start, lambda i, through, gathered: (i <= steps) & (ds > 0), march)
    return gathered
