"""Apertures in maps, films of the sky and bent normals: known answers of each stage."""

import math
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.ambient import aperture_map, bent_normal_sky, sky_video
from approximations.ambient.ambient_aperture import ambient_aperture
from approximations.kit import spherical_harmonics as sh
from approximations.kit.visible_sky import visible_sky
from reference.closed_form import canyon, sky_frames, valley
from scenes.contract import RADIANCE, Sun, Surface
from scenes.sky_frames import SkyFrames
from scenes.terrain import Canyon, Foliage, Terrain
from scenes.wall_under_sky import WallUnderSky

ALBEDO = 0.5


def vector(v):
    """(n, 3) NumPy to a Dr.Jit vector."""
    return mi.Vector3f(np.asarray(v, np.float32).T.copy())


def half_circle():
    t = np.radians(np.linspace(0, 180, 1801))
    return np.degrees(t), vector(np.stack([np.sin(t), 0 * t, np.cos(t)], axis=1))


# Spherical harmonics


@pytest.mark.parametrize(("bands", "lowest", "at"), [(3, -0.143, 101.5), (4, -0.318, 180.0)])
def test_a_disk_of_light_brings_the_smooth_sky_below_zero_as_worked_out(bands, lowest, at):
    angles, w = half_circle()
    found = np.array(sh.evaluate(dr.sh_eval(mi.Vector3f(0, 0, 1), bands - 1), w))
    assert found.min() == pytest.approx(lowest, abs=5e-4)
    assert angles[found.argmin()] == pytest.approx(at, abs=0.1)


def test_a_small_sun_projects_to_its_integrated_radiance():
    sun, (_, w) = Sun(mi.Vector3f(0, 0, 1), 0.1, 2.0), half_circle()
    coefficients = sh.project(lambda v: sky_video.sun_disk(sun, v), 3, rows=256)
    flux = sun.radiance * 2 * math.pi * (1 - math.cos(0.1))
    found = np.array(sh.evaluate(coefficients, w))
    assert found.min() / flux == pytest.approx(-0.143, rel=0.02)


def test_few_bands_hold_their_own_functions_and_the_cosine_scales_them():
    def radiance(w):
        return mi.Color3f(1 + w.x, 2 * w.z, 3 * w.y * w.y - 1)

    w = vector([[0.36, 0.48, 0.8], [-0.6, 0.0, -0.8]])
    coefficients = sh.project(radiance, 3, rows=16)
    np.testing.assert_allclose(sh.evaluate(coefficients, w), radiance(w), atol=2e-6)
    convolved = np.array(sh.evaluate(sh.irradiance(coefficients), w)) / np.pi
    x, y, z = np.array(w)
    np.testing.assert_allclose(convolved, [1 + 2 / 3 * x, 4 / 3 * z, 0.75 * y * y - 0.25], atol=2e-6)


def test_irradiance_of_a_sun_in_three_bands_misses_little_of_a_cosine():
    angles, w = half_circle()
    found = np.array(sh.evaluate(sh.irradiance(dr.sh_eval(mi.Vector3f(0, 0, 1), 2)), w))
    exact = np.maximum(np.cos(np.radians(angles)), 0)
    assert np.abs(found - exact).max() == pytest.approx(0.094, abs=2e-3)


def test_a_mirrored_sky_shines_from_below_as_from_above():
    mirrored = sh.mirrored(lambda w: mi.Color3f(w.x, w.y, w.z))
    up, down = (np.array(mirrored(vector([[0.6, 0, z]]))) for z in (0.8, -0.8))
    assert np.array_equal(up, down)


# Sky video


def frame(scene=None, size=48, **knobs):
    view = (scene or SkyFrames()).view(size)
    video = sky_video.bake(view, **{"side": 256, **knobs})
    return np.array(sky_video.sky_video(view, video)).T.reshape(size, size, 3)


def error(found, truth):
    return np.sqrt(np.mean((found - truth) ** 2)) / truth.mean()


def test_texels_stand_where_the_film_is_read():
    w = sky_video.texel_directions(5)
    assert np.linalg.norm(np.array(w), axis=0) == pytest.approx(1, abs=1e-6)
    uv = np.array(0.5 + 0.5 * mi.Point2f(w.x, w.y) / dr.sqrt(1 + w.z))
    x, y = np.meshgrid((np.arange(5) + 0.5) / 5, (np.arange(5) + 0.5) / 5)
    np.testing.assert_allclose(uv, [x.ravel(), y.ravel()], atol=1e-6)


def test_half_the_map_by_area_is_half_the_sky_by_solid_angle():
    z = np.array(sky_video.texel_directions(256).z)
    assert np.count_nonzero(z > 0.5) / z.size == pytest.approx(math.pi / 8, rel=2e-3)


