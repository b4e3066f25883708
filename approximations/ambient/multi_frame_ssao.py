r"""Multi-frame ambient occlusion on the screen: a few samples of a ball a frame, averaged over frames.

GPU Pro 7, chapter III.3, section 3.3.4. The share of the sky that a point sees,

    AO(x) = (1 / pi) int_hemisphere V(x, w) cos(theta) dw,

is replaced by what the depth buffer says of points round x,

    AO(x) = 1 - P[depth(project(x + R s)) < z(x + R s)],   s uniform in the unit ball,

estimated from `samples` points in each of `frames` frames, all of one set that keeps apart. One frame needs
a set turned from pixel to pixel and a blur against its noise; many frames need neither.

In print, and what was done here:
- The formula is not printed, but that it is the usual one. Half the ball lies behind a flat wall, so that an
  open wall is 1/2: `region="hemisphere"` mirrors the points behind the surface to its front.
- Points are uniform in the ball, or of random length ("close", which gathers them about x).
- Nothing is said of occluders far in front, which darken all that they cover on the screen. `range_check`
  drops what lies nearer to the eye than x by more than R.
- R is a length in space, as far as it goes on the screen. Off the screen nothing occludes.
- What many frames converge to is no sky: hidden things do not occlude, the cosine is missing, and R is
  finite. `occluders="exact"` has rays of length R with the cosine, which leaves the last of these alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    HIDDEN_GEOMETRY,
    NO_MODEL,
    SAMPLING,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    at_most,
    exact_when,
    technique,
)
from approximations.kit.depth_buffer import depth_buffer
from approximations.kit.point_sets import best_candidates
from scenes.contract import SKY_VISIBILITY, Scene, View
from scenes.occluders import Occluders

TILE = 4
"""Side of the tile of mirrors, in pixels; the blur averages over as many."""


@dataclass
class Ball:
    """Points of the unit ball; the normals of TILE x TILE mirrors."""

    points: mi.Vector3f
    mirrors: mi.Vector3f


@technique(
    source="GPU Pro 7, III.3, 3.3.4",
    covers=("multi-frame/07",),
    estimates=SKY_VISIBILITY,
    on=(Occluders,),
    replaces="cosine-weighted share of the sky that a point sees",
    neglects=(NO_MODEL, HIDDEN_GEOMETRY, SAMPLING, SPATIAL_DETAIL),
    claims=(
        at_most(1),
        exact_when("Occluders", 0.02, knobs={"occluders": "exact", "radius": 20.0, "frames": 60}),
    ),
    stress={"Occluders": ("pole", "camera_elevation")},
)
def multi_frame_ssao(
    view: View,
    ball: Ball,
    *,
    occluders: Literal["depth", "exact"] = "depth",
    region: Literal["ball", "hemisphere"] = "ball",
    radius: Annotated[float, Sweep(0.1, 0.4, 1.5, low=0.001, high=1000)] = 0.4,
    range_check: Literal["none", "radius"] = "none",
    turned: Literal["no", "pixel"] = "no",
) -> mi.Float:
    """Share of the sky that is seen, 0 to 1, one number per pixel.

    occluders    what the depth buffer holds, or "exact": what rays of length R meet, with the cosine.
    region       the whole ball, or the half on the surface's side.
    radius       R, m.
    range_check  whether what lies more than R before x counts.
    turned       whether the points are mirrored anew at each pixel of a tile.
    """
    return occlusion(view, ball, occluders, region, radius, range_check, turned)


@technique(
    source="GPU Pro 7, III.3, 3.2 and 3.3.4, the single frame that is set against many",
    estimates=SKY_VISIBILITY,
    on=(Occluders,),
    replaces="cosine-weighted share of the sky that a point sees",
    neglects=(NO_MODEL, HIDDEN_GEOMETRY, SAMPLING, SPATIAL_DETAIL),
    claims=(at_most(1),),
    baseline=True,
)
def single_frame_ssao(
    view: View,
    ball: Ball,
    *,
    radius: Annotated[float, Sweep(0.1, 0.4, low=0.001, high=1000)] = 0.4,
    blur: bool = True,
) -> mi.Float:
    """Share of the sky that is seen, 0 to 1, one number per pixel.

    radius  R, m.
    blur    a separable mean over as many pixels as the tile of mirrors has.
    """
    noisy = occlusion(view, ball, "depth", "ball", radius, "none", "pixel")
    return blurred(view, noisy) if blur else noisy


@multi_frame_ssao.bake
def bake(
    *,
    frames: Annotated[int, Sweep(1, 20, 60, low=1, high=8192)] = 20,
    samples: Annotated[int, Sweep(8, low=1, high=64)] = 8,
    lengths: Literal["ball", "close"] = "ball",
) -> Ball:
    """The points of all frames: `samples` a frame, uniform in the ball or of random length."""
    points = best_candidates(frames * samples, "ball", seed=1)
    rng = np.random.default_rng(2)
    if lengths == "close":
        points = points * rng.random((len(points), 1))
    return _ball(points, rng)


@single_frame_ssao.bake
def bake_one(*, samples: Annotated[int, Sweep(8, 24, low=1, high=64)] = 24) -> Ball:
    """The points of the one frame."""
    return _ball(best_candidates(samples, "ball", seed=1), np.random.default_rng(2))


def _ball(points: np.ndarray, rng: np.random.Generator) -> Ball:
    points[0] = points[1]  # the middle lies on the surface and in no direction
    normals = rng.normal(size=(TILE * TILE, 3))
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return Ball(*(mi.Vector3f(x.T.astype(np.float32)) for x in (points, normals)))


@multi_frame_ssao.domain
def domain(scene: Scene) -> Domain:
    """Detail that the screen resolves, seen from well above its surfaces."""
    if scene.camera_elevation < 20:
        return Domain(False, "a view along the ground, where most of what occludes is hidden")
    return Domain(True)


def occlusion(
    view: View,
    ball: Ball,
    occluders: str,
    region: str,
    radius: float,
    range_check: str,
    turned: str,
) -> mi.Float:
    """1 - P over all points of the ball."""
    surface, buffer = view.surface, depth_buffer(view)
    x, n = surface.position, surface.normal
    own = buffer.project(x)[1]
    m = dr.gather(mi.Vector3f, ball.mirrors, tile_index(view))

    def free(s: mi.Vector3f) -> mi.Bool:
        if turned == "pixel":
            s = s - 2 * dr.dot(s, m) * m
        if occluders == "exact":
            w = dr.normalize(dr.fma(s, mi.Vector3f(dr.rcp(dr.norm(s))), n))
            return view.trace(x + 1e-4 * n, w) > radius
        if region == "hemisphere":
            s = dr.mulsign(s, dr.dot(s, n))
        at, z = buffer.project(x + radius * s)
        stored = buffer.fetch(at)
        clear = stored >= z
        return clear | (own > stored + radius) if range_check == "radius" else clear

    def sample(i, seen):
        return i + 1, seen + dr.select(free(dr.gather(mi.Vector3f, ball.points, i)), mi.Float(1), 0)

    start = (mi.UInt32(0), dr.zeros(mi.Float, dr.width(x)))
    points = dr.width(ball.points)
    _, seen = dr.while_loop(start, lambda i, seen: i < points, sample)
    return dr.select(surface.valid, seen / points, 1)


def tile_index(view: View) -> mi.UInt32:
    """Which pixel of its tile each pixel is."""
    i = dr.arange(mi.UInt32, view.width * view.height)
    return dr.fma(i // view.width % TILE, TILE, i % view.width % TILE)


def blurred(view: View, image: mi.Float) -> mi.Float:
    """A mean over TILE pixels across and then down, of those that the picture has."""
    i = dr.arange(mi.UInt32, view.width * view.height)
    pixel = mi.Point2u(i % view.width, i // view.width)
    for step in (mi.Point2u(1, 0), mi.Point2u(0, 1)):
        dr.eval(image)
        at = [dr.fma(mi.Point2u(k), step, pixel) for k in range(TILE)]
        inside = [(p.x < view.width) & (p.y < view.height) for p in at]
        taps = [
            dr.gather(mi.Float, image, dr.fma(p.y, view.width, p.x), m)
            for p, m in zip(at, inside, strict=True)
        ]
        image = sum(taps) / sum(dr.select(m, mi.Float(1), 0) for m in inside)
    return image
