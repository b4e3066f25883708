r"""Sky video: a film of a bright sky as an ordinary 8-bit video times a smooth sky of a few coefficients.

SIGGRAPH 2006 Course 26, chapter 2, section 2.2.

    project  c_lm = int L(w) Y_lm(w) dw                     per frame and channel
    divide   R = L / L_SH,  L_SH = sum c_lm Y_lm            the ratio, near 1 wherever the sky is smooth
    store    q = (R / R_max)^(1/gamma) in `bits` bits, then a video codec
    play     L' = R_max q^gamma L_SH

In print, and what was done here:
- "Third order" may mean 9 coefficients (bands 0 to 2, the default) or 16: `bands`.
- R_max, a floor under L_SH, the shape of the stored ratio and the lower hemisphere are not given. A disk of
  integrated radiance S brings L_SH down to -0.143 S at 101.5 deg from it with 9 coefficients, and to -0.318 S
  at 180 deg with 16, so that the ratio has no meaning there without a floor.
- The sun has a colour of its own in each frame, but whether its disk was taken out of the film is not said.
  `sun="kept"` leaves it to the ratio, which clips it.
- The codecs named (XVID, DivX) transform blocks of 8 x 8 texels, with colour at half resolution; here so:
  a cosine transform with steps of 2 `quantiser` of 255, one frame at a time.

The map shows equal solid angles: (u, v) = 1/2 + w.xy / (2 sqrt(1 + w.z)), the horizon a circle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy.fft import dctn, idctn

from approximations.contract import (
    ANGULAR_DETAIL,
    CAPACITY,
    NUMBER_FORMAT,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    technique,
)
from approximations.kit.spherical_harmonics import evaluate, mirrored, project
from scenes.contract import RADIANCE, Scene, Sun, View
from scenes.sky_frames import SkyFrames

BLOCK = 8
LUMA = np.array([0.299, 0.587, 0.114])


@dataclass
class Video:
    """One frame: L_SH with its floor, the stored ratio (side, side, 3) in 0..1, and how to read it."""

    coefficients: list[mi.Color3f]
    floor: mi.Color3f  # W m^-2 sr^-1
    ratio: mi.TensorXf
    r_max: float
    gamma: float
    sun: str


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 2.2",
    covers=("sky-video/01",),
    estimates=RADIANCE,
    on=(SkyFrames,),
    replaces="the radiance of the sky by direction, as photographed",
    neglects=(NUMBER_FORMAT, SPATIAL_DETAIL, CAPACITY, ANGULAR_DETAIL),
    stress={"SkyFrames": ("sun_elevation", "cloudiness")},
)
def sky_video(view: View, video: Video) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) from the direction of every camera ray; the ground as it is."""
    w = view.camera.direction
    linear, clamp = dr.FilterMode.Linear, dr.WrapMode.Clamp
    texture = mi.Texture2f(video.ratio, use_accel=False, filter_mode=linear, wrap_mode=clamp)
    stored = mi.Color3f(texture.eval(0.5 + 0.5 * mi.Point2f(w.x, w.y) / dr.sqrt(1 + w.z)))
    ratio = video.r_max * stored**video.gamma
    sky = ratio * smooth_sky(video.coefficients, video.floor, w)
    if video.sun == "removed":
        sky += sun_disk(view.sun, w)
    return dr.select(w.z > 0, sky, view.environment(w))


def smooth_sky(coefficients: list[mi.Color3f], floor: mi.Color3f, w: mi.Vector3f) -> mi.Color3f:
    """L_SH, no lower than the floor."""
    return dr.maximum(evaluate(coefficients, w), floor)


def sun_disk(sun: Sun, w: mi.Vector3f) -> mi.Color3f:
    """The sun's radiance inside its disk."""
    inside = dr.dot(w, sun.direction) > math.cos(sun.angular_radius)
    return mi.Color3f(dr.select(inside, mi.Float(sun.radiance), 0))


