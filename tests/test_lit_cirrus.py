"""Lit cirrus: what an even slab scatters, which side of the sun is bright, and what the slab's shade does."""

import dataclasses

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.high_altitude_layer import LIT, bake, lit_cirrus
from reference.closed_form import high_clouds
from reference.slab_monte_carlo import phase
from reference.verify.routes_high_clouds import high_light_against_points
from reference.verify.run import judge
from scenes.high_clouds import HighClouds


def image(scene, size=32, view=None, stored="exact", **knobs):
    view = view or scene.view(size)
    found = lit_cirrus(view, bake(view, stored=stored), **knobs)
    return np.array(found, np.float64)[0].reshape(size, size)


def even(scene, depth):
    """The scene's view with no streaks: `depth` straight up."""
    view = scene.view(8)
    cloud = dataclasses.replace(
        view.cloud, extinction=lambda p: dr.full(mi.Float, depth / scene.thickness, dr.width(p))
    )
    return dataclasses.replace(view, cloud=cloud)


@pytest.mark.parametrize(("depth", "elevation"), [(0.05, 40.0), (1.0, 40.0), (2.0, 10.0), (0.5, 30.0)])
def test_an_even_slab_scatters_what_the_formula_says(depth, elevation):
    scene = HighClouds(sun_elevation=elevation)
    view = even(scene, depth)
    d, l = np.array(view.camera.direction, np.float64), np.array(scene.to_sun())
    a, b, lobe = 1 / d[2], 1 / l[2], phase(l @ d, scene.g)
    exact = lobe * a * (np.exp(-b * depth) - np.exp(-a * depth)) / (a - b)
    knobs = {"slant": "exact", "sun": "exact", "phase": "exact"}
    assert np.allclose(image(scene, 8, view, **knobs).ravel(), exact, rtol=2e-3)
    drawn = phase(l @ d, 0.2) * (1 - np.exp(-depth))
    assert np.allclose(image(scene, 8, view).ravel(), drawn, rtol=1e-4)


def test_with_every_stage_exact_a_thin_slab_is_the_closed_form():
    scene = HighClouds(thickness=30.0, elevation=65.0)
    exact = high_clouds.high_light(scene, 32)[..., 0]
    assert np.allclose(image(scene, **LIT), exact, atol=0.02 * exact.mean() + 0.01 * exact.max())
    assert np.abs(image(scene, **LIT) - exact).mean() < 0.01 * exact.mean()


def test_thin_ice_brightens_towards_the_sun_and_that_is_on_the_right():
    exact = high_clouds.high_light(HighClouds(optical_depth=0.02), 32)[..., 0]
    smooth = exact / high_clouds.high_depth(HighClouds(optical_depth=0.02), 32)[..., 0]
    at = np.unravel_index(smooth.argmax(), smooth.shape)
    assert at[1] > 24
    scene = HighClouds(optical_depth=0.02, sun_elevation=30.0)
    drawn = image(scene, phase="exact")
    assert drawn[:, 24:].mean() > 1.5 * drawn[:, :8].mean()


def test_twice_the_nodes_change_nothing(monkeypatch):
    scenes = HighClouds(), HighClouds(elevation=23.0, optical_depth=3.0), HighClouds(thickness=3000.0)
    found = [high_clouds.high_light(s, 8) for s in scenes]
    monkeypatch.setattr(high_clouds, "NODES", 32)
    for scene, once in zip(scenes, found, strict=True):
        assert np.allclose(once, high_clouds.high_light(scene, 8), atol=1e-6 * once.mean())


def test_closed_form_is_what_strewn_points_find():
    assert all(judge(c, 1e-3)["verdict"] == "agrees" for c in high_light_against_points(3))
