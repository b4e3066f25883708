r"""Do two routes give the same answer? A test whose false alarms are bounded and whose power is known.

Route a has mean A with variance V_a (of that mean) from K_a batches, route b likewise; an exact route has
variance 0. Under the hypothesis that both means are the same,

    t = (|A - B| - within) / sqrt(V_a + V_b)

is held against Student's law with min(K_a, K_b) - 1 degrees of freedom for each number that goes into it, the
least that it can have (Welch's estimate of them is too generous so far out in the tails: 18 % false alarms
where 10 % were asked for).
`within` is a difference that is no error: float32 rounding, or half a unit of a printed table's last digit.

Images are tested pixel by pixel and as sums over blocks of BLOCKS pixels a side and over the whole image,
each channel apart: fine blocks find structure (a shifted grid), coarse ones bias (1 % of the energy). Every
size of block gets an equal part of the significance, and every block of that size an equal part of that
(Sidak), so that the family of all of them raises a false alarm with at most the significance, and a few tests
of the whole are not drowned in thousands of pixels. Other arrays are lists of numbers that are tested one by
one.

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

    An image has shape (H, W, C); any other shape is a list of numbers. observed: another estimate of the
    variance, from this answer's own batches where `variance` comes from elsewhere. The larger of both counts,
    in each block anew: where paths are rare and bright, a few batches that none of them hit know no noise.
    """

    mean: np.ndarray
    variance: np.ndarray
    batches: int
    observed: np.ndarray | None = None

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
    relative: that disagreement over the second route's value there, infinite where that is 0. tests: size of
    the family. catches, catches_locally: relative errors that would have been found with probability 95 %."""

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
    a, b = (_at_least_1d(x) for x in (a, b))
    slack = np.broadcast_to(FLOAT32 * np.abs(b.mean) if within is None else within, a.mean.shape)
    image = a.mean.ndim == 3
    sides = [s for s in BLOCKS if image and s <= min(a.mean.shape[:2])] if image else [1]
    levels = [_level(a, b, slack, side) for side in sides]
    if image:
        levels.append(_level(a, b, slack, None))
    level = min(levels, key=lambda lv: (_family(lv["p"].min(), lv["p"].size), -lv["t"].max()))
    worst = np.unravel_index(np.lexsort((-level["t"].ravel(), level["p"].ravel()))[0], level["p"].shape)
    family = _family(_family(level["p"][worst], level["p"].size), len(levels))
    local = next((lv for lv in levels if lv["side"] == LOCAL), levels[0])
    share = _part(significance, len(levels))
    return Agreement(
        agrees=bool(family >= significance),
        p=family,
        standard_errors=float(level["t"][worst]),
        relative=_over(float(level["difference"][worst]), float(level["value"][worst])),
        where=_place(level["side"], worst, image),
        tests=sum(lv["p"].size for lv in levels),
        catches=float(np.max(_detectable(levels[-1], share))),
        catches_locally=float(np.median(_detectable(local, share))),
    )


def _over(difference: float, value: float) -> float:
    """A difference as a share of a value."""
    return difference / abs(value) if value else (np.inf if difference else 0.0)


def _family(p: float, tests: int) -> float:
    """The p-value of a family whose least one is p (Sidak)."""
    return float(-np.expm1(tests * np.log1p(-min(float(p), 1 - 1e-16))))


def _part(significance: float, tests: int) -> float:
    """The significance of each test of a family (Sidak)."""
    return float(-np.expm1(np.log1p(-significance) / tests))


def _at_least_1d(x: Sampled) -> Sampled:
    observed = x.variance if x.observed is None else x.observed
    return Sampled(*map(np.atleast_1d, (x.mean, x.variance)), x.batches, np.atleast_1d(observed))


def _level(a: Sampled, b: Sampled, slack: np.ndarray, side: int | None) -> dict:
    """The tests of all blocks of one size (None: the whole image)."""

    def pool(x: np.ndarray) -> np.ndarray:
        if side == 1 or x.ndim != 3:
            return x
        if side is None:
            return x.sum(axis=(0, 1), keepdims=True)
        rows, columns = (np.arange(0, n, side) for n in x.shape[:2])
        return np.add.reduceat(np.add.reduceat(x, rows, axis=0), columns, axis=1)

    va, vb = (np.maximum(pool(x.variance), pool(x.observed)) for x in (a, b))
    value = pool(b.mean)
    difference = np.abs(pool(a.mean) - value)
    excess = np.maximum(difference - pool(slack), 0)
    error = np.sqrt(va + vb)
    batches = min((x.batches for x in (a, b) if x.batches), default=2)
    squares = pool(sum(np.maximum(x.variance, x.observed) for x in (a, b)) ** 2)
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


def _detectable(level: dict, significance: float) -> np.ndarray:
    """Relative errors found with probability 95 % by two-sided tests whose family has that significance."""
    each = _part(significance, level["p"].size)
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
