"""Small scenes rendered by the rules that make the truths, for checks of laws and of printed numbers.

A description has a "sensor", or a shape named "meter" on which the irradiance is measured. All of them are
grey, so that the first channel says everything.
"""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from reference.render import batch_seed, load_description, to_array
from reference.transport import Transport, transport
from reference.verify.agreement import Sampled
from scenes.contract import RADIANCE
from scenes.mitsuba_parts import film

BLACK = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}


def rendered(description: dict, size: int, batches: int, seed: int) -> np.ndarray:
    """Independent batches (K, size, size, 1), of radiance, or of irradiance where there is a meter."""
    how = transport({"sensor": {}, **description}, RADIANCE, size)
    loaded = load(description, size, how)
    drawn = [to_array(mi.render(loaded, spp=how.spp, seed=batch_seed(seed, k))) for k in range(batches)]
    return np.stack(drawn)[..., :1]


def load(description: dict, size: int, how: Transport) -> mi.Scene:
    """The Mitsuba scene. Shapes are not merged, as in `load_description`."""
    if "meter" not in description:
        return load_description(description, how)
    sampler = {"type": how.sampler, "sample_count": how.spp}
    sensor = {"type": "irradiancemeter", "film": film(size), "sampler": sampler}
    meter = {**description["meter"], "sensor": sensor}
    return mi.load_dict({**description, "meter": meter, "integrator": how.integrator}, optimize=False)


def image_of(description: dict, size: int, batches: int, seed: int) -> Sampled:
    """The image (size, size, 1) with its noise."""
    return Sampled.of(rendered(description, size, batches, seed))


def mean_of(description: dict, size: int, batches: int, seed: int) -> Sampled:
    """The mean over the image, one number (1,), with its noise."""
    return Sampled.of(rendered(description, size, batches, seed).mean(axis=(1, 2)))


def joined(samples: list[Sampled], scale: float = 1.0) -> Sampled:
    """Lists of numbers as one list, each `scale` times as large."""
    return Sampled(
        scale * np.concatenate([s.mean for s in samples]),
        scale**2 * np.concatenate([s.variance for s in samples]),
        min(s.batches for s in samples),
    )


def from_above(height: float, half_width: float, size: int) -> dict:
    """A parallel camera at z = height that looks down on |x|, |y| < half_width, x to the right and y up."""
    to_world = mi.ScalarTransform4f().look_at([0, 0, height], [0, 0, 0], [0, 1, 0])
    return {
        "type": "orthographic",
        "near_clip": 1e-4,
        "far_clip": 1e4,
        "to_world": to_world.scale([half_width, half_width, 1]),
        "film": film(size),
    }


def pixel_points(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (x, y) in [-1, 1]^2 of a size x size image, shape (H, W, n), and their weights (n,): 3 x 3 Gauss
    points in each quarter of a pixel. The mean over a pixel is the sum of weights times values."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    t = np.concatenate([nodes / 4 + 0.25, nodes / 4 + 0.75])
    w = np.concatenate([weights, weights]) / 4
    u = (np.arange(size)[:, None] + t) * 2 / size - 1
    shape = (size, size, t.size, t.size)
    x = np.broadcast_to(u[None, :, None, :], shape)
    y = np.broadcast_to(-u[:, None, :, None], shape)
    return x.reshape(size, size, -1), y.reshape(size, size, -1), np.outer(w, w).ravel()


def pixel_means(function, size: int) -> Sampled:
    """The exact image (size, size, 1) of f(x, y) on [-1, 1]^2."""
    x, y, weights = pixel_points(size)
    return Sampled.exact((function(x, y) * weights).sum(axis=-1, keepdims=True))
