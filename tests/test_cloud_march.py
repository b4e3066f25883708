"""The march of a view ray: compositing rules, their orders, and jitter."""

import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.cloud_compositing import bake, cloud_compositing
from approximations.kit.start_jitter import TILE, starts, void_and_cluster
from reference.source_function import once_scattered_by_slab
from scenes.cloud import CloudSlab

SLAB = CloudSlab(optical_depth=8.0)


def off(steps, rule, scene=SLAB, **knobs):
    """Error over the truth of the pixel that looks straight down, and of the whole image."""
    size = 5
    view = scene.view(size)
    found = cloud_compositing(view, bake(view), steps=steps, rule=rule, **{"cut": 0.0, **knobs})
    truth = once_scattered_by_slab(scene, size)[..., 0]
    error = np.array(found)[0].reshape(size, size) / truth - 1
    return error[2, 2], error


@pytest.mark.parametrize(("rule", "order"), [("beer", 1), ("beer entering", 1), ("energy-conserving", 2)])
@pytest.mark.parametrize("seen", ["above", "below"])
def test_rules_converge_with_their_orders(rule, order, seen):
    scene = CloudSlab(optical_depth=8.0, seen=seen)
    coarse, fine = (abs(off(n, rule, scene)[0]) for n in (64, 256))
    assert np.log2(coarse / fine) / 2 == pytest.approx(order, abs=0.1)


def test_beers_two_orders_lie_on_either_side_by_the_known_factors():
    """a e^-a / (1 - e^-a) and a / (1 - e^-a) of what the transfer equation makes of the same samples."""
    a = 8.0 / 16
    right = 1 + off(16, "energy-conserving")[0]
    assert (1 + off(16, "beer")[0]) / right == pytest.approx(a / np.expm1(a), rel=1e-4)
    assert (1 + off(16, "beer entering")[0]) / right == pytest.approx(-a / np.expm1(-a), rel=1e-4)


def test_the_literal_sum_does_not_converge():
    """Density 1/8: the first eight samples count 1, 7/8 ... 1/8, in sum 4.5, whatever their distance."""
    for steps in (4096, 8192):
        unweighted = (1 + off(steps, "literal")[0]) * np.array(once_scattered_by_slab(SLAB, 5))[2, 2, 0]
        assert unweighted == pytest.approx(4.5 * lobe(SLAB), rel=0.02)


def lobe(scene):
    cosine, g = -scene.to_sun()[2], scene.g
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def test_an_early_end_costs_no_more_than_what_it_lets_through():
    whole, cut = off(256, "energy-conserving")[1], off(256, "energy-conserving", cut=0.05)[1]
    lost = (whole - cut) * once_scattered_by_slab(SLAB, 5)[..., 0]
    assert np.all(lost > 0) and np.all(lost < 0.05 * 4)


def test_every_rank_of_blue_noise_is_there_once_and_neighbours_start_far_apart():
    ranks = void_and_cluster()
    assert np.array_equal(np.sort(ranks.ravel()), np.arange(TILE * TILE))
    blue = (ranks + 0.5) / TILE**2
    white = np.random.default_rng(0).permutation(blue.ravel()).reshape(TILE, TILE)
    power = [np.abs(np.fft.fft2(x - x.mean())) ** 2 for x in (blue, white)]
    radius = np.hypot(*np.meshgrid(*[np.fft.fftfreq(TILE)] * 2))
    low = (radius > 0) & (radius < 0.2)
    assert power[0][low].mean() < 0.05 * power[1][low].mean()
    for rank in (102, 300, 512):
        mask = ranks < rank
        assert np.abs(mask.reshape(4, 8, 4, 8).mean((1, 3)) - rank / TILE**2).max() < 0.05


def test_starts_are_the_middle_or_spread_over_the_step():
    table = mi.Float(np.arange(TILE * TILE, dtype=np.float32))
    assert starts("none", table, 40, 40) == 0.5
    tiled = np.array(starts("blue noise", table, 40, 33)).reshape(33, 40)
    assert tiled[32, 33] == 1 and tiled[1, 0] == TILE and tiled[0, 1] == 1
    white = np.array(starts("white", table, 64, 64))
    assert white.min() >= 0 and white.max() < 1 and white.mean() == pytest.approx(0.5, abs=0.02)
    pairs = white.reshape(64, 64)
    assert abs(np.corrcoef(pairs[:, 1:].ravel(), pairs[:, :-1].ravel())[0, 1]) < 0.05


def test_blue_noise_averages_out_where_white_does_not():
    """Over 4 x 4 pixels."""
    size = 64
    spread = {}
    for jitter in ("white", "blue noise"):
        at = np.array(starts(jitter, mi.Float(bake(SLAB.view(2))), size, size)).reshape(16, 4, 16, 4)
        spread[jitter] = at.mean((1, 3)).std()
    assert spread["blue noise"] < 0.5 * spread["white"]
