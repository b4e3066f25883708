"""Cloud shadows in one pass: the light of heaped clouds, and what the pass darkens that it should not."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.cloud_shadow_pass import EXACT, bake, cloud_shadow_pass
from reference.closed_form.clouded_ground import clouded_radiance, ground, sun_depth
from scenes.clouded_ground import CloudedGround


def image(scene, size=48, darkens="frame", **knobs):
    view = scene.view(size)
    return np.array(cloud_shadow_pass(view, bake(view, **knobs), darkens=darkens))[0].reshape(size, size)


def error(scene, **knobs):
    exact = clouded_radiance(scene, 48)[..., 0]
    return np.sqrt(np.mean((image(scene, **knobs) - exact) ** 2)) / exact.mean()


def test_every_ray_meets_the_ground_that_the_closed_form_has():
    scene = CloudedGround()
    surface = scene.view(24).surface
    p, n = ground(scene, 24)
    assert np.all(np.array(surface.valid))
    assert np.allclose(np.array(surface.position).T.reshape(24, 24, 3), p, atol=0.05)
    assert np.allclose(np.array(surface.normal).T.reshape(24, 24, 3), n, atol=2e-5)


@pytest.mark.parametrize("elevation", [90.0, 30.0, 5.0])
def test_depth_along_the_sun_is_the_sum_of_many_samples(elevation):
    scene = CloudedGround(sun_elevation=elevation)
    l = np.array(scene.to_sun())
    half = scene.REACH * scene.thickness
    for p in np.array([[0.0, 0, 0], [700, -900, -120]]):
        t = (np.linspace(scene.MIDDLE - half, scene.MIDDLE + half, 20001) - p[2]) / l[2]
        at = p + t[:, None] * l
        sigma = np.array(scene.extinction(mi.Point3d(at.T)), np.float64)
        assert np.trapezoid(sigma, t) == pytest.approx(float(sun_depth(scene, p)), rel=1e-5)


@pytest.mark.parametrize("elevation", [90.0, 45.0, 10.0])
def test_with_every_stage_exact_it_is_the_closed_form(elevation):
    assert error(CloudedGround(sun_elevation=elevation), **EXACT) < 2e-3


def test_seen_from_anywhere_in_the_layer_a_map_along_the_sun_is_the_same():
    scene = CloudedGround(sun_elevation=20.0)
    assert error(scene, **EXACT, plane=0.0) < 2e-3
    assert error(scene, **(EXACT | {"projection": "planar"}), plane=0.0) > 0.05


def test_the_pass_darkens_the_sky_by_the_clouds_and_only_the_sky():
    scene = CloudedGround(sun_elevation=90.0, sky_share=0.5)
    frame, sun = image(scene), image(scene, darkens="exact")
    p, _ = ground(scene, 48)
    lost = scene.ALBEDO * scene.sky_share * (1 - np.exp(-sun_depth(scene, p)))
    assert np.allclose(sun - frame, lost, atol=2e-3)


def test_under_an_overhead_sun_without_sky_the_pass_is_exact_and_under_a_low_one_too_bright():
    assert error(CloudedGround(sun_elevation=90.0, sky_share=0.0)) < 2e-3
    low = CloudedGround(sun_elevation=20.0, sky_share=0.0)
    assert image(low).mean() > 1.2 * clouded_radiance(low, 48).mean()


def test_the_dark_side_has_sky_alone():
    scene = CloudedGround(sun_elevation=5.0)
    _, n = ground(scene, 48)
    away = n @ np.array(scene.to_sun()) < 0
    assert away.any()
    assert np.allclose(image(scene, darkens="exact")[away], scene.ALBEDO * scene.sky_share, rtol=1e-5)
    assert image(scene)[away].min() < 0.9 * scene.ALBEDO * scene.sky_share


def test_nearest_texels_are_steps_and_linear_ones_are_not():
    scene = CloudedGround()
    knobs = {"projection": "exact", "darkens": "exact", "resolution": 64}
    assert error(scene, filter="nearest", **knobs) > 3 * error(scene, filter="linear", **knobs)
    assert dr.width(scene.view(4).surface.valid) == 16
