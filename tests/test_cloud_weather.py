"""A map of the weather: what it holds, how rain pulls, where it repeats, how much cloud a coverage makes."""

import functools

import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.weather_map import bake, weather_map
from reference.closed_form.broken_field import density_of_field
from reference.verify.routes_broken_field import field_against_tree, forecast
from scenes.broken_field import BrokenField
from scenes.cloud_density import CloudModel, Weather, density


@functools.cache
def truth(scene, size):
    return density_of_field(scene, size).ravel()


def error(fields=None, size=48, rain="towards cumulonimbus", filter="linear", **baked):
    """rmse over the mean density."""
    scene = BrokenField(**(fields or {}))
    view = scene.probes(size)
    found = np.array(weather_map(view, bake(view, **baked), rain=rain, filter=filter), np.float64)
    exact = truth(scene, size)
    return np.sqrt(np.mean((found - exact) ** 2)) / exact.mean()


@pytest.mark.parametrize("fields", [{}, {"cover": 0.0}, {"cover": 1.0}, {"extent": 240e3}])
def test_the_weather_itself_makes_the_closed_form(fields):
    assert error(fields, filter="exact", resolution=4) < 3e-5


def test_the_map_holds_the_weather_at_the_middles_of_its_texels():
    view = BrokenField().probes(8)
    texels = np.array(bake(view, resolution=16, storage="exact").texture.tensor()).reshape(-1, 3)
    at_y, at_x = np.meshgrid(*[(np.arange(16) + 0.5) * 3750] * 2, indexing="ij")
    p = np.stack([at_x.ravel(), at_y.ravel(), 0 * at_x.ravel()], axis=1)
    coverage, type_ = forecast(p, 0.4, 300.0, 0.8)
    wet = 1 - (1 - type_) / (1 - texels[:, 2])
    assert np.allclose(np.maximum(texels[:, 0], 0.7 * wet), coverage, atol=1e-5)
    assert np.allclose(wet, texels[:, 1], atol=1e-4) and texels[:, 1].max() > 0.5


def test_texels_of_8_bits_are_multiples_of_their_step():
    texels = np.array(bake(BrokenField().probes(8), resolution=32).texture.tensor())
    assert np.allclose(255 * texels, np.round(255 * texels), atol=1e-3) and len(np.unique(texels)) > 100


def test_a_wide_front_needs_few_texels_and_a_narrow_one_many():
    wide, narrow = ({"front": f} for f in (10e3, 3.0))
    assert error(wide, resolution=256, storage="exact") < 0.003
    assert error(narrow, resolution=256) > 2 * error(narrow, resolution=2048)
    assert error(wide, storage="exact") < error(wide) / 5


def test_the_nearest_texel_is_worse_than_the_mean_of_four():
    assert error(filter="nearest") > 2 * error()


def test_the_map_repeats_where_the_weather_does_not():
    assert error({"extent": 55e3}) < 0.03 and error({"extent": 240e3}) > 1
    far = BrokenField(extent=240e3).probes(32)
    found = np.array(weather_map(far, bake(far))).reshape(32, 32)
    assert np.corrcoef(found[:, :8].ravel(), found[:, 8:16].ravel())[0, 1] > 0.7


def test_rain_that_is_not_heeded_takes_cloud_away():
    assert error(rain="none") > 0.4 and error({"rain": 0.0}, rain="none") == error({"rain": 0.0})


def deep_share(coverage, type_):
    """Share of columns with an optical depth over 0.1 at 0.02 /m, for one coverage everywhere."""
    columns, heights = 500, 32
    xy = 50e3 * np.random.default_rng(1).random((2, columns))
    z = 1500 + 2500 * (np.arange(heights) + 0.5) / heights
    p = np.stack([*np.repeat(xy, heights, axis=1), np.tile(z, columns)])
    model = CloudModel(1500.0, 4000.0, lambda x, y: Weather(coverage + 0 * x, 0 * x, type_))
    depth = 0.02 * 2500 * np.array(density(model, mi.Point3d(p))).reshape(columns, heights).mean(axis=1)
    return (depth > 0.1).mean()


@pytest.mark.parametrize(
    ("type_", "shares"),
    [(0.0, (0, 0, 0.44, 0.985)), (0.5, (0, 0.04, 0.88, 1)), (1.0, (0, 0.105, 0.99, 1))],
)
def test_coverage_is_not_the_share_of_the_sky_that_is_covered(type_, shares):
    found = [deep_share(c, type_) for c in (0.1, 0.2, 0.3, 0.4)]
    assert found == pytest.approx(shares, abs=0.06)
    assert deep_share(0.0, type_) == 0 and deep_share(1.0, type_) == 1


def test_between_stratus_and_stratocumulus_half_a_coverage_makes_no_cloud():
    assert deep_share(0.5, 0.25) == 0


def test_closed_form_is_that_of_trees():
    for c in field_against_tree(1):
        assert np.abs(c.first.mean - c.second.mean).max() < 1e-11, c.label
