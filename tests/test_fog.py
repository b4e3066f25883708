"""Height fog: closed form, Mitsuba's medium and the techniques, each against an independent route."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.scattering.height_fog import distance_at, fog_transmittance, height_fog, optical_depth
from approximations.scattering.uniform_fog import uniform_fog
from reference.closed_form import fog as truth
from reference.truth import box_filter
from scenes.contract import Fog
from scenes.fog import FogOverGround

EVALUATIONS = ("threshold", "naive", "two_exponentials", "exact")
EXACT = {"evaluation": "exact", "surface_light": "exact", "inscatter": "exact", "samples": 16}


def image(technique, view, **knobs):
    values = np.array(technique(view, **knobs), np.float64)
    return np.broadcast_to(
        np.atleast_2d(values).T, (view.width * view.height, np.atleast_2d(values).shape[0])
    )


def render(scene_dict, spp, max_depth=-1):
    volpath = mi.load_dict({"type": "volpath", "max_depth": max_depth, "rr_depth": 100000})
    return np.array(mi.render(mi.load_dict(scene_dict), integrator=volpath, spp=spp, seed=1), np.float64)


def depth(evaluation, b, c, o_z, length, d_z, slope_threshold=0.01):
    fog = Fog(b, c, 1.0, 0.0, None)
    tau = optical_depth(fog, mi.Float(o_z), mi.Float(length), mi.Float(d_z), evaluation, slope_threshold)
    return np.array(tau, np.float64)


def test_everything_stands_inside_the_fog_and_clear_of_the_camera():
    scene = FogOverGround()
    boxes = [(np.subtract(c, h), np.add(c, h)) for c, h in scene.boxes().values()]
    balls = [(np.subtract(c, r), np.add(c, r)) for c, r in scene.balls().values()]
    for low, high in boxes + balls:
        assert (low >= np.subtract(scene.LOW, 1e-12)).all() and (high < scene.HIGH).all()
        assert low[1] > 2


@pytest.mark.parametrize("camera_height", [0.5, 3.0, 45.0])
def test_float64_rays_meet_what_the_g_buffer_holds(camera_height):
    scene = FogOverGround(camera_height=camera_height)
    surface = scene.view(96).surface
    hit = truth.first_hit(scene, *truth.pinhole_rays(*scene.eye(), scene.FOV, 96)).ravel()
    same = np.isclose(np.array(surface.distance), hit, rtol=1e-4, atol=1e-3)
    assert same.mean() > 0.999
    assert (np.array(surface.valid) == np.isfinite(hit)).mean() > 0.999


@pytest.mark.parametrize("t", [0.0, 1e-7, 1e-3, 1.0, 100.0, -1e-7, -1.0, -20.0])
def test_optical_depth_equals_its_integral(t):
    b, c, z, length = 0.02, 0.5, 7.0, 300.0
    nodes, weights = np.polynomial.legendre.leggauss(200)
    s = 0.5 * length * (nodes + 1)
    slope = t / (c * length)
    integral = 0.5 * length * np.sum(weights * b * np.exp(-c * (z + slope * s)))
    assert truth.optical_depth(b, c, z, np.array([slope]), np.array([length]))[0] == pytest.approx(
        integral, rel=1e-12
    )


@pytest.mark.parametrize("fields", [{}, {"falloff": 0.5, "camera_height": 12.0}])
def test_closed_form_is_what_volpath_sees_through_black_fog(fields):
    scene, size, spp = FogOverGround(albedo=0.0, sun_irradiance=0.0, sky=1.0, **fields), 24, 256
    glowing = scene.mitsuba(size)
    for name in scene.surfaces():
        glowing[name] = {
            **glowing[name],
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}},
        }
    seen = render(glowing, spp, max_depth=1)[..., :1]
    fine = box_filter(truth.fog_transmittance(scene, 8 * size), 8)
    z = (seen - fine) / np.sqrt(fine * (1 - fine) / spp)
    assert abs(z.mean()) < 4 / size
    assert z.std() < 1.15


@pytest.mark.parametrize("falloff", [0.1, 5.0])
def test_the_grid_lies_above_the_exponential_by_no_more_than_stated(falloff, rng):
    scene = FogOverGround(falloff=falloff)
    k = falloff * scene.HEIGHT / scene.VOXELS
    volume = mi.load_dict(scene.medium()["sigma_t"])
    half_voxel = 0.5 * scene.HEIGHT / scene.VOXELS
    z = rng.uniform(half_voxel, min(scene.HEIGHT - half_voxel, 12 / falloff), 200_000)
    at = dr.zeros(mi.SurfaceInteraction3f, z.size)
    at.p = mi.Point3f(1.0, 20.0, mi.Float(z))
    error = np.array(volume.eval_1(at), np.float64) / (scene.density * np.exp(-falloff * z)) - 1
    rounding = 1e-4 if falloff == 5.0 else 2e-6
    assert -rounding < error.min() and error.max() < k**2 / 8 + rounding
    assert error.mean() == pytest.approx(k**2 / 12, rel=0.1, abs=2e-7)


@pytest.mark.parametrize(("c", "worst"), [(1e-3, 0.003), (1e-4, 0.03)])
def test_published_factor_loses_its_digits_just_above_the_threshold(c, worst):
    d_z = np.linspace(0.011, 0.012, 2001).astype(np.float32)
    right = truth.optical_depth(1.0, c, 0.0, d_z.astype(np.float64), np.ones(d_z.size))
    error = np.abs(depth("threshold", 1.0, c, 0.0, 1.0, d_z) / right - 1).max()
    assert 0.5 * worst < error < worst
    assert np.abs(depth("exact", 1.0, c, 0.0, 1.0, d_z) / right - 1).max() < 1e-6


def test_published_form_is_lost_high_above_dense_fog_and_the_stable_forms_are_not():
    b, c, height = 0.02, 0.01, 1e4
    found = {e: depth(e, b, c, height, height, -height)[0] for e in EVALUATIONS}
    assert np.isnan(found["naive"]) and np.isnan(found["threshold"])
    assert found["two_exponentials"] == pytest.approx(b / c, rel=1e-5)
    assert found["exact"] == pytest.approx(b / c, rel=1e-6)
    assert depth("threshold", b, c, 8800.0, 8800.0, -8800.0)[0] == 0


def test_only_the_form_without_a_guard_fails_on_a_level_ray():
    found = {e: depth(e, 0.02, 0.1, 3.0, 10.0, 0.0)[0] for e in EVALUATIONS}
    assert np.isnan(found.pop("naive"))
    assert list(found.values()) == pytest.approx([0.2 * np.exp(-0.3)] * 3, rel=1e-6)


def test_all_forms_agree_on_steep_rays_through_ordinary_fog():
    d_z = np.concatenate([np.linspace(-40, -1), np.linspace(1, 40)])
    right = truth.optical_depth(0.02, 0.1, 3.0, d_z / 50, np.full(d_z.size, 50.0))
    for evaluation in EVALUATIONS:
        assert depth(evaluation, 0.02, 0.1, 3.0, 50.0, d_z) == pytest.approx(right, rel=2e-5)


@pytest.mark.parametrize(
    "fields", [{}, {"falloff": 1e-5}, {"falloff": 5.0, "camera_height": 45.0}, {"density": 0.1}]
)
def test_exact_evaluation_meets_the_closed_form(fields):
    scene = FogOverGround(**fields)
    found = image(fog_transmittance, scene.view(64), evaluation="exact").reshape(64, 64, 1)
    off = np.abs(found - truth.fog_transmittance(scene, 64))
    assert np.quantile(off, 0.999) < 5e-5


def test_half_precision_is_worse_than_single():
    scene = FogOverGround()
    right = truth.fog_transmittance(scene, 48).reshape(-1, 1)
    half, single = (
        np.abs(image(fog_transmittance, scene.view(48), number=n) - right).mean()
        for n in ("float16", "float32")
    )
    assert 1e-4 < half < 5e-3 and single < 2e-5


@pytest.mark.parametrize("w_z", [-0.9, -1e-4, 0.0, 0.3])
def test_depths_are_spread_as_extinction_is(w_z):
    b, c, z, length = 0.05, 0.2, 30.0, 33.0
    u = np.linspace(0, 0.99, 12)
    tau = truth.optical_depth(b, c, z, np.array([w_z]), np.array([length]))
    fog = Fog(b, c, 1.0, 0.0, None)
    s = np.array(distance_at(fog, mi.Float(z), mi.Float(w_z), mi.Float64(tau), mi.Float(u)), np.float64)
    passed = 1 - np.exp(-truth.optical_depth(b, c, z, np.full(u.size, w_z), s))
    assert passed / (1 - np.exp(-tau)) == pytest.approx(u, abs=1e-5)


def test_white_furnace_returns_its_own_radiance():
    scene = FogOverGround(albedo=1.0, ground_albedo=1.0, sun_irradiance=0.0, sky=0.7, density=0.03)
    for technique in (height_fog, uniform_fog):
        assert image(technique, scene.view(32)) == pytest.approx(0.7, rel=1e-5)
    furnace = render(scene.mitsuba(64), 16)[..., 0]
    noise = furnace.std() / 64
    assert noise < 0.002
    assert abs(furnace.mean() - 0.7) < 4 * noise


def test_exact_stages_are_single_scattering():
    scene, size, n = FogOverGround(), 24, 8
    seen = render(scene.mitsuba(size), 2048, max_depth=2)
    found = box_filter(image(height_fog, scene.view(size * n), **EXACT).reshape(size * n, size * n, 3), n)
    assert found.mean() == pytest.approx(seen.mean(), rel=0.01)
    sky_rows = slice(0, size // 4)
    assert found[sky_rows].mean() == pytest.approx(seen[sky_rows].mean(), rel=0.005)
    assert np.median(np.abs(found / seen - 1)) < 0.025


def test_uniform_fog_is_height_fog_without_falloff():
    view = FogOverGround(falloff=1e-5).view(32)
    right = image(height_fog, view, evaluation="exact")
    assert image(uniform_fog, view) == pytest.approx(right, rel=1e-3)
    view = FogOverGround(falloff=0.1).view(32)
    off = image(uniform_fog, view) / image(height_fog, view, evaluation="exact") - 1
    assert np.abs(off).max() > 0.2


def test_surfaces_lose_light_to_fog_on_its_way():
    view = FogOverGround(density=0.05).view(32)
    clear, fogged = (
        image(height_fog, view, inscatter="constant", surface_light=light) for light in ("unfogged", "exact")
    )
    assert (fogged <= clear + 1e-6).all() and fogged.mean() < 0.97 * clear.mean()