@sky_video.bake
def bake(
    view: View,
    *,
    bands: Literal[3, 4] = 3,
    sun: Literal["removed", "kept"] = "removed",
    r_max: Annotated[float, Sweep(2.0, 16.0, low=1, high=64)] = 4.0,
    floor: Annotated[float, Sweep(low=0, high=1)] = 0.05,
    gamma: Annotated[float, Sweep(2.0, low=1, high=4)] = 1.0,
    side: Annotated[int, Sweep(100, low=16, high=2048)] = 384,
    stored: Literal["codec", "texels", "exact"] = "codec",
    bits: Annotated[int, Sweep(5, low=2, high=16)] = 8,
    quantiser: Annotated[int, Sweep(16, low=1, high=31)] = 4,
) -> Video:
    """Divide a frame by its smooth part and store the ratio on a map of side x side texels.

    floor   under L_SH, as a share of its mean.
    stored  through the "codec", as "texels" of `bits` bits, or "exact": neither rounded nor clipped.
    A film holds 108 bytes of coefficients a frame, 192 with four bands, besides the video.
    """
    frame = mirrored(with_sun(view) if sun == "kept" else view.environment)
    coefficients = project(frame, bands)
    lowest = dr.maximum(floor * evaluate(coefficients[:1], mi.Vector3f(0, 0, 1)), 1e-4)
    w = texel_directions(side)
    ratio = frame(w) / smooth_sky(coefficients, lowest, w) / r_max
    q = np.array(ratio, np.float64).T.reshape(side, side, 3) ** (1 / gamma)
    if stored != "exact":
        q = rounded(np.minimum(q, 1), bits)
    if stored == "codec":
        q = rounded(decoded(q, quantiser), bits)
    return Video(coefficients, lowest, mi.TensorXf(q.astype(np.float32)), r_max, gamma, sun)


def with_sun(view: View) -> Callable[[mi.Vector3f], mi.Color3f]:
    """The sky with the sun's disk in it."""
    return lambda w: view.environment(w) + sun_disk(view.sun, w)


def texel_directions(side: int) -> mi.Vector3f:
    """Unit directions of the middles of texels, row by row; corners look below the horizon."""
    x, y = dr.meshgrid(dr.arange(mi.Float, side), dr.arange(mi.Float, side))
    at = (2 * mi.Point2f(x, y) + 1) / side - 1
    squared = dr.squared_norm(at)
    across = at * dr.safe_sqrt(2 - squared)
    return mi.Vector3f(across.x, across.y, 1 - squared)


def rounded(q: np.ndarray, bits: int) -> np.ndarray:
    """To the nearest of 2^bits even levels from 0 to 1."""
    levels = int("1" * bits, base=2)
    return np.round(np.clip(q, 0, 1) * levels) / levels


def decoded(image: np.ndarray, quantiser: int) -> np.ndarray:
    """What a codec makes of an RGB image (rows, columns, 3) in 0..1: luma and half-resolution colour
    differences, each transformed in blocks and rounded."""
    luma = image @ LUMA
    blue, red = (transformed(halved(image[..., c] - luma), quantiser) for c in (2, 0))
    luma = transformed(luma, quantiser)
    r, b = luma + doubled(red, luma.shape), luma + doubled(blue, luma.shape)
    g = (luma - LUMA[0] * r - LUMA[2] * b) / LUMA[1]
    return np.stack([r, g, b], axis=-1)


def transformed(plane: np.ndarray, quantiser: int) -> np.ndarray:
    """Cosine transform of blocks, its coefficients rounded to steps of 2 quantiser / 255, and back."""
    rows, columns = plane.shape
    padded = np.pad(plane, [(0, -n % BLOCK) for n in plane.shape], mode="edge")
    blocks = padded.reshape(padded.shape[0] // BLOCK, BLOCK, -1, BLOCK)
    step = 2 * quantiser / 255
    coded = step * np.round(dctn(blocks, axes=(1, 3), norm="ortho") / step)
    return idctn(coded, axes=(1, 3), norm="ortho").reshape(padded.shape)[:rows, :columns]


def halved(plane: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 texels; an odd last row or column stands for two."""
    even = np.pad(plane, [(0, n % 2) for n in plane.shape], mode="edge")
    return even.reshape(even.shape[0] // 2, 2, -1, 2).mean(axis=(1, 3))


def doubled(plane: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Each texel repeated 2 x 2."""
    return plane.repeat(2, axis=0).repeat(2, axis=1)[: shape[0], : shape[1]]


@sky_video.domain
def domain(scene: Scene) -> Domain:
    """Skies of broad daylight, filmed hour after hour (2.2)."""
    if scene.sun_elevation < 5:
        return Domain(False, "at sunset a narrow glow stands on the horizon, which few bands miss")
    return Domain(True)
