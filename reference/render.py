"""Truths by Monte Carlo: independent batches, one seed each, of the transport that the rules choose.

A batch has a fixed number of samples a pixel, so that memory does not grow with the samples asked for, and
its pixels depend on the seed alone: not on how many batches are made, or in how many sittings.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.entry import starts_inside
from reference.moments import Moments, from_batches
from reference.toolchain import other_variant, spectral_twin
from reference.transport import Transport, transport
from reference.truth import Truth, find_sampler
from scenes.contract import BadInput, Quantity, Scene

Draw = Callable[[int, int], np.ndarray]


def load_scene(scene: Scene, quantity: Quantity, size: int, how: Transport | None = None) -> mi.Scene:
    """The Mitsuba scene with the transport that the quantity needs. Raises BadInput if rejected."""
    description = scene.mitsuba(size)
    try:
        return load_description(description, how or transport(description, quantity, size))
    except Exception as error:
        reason = " ".join(str(error).split())
        raise BadInput(
            f"Mitsuba rejects the scene {type(scene).__name__}: {reason}; mend its mitsuba()"
        ) from error


def load_description(description: dict, how: Transport) -> mi.Scene:
    """A scene dictionary with its transport.

    Loaded without Mitsuba's merging of shapes: in 3.9.1 rectangles of equal BSDF become one mesh with an
    invalid bounding box, and a uniform sky then leaks through walls (+5.5 % of the mean in a valley).
    """
    sampler = {"type": how.sampler, "sample_count": how.spp}
    sensor = {**description["sensor"], "sampler": sampler}
    follow = starts_inside(how.integrator) if how.starts_inside else how.integrator
    whole = {**description, "sensor": sensor, "integrator": follow}
    return mi.load_dict(whole, optimize=False)


def sample(scene: Scene, quantity: Quantity, size: int, how: Transport | None = None) -> Draw:
    """f(spp, seed) -> (size, size, C) float64: one unbiased batch, loading the scene only once.

    A spectral scene is rendered in the spectral twin of the variant, in linear sRGB.
    """
    declared = find_sampler(type(scene), quantity)
    if declared is not None:
        return lambda spp, seed: np.asarray(declared(scene, size, spp, seed), np.float64)
    variant = variant_of(scene)
    with other_variant(variant):
        loaded = load_scene(scene, quantity, size, how)

    return lambda spp, seed: render_once(loaded, spp, seed)


def batch_seed(seed: int, k: int) -> int:
    """Mitsuba's seed for batch k of a series, scattered over 32 bits.

    Mitsuba 3.9.1 seeds a pixel's strata in `multijitter` by seed + index of its first sample, so that at n
    samples a pixel the image of seed + n is mostly that of seed, shifted by a pixel (correlation 0.4 to 0.5
    between neighbours): seeds in a row would smear the noise of their mean along the rows.
    """
    return int(np.random.SeedSequence([seed, k]).generate_state(1)[0])


def variant_of(scene: Scene) -> str:
    """The variant that renders a scene: this one, or its spectral twin."""
    return spectral_twin(mi.variant()) if scene.spectral else mi.variant()


def render_once(loaded: mi.Scene, spp: int, seed: int) -> np.ndarray:
    """One image (H, W, C) float64 of a loaded scene, whatever the variant that it was loaded in: setting
    another variant takes a tenth of a second."""
    sensor = loaded.sensors()[0]
    return to_array(loaded.integrator().render(loaded, sensor, seed=seed, spp=spp, evaluate=False))


def to_array(image: Any) -> np.ndarray:
    """A rendered image as (H, W, C) float64."""
    dr.eval(image)
    array = np.asarray(image, np.float64)
    return array if array.ndim == 3 else array[..., None]


def render_batches(
    scene: Scene,
    quantity: Quantity,
    size: int,
    first: int,
    count: int,
    seed: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    draw: Draw | None = None,
) -> Truth:
    """The truth that batches first ... first + count - 1 make, both even. Batch k has `batch_seed(seed, k)`.

    draw: the sampler of the scene, where it is loaded already.
    """
    started = time.perf_counter()
    draw = draw or sample(scene, quantity, size)
    how = transport(scene.mitsuba(size), quantity, size)
    moments = Moments()
    for k in range(first, first + count):
        moments.add(draw(how.spp, batch_seed(seed, k)))
        progress(k + 1)
    truth = moments.truth()
    truth.provenance.update(
        {
            "method": "Monte Carlo",
            **method(scene, quantity, size),
            "scene": type(scene).__name__,
            "fields": scene.fields(),
            "quantity": quantity.name,
            "size": size,
            "seed": seed,
            "variant": variant_of(scene),
            "mitsuba": mi.__version__,
            "drjit": dr.__version__,
            "seconds": round(time.perf_counter() - started, 2),
        }
    )
    return truth


def method(scene: Scene, quantity: Quantity, size: int) -> dict[str, Any]:
    """How a truth is made: the transport, with the declared sampler's name in the integrator's place."""
    plain = transport(scene.mitsuba(size), quantity, size).plain()
    declared = find_sampler(type(scene), quantity)
    if declared is not None:
        plain["integrator"] = f"{declared.__module__}.{declared.__name__}"
    return plain


def render_file(path: Path, spp: int, count: int = 16) -> Truth:
    """A truth from a Mitsuba XML file, with the sensor and integrator that it names.

    Raises BadInput where the file is missing or Mitsuba rejects it.
    """
    if not path.is_file():
        raise BadInput(f"{path}: no such file; give a Mitsuba scene in XML")
    try:
        loaded = mi.load_file(str(path))
        drawn = [to_array(mi.render(loaded, spp=spp, seed=batch_seed(1, k))) for k in range(count)]
    except Exception as error:
        reason = " ".join(str(error).split())
        raise BadInput(f"Mitsuba rejects {path}: {reason}") from error
    truth = from_batches(np.stack(drawn)[..., :3])
    truth.provenance.update({"method": "Monte Carlo", "scene": path.name, "spp": spp, "seed": 1})
    return truth
