"""Stored truths against renders made now: the mean pixel by pixel, and the variance that is claimed of it.

n new batches with seeds of their own are drawn as the truth's were. If nothing changed, their mean has K / n
times the stored variance, which K batches stand behind, so that few new samples suffice. Where
paths are rare and bright, K batches may know too little of a pixel's variance: the new batches' own and the
mean of the stored one over NEIGHBOURS x NEIGHBOURS pixels are taken where they are larger. The variance is
tested as the ratio of the new batches' own, summed over the image, to the stored one, with the
jackknife over TILES x TILES parts of the image; storing rounds standard errors to 3 %, which shifts no sum by
more than `ROUNDING`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter

from reference import store
from reference.render import batch_seed, sample
from reference.transport import transport
from reference.truth import Truth
from reference.verify.agreement import FLOAT32, Sampled
from reference.verify.checks import Comparison
from scenes.contract import QUANTITIES, BadInput, Scene, make_scene

BATCHES, MOST_BATCHES = 4, 16
NOISY = 0.003
"""Relative noise of the mean of one batch above which MOST_BATCHES are drawn: fewer would miss 1 %."""
FIRST = 1_000_000
"""No truth has so many batches."""
TILES = 8
NEIGHBOURS = 5
ROUNDING = 0.01


def question(about: dict) -> tuple[Scene, object, int]:
    """The scene, quantity and size that a stored truth answers. Raises BadInput for a scene that is gone."""
    try:
        return make_scene(about["scene"], about["fields"]), QUANTITIES[about["quantity"]], about["size"]
    except KeyError as error:
        raise BadInput(f"the file does not say what it answers ({error} is missing): prune it") from error


def is_current(path: Path, about: dict) -> bool:
    """Whether today's code would look for this file under this name."""
    try:
        scene, quantity, size = question(about)
        key = store.truth_key(scene, quantity, size, about["seed"])
    except (BadInput, KeyError):
        return False
    return about.get("key") == key and path.name == store.file_name(scene, quantity, size, key)


def rendered_again(truth: Truth, seed: int) -> list[Comparison]:
    """Comparisons of a stored truth's mean and variance with new batches."""
    about = truth.provenance
    scene, quantity, size = question(about)
    draw, spp = sample(scene, quantity, size), transport(scene.mitsuba(size), quantity, size).spp
    per_batch = truth.variance * truth.batches
    noise = np.sqrt(per_batch.sum()) / max(truth.mean.sum(), 1e-300)
    batches = MOST_BATCHES if noise > NOISY else BATCHES
    new = np.stack([draw(spp, batch_seed(seed, FIRST + k)) for k in range(batches)])
    new = new[..., : truth.mean.shape[2]]
    around = uniform_filter(truth.variance, (NEIGHBOURS, NEIGHBOURS, 1))
    size_of_light = np.abs(truth.mean)
    name = f"{about['scene']} {about['quantity']} {size}"
    return [
        Comparison(
            f"{name}: mean",
            Sampled(new.mean(axis=0), per_batch / batches, truth.batches, new.var(axis=0, ddof=1) / batches),
            Sampled(truth.mean, truth.variance, truth.batches, around),
            within=FLOAT32 * (size_of_light + size_of_light.mean()),
        ),
        variance_ratio(f"{name}: variance", new.var(axis=0, ddof=1), per_batch),
    ]


def variance_ratio(label: str, new: np.ndarray, stored: np.ndarray) -> Comparison:
    """Sum of new variances over sum of stored ones, against 1."""
    height, width = new.shape[:2]
    parts = [
        (new[y][:, x].sum(), stored[y][:, x].sum())
        for y in np.array_split(np.arange(height), TILES)
        for x in np.array_split(np.arange(width), TILES)
    ]
    a, b = np.array(parts).T
    if b.sum() == 0:
        return Comparison(label, Sampled.exact(1.0 + a.sum()), Sampled.exact(1.0), within=ROUNDING)
    left_out = (a.sum() - a) / np.maximum(b.sum() - b, 1e-300)
    n = len(parts)
    variance = (n - 1) / n * ((left_out - left_out.mean()) ** 2).sum()
    ratio = Sampled(np.array(a.sum() / b.sum()), np.array(variance), n)
    return Comparison(label, ratio, Sampled.exact(1.0), within=ROUNDING)
