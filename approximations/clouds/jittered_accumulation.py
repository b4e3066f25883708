r"""Clouds over many frames, the other way: all pixels marched in a few coarse steps, whose start is jittered.

What later renderers do instead of marching one pixel of sixteen (GPU Pro 7, II.4, section 4.6, which has
nothing of it). In frame n a ray is cut in few steps of length h, the first sample at the share u of a step,

    tau_n = h sum_i sigma(near + (i + u) h),   u = frac(noise(x) + n / golden ratio),
    C_n(x) = (1 - a) C_{n-1}(y) + a e^(-tau_n),   a = max(share, 1 / n),

y being where the last screen had what x sees (`cloud_reprojection`, of which the guesses of distance and wind
are the same). The mean of tau_n over u is exact for any number of steps; the mean of e^(-tau_n) is not: it is
too clear, the more the fewer the steps, and no number of frames mends that. Every frame pays for all pixels.

- `noise`: interleaved gradient noise, frac(52.9829189 frac(0.06711056 x + 0.00583715 y)), which is even over
  any 3 x 3 pixels; "white", anew at each pixel and frame; "none", every sample amid its step, which leaves
  bands.
- `share`: what the newest frame counts for. A ghost fades by 1 - share a frame, and never goes at once.
- Where the last screen has nothing a pixel starts anew, with the noise of one frame.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import SAMPLING, STALE_FRAMES, Sweep, at_most, exact_when, technique
from approximations.kit.depth_buffer import DepthBuffer
from approximations.kit.reprojection import (
    INFINITY,
    Reach,
    crossed,
    earlier,
    fetch,
    pixels,
    ray,
    screen,
    texture,
)
from scenes.contract import TRANSMITTANCE, View
from scenes.moving_clouds import MovingClouds

GOLDEN = 0.6180339887  # 1 / golden ratio
AT_REST = {"turn": 0.0, "travel": 0.0, "wind": 0.0}


@technique(
    source="the usual alternative to GPU Pro 7, II.4, sec. 4.6",
    estimates=TRANSMITTANCE,
    on=(MovingClouds,),
    replaces="a fine march of every pixel in every frame",
    neglects=(SAMPLING, STALE_FRAMES),
    claims=(
        at_most(1.0),
        exact_when("MovingClouds", 0.003, fields=AT_REST, knobs={"noise": "none", "steps": 64}),
    ),
    baseline=True,
)
def jittered_accumulation(
    view: View,
    *,
    noise: Literal["gradient", "white", "none"] = "gradient",
    share: Annotated[float, Sweep(0.3, low=0.001, high=1)] = 0.1,
    steps: Annotated[int, Sweep(12, low=1, high=1024)] = 6,
    distance: Reach = "shell",
    wind: Literal["ignored", "followed"] = "ignored",
    frames: Annotated[int, Sweep(low=1, high=1024)] = 16,
) -> mi.Color3f:
    """Transmittance (0 to 1) of the last frame, one value per pixel.

    noise     where in its step the first sample of a ray is.
    share     least weight of the newest frame.
    steps     samples along a ray in a frame.
    distance  at which history is looked for.
    wind      whether it is looked for upwind.
    frames    how many there have been.
    """
    before, now = None, None
    for n, ago in enumerate(reversed(range(frames)), 1):
        camera = screen(view, ago)
        weight = dr.opaque(mi.Float, max(share, 1 / n))
        now = _frame(view, camera, before, now, ago, noise, weight, steps, distance, wind)
        dr.eval(now)
        before = camera
    return mi.Color3f(now)


def starts(x: mi.Point2u, width: int, frame: mi.UInt32, noise: str) -> mi.Float:
    """Where in its step a pixel's first sample is in a frame, 0 to 1."""
    if noise == "none":
        return mi.Float(0.5)
    if noise == "white":
        return mi.sample_tea_float32(dr.fma(x.y, width, x.x), frame)
    across = fraction(dr.dot(mi.Point2f(x), mi.Point2f(0.06711056, 0.00583715)))
    return fraction(dr.fma(mi.Float(frame), GOLDEN, fraction(52.9829189 * across)))


def fraction(x: mi.Float) -> mi.Float:
    """What is left of x >= 0 without its whole part."""
    return x - dr.floor(x)


def _frame(
    view: View,
    camera: DepthBuffer,
    before: DepthBuffer | None,
    history: mi.Float | None,
    ago: int,
    noise: str,
    weight: mi.Float,
    steps: int,
    distance: str,
    wind: str,
) -> mi.Float:
    """One frame's image from that of the frame before, which the first has none of."""
    w, h = view.width, view.height
    blown, step = (dr.opaque(mi.Vector3f, view.cloud.model.blown(n)) for n in (ago, 1))
    x = pixels(w, h)
    d = ray(camera, mi.Point2f(x))
    first = starts(x, w, dr.opaque(mi.UInt32, ago), noise)
    image, far = crossed(view, camera.eye, d, blown, steps, first)
    if before is not None:
        reach = mi.Float(INFINITY)
        if distance == "shell":
            reach = view.cloud.span(camera.eye, d)[0]
        elif distance == "depth":
            reach = far
        y = earlier(before, camera, d, reach, step if wind == "followed" else mi.Vector3f(0))
        kept, there = fetch(texture(history, w, h, "bilinear"), y)
        image = dr.select(there, dr.lerp(kept, image, weight), image)
    return dr.select(dr.isfinite(view.trace(camera.eye, d)), 1, image)
