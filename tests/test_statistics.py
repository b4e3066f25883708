"""The tester tested: every statistic under known errors and known noise, every metric by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from compare import metrics, statistics
from compare.statistics import Estimate
from reference.moments import from_batches
from reference.truth import Truth
from scenes.contract import DISTANCE, RADIANCE, TRANSMITTANCE, BadInput

TRIALS = 1500
LOW, HIGH = 0.93, 0.97


def image(rng, channels):
    """A true radiance image with structure, 24 x 24."""
    y, x = np.mgrid[0:24, 0:24] / 24
    base = 0.3 + x + 0.5 * np.sin(7 * y) ** 2
    return base[..., None] * np.linspace(0.7, 1.3, channels)


def trial(rng, true, sigma, correlation, count):
    """A truth from `count` batches whose channels are correlated within a pixel."""
    c = true.shape[2]
    root = np.linalg.cholesky(correlation * np.ones((c, c)) + (1 - correlation) * np.eye(c))
    noise = rng.normal(size=(count, *true.shape)) @ root.T
    return from_batches(true + sigma * np.sqrt(count) * (0.5 + true) * noise)


@pytest.mark.parametrize(
    ("channels", "correlation", "error", "count"),
    [(1, 0, 0.1, 16), (1, 0, 0.0, 16), (3, 0.9, 0.1, 16), (3, 0.0, 0.05, 16), (3, 0.9, 0.02, 8)],
)
def test_intervals_hold_the_true_value_93_to_97_percent(rng, channels, correlation, error, count):
    true = image(rng, channels)
    estimate = true * (1 + error * np.cos(np.arange(true.size)).reshape(true.shape)) + 0.3 * error
    mean = true.mean()
    gain = (estimate * true).sum() / (estimate**2).sum()
    exact = {
        "mse": ((estimate - true) ** 2).mean(),
        "bias": estimate.sum() / true.sum() - 1,
        "gain": gain,
        "left": ((gain * estimate - true) ** 2).mean(),
    }
    held = dict.fromkeys(exact, 0)
    values = {name: [] for name in exact}
    for _ in range(TRIALS):
        truth = trial(rng, true, 0.05, correlation, count)
        found = {"mse": statistics.mse(estimate, truth), "bias": statistics.bias(estimate, truth)}
        found["gain"], found["left"] = statistics.best_gain(estimate, truth)
        for name, e in found.items():
            held[name] += e.low <= exact[name] <= e.high
            values[name].append(e.value)
    for name, hits in held.items():
        assert LOW <= hits / TRIALS <= HIGH, f"{name} held {hits / TRIALS:.3f}"
        spread = np.std(values[name]) / math.sqrt(TRIALS)
        assert abs(np.mean(values[name]) - exact[name]) < 4 * spread + 2e-4 * mean, f"{name} is biased"


def test_plain_squared_error_is_overstated_by_the_noise(rng):
    true = image(rng, 1)
    truths = [trial(rng, true, 0.1, 0, 16) for _ in range(200)]
    plain = np.mean([((true - t.mean) ** 2).mean() for t in truths])
    unbiased = np.mean([statistics.mse(true, t).value for t in truths])
    assert plain > 5e-3
    assert abs(unbiased) < plain / 50


def test_an_image_that_meets_a_noisy_truth_too_well_still_has_an_interval():
    """By hand: n means of variance v from 4 batches make a squared error of variance 2 v^2 / n, of which an
    estimate of v from 4 is too high by the factor 1 + 2 / 3."""
    n, v = 64, 0.01
    truth = exact(np.ones((8, 8)))
    truth = replace(truth, variance=np.full_like(truth.mean, v), batches=4)
    found = statistics.mse(truth.mean, truth)
    assert found.value == pytest.approx(-v)
    assert found.high - found.value == pytest.approx(1.96 * v * math.sqrt(2 / n / (5 / 3)), rel=1e-3)


def test_relative_mse_of_a_two_pixel_image_by_hand():
    truth = exact([[1.0, 3.0]])
    e = metrics.errors(np.array([[[1.1], [2.4]]]), truth, RADIANCE, None)
    assert e["rmse"].value == pytest.approx(math.sqrt((0.01 + 0.36) / 2) / 2)
    assert e["relmse"].value == pytest.approx((0.01 / 1.04 + 0.36 / 9.04) / 2)
    assert e["bias"].value == pytest.approx(3.5 / 4 - 1)
    assert e["gain"].value == pytest.approx((1.1 + 7.2) / (1.21 + 5.76))
    assert e["p50"].value == pytest.approx(0.15)
    assert e["max"].value == pytest.approx(0.2)


def test_gain_fit_separates_level_from_shape():
    truth = exact(np.linspace(1, 2, 64).reshape(8, 8))
    e = metrics.errors(0.5 * truth.mean, truth, RADIANCE, None)
    assert e["gain"].value == pytest.approx(2)
    assert e["rmse"].value > 0.5
    assert e["rmse_gain"].value == pytest.approx(0, abs=1e-12)


def test_ratio_metrics_by_hand():
    e = metrics.errors(np.array([[[0.5], [0.9]]]), exact([[0.4, 1.0]]), TRANSMITTANCE, None)
    assert e["mae"].value == pytest.approx(0.1)
    assert e["rmse"].value == pytest.approx(0.1)
    assert e["bias"].value == pytest.approx(0, abs=1e-12)


def test_metrics_of_lengths_by_hand_are_in_metres_and_signed():
    truth = exact([[-1.0, 0.0, 1.0, 2.0]])
    found = metrics.errors(np.array([[[-1.0], [0.5], [1.0], [1.9]]]), truth, DISTANCE, None)
    assert found["bias"].value == pytest.approx(0.1)
    assert found["mae"].value == pytest.approx(0.15)
    assert found["rmse"].value == pytest.approx(math.sqrt((0.25 + 0.01) / 4))
    assert found["max"].value == pytest.approx(0.5)
    assert not metrics.flaws(truth.mean, signed=True)
    assert [f["kind"] for f in metrics.flaws(truth.mean)] == ["negative"]


def test_interval_of_an_offset_holds_the_true_one(rng):
    true, inside = image(rng, 1) - 0.8, 0
    for _ in range(400):
        e = statistics.offset(true + 0.05, trial(rng, true, 0.1, 0, 16))
        inside += e.low <= 0.05 <= e.high
    assert LOW - 0.02 <= inside / 400 <= HIGH + 0.02


def test_percentile_floor_is_what_the_halves_read(rng):
    truth = trial(rng, image(rng, 1), 0.1, 0, 16)
    e = metrics.errors(truth.mean + 1e-3, truth, RADIANCE, None)
    assert not e["p99"].resolved
    assert metrics.errors(truth.mean * 3, truth, RADIANCE, None)["p50"].resolved


def test_one_bright_pixel_does_not_move_flip_when_exposures_are_pinned(rng):
    true = np.repeat(image(rng, 1), 3, 2)
    test = true * 1.05
    plain = metrics.flip_map(true, test, (-2, 2)).mean()
    bright = true.copy()
    bright[3, 3] = 1e4
    spot = test.copy()
    spot[3, 3] = 1e4
    assert metrics.flip_map(bright, spot, (-2, 2)).mean() == pytest.approx(plain, rel=0.1)


def test_grey_truth_is_held_against_every_channel_of_a_colour():
    truth = exact([[1.0, 1.0]])
    colour = np.array([[[1.0, 1.1, 0.9], [1.0, 1.0, 1.0]]])
    e = metrics.errors(colour, truth, RADIANCE, None)
    assert e["rmse"].value == pytest.approx(math.sqrt(0.02 / 6))


def test_flaws_are_counted_and_located():
    a = np.ones((2, 3, 1))
    a[0, 1], a[1, 2], a[1, 0] = np.nan, np.inf, -1
    found = {f["kind"]: f for f in metrics.flaws(a)}
    assert found["NaN"]["pixel"] == [1, 0]
    assert found["infinity"]["pixel"] == [2, 1]
    assert found["negative"]["count"] == 1


def test_images_of_different_size_are_refused():
    with pytest.raises(BadInput, match="differ in size"):
        metrics.errors(np.ones((2, 2, 1)), exact([[1.0, 1.0]]), RADIANCE, None)


def test_median_interval_covers_whatever_the_distribution(rng):
    hits = 0
    for _ in range(2000):
        e = statistics.median(list(rng.exponential(size=11)))
        hits += e.low <= math.log(2) <= e.high
    assert hits / 2000 > 0.94


def test_unresolved_means_under_twice_the_floor():
    assert not Estimate(1.0, 1.0, 1.0, 0.6).resolved
    assert Estimate(1.0, 1.0, 1.0, 0.4).resolved


def exact(values) -> Truth:
    mean = np.asarray(values, float)[..., None]
    return Truth(mean, np.zeros_like(mean), np.eye(1), None, 0)
