"""Clouds that the wind carries: which way they go, how they lean, when they come back, what stays behind."""

import dataclasses
import functools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.cloud_wind import EXACT, cloud_wind
from reference.closed_form.blown_field import carried_density
from reference.verify.routes_blown_field import blown_field_against_paths, walked_back
from scenes.blown_field import BlownField

MOVED = {"weather": "exact", "top_offset": 0.0}
SIZE = 48


def blown(scene, **wind):
    """The view of a scene, its wind changed; times are no constants of the code made."""
    view = scene.probes(SIZE)
    model = dataclasses.replace(view.cloud.model, **wind)
    held = {n: dr.opaque(mi.Float, getattr(model, n)) for n in ("time", "updraft")}
    model = dataclasses.replace(model, **held)
    return dataclasses.replace(view, cloud=dataclasses.replace(view.cloud, model=model))


def image(scene, wind=None, **knobs):
    return np.array(cloud_wind(blown(scene, **(wind or {})), **knobs), np.float64)


def error(scene, **knobs):
    return np.sqrt(np.mean((image(scene, **knobs) - truth(scene)) ** 2))


@functools.cache
def truth(scene):
    return carried_density(scene, SIZE).ravel()


def at_first(scene, moved):
    """Density at time 0 at places displaced by `moved` (m) from the probes."""
    view = scene.probes(SIZE)
    return np.array(view.cloud.extinction(view.camera.origin + moved))


@pytest.mark.parametrize("fields", [{}, {"time": 600.0, "shear": 20.0}])
def test_with_every_stage_exact_it_is_the_closed_form(fields):
    assert error(BlownField(**fields), **EXACT) < 2e-6


def test_a_scroll_without_a_lean_is_exact_without_shear_and_updraft():
    assert error(BlownField(shear=0.0, updraft=0.0, time=300.0), **MOVED) < 2e-6


def test_clouds_go_with_the_wind_and_as_printed_against_it():
    scene = BlownField(updraft=0.0)
    for sense, side in (("downwind", -1), ("printed", 1)):
        came_from = at_first(scene, side * 600 * mi.Vector3f(0.96, 0.28, 0))
        assert np.abs(image(scene, sense=sense, **MOVED) - came_from).max() < 1e-4


def test_billows_rise_and_along_y_they_drift():
    scene = BlownField(speed=0.0)
    for upward, way in (("height", mi.Vector3f(0, 0, 1)), ("y", mi.Vector3f(0, 1, 0))):
        assert np.abs(image(scene, upward=upward, **MOVED) - at_first(scene, -60 * way)).max() < 1e-4


def test_tops_lean_500_m_downwind_at_all_times():
    scene = BlownField(updraft=0.0, time=0.0)
    h = (scene.probes(SIZE).camera.origin.z - 1500) / 2500
    leaned = at_first(scene, -500 * h * mi.Vector3f(0.96, 0.28, 0))
    assert np.abs(image(scene, weather="exact") - leaned).max() < 1e-4


def test_the_lean_is_right_after_100_s_of_a_gain_of_5_m_per_s():
    errors = [error(BlownField(time=t, updraft=0.0), weather="exact") for t in (40.0, 100.0, 160.0)]
    assert errors[1] < 2e-6 < 0.01 < min(errors[0], errors[2])


def test_shear_leans_what_rises_by_the_wind_half_way_up():
    scene = BlownField(time=250.0, updraft=4.0, shear=10.0)
    p = scene.points(4)
    came_from = scene.origins(p)
    assert np.allclose(walked_back(scene, p), came_from, atol=1e-6)
    h = (p[2] - 1500) / 2500
    assert np.allclose(p[0] - came_from[0], 250 * (10 + 10 * (h - 0.2)) * 0.96)
    assert np.allclose(p[2] - came_from[2], 1000)


def test_clouds_stay_where_a_still_map_has_them():
    """What goes with the air is less wrong by two thirds."""
    scene = BlownField()
    assert error(scene, weather="exact") < error(scene) / 3
    still = np.sqrt(np.mean((at_first(scene, 0) - truth(scene)) ** 2))
    assert 0.8 * still < error(scene) < 0.95 * still


def test_clouds_come_back_when_all_has_been_blown_a_whole_tile():
    """(0.96, 0.28) times 150 km are 24 and 7 tiles of 6 km."""
    scene = BlownField(updraft=0.0)
    now, later = (image(scene, {"time": t}) for t in (0.0, 15e3))
    assert np.abs(later - now).max() < 1e-3 and np.abs(image(scene, {"time": 7e3}) - now).max() > 0.2


def test_a_second_texture_of_its_own_speed_changes_edges_only():
    own = image(BlownField(), detail_speed=1.5) - image(BlownField())
    assert 0.005 < np.sqrt(np.mean(own**2)) < 0.03


def test_no_wind_has_no_direction_to_lean_in():
    scene = BlownField(speed=0.0, updraft=0.0, shear=0.0)
    assert error(scene) < 2e-6


def test_closed_form_is_that_of_paths_and_trees():
    for c in blown_field_against_paths(1):
        assert np.abs(c.first.mean - c.second.mean).max() < 1e-9, c.label
