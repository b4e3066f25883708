"""Frames of a moving pinhole camera: rays, where a point stood on an earlier screen, and what was there.

A screen is a flat array, row by row; places on it are in pixels, whole at the pixels' centres.
"""

from __future__ import annotations

import math
from typing import Literal

import drjit as dr
import mitsuba as mi

from approximations.kit.depth_buffer import DepthBuffer
from scenes.contract import View

Filter = Literal["bilinear", "nearest"]
Reach = Literal["shell", "depth", "infinity"]

INFINITY = 1e7  # m: 60 m aside are 1/200 of a pixel of 0.07 degrees


def screen(view: View, ago: int) -> DepthBuffer:
    """The camera as it stood some frames ago, of the view's `cloud.model` (place, axes, field_of_view). What
    it is made of is not known when kernels are compiled, so that all frames share them."""
    flight, w, h = view.cloud.model, view.width, view.height
    step = 2 * math.tan(flight.field_of_view / 2) / w
    forward, right, down = (mi.ScalarVector3f(x) for x in flight.axes(ago))
    corner = forward - 0.5 * step * ((w - 1) * right + (h - 1) * down)
    parts = [dr.opaque(mi.Vector3f, list(x)) for x in (forward, corner, step * right, step * down)]
    return DepthBuffer(dr.opaque(mi.Point3f, flight.place(ago)), *parts, mi.Float(dr.inf), w, h)


def ray(camera: DepthBuffer, at: mi.Point2f) -> mi.Vector3f:
    """Unit direction in which the camera sees a place on the screen."""
    return dr.normalize(camera.corner + at.x * camera.right + at.y * camera.down)


def pixels(width: int, height: int) -> mi.Point2u:
    """Every pixel of a screen."""
    i = dr.arange(mi.UInt32, width * height)
    return mi.Point2u(i % width, i // width)


def texture(image: mi.Float, width: int, height: int, filter: str) -> mi.Texture2f:
    """An image as a texture unit reads it; its edge stands for what is beyond."""
    mode = dr.FilterMode.Nearest if filter == "nearest" else dr.FilterMode.Linear
    texels = mi.TensorXf(image, shape=(height, width, 1))
    return mi.Texture2f(texels, use_accel=False, filter_mode=mode, wrap_mode=dr.WrapMode.Clamp)


def fetch(image: mi.Texture2f, at: mi.Point2f) -> tuple[mi.Float, mi.Bool]:
    """An image at places on its screen, and whether they lie on it."""
    height, width, _ = image.shape
    uv = (at + 0.5) / mi.Point2f(width, height)
    return image.eval(uv)[0], dr.all((uv >= 0) & (uv <= 1))


def earlier(
    before: DepthBuffer,
    camera: DepthBuffer,
    d: mi.Vector3f,
    reach: mi.Float,
    blown: mi.Vector3f,
) -> mi.Point2f:
    """Where on the screen of the frame before stood what is seen along d (unit) at a distance of `reach`
    (m) and has since been blown so far (m). It must have been in front of the camera."""
    return before.project(camera.eye + reach * d - blown)[0]


def crossed(
    view: View, o: mi.Point3f, d: mi.Vector3f, blown: mi.Vector3f, steps: int, first: mi.Float | float
) -> tuple[mi.Float, mi.Float]:
    """Transmittance (0 to 1) of the clouds along rays by `steps` samples, the first of them after the share
    `first` of a step, and the mean distance (m) of what takes light away, the near side where nothing does.

    blown: how far (m) the clouds have still to go to where they are in the last frame.
    """
    near, far = view.cloud.span(o, d)
    ds = (far - near) / steps

    def march(i, through, lost):
        t = near + (mi.Float(i) + first) * ds
        kept = through * dr.exp(-view.cloud.extinction(o + t * d + blown) * ds)
        return i + 1, kept, lost + (through - kept) * t

    start = (mi.UInt32(0), dr.ones(mi.Float, dr.width(d)), dr.zeros(mi.Float, dr.width(d)))
    _, through, lost = dr.while_loop(start, lambda i, through, lost: (i < steps) & (ds > 0), march)
    clear = through > 0.999
    return through, dr.select(clear, near, lost / dr.maximum(1 - through, 1e-6))
