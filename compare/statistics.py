r"""Errors against a truth that is itself a noisy mean, with 95 % intervals.

A is the estimate, R the truth plus noise of covariance C per pixel (channels share their paths), D the
true error,
d = A - R. For independent pixels, with K batches behind C:

    squared error     e = |d|^2 - tr C                 unbiased: |d|^2 alone overstates by tr C
    its variance      4 d'Cd - 2 tr C^2 (1 - 1/(K-1))  plug-in for 4 D'CD + 2 tr C^2 + 2 tr C^2/(K-1)

since d'Cd overstates D'CD by tr C^2. C is built from the per-channel variances and the correlation
that the truth carries. Means are taken over pixels and channels.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from scipy import stats

from reference.truth import Truth

Z95 = 1.959963984540054


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval. floor: what the metric reads between two halves of the truth,
    for metrics that cannot be freed of the truth's noise; None for unbiased ones."""

    value: float
    low: float
    high: float
    floor: float | None = None

    @property
    def resolved(self) -> bool:
        """False where the value is under twice its floor."""
        return self.floor is None or self.value >= 2 * self.floor

    def plain(self) -> dict:
        """As JSON data."""
        return asdict(self) | {"resolved": self.resolved}


def interval(value: float, variance: float) -> Estimate:
    """Normal 95 % interval."""
    half = Z95 * math.sqrt(max(variance, 0.0))
    return Estimate(value, value - half, value + half)


def root(e: Estimate, unit: float = 1.0) -> Estimate:
    """sqrt(max(e, 0)) / unit, the interval mapped through."""
    return Estimate(*(math.sqrt(max(x, 0.0)) / unit for x in (e.value, e.low, e.high)))


def quadratic(d: np.ndarray, truth: Truth) -> np.ndarray:
    """d'Cd per pixel, (H, W)."""
    scaled = d * np.sqrt(truth.variance)
    return np.einsum("hwc,cd,hwd->hw", scaled, truth.correlation, scaled)


def trace_square(truth: Truth) -> np.ndarray:
    """tr C^2 per pixel, (H, W), freed of the excess that estimating C from K batches adds."""
    v = truth.variance
    squared = np.einsum("hwc,cd,hwd->hw", v, truth.correlation**2, v)
    return squared if truth.exact else squared / (1 + 2 / (truth.batches - 1))


def mse(a: np.ndarray, truth: Truth, weight: np.ndarray | float = 1.0) -> Estimate:
    """Unbiased mean of weight * (A - R)^2, weight (H, W, C) or a number. Its variance is 4 d'Cd + 2 tr C^2 of
    the true difference d, hence never less than the noise alone makes, whatever few batches say."""
    root_weight = np.sqrt(np.broadcast_to(weight, a.shape))
    d = (a - truth.mean) * root_weight
    weighted = Truth(truth.mean, truth.variance * root_weight**2, truth.correlation, None, truth.batches)
    value = float((d**2 - weighted.variance).mean())
    if truth.exact:
        return Estimate(value, value, value)
    extra = 1 - 1 / (truth.batches - 1)
    noise = trace_square(weighted).sum()
    variance = max(4 * quadratic(d, weighted).sum() - 2 * extra * noise, 2 * noise) / a.size**2
    return interval(value, float(variance))


def bias(a: np.ndarray, truth: Truth) -> Estimate:
    """Signed relative bias: sum A / sum R - 1."""
    total = truth.mean.sum()
    variance = quadratic(np.ones_like(truth.mean), truth).sum()
    return interval(float(a.sum() / total - 1), float(variance * (a.sum() / total**2) ** 2))


def offset(a: np.ndarray, truth: Truth) -> Estimate:
    """Mean of A less the mean of R."""
    variance = quadratic(np.ones_like(truth.mean), truth).sum() / truth.mean.size**2
    return interval(float((a - truth.mean).mean()), float(variance))


def best_gain(a: np.ndarray, truth: Truth) -> tuple[Estimate, Estimate]:
    """The single factor g on A that leaves the least squared error, and the MSE left after it.

    g says how far the level is off, what is left how far the shape is. Fitting g takes part of the
    noise with it; that part is given back.
    """
    power = float((a**2).sum())
    if power == 0:
        return Estimate(0.0, 0.0, 0.0), mse(a, truth)
    gain = float((a * truth.mean).sum()) / power
    absorbed = float(quadratic(a, truth).sum()) / power
    left = mse(gain * a, truth)
    shift = absorbed / a.size
    return (
        interval(gain, absorbed / power),
        Estimate(left.value + shift, left.low + shift, left.high + shift),
    )


def spread(values: list[float]) -> Estimate:
    """Mean of independent repetitions with Student's 95 % interval."""
    mean, n = float(np.mean(values)), len(values)
    if n < 2:
        return Estimate(mean, -math.inf, math.inf)
    half = stats.t.ppf(0.975, n - 1) * float(np.std(values, ddof=1)) / math.sqrt(n)
    return Estimate(mean, mean - half, mean + half)


def median(values: list[float]) -> Estimate:
    """Median with the 95 % interval from order statistics (binomial, free of any distribution)."""
    ordered, n = sorted(values), len(values)
    k = int(stats.binom.ppf(0.025, n, 0.5))
    return Estimate(float(np.median(ordered)), ordered[max(k - 1, 0)], ordered[min(n - k, n - 1)])


def combine(spread_of_a: Estimate, truth_part: Estimate) -> Estimate:
    """One interval from two independent sources of uncertainty about the same value."""
    value = spread_of_a.value
    half = math.hypot(spread_of_a.high - value, truth_part.high - truth_part.value)
    return Estimate(value, value - half, value + half)
