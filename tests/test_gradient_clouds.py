"""A cloud of sprites: how opaque they are, which side is bright, where the rim glows."""

import numpy as np
import pytest

from approximations.clouds.gradient_clouds import DARK, SPREAD, WIDTH, bake, gradient_clouds
from scenes.cloud import CloudSphere


def image(scene, count=32, size=32, **knobs):
    view = scene.view(size)
    return np.array(gradient_clouds(view, bake(view, count=count), **knobs), np.float64)[0].reshape(
        size, size
    )


def test_sprites_hold_the_balls_extinction_and_are_sorted_from_back_to_front():
    view = CloudSphere(optical_depth=6.0).view(4)
    sprites = bake(view, count=64)
    places = np.array(sprites.place)
    assert sprites.count * 2 * np.pi * WIDTH**2 * sprites.depth == pytest.approx(
        4 / 3 * np.pi * 3.0, rel=1e-5
    )
    assert np.linalg.norm(places, axis=0).max() <= SPREAD
    assert np.abs(places.mean(axis=1)).max() < 0.06
    assert np.all(np.diff(places[1]) <= 0)


def test_the_side_towards_the_sun_is_bright_and_the_other_dark():
    lit = image(CloudSphere(optical_depth=64.0, sun_angle=90.0), gradient="pixel")
    row = lit[15:17].mean(axis=0)
    assert row[6] > 0.75 / np.pi
    assert row[-7] == pytest.approx((0.625 - 0.375 * 0.59) / np.pi, rel=0.1)
    assert row[15:17].mean() == pytest.approx((1 + DARK) / 2 / np.pi, rel=0.05)
    assert np.all(np.diff(row[6:-6]) < 0)
    front = image(CloudSphere(optical_depth=64.0, sun_angle=0.0), gradient="pixel")
    assert front[15:17, 15:17].mean() == pytest.approx(1 / np.pi, rel=0.02)


def test_per_sprite_the_ramp_is_that_of_the_foremost_sprites():
    scene = CloudSphere(optical_depth=64.0, sun_angle=90.0)
    row = image(scene)[15:17].mean(axis=0)
    assert row[6] > 0.7 / np.pi and row[-7] < 0.55 / np.pi


def test_thick_and_thin_clouds_shade_alike():
    thick, thin = (image(CloudSphere(optical_depth=x), gradient="pixel")[16, 8:24] for x in (40.0, 64.0))
    assert np.allclose(thick, thin, rtol=0.01)


def test_without_contrast_all_is_the_mean_of_dark_and_bright():
    lit = image(CloudSphere(optical_depth=64.0), contrast=0.0)
    assert lit[16, 16] == pytest.approx((1 + DARK) / 2 / np.pi, rel=1e-3)


def test_the_rim_glows_only_before_the_sun_and_only_where_the_cloud_is_thin():
    behind = CloudSphere(sun_angle=180.0)
    rim = image(behind) - image(behind, scale=0.0)
    assert rim[15:17, 15:17].max() == 0
    assert rim.max() > 0.05
    assert np.all(rim >= -1e-7)
    assert (
        np.abs(image(CloudSphere(sun_angle=80.0)) - image(CloudSphere(sun_angle=80.0), scale=0.0)).max() == 0
    )
    narrower = image(behind, threshold=0.25) - image(behind, scale=0.0)
    assert narrower.sum() < 0.5 * rim.sum()
    steeper = image(behind, slope=16.0) - image(behind, scale=0.0)
    assert steeper.sum() > rim.sum()
    off = CloudSphere(sun_angle=150.0)
    fall = (image(off) - image(off, scale=0.0)).max() / rim.max()
    assert fall == pytest.approx(np.cos(np.radians(30)) ** 8, rel=0.01)
