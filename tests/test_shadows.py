"""Shadow maps and their filters: maps against geometry, penumbrae against closed forms, buffers as tabled."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.kit.point_sets import best_candidates, lattice, random_points, spiral
from approximations.kit.running_mean import updated
from approximations.kit.shadow_map import bounds, render
from approximations.shadows import multi_frame_shadows, percentage_closer_soft_shadows, rotated_poisson_pcf
from reference.closed_form import half_plane
from reference.closed_form.caps import half_plane_share
from scenes.contract import Axis
from scenes.shadow_casters import HalfPlane, PoleAndBars

SIZE = 64


def image(module, name, scene, size=SIZE, **knobs):
    """(size, size) of a technique at one sample a pixel."""
    technique = getattr(module, name)
    frame, bake = technique.split(technique.settings(knobs))
    view = scene.view(size)
    out = np.array(technique(view, technique.run_bake(view, bake), **frame))
    return (out[0] if out.ndim == 2 else out).reshape(size, size).astype(float)


def pcf(scene, size=SIZE, **knobs):
    return image(rotated_poisson_pcf, "rotated_poisson_pcf", scene, size, **knobs)


def pcss(scene, size=SIZE, **knobs):
    return image(percentage_closer_soft_shadows, "percentage_closer_soft_shadows", scene, size, **knobs)


def frames(scene, size=SIZE, **knobs):
    return image(multi_frame_shadows, "multi_frame_visibility", scene, size, **knobs)


def rms(x):
    return float(np.sqrt(np.mean(x**2)))


# Scenes


@pytest.mark.parametrize("field", ["light_size", "light_elevation", "gap"])
def test_the_camera_never_sees_the_light(field):
    axis: Axis = PoleAndBars.axes()[field]
    for value in (axis.low, axis.high):
        scene = PoleAndBars(**{field: value})
        world = mi.load_dict({k: v for k, v in scene.mitsuba(16).items() if k != "sensor"}, optimize=False)
        camera = scene.view(16).camera
        seen = world.ray_intersect(mi.Ray3f(camera.origin, camera.direction))
        assert np.allclose(seen.t, scene.view(16).surface.distance)


@pytest.mark.parametrize("shape", ["rectangle", "disk"])
def test_penumbra_of_the_half_plane_is_light_size_over_distance_wide(shape):
    scene, size = HalfPlane(light_shape=shape, light_size=0.4), 512
    x = np.array(scene.view(size).surface.position).T.reshape(size, size, 3)
    v = half_plane.visibility(scene, size)[..., 0]
    ground = x[..., 2] < 0.5
    half_width = 0.4 * 1.0 / (4.0 - 1.0)
    partly = ground & (v > 0) & (v < 1)
    assert np.abs(x[partly][:, 0]).max() == pytest.approx(half_width, rel=0.05)
    assert v[ground & (np.abs(x[..., 0]) < 2e-3)] == pytest.approx(0.5, abs=0.02)


# Maps


@pytest.mark.parametrize(("bits", "step"), [(None, 1e-5), (24, 2e-5), (16, 0.04)])
def test_a_map_holds_the_depth_of_what_its_light_sees(bits, step):
    """16 bits that begin at 0.02 m are worth z^2 / (0.02 m 2^17) = 6 mm at 4 m."""
    view = HalfPlane().view(SIZE)
    eye, (centre, radius) = view.lights[0].centre, bounds(view.surface)
    maps = render(view.trace, eye, view.lights[0].u, centre, radius, size=64, bits=bits, near=0.02)
    one = maps.at(mi.UInt32(0))
    x = np.linspace(-0.9, 0.9, 16)
    for z, side in ((3.0, -1), (4.0, 1)):
        p = mi.Point3f(mi.Float(side * (1.0 + x)), mi.Float(x), mi.Float(4.0 - z))
        ab, depth = one.project(p)
        stored = np.array(one.fetch(ab, mi.UInt32(0)))
        inside = np.isfinite(stored)
        assert inside.sum() > 8
        texel = np.array(2 * one.tangent * depth / 64)
        tilt = abs(float(one.w.x[0])) + abs(float(one.w.y[0]))
        error = np.abs(stored - np.array(depth))[inside]
        assert error.max() < step * (z / 4) ** 2 + 2 * tilt * texel.max()


def test_receiver_plane_gives_the_depth_at_every_tap():
    view = PoleAndBars().view(16)
    maps = render(view.trace, view.lights[0].centre, view.lights[0].u, *bounds(view.surface), size=16)
    one = maps.at(mi.UInt32(0))
    a, b = mi.Point3f(0.3, -0.2, 0.1), mi.Point3f(0.5, 0.4, 0.1)
    ab, z = one.project(b)
    assert one.plane(a, mi.Vector3f(0, 0, 1), ab)[0] == pytest.approx(z[0], rel=1e-5)


def test_bilinear_comparison_moves_smoothly_between_texels():
    scene = HalfPlane(light_size=0.02)
    knobs = {"kernel": "grid", "taps": 1, "rotation": "none", "map_size": 64, "radius": 0.001}
    hard, soft = pcf(scene, **knobs), pcf(scene, compare="bilinear", **knobs)
    assert set(np.unique(hard)) == {0.0, 1.0}
    assert np.mean((soft > 0.01) & (soft < 0.99)) > 0.01
    assert np.abs(soft - hard).max() <= 0.5 + 1e-6


# Rotated Poisson disk


def test_eight_taps_have_nine_levels_and_variance_under_a_thirtysecond():
    found = pcf(PoleAndBars(), 96)
    assert len(np.unique(np.round(8 * found))) == 9
    np.testing.assert_allclose(8 * found, np.round(8 * found), atol=1e-5)
    noise = pcf(PoleAndBars(), 96) - pcf(PoleAndBars(), 96, kernel="exact")
    assert np.mean(noise**2) < 1 / 32


def test_rotation_trades_bands_for_noise():
    """Beside a straight edge the still kernel is the same along it, the turning one is not."""
    scene = HalfPlane()
    still, turning = pcf(scene, rotation="none", radius=0.03), pcf(scene, radius=0.03)
    assert still.std(axis=1).max() < 0.05 < turning.std(axis=1).max()
    truth = half_plane.visibility(scene, SIZE)[..., 0]
    band = (truth > 0.02) & (truth < 0.98)
    rows = band.any(axis=1)
    assert rms((turning - truth)[rows].mean(axis=1)) < rms((still - truth)[rows].mean(axis=1))


def test_sixteen_bits_shade_open_ground_where_their_range_begins_at_the_light():
    """The wider the range, the coarser the steps: z^2 / (near 2^17) = 5 cm at 8 m from 1 cm on."""
    scene = PoleAndBars(gap=1.0)
    knobs = {"receiver": "plane", "bias": 0.03}
    shaded = {n: np.mean(1 - pcf(scene, near=n, **knobs)) for n in (0.01, 0.1)}
    exact = np.mean(1 - pcf(scene, depth_bits="exact", near=0.01, **knobs))
    assert shaded[0.01] > 2 * shaded[0.1]
    assert shaded[0.1] == pytest.approx(exact, rel=0.15)


def test_a_constant_depth_shades_itself_where_the_bias_is_less_than_the_slope():
    scene = PoleAndBars()
    truth = pcss(scene, blockers="exact").mean()
    assert pcf(scene, bias=0.01).mean() < truth - 0.15
    assert pcf(scene, bias=0.01, receiver="plane", depth_bits="exact").mean() == pytest.approx(
        truth, abs=0.02
    )


# Percentage-closer soft shadows


@pytest.mark.parametrize(("height", "size"), [(0.3, 1.0), (1.0, 0.25), (1.5, 0.8)])
@pytest.mark.parametrize("shape", ["rectangle", "disk"])
def test_width_of_the_filter_follows_the_caster(height, size, shape):
    scene = HalfPlane(height=height, light_size=size, light_shape=shape)
    truth = half_plane.visibility(scene, SIZE)[..., 0]
    found = pcss(scene, kernel="exact", filter_taps=256, blocker_taps=64, search=0.4, map_size=2048)
    assert rms(found - truth) < 0.02
    fixed = pcf(scene, kernel="exact", radius=0.01, receiver="plane", rotation="none")
    assert rms(fixed - truth) > 2 * rms(found - truth)


# Multi-frame


def test_more_frames_do_not_average_the_bias_of_the_map_away():
    scene = HalfPlane(height=0.05)
    truth = half_plane.visibility(scene, SIZE)[..., 0]
    few, many = (rms(frames(scene, frames=n) - truth) for n in (16, 256))
    assert many == pytest.approx(few, rel=0.1)
    assert many > 0.05
    assert rms(frames(scene, frames=64, visibility="exact") - truth) < 0.02


def test_even_points_converge_faster_than_random_ones():
    """Error of the share beyond straight edges: random points -0.5 on a log-log line, even ones steeper."""
    edges = np.linspace(-0.9, 0.9, 19)
    turns = np.linspace(0, np.pi, 7)

    def error(make, n):
        found = []
        for seed in range(12):
            points = make(n, "disk", seed)
            across = points @ np.stack([np.cos(turns), np.sin(turns)])
            share = (across[..., None] > edges).mean(axis=0)
            found.append(share - half_plane_share(0.5 - 0.5 * edges))
        return rms(np.array(found))

    slope = {m: np.log(error(m, 256) / error(m, 16)) / np.log(16) for m in (best_candidates, random_points)}
    assert slope[random_points] == pytest.approx(-0.5, abs=0.06)
    assert slope[best_candidates] < -0.6
    assert error(best_candidates, 64) < 0.6 * error(random_points, 64)


def test_lights_taken_from_the_middle_outwards_and_stopped_early_are_smaller():
    """At a quarter of a disk the points reach half its radius; shuffled they reach all of it."""
    view = HalfPlane(light_shape="disk").view(4)

    def reach(order):
        points = np.array(multi_frame_shadows.bake(view, frames=64, finished=0.25, order=order))
        return np.linalg.norm(points, axis=0).max()

    assert reach("centre_out") == pytest.approx(0.5, abs=0.04)
    assert reach("shuffled") > 0.9


def test_light_of_an_open_point_is_the_sum_over_the_light_and_not_what_one_point_gives():
    """Straight below a square of half size 2 at 4 m the irradiance is 4 times that of a corner's square:
    L [2 X / sqrt(1 + X^2) atan(X / sqrt(1 + X^2)) ] per corner over 2, X = 2 / 4."""
    x = 0.5 / np.sqrt(1 + 0.5**2)
    exact = 4 * 0.5 * 2 * x * np.arctan(x) * 300.0 * 0.5 / np.pi
    view = PoleAndBars(light_size=2.0, light_elevation=85.0).view(4)
    one = dr.ones(mi.Float, 1)
    light = replace(
        view.lights[0],
        centre=mi.Point3f(0, 0, 4),
        u=mi.Vector3f(2, 0, 0),
        v=mi.Vector3f(0, -2, 0),
    )
    surface = replace(
        view.surface,
        valid=one > 0,
        position=mi.Point3f(0, 0, 0) * one,
        normal=mi.Vector3f(0, 0, 1) * one,
        albedo=mi.Color3f(0.5) * one,
    )
    point = replace(
        view,
        width=1,
        height=1,
        surface=surface,
        lights=(light,),
        trace=lambda o, d: dr.full(mi.Float, dr.inf, dr.width(d)),
    )
    technique = multi_frame_shadows.multi_frame_shadows
    points = multi_frame_shadows.bake(point, frames=256)

    def radiance(weight):
        return float(technique(point, points, visibility="exact", weight=weight)[0][0])

    assert radiance("area") == pytest.approx(exact, rel=0.01)
    assert radiance("centre") == pytest.approx(300 * 16 / 16 * 0.5 / np.pi, rel=1e-4)
    assert radiance("area") < radiance("omni") < radiance("centre")


def test_even_sets_have_the_centroid_of_their_shape():
    """In the unit square the centroid of 64 even points strays by at most 0.032, of random ones by 0.051."""
    rng = np.random.default_rng(1)
    even = [best_candidates(64, "square", s).mean(axis=0) / 2 for s in range(60)]
    random = [rng.uniform(-0.5, 0.5, (64, 2)).mean(axis=0) for _ in range(2000)]
    assert np.sqrt(np.mean(np.sum(np.square(even), axis=1))) < 0.032
    assert np.sqrt(np.mean(np.sum(np.square(random), axis=1))) == pytest.approx(0.051, abs=0.002)


@pytest.mark.parametrize(("shape", "mean_square"), [("square", 2 / 3), ("disk", 0.5), ("ball", 0.6)])
def test_sets_are_as_many_as_asked_and_uniform(shape, mean_square):
    assert all(len(best_candidates(n, shape, s)) == n for n in (1, 2, 5, 8) for s in range(20))
    points = best_candidates(256, shape, 3)
    assert np.mean(np.sum(points**2, axis=1)) == pytest.approx(mean_square, abs=0.04)
    assert points[0] == pytest.approx(0)


def test_regular_sets():
    assert np.mean(np.sum(spiral(64) ** 2, axis=1)) == pytest.approx(0.5, abs=1e-9)
    assert np.mean(lattice(9) ** 2) == pytest.approx(8 / 27)
    assert np.abs(spiral(256).mean(axis=0)).max() < 0.01


# Buffers (3.2.2)


def error_of_mean(format, samples):
    """rmse and bias of the running mean of (frames, pixels) samples against their mean."""
    mean = mi.Float(0)
    for k, c in enumerate(samples):
        mean = updated(mean, mi.Float(c.astype(np.float32)), dr.opaque(mi.Float, k + 1), format)
        dr.eval(mean)
    error = np.array(mean).astype(float) - samples.astype(np.float32).mean(axis=0, dtype=np.float64)
    return rms(error), error.mean()


@pytest.fixture(scope="module")
def edge():
    rng = np.random.default_rng(5)
    return rng.random((1024, 4000)) < rng.uniform(0.1, 0.9, 4000)


@pytest.fixture(scope="module")
def noise():
    return np.random.default_rng(6).normal(0.5, 0.1, (1024, 4000))


@pytest.mark.parametrize(
    ("format", "early", "late"),
    [
        ("unorm8", 8.7e-3, 1.4e-1),
        ("unorm16", 2.2e-5, 8.0e-5),
        ("half", 4.7e-4, 2.3e-2),
        ("half_truncated", 5.9e-3, 1.0e-1),
        ("float32", 5e-8, 2.4e-7),
    ],
)
def test_buffers_err_on_edges_as_tabled(format, early, late, edge):
    assert error_of_mean(format, edge[:64].astype(float))[0] == pytest.approx(early, rel=0.5)
    assert error_of_mean(format, edge.astype(float))[0] == pytest.approx(late, rel=0.5)


@pytest.mark.parametrize(
    ("format", "rmse", "bias"),
    [
        ("unorm8", 1.1e-2, 2e-4),
        ("unorm16", 8.0e-5, 2e-6),
        ("half", 2.0e-3, -4e-5),
        ("half_truncated", 8.0e-2, -7.5e-2),
    ],
)
def test_buffers_err_on_noise_as_tabled(format, rmse, bias, noise):
    found = error_of_mean(format, noise)
    assert found[0] == pytest.approx(rmse, rel=0.5)
    assert found[1] == pytest.approx(bias, abs=max(0.3 * abs(bias), 0.1 * rmse))
