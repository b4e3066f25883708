r"""Statistics of independent batches that arrive one by one, and the truth that they make.

Mean and squared deviations grow by Welford's rule in float64; two groups of batches join by Chan's:

    n = n_a + n_b,   d = mean_b - mean_a,
    mean = mean_a + d n_b / n,   SS = SS_a + SS_b + d^2 n_a n_b / n,

so that a stored truth goes on where it stopped. Rare bright paths make a variance unreliable: a pixel that
one of them has hit rests on one batch. They are found by the largest batch's share of the squared deviations
(Grubbs's test: n / (n - 1) times it is Beta(1/2, (n - 2) / 2) for normal batches) and by the kurtosis of the
batches about their mean, and are reported with the pixel where they live, never clipped.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy import stats

from reference.truth import Truth
from scenes.contract import BadInput

RARE = 0.01
"""Chance that an image without rare paths is said to have one."""
NAMED_PIXELS = 8


class Moments:
    """Running statistics of batches (H, W, C), all float64."""

    def __init__(self) -> None:
        self.count = 0
        self.mean = self.squares = self.odd = self.peak = self.first = self.third = self.fourth = None

    def add(self, image: np.ndarray) -> None:
        """Take one batch. Raises BadInput where it holds a value that is not finite."""
        image = np.asarray(image, np.float64)
        if not np.isfinite(image).all():
            y, x, _ = np.argwhere(~np.isfinite(image))[0]
            raise BadInput(
                f"the reference render gave a value that is not finite at pixel ({x}, {y}), "
                f"batch {self.count}: look at the scene's lights and materials there"
            )
        if self.mean is None:
            self.first, self.peak = image, image.copy()
            self.mean, self.squares, self.odd, self.third, self.fourth = (
                np.zeros_like(image) for _ in range(5)
            )
            self.covariance = np.zeros((image.shape[2],) * 2)
        self.count += 1
        before = image - self.mean
        self.mean += before / self.count
        after = image - self.mean
        self.squares += before * after
        self.covariance += np.einsum("hwc,hwd->cd", before, after)
        if self.count % 2 == 0:
            self.odd += image
        np.maximum(self.peak, image, out=self.peak)
        shifted = image - self.first
        self.third += shifted**3
        self.fourth += shifted**4

    def truth(self) -> Truth:
        """The mean, the variance of that mean, and the health of both. An even number of batches."""
        n, scale = self.count, np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        found = Truth(
            mean=self.mean,
            variance=self.squares / (n * (n - 1)),
            correlation=self.covariance / np.outer(scale, scale),
            half_difference=self.mean - 2 * self.odd / n,
            batches=n,
            provenance={"kurtosis": round(self.kurtosis(), 3), "rare_paths": self.rare_paths()},
        )
        return one_channel(found)

    def kurtosis(self) -> float:
        """Mean over pixels of the batches' kurtosis, less what normal batches have, 3 (n - 1) / (n + 1)."""
        n, shift = self.count, self.mean - self.first
        variance = self.squares / n
        fourth = (
            self.fourth / n
            - 4 * shift * (self.third / n)
            + 6 * shift**2 * (variance + shift**2)
            - 3 * shift**4
        )
        seen = variance > 1e-9 * max(float(variance.max()), 1e-300)
        if not seen.any():
            return 0.0
        return float((fourth[seen] / variance[seen] ** 2).mean() - 3 * (n - 1) / (n + 1))

    def rare_paths(self) -> dict:
        """How many values rest on one bright batch, and the worst of them: its pixel, the batch's share of
        the squared deviations, and the batch's value over the mean of the pixel."""
        n = self.count
        if n < 4:
            return {"count": 0, "worst": []}
        share = (self.peak - self.mean) ** 2 / np.maximum(self.squares, 1e-300) * (self.squares > 0)
        each = -np.expm1(np.log1p(-RARE) / (share.size * n))
        limit = (n - 1) / n * stats.beta.isf(min(2 * each, 1), 0.5, (n - 2) / 2)
        over = (share > limit).any(axis=2)
        weight = np.where(share > limit, (self.peak - self.mean) ** 2, 0).sum(axis=2)
        worst = np.argsort(-weight, axis=None)[: min(NAMED_PIXELS, int(over.sum()))]
        named = []
        for y, x in zip(*np.unravel_index(worst, over.shape), strict=True):
            c = int(np.argmax(share[y, x]))
            named.append(
                {
                    "pixel": [int(x), int(y)],
                    "share_of_one_batch": round(float(share[y, x, c]), 4),
                    "times_the_mean": round(float(self.peak[y, x, c] / max(self.mean[y, x, c], 1e-300)), 2),
                }
            )
        return {"count": int(over.sum()), "worst": named}


def from_batches(images: np.ndarray) -> Truth:
    """The truth that K independent images (K, H, W, C) make, K even."""
    moments = Moments()
    for image in images:
        moments.add(image)
    return moments.truth()


def join(a: Truth, b: Truth) -> Truth:
    """The truth that the batches of a and those of b make together; rare paths of both are kept."""
    channels = max(t.mean.shape[2] for t in (a, b))
    a, b = a.spread(channels), b.spread(channels)
    n = a.batches + b.batches
    d = b.mean - a.mean
    squares = sum(t.variance * t.batches * (t.batches - 1) for t in (a, b))
    squares = squares + d**2 * (a.batches * b.batches / n)
    covariance = np.einsum("hwc,hwd->cd", d, d) * (a.batches * b.batches / n)
    for t in (a, b):
        own = np.sqrt((t.variance * t.batches * (t.batches - 1)).sum(axis=(0, 1)))
        covariance = covariance + t.correlation * np.outer(own, own)
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    rare = [t.provenance["rare_paths"] for t in (a, b)]
    worst = sorted(rare[0]["worst"] + rare[1]["worst"], key=lambda r: -r["times_the_mean"])
    kurtosis = sum(t.batches * t.provenance["kurtosis"] for t in (a, b)) / n
    return Truth(
        mean=a.mean + d * (b.batches / n),
        variance=squares / (n * (n - 1)),
        correlation=covariance / np.outer(scale, scale),
        half_difference=(a.batches * a.half_difference + b.batches * b.half_difference) / n,
        batches=n,
        provenance=a.provenance
        | {
            "kurtosis": round(kurtosis, 3),
            "rare_paths": {
                "count": max(r["count"] for r in rare),
                "worst": _distinct(worst)[:NAMED_PIXELS],
            },
        },
    )


def one_channel(truth: Truth) -> Truth:
    """The truth with one channel where all agree."""
    mean = truth.mean
    if mean.shape[2] == 1 or not np.allclose(mean, mean[..., :1], rtol=1e-5, atol=1e-7):
        return truth
    return replace(
        truth,
        mean=mean[..., :1],
        variance=truth.variance[..., :1],
        correlation=np.ones((1, 1)),
        half_difference=truth.half_difference[..., :1],
    )


def _distinct(named: list[dict[str, Any]]) -> list[dict[str, Any]]:
    found: dict[tuple, dict] = {}
    for r in named:
        found.setdefault(tuple(r["pixel"]), r)
    return list(found.values())
