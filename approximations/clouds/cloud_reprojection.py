r"""Clouds over many frames: one pixel of every block is marched a frame, the rest is taken from the last one.

GPU Pro 7, chapter II.4, section 4.6. The chapter only says that clouds take 20 ms marched outright and 2 ms
when the image is built up by temporal reprojection. How is told in the talk that it refers to, as later made
again by many: in frame n the pixel s(n) of every block of b x b is marched, b = 4, where s runs through all
b^2 pixels; the small image that this makes is the fallback. For a pixel x on whose ray d from the eye o
something is taken to be at the distance t,

    y = project_{n-1}(o + t d),
    C_n(x) = march where it is x's turn,  C_{n-1}(y) where y lies on the screen,  else the small image at x.

With all at rest C is the full march after b^2 frames, and a cloud that is gone is gone after as many. What it
costs: changes are late, t is a guess, every fetch blurs, nothing is known of what comes in over an edge, and
pixels jump at their turn: with clouds that move 20 m a frame the change from frame to frame is wrong by 3.6
times itself, by 1.1 where depth and wind are followed (block 2: 1.7 and 0.7). A frame does 1/12 of the work
of a full march, at 64 steps 1/14: the projection and the history of all pixels are why it is not 1/16.

Not given, and what was done here:
- `distance`: where the ray enters the layer of clouds ("shell"), the mean distance of what the small image
  lost its light to ("depth"), or "infinity", which follows the turning of a camera and nothing else.
- `order`: the Bayer matrix, whose prefixes are spread over the block, or row by row ("scan").
- `wind`: whether points are moved back by the wind of a frame ahead of the projection.
- `blend`: the share of history that is kept even where a pixel is marched, against flicker of coarse marches.
- `filter`: of history and of the small image. Bilinear fetches blur a moving image anew at each frame; with
  nearest ones what moves by less than half a pixel a frame does not move at all until its turn.
- `image`: "low" is the small image alone, at a quarter or (block 2) half of the resolution, as in renderers
  without history. "exact" marches all pixels of the last frame.
- Hills hide clouds: their rays are not marched and leave a transmittance of 1 in the history, so that what
  comes out from behind them is too clear until its turn.
- The first frame is all fallback. What moves over the screen may miss its turn many times, so that it grows
  older than b^2 frames: the error still rises between 17 and 64 `frames`.
- The cost that is reported is that of all `frames`; each picture on the way costs that over `frames`. The
  screen has the resolution of the samples, of which 4 x 4 are averaged to a pixel of the picture that is
  judged: a block of 4 is one such pixel, which is kind to the small image.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import SAMPLING, STALE_FRAMES, Domain, Sweep, at_most, exact_when, technique
from approximations.kit.depth_buffer import DepthBuffer
from approximations.kit.reprojection import (
    INFINITY,
    Filter,
    Reach,
    crossed,
    earlier,
    fetch,
    pixels,
    ray,
    screen,
    texture,
)
from scenes.contract import TRANSMITTANCE, Scene, View
from scenes.moving_clouds import MovingClouds

BAYER = ((0, 8, 2, 10), (12, 4, 14, 6), (3, 11, 1, 9), (15, 7, 13, 5))
"""Ranks of the pixels of a block of 4; those of a block of 2 stand in its corner in the right order."""

AT_REST = {"turn": 0.0, "travel": 0.0, "wind": 0.0}


@technique(
    source="GPU Pro 7, II.4, sec. 4.6",
    covers=("cloudscapes/19",),
    estimates=TRANSMITTANCE,
    on=(MovingClouds,),
    replaces="a march of every pixel in every frame",
    neglects=(STALE_FRAMES, SAMPLING),
    claims=(
        at_most(1.0),
        exact_when("MovingClouds", 0.003, knobs={"image": "exact"}),
        exact_when("MovingClouds", 0.003, fields=AT_REST),
    ),
    stress={"MovingClouds": ("travel", "wind")},
)
def cloud_reprojection(
    view: View,
    *,
    image: Literal["temporal", "low", "exact"] = "temporal",
    block: Literal[2, 4] = 4,
    order: Literal["bayer", "scan"] = "bayer",
    distance: Reach = "shell",
    wind: Literal["ignored", "followed"] = "ignored",
    filter: Filter = "bilinear",
    blend: Annotated[float, Sweep(0.5, low=0, high=0.99)] = 0.0,
    frames: Annotated[int, Sweep(low=1, high=1024)] = 24,
    steps: Annotated[int, Sweep(low=1, high=1024)] = 32,
) -> mi.Color3f:
    """Transmittance (0 to 1) of the last frame, one value per pixel.

    image     built up over frames, the small image of the last frame, or a march of all its pixels.
    block     pixels along a side of a block.
    order     of the pixels of a block.
    distance  at which history is looked for.
    wind      whether it is looked for upwind.
    filter    of history and small image.
    blend     share of history in a pixel that is marched.
    frames    how many there have been.
    steps     samples along a ray.
    """
    size = 1 if image == "exact" else block
    count = frames if image == "temporal" else 1
    for now in pictures(view, count, size, order, distance, wind, filter, blend, steps):
        last = now
    return mi.Color3f(last)


@cloud_reprojection.domain
def domain(scene: Scene) -> Domain:
    """Turning and flying as players do, and wind that takes no cloud across a block before its turn."""
    if scene.turn > 2:
        return Domain(False, "a camera that whirls round shows more new sky than old")
    if scene.wind > 20:
        return Domain(False, "a time-lapse: clouds cross several blocks in the frames that make an image")
    if scene.travel > 20:
        return Domain(False, "a camera faster than any aircraft")
    return Domain(True)


def permutation(block: int, order: str) -> list[tuple[int, int]]:
    """The pixels (x, y) of a block in the order in which they are marched, the last frame's first."""
    found = [(i % block, i // block) for i in range(block * block)]
    return sorted(found, key=lambda p: BAYER[p[1]][p[0]]) if order == "bayer" else found


def pictures(view: View, frames: int, block: int, order: str, *how: str | float | int) -> Iterator[mi.Float]:
    """The image of every frame up to the last. how: distance, wind, filter, blend, steps, as above."""
    turns = permutation(block, order)
    before, now = None, None
    for ago in reversed(range(frames)):
        camera = screen(view, ago)
        now = _frame(view, camera, before, now, ago, block, turns[ago % len(turns)], *how)
        dr.eval(now)
        before = camera
        yield now


def _frame(
    view: View,
    camera: DepthBuffer,
    before: DepthBuffer | None,
    history: mi.Float | None,
    ago: int,
    block: int,
    turn: tuple[int, int],
    distance: str,
    wind: str,
    filter: str,
    blend: float,
    steps: int,
) -> mi.Float:
    """One frame's image from that of the frame before, which the first has none of."""
    w, h = view.width, view.height
    across, below = -(-w // block), -(-h // block)
    offset = mi.Point2u(dr.opaque(mi.UInt32, turn[0]), dr.opaque(mi.UInt32, turn[1]))
    blown, step = (dr.opaque(mi.Vector3f, view.cloud.model.blown(n)) for n in (ago, 1))

    marched = ray(camera, mi.Point2f(pixels(across, below) * block + offset))
    hidden = dr.isfinite(view.trace(camera.eye, marched))
    through, far = crossed(view, camera.eye, marched, blown, steps, 0.5)
    low = dr.select(hidden, 1, through)
    dr.eval(low, far)

    x = pixels(w, h)
    d = ray(camera, mi.Point2f(x))
    own = x // block
    cell = dr.fma(own.y, across, own.x)
    fresh = dr.gather(mi.Float, low, cell)
    small = texture(low, across, below, filter)
    old, _ = fetch(small, (mi.Point2f(x) - mi.Point2f(offset)) / block)
    if before is not None:
        reach = mi.Float(INFINITY)
        if distance == "shell":
            reach = view.cloud.span(camera.eye, d)[0]
        elif distance == "depth":
            reach = dr.gather(mi.Float, far, cell)
        y = earlier(before, camera, d, reach, step if wind == "followed" else mi.Vector3f(0))
        kept, there = fetch(texture(history, w, h, filter), y)
        old = dr.select(there, kept, old)
        fresh = dr.select(there, dr.lerp(fresh, kept, blend), fresh)
    image = dr.select(dr.all(x - own * block == offset), fresh, old)
    return dr.select(dr.isfinite(view.trace(camera.eye, d)), 1, image)
