"""Two balls of cloud: the scene, its light by three routes, its crease, and the curves of light on it."""

import dataclasses

import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.cloud_light import cloud_light
from approximations.clouds.scattering_octaves import octave_light
from reference import two_balls_monte_carlo as walk
from reference.closed_form.two_balls import once_scattered_by_two_balls
from reference.slab_monte_carlo import phase
from reference.source_function import once_scattered_by_sphere
from scenes.cloud import CloudSphere
from scenes.two_balls import TwoBalls

FOUR_PI = 4 * np.pi


def through(view, x):
    """The view with one ray through each x, at the height of the middles."""
    origin, direction = mi.Point3f(mi.Float(x), -6, 0), mi.Vector3f(0, 1, 0)
    camera = dataclasses.replace(view.camera, origin=origin, direction=direction)
    return dataclasses.replace(view, width=len(x), height=1, camera=camera)


def walked(scene, x, n, seed=5):
    """4 pi L and its standard error at the height of the middles."""
    p = np.repeat([[a, -6.0, 0.0] for a in x], n, axis=0)
    light = walk.radiance(scene, p, np.tile([0.0, 1.0, 0.0], (len(p), 1)), np.random.default_rng(seed))
    light = FOUR_PI * light.reshape(len(x), n)
    return light.mean(axis=1), light.std(axis=1) / np.sqrt(n)


@pytest.mark.parametrize("scene", [TwoBalls(gap=0.1), TwoBalls(turn=80.0, gap=0.5)])
def test_span_and_extinction_are_those_of_the_shapes_that_mitsuba_has(scene):
    view = scene.view(17)
    camera, world = view.camera, mi.load_dict(scene.mitsuba(17))
    at, depth, ends, met = np.zeros(17 * 17), np.zeros(17 * 17), [], np.ones(17 * 17, bool)
    ray = mi.Ray3f(camera.origin, camera.direction)
    for k in range(4):
        hit = world.ray_intersect(ray)
        t, met = np.array(hit.t), met & np.array(hit.is_valid())
        depth += np.where(met & (k % 2 == 1), scene.sigma_t * t, 0)
        at = at + np.where(met, t, 0)
        ends.append(np.where(met, at, 0))
        ray = hit.spawn_ray(camera.direction)
    near, far = map(np.array, scene.span(camera.origin, camera.direction))
    assert np.allclose(near, ends[0], atol=1e-3)
    assert np.allclose(far, np.max(ends, axis=0), atol=0.01)
    n = 2000
    found = np.zeros(17 * 17)
    for i in range(n):
        point = camera.origin + mi.Float(near + (i + 0.5) / n * (far - near)) * camera.direction
        found += np.array(view.cloud.extinction(point)) * (far - near) / n
    assert np.allclose(found, depth, atol=0.02 * depth.max())


def test_apart_and_side_by_side_each_is_the_single_ball():
    """Under a sun overhead neither shades the other; the single ball is lit from the left."""
    alone = once_scattered_by_sphere(CloudSphere(optical_depth=6.0, sun_angle=90.0, g=0.3), 22)[..., 0]
    scene = TwoBalls(optical_depth=6.0, gap=2.0, turn=0.0, sun_angle=90.0, g=0.3)
    pair = once_scattered_by_two_balls(scene, 62)[..., 0]
    turned = np.rot90(alone, -1)
    assert np.allclose(pair[20:42, :22], turned, atol=1e-6 * turned.max())
    assert np.allclose(pair[20:42, 40:], turned, atol=1e-6 * turned.max())
    assert pair[:, 22:40].max() == 0


@pytest.mark.parametrize("turn", [40.0, 90.0])
def test_with_the_sun_behind_the_eye_both_chords_are_one(turn):
    """(checked) Beer gives B = (1 - e^-2t) / 2 and Beer-powder 2 B^2, t the optical depth of all cloud on the
    ray: no crease and no dark edge but where t is small."""
    scene = TwoBalls(optical_depth=1.5, sun_angle=0.0, turn=turn, gap=0.3)
    x = np.linspace(-1.7, 1.7, 41) + 0.003
    p = np.c_[x, np.full_like(x, -6.0), 0 * x]
    spans = walk.chords(scene, p, np.tile([0.0, 1.0, 0.0], (41, 1)))
    t = scene.sigma_t * (spans[:, :, 1] - spans[:, :, 0]).sum(axis=1)
    b, lobe = (1 - np.exp(-2 * t)) / 2, phase(np.array(-1.0), 0.2)
    settings = {"steps": 2048, "light_steps": 2048}
    view = through(scene.view(4), x)
    for energy, known in (("beer", b), ("beer_powder", 2 * b * b)):
        found = np.array(cloud_light(view, energy=energy, **settings))[0] / lobe
        assert np.allclose(found, known, atol=2e-3)
    size = 41
    row = once_scattered_by_two_balls(scene, size)[size // 2, :, 0]
    x = scene.half_width * ((np.arange(size) + 0.5) * 2 / size - 1)
    spans = walk.chords(scene, np.c_[x, 0 * x - 6, 0 * x], np.tile([0.0, 1.0, 0.0], (size, 1)))
    t = scene.sigma_t * (spans[:, :, 1] - spans[:, :, 0]).sum(axis=1)
    assert np.allclose(row, phase(np.array(-1.0), 0.85) * (1 - np.exp(-2 * t)) / 2, rtol=1e-9, atol=1e-15)


def test_a_ball_in_the_shadow_of_the_other_is_lit_through_it():
    scene = TwoBalls(optical_depth=1.0, turn=90.0, sun_angle=180.0, g=0.0)
    light = once_scattered_by_two_balls(scene, 63)[31, 31, 0]
    assert FOUR_PI * light == pytest.approx(2 * np.exp(-2), rel=1e-9)


@pytest.mark.parametrize(
    ("sun_angle", "crease", "limb"), [(0.0, (0.69, 0.9), (0.28, 0.44)), (90.0, (1.15, 1.5), (0.5, 0.72))]
)
def test_a_crease_is_brighter_than_a_free_limb(sun_angle, crease, limb):
    """Over the brightness of the bulge, at optical depth 16: light that leaves one ball enters the other."""
    scene = TwoBalls(sun_angle=sun_angle)
    light, error = walked(scene, [-0.866, 0.12, -1.83], 12000)
    assert np.all(error < 0.07 * light)
    assert crease[0] < light[1] / light[0] < crease[1]
    assert limb[0] < light[2] / light[0] < limb[1]


def test_curves_of_light_know_no_crease_under_a_sun_behind_the_eye_and_too_much_of_one_overhead():
    ratios = {}
    for sun_angle in (0.0, 90.0):
        view = through(TwoBalls(sun_angle=sun_angle).view(4), [-0.866, 0.12])
        for technique in (cloud_light, octave_light):
            bulge, crease = np.array(technique(view, steps=1024, light_steps=64))[0]
            ratios[technique.name, sun_angle] = crease / bulge
    assert ratios["cloud_light", 0.0] == pytest.approx(1, abs=0.01)
    assert ratios["octave_light", 0.0] == pytest.approx(1, abs=0.01)
    assert 3 < ratios["cloud_light", 90.0] < 4
    assert 1.5 < ratios["octave_light", 90.0] < 1.8
