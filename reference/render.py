"""Truths by Monte Carlo: independent batches, their mean, the variance of that mean, and its health."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.transport import Effort, integrator
from reference.truth import Truth, find_sampler
from scenes.contract import BadInput, Quantity, Scene


def load_scene(scene: Scene, quantity: Quantity, size: int) -> mi.Scene:
    """The Mitsuba scene with the integrator that the quantity needs. Raises BadInput if rejected.

    Loaded without Mitsuba's merging of shapes: in 3.9.1 rectangles of equal BSDF become one mesh with an
    invalid bounding box, and a uniform sky then leaks through walls (+5.5 % of the mean in a valley).
    """
    description = scene.mitsuba(size)
    try:
        whole = {**description, "integrator": integrator(description, quantity)}
        return mi.load_dict(whole, optimize=False)
    except Exception as error:
        reason = " ".join(str(error).split())
        raise BadInput(f"Mitsuba rejects the scene {type(scene).__name__}: {reason}") from error


def sample(scene: Scene, quantity: Quantity, size: int) -> Callable[[int, int], np.ndarray]:
    """f(spp, seed) -> (size, size, C) float64: one unbiased batch, loading the scene only once."""
    declared = find_sampler(type(scene), quantity)
    if declared is not None:
        return lambda spp, seed: np.asarray(declared(scene, size, spp, seed), np.float64)
    loaded = load_scene(scene, quantity, size)
    return lambda spp, seed: to_array(mi.render(loaded, spp=spp, seed=seed))


def to_array(image: Any) -> np.ndarray:
    """A rendered image as (H, W, C) float64."""
    dr.eval(image)
    array = np.asarray(image, np.float64)
    return array if array.ndim == 3 else array[..., None]


def batches(scene: Scene, quantity: Quantity, size: int, effort: Effort) -> Iterator[np.ndarray]:
    """Independent batches, one seed each."""
    draw = sample(scene, quantity, size)
    for k in range(effort.batches):
        yield draw(effort.spp, effort.seed + k)


def render_truth(
    scene: Scene,
    quantity: Quantity,
    size: int,
    effort: Effort,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Truth:
    """The truth of a quantity on a scene at size x size pixels, from independent batches."""
    started = time.perf_counter()
    drawn = []
    for image in batches(scene, quantity, size, effort):
        drawn.append(image)
        progress(len(drawn), effort.batches)
    truth = from_batches(np.stack(drawn))
    truth.provenance.update(
        {
            "method": "Monte Carlo",
            "integrator": method(scene, quantity, size),
            "scene": type(scene).__name__,
            "fields": scene.fields(),
            "quantity": quantity.name,
            "size": size,
            "spp": effort.spp * effort.batches,
            "batches": effort.batches,
            "seed": effort.seed,
            "variant": mi.variant(),
            "mitsuba": mi.__version__,
            "drjit": dr.__version__,
            "seconds": round(time.perf_counter() - started, 2),
        }
    )
    return truth


def method(scene: Scene, quantity: Quantity, size: int) -> Any:
    """The integrator's dictionary, or the name of the declared sampler."""
    declared = find_sampler(type(scene), quantity)
    if declared is not None:
        return f"{declared.__module__}.{declared.__name__}"
    return integrator(scene.mitsuba(size), quantity)


def from_batches(images: np.ndarray) -> Truth:
    """Statistics of K independent images (K, H, W, C).

    Channels that agree everywhere are kept as one. The pixel whose batches are least normal (largest
    share of its sum of squared deviations in one batch) is recorded: rare bright paths make the
    variance there unreliable, and they are reported, never clipped.
    """
    if not np.isfinite(images).all():
        k, y, x, _ = np.argwhere(~np.isfinite(images))[0]
        raise BadInput(f"the reference render gave a value that is not finite at pixel ({x}, {y}), batch {k}")
    if images.shape[3] > 1 and np.allclose(images, images[..., :1], rtol=1e-5, atol=1e-7):
        images = images[..., :1]
    count = len(images)
    mean = images.mean(axis=0)
    deviation = images - mean
    squared = (deviation**2).sum(axis=0)
    covariance = np.einsum("khwc,khwd->cd", deviation, deviation)
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    share = (deviation**2).max(axis=0) / np.maximum(squared, 1e-300) * (squared > 0)
    weight = share * np.sqrt(squared)
    y, x, _ = np.unravel_index(np.argmax(weight), weight.shape)
    return Truth(
        mean=mean,
        variance=squared / (count * (count - 1)),
        correlation=covariance / np.outer(scale, scale),
        half_difference=0.5 * (images[0::2].mean(axis=0) - images[1::2].mean(axis=0)),
        batches=count,
        provenance={
            "relative_standard_error": float(
                np.sqrt(squared.mean() / (count * (count - 1))) / max(abs(mean.mean()), 1e-300)
            ),
            "heaviest_tail": {"pixel": [int(x), int(y)], "share_of_one_batch": float(share[y, x].max())},
        },
    )


def render_file(path: Path, spp: int, count: int = 16) -> Truth:
    """A truth from a Mitsuba XML file, with the sensor and integrator that it names.

    Raises BadInput where the file is missing or Mitsuba rejects it.
    """
    if not path.is_file():
        raise BadInput(f"{path}: no such file; give a Mitsuba scene in XML")
    try:
        loaded = mi.load_file(str(path))
        drawn = [to_array(mi.render(loaded, spp=spp, seed=1 + k)) for k in range(count)]
    except Exception as error:
        reason = " ".join(str(error).split())
        raise BadInput(f"Mitsuba rejects {path}: {reason}") from error
    truth = from_batches(np.stack(drawn)[..., :3])
    truth.provenance.update(
        {"method": "Monte Carlo", "scene": path.name, "spp": spp * count, "batches": count, "seed": 1}
    )
    return truth
