"""Light baked into rooms: known answers of each technique, and the pieces that they share."""

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.ambient.gathered_lightmap import gathered_lightmap, openness
from approximations.ambient.irradiance_volume import FRAME, Volume, sample, time_average
from approximations.ambient.nearest_cube_map import Captured, box_projected
from approximations.ambient.radiosity_normal_mapping import BASIS, basis_weights
from approximations.kit.gathered_light import from_lights, meets
from approximations.kit.light_map import atlas, luxels, place, seen_along
from compare.measure import evaluate
from reference.render import sample as sample_truth
from scenes.contract import DIRECT_RADIANCE, ONE_BOUNCE, RADIANCE, AreaLight, Chart, View
from scenes.rooms import ColouredRoom


def cone(n, degrees, rng):
    """n unit vectors (n, 3) spread evenly over the cap about +z."""
    z = 1 - rng.random(n) * (1 - math.cos(math.radians(degrees)))
    r, phi = np.sqrt(1 - z * z), 2 * np.pi * rng.random(n)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)


def weights_of(normals, form):
    found = basis_weights(mi.Vector3f(normals.T.astype(np.float32).copy()), form)
    return np.stack([np.array(w, np.float64) for w in found], axis=1)


@pytest.mark.parametrize(
    ("form", "rms", "bias", "most"),
    [("clamped", 0.182, 0.126, 0.50), ("squared", 0.178, -0.068, 0.42), ("normalised", 0.178, -0.067, 0.42)],
)
def test_one_light_anywhere_over_normals_within_45_degrees(form, rms, bias, most, rng):
    n, l = cone(200_000, 45, rng), cone(200_000, 90, rng)
    irradiance = np.maximum(l @ np.array(BASIS).T, 0)
    error = (weights_of(n, form) * irradiance).sum(axis=1) - np.maximum((n * l).sum(axis=1), 0)
    assert math.sqrt((error**2).mean()) == pytest.approx(rms, abs=0.002)
    assert error.mean() == pytest.approx(bias, abs=0.002)
    assert np.abs(error).max() == pytest.approx(most, abs=0.01)


@pytest.mark.parametrize(("form", "flat"), [("clamped", 1.37), ("squared", 0.79), ("normalised", 0.79)])
def test_constant_sky_on_the_flat_surface(form, flat):
    one = (1 + 1 / math.sqrt(3)) / 2
    assert weights_of(np.array([[0, 0, 1.0]]), form).sum() * one == pytest.approx(flat, abs=0.005)


def test_a_light_map_returns_what_is_linear_between_its_outermost_luxels():
    charts = (
        Chart([0, 0, 0], [1, 0, 0], [0, 2, 0], 0.5),
        Chart([5, 0, 1], [0, 3, 0], [0, 0, 1], [0.1, 0.2, 0.3]),
    )
    grid = atlas(charts, 0.25)
    p, _ = luxels(grid)
    assert grid.luxels == 4 * 8 + 12 * 4 == dr.width(p)
    values = 3 * p.x + 2 * p.y - p.z
    at = mi.Point3f([0.3, 0.8, 5], [0.2, 1.7, 2.2], [0, 0, 1.4])
    found = place(grid, at, mi.UInt32([0, 0, 1])).fetch(mi.Float(values))
    assert np.allclose(found, 3 * at.x + 2 * at.y - at.z, atol=1e-5)
    beyond = place(grid, mi.Point3f([0.0], [0.0], [0.0]), mi.UInt32([0])).fetch(mi.Float(values))
    assert np.allclose(beyond, 3 * 0.125 + 2 * 0.125)
    assert np.allclose(np.array(grid.frame(mi.UInt32([0, 1])).n).T, [[0, 0, 1], [1, 0, 0]])


def ramp(slope):
    """A volume of 8 cells of 1 m along x whose irradiance is slope times the way along x."""
    colours = mi.Color3f(mi.Float(np.tile(slope * (np.arange(8) + 0.5), 6).astype(np.float32)))
    return Volume(mi.Point3f(0, 0, 0), mi.Vector3f(1, 1, 1), (8, 1, 1), colours)


def test_the_time_average_lags_by_speed_times_time_constant():
    p, n = mi.Point3f([7.0], [0.5], [0.5]), mi.Vector3f([0.6], [0.0], [0.8])
    now = time_average(ramp(2.0), p, n, mi.Vector3f(1, 0, 0), 0.0, "trilinear")
    late = time_average(ramp(2.0), p, n, mi.Vector3f(1, 0, 0), 0.5, "trilinear")
    assert now.x[0] == pytest.approx(14.0)
    a = 1 - math.exp(-FRAME / 0.5)
    assert late.x[0] == pytest.approx(14.0 - 2 * FRAME * (1 - a) / a, abs=0.03)