def test_the_film_unrounded_is_the_sky_and_bits_and_codec_cost_in_turn():
    truth = sky_frames.sky_frame(SkyFrames(), 48)
    exact, texels, coded = (error(frame(stored=s), truth) for s in ("exact", "texels", "codec"))
    assert exact < 0.01
    assert coded > 1.5 * texels > 1.5 * exact
    assert error(frame(stored="texels", bits=4), truth) > 4 * error(frame(stored="texels", bits=7), truth)


def test_eight_bits_round_the_ratio_by_half_a_step():
    truth, r_max, floor = sky_frames.sky_frame(SkyFrames(), 48), 4.0, 0.05
    view = SkyFrames().view(48)
    video = sky_video.bake(view, stored="texels", r_max=r_max, floor=floor, side=1024)
    smooth = sky_video.smooth_sky(video.coefficients, video.floor, view.camera.direction)
    step = r_max / 255 * np.array(smooth).T.reshape(48, 48, 3)
    above = np.array(view.camera.direction.z).reshape(48, 48) > 0.1
    off = np.abs(np.array(sky_video.sky_video(view, video)).T.reshape(48, 48, 3) - truth) / step
    assert np.quantile(off[above], 0.98) < 0.52
    assert 0.12 < off[above].mean() < 0.26  # 1/4 at texels, less between them


def test_a_sun_left_in_the_film_is_clipped_and_empties_the_sky_across_from_it():
    view, truth = SkyFrames().view(48), sky_frames.sky_frame(SkyFrames(), 48)
    shown = {sun: frame(sun=sun, floor=0.0) for sun in ("removed", "kept")}
    sky = np.array(view.camera.direction.z).reshape(48, 48) > 0.1
    assert shown["kept"].max() < 0.01 * view.sun.radiance
    assert (shown["kept"][sky] < 1e-3).mean() > 0.03
    assert (shown["removed"][sky] > 0).all()
    assert error(shown["removed"], truth) < 0.05


def test_a_codec_without_quantiser_or_colour_edges_is_the_identity(rng):
    grey = np.repeat(rng.uniform(size=(20, 27, 1)), 3, axis=2)
    np.testing.assert_allclose(sky_video.decoded(grey, 1e-9), grey, atol=1e-9)
    flat = np.broadcast_to([0.2, 0.5, 0.9], (16, 24, 3))
    np.testing.assert_allclose(sky_video.decoded(flat, 1e-9), flat, atol=1e-9)
    assert np.abs(sky_video.decoded(grey, 16) - grey).max() > 0.02


# Apertures in maps


def test_apertures_are_fetched_between_vertices_along_the_triangles():
    corners = np.array([[0.9, 0.1, 0.5], [0.1, 0.9, 0.7], [0.5, 0.6, 0.2], [0.8, 0.8, 0.8]])
    axes = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    grid = np.concatenate([axes, [[0.1], [0.2], [0.3], [0.4]]], axis=1).reshape(2, 2, 4)  # [v][u]
    baked = aperture_map.ApertureMap(mi.TensorXf(grid.astype(np.float32)), None, "vertex")
    for uv, shares in {
        (0.0, 0.0): (1, 0, 0, 0),
        (1.0, 0.0): (0, 1, 0, 0),
        (0.0, 1.0): (0, 0, 1, 0),
        (1.0, 1.0): (0, 0, 0, 1),
        (0.2, 0.5): (0.3, 0.2, 0.5, 0),
        (0.9, 0.4): (0, 0.6, 0.1, 0.3),
    }.items():
        caps = aperture_map.fetch_vertices(baked, mi.Point2f(*uv))
        mean = np.array(shares) @ grid.reshape(4, 4)
        assert np.array(caps.radius)[0] == pytest.approx(mean[3], abs=1e-6)
        axis = mean[:3] / np.linalg.norm(mean[:3])
        np.testing.assert_allclose(np.array(caps.axis)[:, 0], axis, atol=1e-6)


@pytest.mark.parametrize("place", ["texel", "vertex"])
def test_flat_open_ground_keeps_whole_hemispheres_in_any_map(place):
    view = Foliage(leaves=0).view(16)
    baked = aperture_map.bake(view, place=place, side=8, rays=16)
    grid = np.array(baked.grid)
    assert grid.shape == (9 if place == "vertex" else 8,) * 2 + (4,)
    np.testing.assert_allclose(grid[..., 3], 0.5 * np.pi, atol=1e-6)
    assert grid[..., 2].min() > 0.98


