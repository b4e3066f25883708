r"""Screen-space ambient occlusion, gathered over frames instead of blurred.

GPU Pro 7, chapter III.3, section 3.3.4. What it stands for is the openness of a point x with normal n,

    A(x) = 1/pi int V(x, w) n . w dw.

    samples    points x + R s of a ball round x, s from a table of unit-ball points
    occluder   a sample is hidden where the depth buffer stands in front of it
    frames     A = share of samples that are not hidden, the mean over frames with a slice of the table each

The source prints no formula for the test and names the ball of the first such method. On a flat wall half of
the ball lies in the wall, so that A = 0.5 where nothing hides anything: `volume` offers the half towards the
normal, and cosine-weighted directions without an end. Blurring a single frame of rotated samples is what the
source replaces: frames=1, samples=24, rotation="per pixel", blur=2.

What no number of samples mends: nothing is known behind the first surface or off the screen, and every
surface is endlessly thick. `range_check` lets occluders more than R in front of the sample pass.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    COSINE_OVER_LIGHT,
    HIDDEN_GEOMETRY,
    SAMPLING,
    SHAPE_OF_VISIBILITY,
    Domain,
    Sweep,
    at_most,
    technique,
)
from approximations.kit.depth_buffer import DepthBuffer, depth_buffer
from approximations.kit.loops import repeat
from approximations.kit.sampling import random_turn
from scenes.contract import SKY_VISIBILITY, Scene, View
from scenes.occluders import Occluders

TABLE = 512
"""Points in the table; frames go round it."""
CANDIDATES = 16
LIFT = 1e-3
"""Of the point off its surface, in units of the radius."""


@technique(
    source="GPU Pro 7, III.3, section 3.3.4",
    covers=("multi-frame/07",),
    estimates=SKY_VISIBILITY,
    on=(Occluders,),
    replaces="cosine-weighted visibility of the sky",
    neglects=(SHAPE_OF_VISIBILITY, COSINE_OVER_LIGHT, HIDDEN_GEOMETRY, SAMPLING),
    claims=(at_most(1.0),),
    stress={"Occluders": ("elevation", "gap", "pole")},
)
def multi_frame_ssao(
    view: View,
    table: mi.Vector3f,
    *,
    frames: Annotated[int, Sweep(1, 4, 16, 60, low=1, high=4096)] = 60,
    samples: Annotated[int, Sweep(8, 24, low=1, high=TABLE)] = 8,
    radius: Annotated[float, Sweep(0.1, 0.5, 2.0, low=1e-3, high=100.0)] = 0.5,
    rotation: Literal["none", "per pixel"] = "none",
    range_check: bool = False,
    blur: Annotated[int, Sweep(0, 2, low=0, high=16)] = 0,
    occluder: Literal["depth buffer", "exact"] = "depth buffer",
    volume: Literal["ball", "hemisphere", "exact"] = "ball",
) -> mi.Float:
    """Openness A (0 to 1), 1 where the camera sees no surface. Cost is that of all frames together.

    samples are points per frame, radius is R (m), blur half the width of a box (texels), over each side.
    rotation turns the table about the view direction. occluder "exact" traces a ray to the sample. volume
    "exact": directions spread by cosine, whose rays have no end; the depth buffer takes the sample on them.
    """
    surface, buffer = view.surface, depth_buffer(view)
    x, n = surface.position + LIFT * radius * surface.normal, surface.normal
    count = view.width * view.height
    turn = random_turn(count, seed=1) if rotation == "per pixel" else mi.Float(0)
    spin = dr.sincos(turn)
    width, total = dr.width(table), frames * samples

    def offset(i: mi.UInt32) -> mi.Vector3f:
        s = dr.gather(mi.Vector3f, table, i % width)
        s = mi.Vector3f(spin[1] * s.x + spin[0] * s.y, spin[1] * s.y - spin[0] * s.x, s.z)
        if volume == "exact":
            length = dr.norm(s)
            return length * dr.normalize(n + s / length)
        return dr.mulsign(s, dr.dot(s, n)) if volume == "hemisphere" else s

    def hidden(s: mi.Vector3f) -> mi.Bool:
        if occluder == "exact":
            length = dr.norm(s)
            reach = dr.inf if volume == "exact" else radius * length
            return view.trace(x, s / length) < reach
        at, z = buffer.project(x + radius * s)
        stands, _ = buffer.fetch(at)
        return (stands < z) & ((z - stands < radius) if range_check else True)

    def add(i: mi.UInt32, free: mi.Float) -> tuple[mi.Float]:
        return (free + dr.select(hidden(offset(i)), mi.Float(0), 1),)

    openness = repeat(total, add, dr.zeros(mi.Float, count))[0] / total
    if blur:
        openness = box_blur(openness, buffer, blur)
    return dr.select(surface.valid, openness, 1)


def box_blur(image: mi.Float, buffer: DepthBuffer, half: int) -> mi.Float:
    """Mean over (2 half + 1)^2 texels, clamped at the border: rows, then columns."""
    for across in (True, False):
        dr.eval(image)
        i = dr.arange(mi.Int, buffer.width * buffer.height)
        column, row = i % buffer.width, i // buffer.width
        total = mi.Float(0)
        for k in range(-half, half + 1):
            c = dr.clip(column + k, 0, buffer.width - 1) if across else column
            r = row if across else dr.clip(row + k, 0, buffer.height - 1)
            total += dr.gather(mi.Float, image, mi.UInt32(r * buffer.width + c))
        image = total / (2 * half + 1)
    return image


@multi_frame_ssao.bake
def bake(
    view: View,
    *,
    kernel: Literal["poisson", "uniform"] = "poisson",
    order: Literal["as drawn", "by length"] = "as drawn",
) -> mi.Vector3f:
    """TABLE points of the unit ball.

    kernel "poisson": each the farthest of CANDIDATES from those before it, so that any first part of the
    table is well spread; "uniform": independent. order "by length": near occluders first.
    """
    rng = np.random.default_rng(1)
    chosen = np.empty((0, 3))
    for _ in range(TABLE):
        drawn = rng.normal(size=(CANDIDATES if kernel == "poisson" else 1, 3))
        lengths = np.linalg.norm(drawn, axis=1, keepdims=True)
        drawn *= rng.random(lengths.shape) ** (1 / 3) / lengths
        apart = np.linalg.norm(drawn[:, None] - chosen, axis=2).min(axis=1, initial=np.inf)
        chosen = np.vstack([chosen, drawn[[np.argmax(apart)]]])
    if order == "by length":
        chosen = chosen[np.argsort(np.linalg.norm(chosen, axis=1))]
    return mi.Vector3f(*chosen.T.astype(np.float32))


@multi_frame_ssao.domain
def domain(scene: Scene) -> Domain:
    """Contact shadows of things that the screen shows, seen from well above (3.3.4)."""
    if scene.elevation < 15:
        return Domain(False, "surfaces seen at a grazing angle hide what occludes them")
    if scene.pole < 0.01:
        return Domain(False, "occluders thinner than a pixel come and go in the depth buffer")
    return Domain(True)
