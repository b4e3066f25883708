r"""Do two routes give the same answer? A test whose false alarms are bounded and whose power is known.

Route a has mean A with variance V_a (of that mean) from K_a batches, route b likewise; an exact route has
variance 0. Under the hypothesis that both means are the same,

    t = (|A - B| - within) / sqrt(V_a + V_b)

is held against Student's law with min(K_a, K_b) - 1 degrees of freedom for each number that goes into it, the
least that it can have (Welch's estimate of them is too generous so far out in the tails: 18 % false alarms
where 10 % were asked for).
`within` is a difference that is no error: float32 rounding, or half a unit of a printed table's last digit.

Images are tested pixel by pixel and as sums over blocks of BLOCKS pixels a side and over the whole image,
each channel apart: fine blocks find structure (a shifted grid), coarse ones bias (1 % of the energy). The
smallest p-value is held against the significance over the number of tests (Sidak), so that the family of
all of them raises a false alarm with at most that probability. Other arrays are lists of numbers that are
tested one by one.

Power: a relative error of (t_crit + 1.645) sqrt(V_a + V_b) / B is found with probability 95 %, t_crit being
the quantile that the family's significance asks for. `catches` states it for an error that is the same
factor everywhere, `catches_locally` for one within a single block of LOCAL pixels, median over blocks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

BLOCKS = (1, 4, 16)
LOCAL = 16
POWER_Z = 1.6448536269514722  # one-sided 95 % of the normal law
FLOAT32 = 1e-5
"""Relative difference that rounding may cause: float32 sums over a path."""


@dataclass(frozen=True)
class Sampled:
    """An answer with its noise: mean, variance of that mean (same shape), independent batches (0 = exact).

    An image has shape (H, W, C); any other shape is a list of numbers.
    """

    mean: np.ndarray
    variance: np.ndarray
    batches: int

    @classmethod
    def exact(cls, value) -> Sampled:
        """A closed form, a quadrature, a printed table."""
        mean = np.asarray(value, np.float64)
        return cls(mean, np.zeros_like(mean), 0)

    @classmethod
    def of(cls, batches) -> Sampled:
        """Statistics of K independent batches, (K, ...) with K >= 2."""
        drawn = np.asarray(batches, np.float64)
        return cls(drawn.mean(axis=0), drawn.var(axis=0, ddof=1) / len(drawn), len(drawn))


@dataclass(frozen=True)
class Agreement:
    """agrees: no test of the family fired. p: the family's p-value (Sidak). standard_errors: the disagreement
    of the most telling test, whose place `where` names; infinite where two exact routes differ.
    relative: that disagreement over the second route's value there. tests: size of the family.
    catches, catches_locally: relative errors that would have been found with probability 95 %."""

    agrees: bool
    p: float
    standard_errors: float
    relative: float
    where: str
    tests: int
    catches: float
    catches_locally: float


def agreement(
    a: Sampled, b: Sampled, *, significance: float = 0.01, within: np.ndarray | float | None = None
) -> Agreement:
    """Test whether a and b, of one shape, are estimates of the same numbers; b is the yardstick.

    within: allowed difference per number (absolute); FLOAT32 |b| where not given.
    """
    if np.shape(a.mean) != np.shape(b.mean):
        raise ValueError(f"shapes differ: {np.shape(a.mean)} and {np.shape(b.mean)}")
    a, b = (Sampled(np.atleast_1d(x.mean), np.atleast_1d(x.variance), x.batches) for x in (a, b))
    slack = np.broadcast_to(FLOAT32 * np.abs(b.mean) if within is None else within, a.mean.shape)
    image = a.mean.ndim == 3
    sides = [s for s in BLOCKS if image and s <= min(a.mean.shape[:2])] if image else [1]
    levels = [_level(a, b, slack, side) for side in sides]
    if image:
        levels.append(_level(a, b, slack, None))
    tests = sum(level["p"].size for level in levels)
    least = min(range(len(levels)), key=lambda i: (levels[i]["p"].min(), -levels[i]["t"].max()))
    level = levels[least]
    worst = np.unravel_index(np.lexsort((-level["t"].ravel(), level["p"].ravel()))[0], level["p"].shape)
    family = -np.expm1(tests * np.log1p(-min(float(level["p"][worst]), 1 - 1e-16)))
    each = -np.expm1(np.log1p(-significance) / tests)
    local = next((lv for lv in levels if lv["side"] == LOCAL), levels[0])
    return Agreement(
        agrees=bool(family >= significance),
        p=float(family),
        standard_errors=float(level["t"][worst]),
        relative=float(level["difference"][worst] / max(abs(level["value"][worst]), 1e-300)),
        where=_place(level["side"], worst, image),
        tests=tests,
        catches=float(np.max(_detectable(levels[-1], each))),
        catches_locally=float(np.median(_detectable(local, each))),
    )


def _level(a: Sampled, b: Sampled, slack: np.ndarray, side: int | None) -> dict:
    """The tests of all blocks of one size (None: the whole image)."""

    def pool(x: np.ndarray) -> np.ndarray:
        if side == 1 or x.ndim != 3:
            return x
        if side is None:
            return x.sum(axis=(0, 1), keepdims=True)
        rows, columns = (np.arange(0, n, side) for n in x.shape[:2])
        return np.add.reduceat(np.add.reduceat(x, rows, axis=0), columns, axis=1)

    va, vb, value = pool(a.variance), pool(b.variance), pool(b.mean)
    difference = np.abs(pool(a.mean) - value)
    excess = np.maximum(difference - pool(slack), 0)
    error = np.sqrt(va + vb)
    batches = min((x.batches for x in (a, b) if x.batches), default=2)
    squares = pool((a.variance + b.variance) ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(error > 0, excess / error, np.where(excess > 0, np.inf, 0.0))
        freedom = np.where(squares > 0, (batches - 1) * (va + vb) ** 2 / squares, np.inf)
    p = np.where(np.isinf(t), 0.0, 2 * stats.t.sf(t, np.minimum(freedom, 1e9)))
    return {
        "side": side,
        "t": t,
        "p": np.minimum(p, 1.0),
        "difference": difference,
        "value": value,
        "error": error,
        "slack": pool(slack),
        "freedom": freedom,
    }


def _detectable(level: dict, each: float) -> np.ndarray:
    """Relative errors found with probability 95 % by tests of two-sided significance `each`."""
    critical = stats.t.isf(each / 2, np.minimum(level["freedom"], 1e9))
    found = level["slack"] + np.where(level["error"] > 0, (critical + POWER_Z) * level["error"], 0)
    return found / np.maximum(np.abs(level["value"]), 1e-300)


def _place(side: int | None, index: tuple, image: bool) -> str:
    """Where a test stands, in words."""
    if not image:
        return f"number {int(np.ravel(index)[0])}" if index else "the number"
    if side is None:
        return "whole image"
    y, x = (int(i) * side for i in index[:2])
    return f"pixel ({x}, {y})" if side == 1 else f"{side}x{side} pixels at ({x}, {y})"