def test_eight_bits_of_an_aperture_are_off_by_half_a_step_at_most(rng):
    x = mi.Float(rng.uniform(-1, 1, 1000).astype(np.float32))
    off = np.abs(np.array(aperture_map.rounded(x, -1, 1, "8 bit") - x))
    assert off.max() == pytest.approx(1 / 255, rel=0.02)
    assert np.abs(np.array(aperture_map.rounded(x, -1, 1, "float16") - x)).max() < 5e-4
    ends = aperture_map.rounded(mi.Float([-1, 1]), -1, 1, "8 bit")
    np.testing.assert_allclose(ends, [-1, 1], atol=1e-6)


@pytest.mark.parametrize("scene", [Terrain(), Canyon(), Foliage()], ids=lambda s: type(s).__name__)
def test_a_chart_leads_back_to_the_points_that_the_camera_sees(scene):
    view = scene.view(24)
    uv, seen = view.surface.uv, np.array(view.surface.valid)
    inside = seen & (np.abs(np.array(uv) - 0.5) < 0.499).all(axis=0)
    p, n = view.chart(uv)
    assert inside.mean() > 0.5
    assert np.abs(np.array(p - view.surface.position))[:, inside].max() < 2e-3
    assert np.quantile(np.array(dr.dot(n, view.surface.normal))[inside], 0.02) > 0.999


def test_finer_maps_come_nearer_to_apertures_of_every_pixel():
    view = Terrain(amplitude=1.0).view(32)
    pixel = np.array(aperture_map.aperture_map(view, aperture_map.bake(view, place="exact", rays=128)))

    def off(side):
        found = aperture_map.aperture_map(view, aperture_map.bake(view, side=side, rays=128))
        return np.sqrt(np.mean((np.array(found) - pixel) ** 2)) / pixel.mean()

    coarse, middle, fine = (off(side) for side in (6, 24, 96))
    assert coarse > 1.4 * middle > 1.4**2 * fine


@pytest.mark.parametrize("width", [0.3, 1.0, 4.0])
def test_bake_in_a_canyon_sees_a_lune(width):
    scene, size = Canyon(width=width), 24
    p, n, valid = canyon.first_hits(scene, *valley.camera_rays(scene, size))
    trench = valid & (p[:, 2] < 0.98) & (np.abs(np.abs(p[:, 0]) - 0.5 * width) + np.abs(n[:, 0]) > 0.01)
    (m1, _), (m2, _) = canyon.lune(scene, p, n)
    share = 1 - np.arccos(np.clip((m1 * m2).sum(axis=1), -1, 1)) / np.pi
    seen = visible_sky(scene.view(size), mi.Point3f(vector(p)), vector(n), 2048)
    sky, _ = canyon.irradiance(scene, p, n)
    assert trench.sum() > 10
    np.testing.assert_allclose(np.array(seen.share)[trench], share[trench], atol=0.01)
    np.testing.assert_allclose(np.array(seen.openness)[trench], sky[trench] / np.pi, atol=0.01)


def misclassified(view, p, n, rays=4096):
    """Per point (n, 3): solid angles (sr) of false light and false shadow, and the visible one."""
    points = replace(view, surface=Surface(None, p, n, None, None))
    caps = ambient_aperture.bake_function(points, rays=rays)
    count = dr.width(p)
    k = np.arange(rays)
    z, turn = 1 - (2 * k + 1) / rays, k * np.pi * (3 - 5**0.5)
    spiral = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)
    ray, point = dr.meshgrid(dr.arange(mi.UInt32, rays), dr.arange(mi.UInt32, count))
    w = dr.gather(mi.Vector3f, vector(spiral), ray)
    axis, normal = (dr.gather(mi.Vector3f, x, point) for x in (caps.axis, n))
    in_cap = dr.dot(axis, w) > dr.cos(dr.gather(mi.Float, caps.radius, point))
    free = view.visible(dr.gather(mi.Point3f, p, point), normal, w) & (dr.dot(normal, w) > 0)
    each = [in_cap & ~free, ~in_cap & free, free]
    share = [np.array(x).reshape(count, rays).mean(axis=1) for x in each]
    return 4 * np.pi * np.stack(share, axis=1)


def test_a_cap_for_a_band_lets_in_as_much_false_light_as_it_casts_false_shadow():
    found = {}
    for width in (0.2, 1.0, 10.0):
        view = Canyon(width=width).view(8)
        middle = mi.Point3f(0.0, 0.0, 0.0) + dr.zeros(mi.Point3f, 2)
        up = mi.Vector3f(0.0, 0.0, 1.0) + dr.zeros(mi.Vector3f, 2)
        light, shadow, visible = misclassified(view, middle, up)[0]
        assert light == pytest.approx(shadow, abs=0.08)
        assert visible == pytest.approx(4 * math.atan(0.5 * width), rel=0.03)
        found[width] = light / visible
    assert found[0.2] > 1.8 * found[1.0] > 1.8**2 * found[10.0]
    assert found[0.2] > 0.6


