"""The judge of two routes: false alarms as rare as stated, stated power kept, faults found where they are."""

import numpy as np
import pytest
from scipy import stats

from reference.verify.agreement import Sampled, agreement

SIZE = 32


def image(rng, noise=0.05, k=16, true=None):
    """A route of K normal batches to a picture with structure."""
    y, x = np.mgrid[0:SIZE, 0:SIZE, 0:3][:2] / SIZE
    true = 1 + x + np.sin(9 * y) ** 2 if true is None else true
    return Sampled.of(true + noise * (0.5 + true) * rng.normal(size=(k, *true.shape)))


def bounds(n, p):
    """Between which counts of n trials a chance of p stays but once in 1000 times."""
    return stats.binom.ppf(5e-4, n, p), stats.binom.ppf(1 - 5e-4, n, p)


@pytest.mark.parametrize("k", [4, 16])
def test_false_alarms_of_the_family_are_as_rare_as_asked(rng, k):
    n, significance = 300, 0.1
    alarms = sum(
        not agreement(image(rng, k=k), image(rng, k=16), significance=significance).agrees for _ in range(n)
    )
    assert alarms <= bounds(n, significance)[1]


def test_a_factor_of_the_stated_power_is_found_95_times_in_100(rng):
    n = 150
    catches = agreement(image(rng), image(rng)).catches
    assert 1e-4 < catches < 0.01
    found = 0
    for _ in range(n):
        a = image(rng)
        a = Sampled(a.mean * (1 + catches), a.variance, a.batches)
        found += not agreement(a, image(rng)).agrees
    assert found >= bounds(n, 0.95)[0]


def test_a_fault_in_one_block_is_found_and_placed(rng):
    a, b = image(rng), image(rng)
    catches = agreement(a, b).catches_locally
    mean = a.mean.copy()
    mean[16:32, 0:16] *= 1 + 1.5 * catches
    found = agreement(Sampled(mean, a.variance, a.batches), b)
    assert not found.agrees
    assert found.where == "16x16 pixels at (0, 16)"


def test_a_shifted_grid_is_found_where_bias_is_not(rng):
    true = 1 + (np.indices((SIZE, SIZE, 1)).sum(axis=0) // 4 % 2)
    a, b = image(rng, true=true), image(rng, true=true)
    shifted = agreement(Sampled(np.roll(a.mean, 1, axis=1), a.variance, a.batches), b)
    assert not shifted.agrees
    assert "pixel" in shifted.where


def test_exact_routes_may_differ_by_rounding_alone():
    one = Sampled.exact([1.0, 2.0])
    assert agreement(Sampled.exact([1.0 + 5e-6, 2.0]), one).agrees
    off = agreement(Sampled.exact([1.0, 2.0002]), one)
    assert not off.agrees and np.isinf(off.standard_errors) and off.where == "number 1"
    assert off.relative == pytest.approx(1e-4)


def test_a_difference_from_nothing_has_no_share():
    found = agreement(Sampled.exact([0.0, 1.0]), Sampled.exact([1e-3, 1.0]))
    assert found.relative == pytest.approx(1.0)
    assert np.isinf(agreement(Sampled.exact([1e-3, 1.0]), Sampled.exact([0.0, 1.0])).relative)


def test_a_printed_digit_is_no_error_and_the_next_one_is():
    printed = Sampled.exact(0.5534)
    assert agreement(Sampled.exact(0.55344), printed, within=5e-5).agrees
    assert not agreement(Sampled.exact(0.55356), printed, within=5e-5).agrees


def test_more_batches_than_the_worse_route_has_buy_nothing(rng):
    """t with few batches has heavy tails; 3 degrees of freedom, not 3 + 10^6."""
    few, exact = (
        Sampled(np.array([1.05]), np.array([1e-4]), 4),
        Sampled(np.array([1.0]), np.array([1e-8]), 10**6),
    )
    assert agreement(few, exact).p == pytest.approx(2 * stats.t.sf(5.0, 3), rel=0.01)


def test_pictures_of_different_shape_are_refused(rng):
    with pytest.raises(ValueError, match="shapes differ"):
        agreement(Sampled.exact(np.ones((4, 4, 3))), Sampled.exact(np.ones((4, 4, 1))))
