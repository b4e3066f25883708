"""Batches that arrive one by one give the same truth in any sitting; rare bright paths are found, not cut."""

import numpy as np
import pytest
from scipy import stats

from reference.moments import from_batches, join
from reference.truth import Truth
from scenes.contract import BadInput


@pytest.fixture
def batches(rng):
    """16 images of 8 x 8 with correlated channels, far from zero mean."""
    shared = rng.normal(size=(16, 8, 8, 1))
    return 50 + np.array([1.0, 2.0, 0.5]) * (shared + 0.3 * rng.normal(size=(16, 8, 8, 3)))


def test_running_moments_are_those_of_the_whole_stack(batches):
    truth = from_batches(batches)
    assert np.allclose(truth.mean, batches.mean(axis=0), rtol=1e-14)
    assert np.allclose(truth.variance, batches.var(axis=0, ddof=1) / 16, rtol=1e-12)
    centred = (batches - batches.mean(axis=0)).reshape(-1, 3)
    assert np.allclose(truth.correlation, np.corrcoef(centred.T), atol=1e-12)
    a, b = truth.halves()
    assert np.allclose(a, batches[0::2].mean(axis=0)) and np.allclose(b, batches[1::2].mean(axis=0))
    excess = stats.kurtosis(batches, axis=0, fisher=False).mean() - 3 * 15 / 17
    assert truth.provenance["kurtosis"] == pytest.approx(excess, abs=6e-4)


@pytest.mark.parametrize("cut", [4, 8, 14])
def test_two_sittings_join_to_one(batches, cut):
    whole = from_batches(batches)
    joined = join(from_batches(batches[:cut]), from_batches(batches[cut:]))
    assert joined.batches == 16
    for name in ("mean", "variance", "correlation", "half_difference"):
        assert np.allclose(getattr(joined, name), getattr(whole, name), rtol=1e-10, atol=1e-13), name


def test_grey_sittings_join_coloured_ones(batches):
    grey = np.repeat(batches[:8, ..., :1], 3, axis=3)
    joined = join(from_batches(grey), from_batches(batches[8:]))
    whole = np.concatenate([grey, batches[8:]])
    assert np.allclose(joined.mean, whole.mean(axis=0))
    assert np.allclose(joined.variance, whole.var(axis=0, ddof=1) / 16)


def test_a_rare_bright_path_is_named_with_its_pixel_and_stays_in_the_mean(batches):
    batches[5, 2, 6] += 40_000
    truth = from_batches(batches)
    rare = truth.provenance["rare_paths"]
    assert rare["count"] == 1
    assert rare["worst"][0]["pixel"] == [6, 2]
    assert rare["worst"][0]["share_of_one_batch"] > 0.9
    assert truth.mean[2, 6, 0] == pytest.approx(batches[:, 2, 6, 0].mean())
    assert truth.provenance["kurtosis"] > 0.1


def test_a_rare_path_of_either_sitting_is_remembered(batches):
    batches[3, 1, 4] += 40_000
    joined = join(from_batches(batches[:8]), from_batches(batches[8:]))
    assert joined.provenance["rare_paths"]["worst"][0]["pixel"] == [4, 1]


def test_normal_batches_are_seldom_said_to_hold_rare_paths(rng):
    alarms = sum(
        from_batches(rng.normal(5, 1, size=(16, 16, 16, 1))).provenance["rare_paths"]["count"] > 0
        for _ in range(300)
    )
    assert alarms <= 10  # 3 expected at 1 %; 10 or more happen once in 900 times


def test_a_batch_that_is_not_finite_is_refused_with_its_pixel(batches):
    batches[1, 2, 3] = np.inf
    with pytest.raises(BadInput, match=r"pixel \(3, 2\), batch 1"):
        from_batches(batches)


def test_resolution_is_the_error_that_is_told_from_none(rng):
    """Of perfect estimates 2.5 % read an rmse above the resolution."""
    above = []
    for _ in range(400):
        truth = from_batches(1 + 0.1 * rng.normal(size=(16, 12, 12, 1)))
        squared = ((truth.mean - 1) ** 2 - truth.variance).mean()
        above.append(squared > truth.resolution() ** 2)
    assert 0.005 < np.mean(above) < 0.06


def test_resolution_of_the_worst_tile_is_that_of_the_tile_alone():
    variance = np.full((8, 8, 1), 1e-6)
    variance[4:, 4:] = 1e-4
    mean = np.ones((8, 8, 1))
    truth = Truth(mean, variance, np.eye(1), mean * 0, 16)
    corner = Truth(mean[:4, :4], variance[4:, 4:], np.eye(1), mean[:4, :4] * 0, 16)
    assert truth.resolution(4) == pytest.approx(corner.resolution())
    assert truth.resolution() < truth.resolution(4)
    assert truth.resolution(100) == pytest.approx(truth.resolution())
