"""Occlusion from the depth buffer: flat walls, valleys, and the buffer itself."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.ambient import horizon_occlusion, multi_frame_ssao
from approximations.kit.depth_buffer import depth_buffer
from reference.closed_form import valley
from scenes.contract import View
from scenes.mitsuba_parts import camera_rays, diffuse, g_buffer, perspective, ray_tracer
from scenes.occluders import Occluders
from scenes.sunlit import Valley

SIZE = 48


def wall(tilt):
    """A wide flat wall that leans by `tilt` degrees from facing the camera."""
    to_world = mi.ScalarTransform4f().rotate([1, 0, 0], tilt).scale(50)
    shapes = mi.load_dict(
        {"type": "scene", "wall": {"type": "rectangle", "to_world": to_world, "bsdf": diffuse(0.5)}}
    )
    camera = camera_rays(mi.load_dict(perspective([0, 0, 5], [0, 0, 0], 40, SIZE)), SIZE)
    return View(SIZE, SIZE, camera, surface=g_buffer(shapes, camera), trace=ray_tracer(shapes))


def image(technique, view, **knobs):
    frame, bake = technique.split(technique.settings(knobs))
    found = np.array(technique(view, technique.run_bake(view, bake), **frame))
    return found.reshape(view.height, view.width).astype(float)


def inner(x):
    """Away from the edges of the screen, off which nothing occludes."""
    return x[SIZE // 4 : -SIZE // 4, SIZE // 4 : -SIZE // 4]


def ssao(view, **knobs):
    return image(multi_frame_ssao.multi_frame_ssao, view, **knobs)


@pytest.mark.parametrize("tilt", [0, 30, 50])
def test_a_flat_wall_is_half_open_to_the_ball_and_open_to_its_hemisphere(tilt):
    view = wall(tilt)
    full = inner(ssao(view, frames=60, radius=0.5))
    assert full.mean() == pytest.approx(0.5, abs=0.015)
    assert inner(ssao(view, frames=60, radius=0.5, region="hemisphere")).mean() > 0.97
    assert inner(ssao(view, radius=0.5, occluders="exact")) == pytest.approx(1, abs=1e-6)


def test_more_frames_come_nearer_to_the_limit_of_the_estimator_and_not_to_the_sky():
    view = Occluders().view(SIZE)
    limit = ssao(view, frames=100)
    error = {n: np.sqrt(np.mean((ssao(view, frames=n) - limit) ** 2)) for n in (2, 8, 32)}
    assert error[8] < 0.5 * error[2] and error[32] < 0.3 * error[2]
    sky = ssao(view, frames=60, occluders="exact", radius=50.0)
    assert np.sqrt(np.mean((limit - sky) ** 2)) > 10 * error[32]


def test_turned_points_trade_bands_for_noise_that_the_blur_takes_away():
    view = wall(0)
    technique = multi_frame_ssao.single_frame_ssao
    noisy, smooth = (inner(image(technique, view, samples=8, blur=b)) for b in (False, True))
    assert noisy.std() > 0.03
    assert smooth.std() < 0.3 * noisy.std()
    assert smooth.mean() == pytest.approx(noisy.mean(), abs=0.01)


def test_range_check_ends_the_halo_before_a_far_wall():
    view = Occluders().view(96)
    halo, clean = (ssao(view, radius=0.4, region="hemisphere", range_check=r) for r in ("none", "radius"))
    assert np.all(clean >= halo)
    assert (clean - halo).max() > 0.3


@pytest.mark.parametrize(
    ("name", "tilt"), [("hbao", 0), ("hbao", 40), ("gtao", 0), ("gtao", 40), ("gtao", 70)]
)
def test_a_flat_wall_is_open_to_horizons(name, tilt):
    found = image(getattr(horizon_occlusion, name), wall(tilt), radius=1.0)
    assert inner(found).mean() == pytest.approx(1, abs=0.03)


@pytest.mark.parametrize(("h", "g"), [(0.3, 0.0), (1.2, 0.4), (-0.9, -0.3), (-1.4, 0.1)])
def test_arc_of_a_slice_is_its_integral(h, g):
    """a(h) = int_0^h cos(x - g) |sin x| dx."""
    x = np.linspace(0, h, 20001)
    y = np.cos(x - g) * np.abs(np.sin(x))
    area = np.abs(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(x)))
    assert horizon_occlusion.arc(mi.Float(h), mi.Float(g))[0] == pytest.approx(area, abs=1e-5)


@pytest.mark.parametrize("slope", [20.0, 45.0])
def test_gtao_of_a_valley_is_its_closed_form(slope):
    """A height field on the screen: with enough lines and samples the horizon integral is exact."""
    scene, size = Valley(slope=slope), 256
    shapes = mi.load_dict({"type": "scene", **scene.surfaces()}, optimize=False)
    camera = camera_rays(mi.load_dict(perspective([0, 0, 14], [0, 0, 0], 60, size)), size)
    view = View(size, size, camera, surface=g_buffer(shapes, camera))
    found = image(horizon_occlusion.gtao, view, radius=20.0, lines=16, steps=64)
    p = np.array(view.surface.position).T.astype(float)
    middle = np.array(view.surface.valid) & (np.abs(p[:, 1]) < 1) & (np.abs(p[:, 0]) > 0.1)
    side = np.where(p[:, 0] > 0, 1.0, -1.0)
    exact = valley.irradiance_of_sky(scene, p[middle], side[middle]) / np.pi
    difference = found.ravel()[middle] - exact
    assert np.abs(difference.mean()) < 0.02
    assert np.sqrt(np.mean(difference**2)) < 0.03


def test_the_depth_buffer_gives_back_the_points_that_were_seen():
    view = Occluders().view(SIZE)
    buffer = depth_buffer(view)
    at, z = buffer.project(view.surface.position)
    i = np.arange(SIZE * SIZE)
    np.testing.assert_allclose(np.array(at), [i % SIZE, i // SIZE], atol=2e-3)
    np.testing.assert_allclose(np.array(buffer.fetch(at)), np.array(z), rtol=1e-6)
    point, seen = buffer.point(at)
    assert dr.all(seen)
    np.testing.assert_allclose(np.array(point), np.array(view.surface.position), atol=1e-4)
    assert np.isinf(buffer.fetch(mi.Point2f(-1.0, 3.0))[0])
    assert buffer.pixels(1.0, mi.Float(6.0))[0] == pytest.approx(
        SIZE / (12 * np.tan(np.radians(17))), rel=1e-4
    )