def test_an_open_point_is_classified_without_a_mistake():
    view = Foliage(leaves=0).view(8)
    p = mi.Point3f(0.0, 0.0, 0.0) + dr.zeros(mi.Point3f, 2)
    light, shadow, visible = misclassified(view, p, mi.Vector3f(0.0, 0.0, 1.0) + dr.zeros(mi.Vector3f, 2))[0]
    assert light + shadow < 0.1
    assert visible == pytest.approx(2 * math.pi, rel=0.03)


# Bent normals


def flat_sky(view, radiance=1.0):
    return replace(view, environment=lambda w: mi.Color3f(radiance), sun=replace(view.sun, irradiance=0.0))


def test_under_a_uniform_sky_open_convolved_and_exact_are_its_openness_and_print_forgets_it():
    view = flat_sky(WallUnderSky().view(24))
    baked = bent_normal_sky.bake(view, rays=128)
    hit, openness = np.array(view.surface.valid), np.array(baked.openness)
    assert openness[hit].min() < 0.5
    for ambient, factor in {"printed": 1, "open": openness, "convolved": openness, "exact": openness}.items():
        found = np.array(bent_normal_sky.bent_normal_sky(view, baked, ambient=ambient))[0]
        np.testing.assert_allclose(found[hit], (ALBEDO * factor * np.ones(hit.size))[hit], atol=2e-3)


def test_open_ground_under_a_linear_sky_gets_two_thirds_of_its_slope():
    view = flat_sky(WallUnderSky(height=0.0, gap=0.0).view(16))
    view = replace(view, environment=lambda w: mi.Color3f(1 + w.z))
    p = mi.Point3f(50.0, 50.0, 0.0) + dr.zeros(mi.Point3f, 256)
    up = mi.Vector3f(0.0, 0.0, 1.0) + dr.zeros(mi.Vector3f, 256)
    view = replace(view, surface=replace(view.surface, position=p, normal=up))
    baked = bent_normal_sky.bake(view, rays=256, bands=4)
    hit = np.array(view.surface.valid)
    exact = ALBEDO * (1 + 2 / 3)
    for ambient, within in {"convolved": 0.02, "exact": 0.02}.items():
        found = np.array(bent_normal_sky.bent_normal_sky(view, baked, ambient=ambient))[0][hit]
        assert found == pytest.approx(exact, rel=within)
    printed = np.array(bent_normal_sky.bent_normal_sky(view, baked))[0][hit].mean()
    assert printed == pytest.approx(2 * ALBEDO, rel=0.08)


def test_the_sun_reaches_what_no_surface_hides():
    scene = WallUnderSky()
    view = replace(scene.view(32), environment=lambda w: mi.Color3f(0))
    baked = bent_normal_sky.bake(view, rays=16)
    mapped, bare = (
        np.array(bent_normal_sky.bent_normal_sky(view, baked, shadow=s))[0] for s in ("mapped", "none")
    )
    facing = np.array(dr.maximum(dr.dot(view.surface.normal, view.sun.direction), 0))
    valid = np.array(view.surface.valid)
    np.testing.assert_allclose(bare, np.where(valid, ALBEDO / np.pi * 1.5 * facing, 0), atol=1e-6)
    shaded = (mapped == 0) & (bare > 0)
    assert 0.01 < shaded.mean() < 0.3
    assert np.array_equal(mapped[~shaded], bare[~shaded])


def test_author_would_not_use_them_where_they_err():
    rules = {
        aperture_map.domain: (
            [Terrain(), Canyon(width=1)],
            [Foliage(), Canyon(width=0.9), Terrain(light_elevation=10)],
        ),
        sky_video.domain: ([SkyFrames()], [SkyFrames(sun_elevation=4)]),
        bent_normal_sky.domain: ([WallUnderSky()], [WallUnderSky(gap=0.05), WallUnderSky(sun_elevation=4)]),
    }
    for rule, (inside, outside) in rules.items():
        assert all(rule(s).inside for s in inside)
        assert not any(rule(s).inside for s in outside)


def test_the_frame_is_the_scenes_own_sky():
    scene = SkyFrames()
    view = scene.view(16)
    assert scene.quantities == (RADIANCE,)
    np.testing.assert_allclose(
        np.array(scene.radiance(view.camera.direction)).T.reshape(16, 16, 3),
        sky_frames.sky_frame(scene, 16),
        rtol=2e-3,
    )
