"""High clouds as one picture: what a slanted way, a thick slab, few texels and eight bits do to it."""

import dataclasses

import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.high_altitude_layer import EXACT, bake, high_altitude_layer
from reference.closed_form.high_clouds import high_transmittance
from reference.verify.routes_high_clouds import high_clouds_against_points
from reference.verify.run import judge
from scenes.high_clouds import HighClouds


def image(scene, size=48, slant="none", parallax="none", **knobs):
    view = scene.view(size)
    found = high_altitude_layer(view, bake(view, **knobs), slant=slant, parallax=parallax)
    return np.array(found, np.float64)[0].reshape(size, size)


def exact(scene):
    return high_transmittance(scene, 48)[..., 0]


@pytest.mark.parametrize("fields", [{}, {"thickness": 1000.0, "time": 1800.0}, {"elevation": 65.0}])
def test_with_every_stage_exact_it_is_the_closed_form(fields):
    scene = HighClouds(**fields)
    assert np.allclose(image(scene, **EXACT), exact(scene), atol=3e-3)


def test_published_layer_lacks_the_slant_and_so_is_too_clear():
    scene = HighClouds(thickness=30.0, elevation=65.0)
    sine = np.array(scene.view(48).camera.direction)[2].reshape(48, 48)
    published = image(scene, stored="exact")
    assert np.allclose(published ** (1 / sine), exact(scene), atol=4e-3)
    assert image(HighClouds()).mean() > 1.2 * exact(HighClouds()).mean()


def test_a_thin_slab_has_no_parallax_and_a_thick_one_has():
    thin, thick = (HighClouds(thickness=x, elevation=65.0) for x in (30.0, 3000.0))
    slanted = {"slant": "exact", "stored": "exact"}
    assert np.abs(image(thin, **slanted) - exact(thin)).max() < 0.005
    assert np.abs(image(thick, **slanted) - exact(thick)).max() > 0.2


def test_the_wind_moves_the_picture_with_it():
    """30 m/s along x for 100 s: the streaks overhead are those that were 3 km upwind."""
    scene = HighClouds(time=100.0, elevation=65.0)
    view = scene.view(2)
    up = dataclasses.replace(
        view.camera, origin=mi.Point3f(3000.0, 1200.0, 0.0), direction=mi.Vector3f(0, 0, 1)
    )
    now = high_altitude_layer(dataclasses.replace(view, camera=up), bake(view, stored="exact"))
    before = np.exp(-np.array(scene.picture(mi.Float(0.0), mi.Float(0.0)))[0])
    assert np.array(now)[0][0] == pytest.approx(before, abs=2e-3)


def test_eight_bits_and_few_texels_are_off_by_their_own_steps():
    scene = HighClouds()
    fine = image(scene, stored="exact")
    byte = np.abs(image(scene) - fine).max()
    assert 0.3 / 255 < byte <= 0.51 / 255
    assert np.abs(image(scene, resolution=32, stored="exact") - fine).max() > 0.03


def test_closed_form_is_what_strewn_points_find():
    assert all(judge(c, 1e-3)["verdict"] == "agrees" for c in high_clouds_against_points(3))
