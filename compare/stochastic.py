r"""Errors of an estimate that is itself a mean of independent images, freed of the noise of both sides.

Estimate A with covariance C_A (of that mean) per pixel, truth R with C_R, d = A - R, C = C_A + C_R. All
metrics are those of `compare.metrics` with C in the place of C_R, so that they are errors of the limit of A,
but for

    bias        b = sum A / sum R - 1          var b = (1'C_A 1 + (1 + b)^2 1'C_R 1) / (sum R)^2
    gain        g = A'R / p,  p = A'A - tr C_A   var g = (A'C_R A + (R - 2 g A)'C_A (R - 2 g A)) / p^2
    rmse_gain   of g A with C = g^2 C_A + C_R, and A'C A / p given back, which the fit takes

and for the metrics that cannot be freed of noise, whose floor is that of both sides.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count

import numpy as np

from compare import metrics
from compare.statistics import Estimate, interval, mse, quadratic, root
from reference.render import batch_seed
from reference.truth import Truth
from scenes.contract import Quantity

FIRST_FRAME = 2_000_000


def frame_seeds(seed: int) -> Iterator[int]:
    """Seeds of independent frames, which no truth has."""
    return (batch_seed(seed, FIRST_FRAME + k) for k in count())


def errors(
    estimate: Truth, truth: Truth, quantity: Quantity, exposure: tuple[float, float] | None
) -> dict[str, Estimate]:
    """All metrics of a sampled estimate, FLIP only with an exposure."""
    a, r = estimate.spread(3), truth.spread(3)
    found = metrics.errors(a.mean, joint(a, r), quantity, exposure) | {"bias": bias(a, r)}
    if "gain" in found:
        gain, left = best_gain(a, r)
        found |= {"gain": gain, "rmse_gain": root(left, float(r.mean.mean()))}
    return found


def noise(estimate: Truth, truth: Truth) -> float:
    """Standard deviation of a single image over the mean of the truth."""
    return float(np.sqrt((estimate.variance * estimate.batches).mean()) / truth.mean.mean())


def joint(a: Truth, r: Truth, gain: float = 1.0) -> Truth:
    """The truth with the noise of gain A on top of its own."""
    variance = gain**2 * a.variance + r.variance
    covariance = gain**2 * pooled(a) + pooled(r)
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    halves = [g * t.half_difference for g, t in ((gain, a), (1, r)) if t.half_difference is not None]
    return replace(
        r,
        variance=variance,
        correlation=covariance / np.outer(scale, scale),
        half_difference=sum(halves) if halves else None,
        batches=min((t.batches for t in (a, r) if not t.exact), default=0),
    )


def pooled(t: Truth) -> np.ndarray:
    """Mean covariance of a pixel's channels, (C, C)."""
    scale = np.sqrt(t.variance.mean(axis=(0, 1)))
    return t.correlation * np.outer(scale, scale)


def bias(a: Truth, r: Truth) -> Estimate:
    """Signed relative bias."""
    total, ratio, ones = r.mean.sum(), a.mean.sum() / r.mean.sum(), np.ones_like(r.mean)
    variance = (quadratic(ones, a).sum() + ratio**2 * quadratic(ones, r).sum()) / total**2
    return interval(float(ratio - 1), float(variance))


def best_gain(a: Truth, r: Truth) -> tuple[Estimate, Estimate]:
    """The factor on A that leaves the least squared error, and the mean squared error left after it."""
    power = float((a.mean**2 - a.variance).sum())
    if power <= 0:
        return Estimate(0.0, 0.0, 0.0), mse(0 * a.mean, r)
    g = float((a.mean * r.mean).sum()) / power
    both = joint(a, r, g)
    left, taken = mse(g * a.mean, both), float(quadratic(a.mean, both).sum()) / power / a.mean.size
    variance = quadratic(a.mean, r).sum() + quadratic(r.mean - 2 * g * a.mean, a).sum()
    return (
        interval(g, float(variance) / power**2),
        Estimate(left.value + taken, left.low + taken, left.high + taken),
    )