def test_the_nearest_cell_is_the_one_that_the_model_is_in():
    x = mi.Float([0.1, 0.9, 1.1, 7.9, -3.0, 12.0])
    found = sample(ramp(1.0), mi.Point3f(x, 0.5, 0.5), mi.Vector3f(0, 0, 1), "nearest")
    assert np.allclose(found.x, [0.5, 0.5, 1.5, 7.5, 0.5, 7.5])


def test_a_cube_weighs_its_colours_by_the_squares_of_the_normal():
    colours = mi.Color3f(mi.Float([1, 2, 3, 4, 5, 6]))
    volume = Volume(mi.Point3f(0), mi.Vector3f(1), (1, 1, 1), colours)
    n = mi.Vector3f([0.6, -0.6], [0.0, 0.8], [-0.8, 0.0])
    found = sample(volume, dr.zeros(mi.Point3f, 2), n, "nearest")
    assert np.allclose(found.x, [0.36 * 1 + 0.64 * 6, 0.36 * 2 + 0.64 * 3])


def test_a_box_is_asked_for_what_the_ray_meets_on_its_walls():
    world = Captured([], [], mi.Point3f(-1, -2, 0), mi.Point3f(1, 1, 2), None, None, None)
    p, r = mi.Point3f([0.5], [0.0], [0.0]), dr.normalize(mi.Vector3f([0.5], [0.0], [1.0]))
    w = box_projected(world, p, r, mi.Point3f(0, -0.5, 1.4))
    assert np.allclose(np.array(w).ravel(), [1.0, 0.5, -0.4], atol=1e-6)


def test_occlusion_counts_what_stands_within_reach():
    view = View(1, 1, None, trace=lambda o, d: dr.select(d.x > 0, mi.Float(0.5), dr.inf))
    p, n = dr.zeros(mi.Point3f, 3), mi.Vector3f([0, 0, 0], [0, 0, 0], [1, 1, 1])
    assert np.allclose(openness(view, p, n, 4096, 1.0), 0.5, atol=0.01)
    assert np.allclose(openness(view, p, n, 4096, 0.25), 1.0, atol=0.01)


def test_samples_of_a_light_give_its_form_factor():
    light = AreaLight("rectangle", [0, 0, 2.0], [0.5, 0, 0], [0, -0.5, 0], 3.0)
    view = View(1, 1, None, lights=(light,), trace=lambda o, d: dr.full(mi.Float, dr.inf, dr.width(o)))
    up = mi.Vector3f([0.0], [0.0], [1.0])
    found = from_lights(view, mi.Point3f([0.0], [0.0], [0.0]), up, 16).on(up)
    a = 0.5 / math.sqrt(4 + 0.25)
    quarter = a * math.atan(a) / math.pi
    assert found.x[0] == pytest.approx(3 * math.pi * 4 * quarter, rel=2e-3)
    below = from_lights(view, mi.Point3f([0.0], [0.0], [3.0]), up, 4).on(-up)
    assert below.x[0] == 0


def test_a_ray_meets_the_glowing_side_of_a_light_only():
    light = AreaLight("rectangle", [0, 0, 2.0], [0.5, 0, 0], [0, -0.5, 0], 3.0)
    view = View(1, 1, None, trace=lambda o, d: dr.full(mi.Float, 3.0, dr.width(d)))
    o = mi.Point3f([0, 0, 0, 0, 0], [0, 0, 0, 0, 0], [0, 0, 3, -2, 3])
    d = dr.normalize(mi.Vector3f([0, 0.3, 0, 0, 0], [0, 0, 0, 0, 0], [1, 1, -1, 1, 1]))
    assert np.array(meets(view, light, o, d)).tolist() == [True, False, False, False, False]


def test_a_final_gather_is_direct_light_and_its_first_bounce():
    scene = ColouredRoom()
    once = sum(sample_truth(scene, q, 24)(100, 1) for q in (DIRECT_RADIANCE, ONE_BOUNCE))
    settings = gathered_lightmap.settings({"combine": "none"})
    found = evaluate(gathered_lightmap, scene, RADIANCE, settings, 24)
    assert np.allclose(found.mean(axis=(0, 1)), once.mean(axis=(0, 1)), rtol=0.02)


def test_a_ray_that_slips_out_between_the_walls_sees_nothing():
    chart = Chart([0, 0, 0], [1, 0, 0], [0, 1, 0], albedo=0.5)
    grid = atlas((chart,), 0.25)
    e = dr.full(mi.Color3f, 1, grid.luxels)
    far = mi.Float([1.0, dr.inf])
    view = View(2, 1, None, charts=(chart,), trace=lambda o, d: far)
    seen = seen_along(view, grid, e, mi.Point3f(0.5, 0.5, 1), mi.Vector3f([0, 0.6], [0, 0], [-1, 0.8]))
    assert np.allclose(np.array(seen.x), [0.5 / math.pi, 0])
