"""Ambient occlusion from a depth buffer: what it gives where the answer is known."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.ambient import multi_frame_ssao as ssao
from approximations.ambient.horizon_occlusion import gtao, hbao
from approximations.kit.depth_buffer import depth_buffer
from scenes.mitsuba_parts import diffuse
from scenes.occluders import Occluders


class Floor(Occluders):
    """The floor alone."""

    def surfaces(self):
        floor = {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(60), "bsdf": diffuse(0.5)}
        return {"floor": floor}


class Wall(Floor):
    """A wall of 1 m, long as a street, that faces the camera from y = 0.4."""

    def surfaces(self):
        place = mi.ScalarTransform4f().translate([0, 1.4, 0.5]).scale([60, 1, 0.5])
        return super().surfaces() | {"wall": {"type": "cube", "to_world": place, "bsdf": diffuse(0.5)}}


def openness(technique, scene, size=64, **knobs):
    view = scene.view(size)
    extra = (ssao.bake(view),) if technique is ssao.multi_frame_ssao else ()
    return view, np.array(technique(view, *extra, **knobs)).reshape(size, size)


def test_a_point_falls_on_its_own_texel_at_its_own_depth():
    view = Occluders().view(48)
    buffer = depth_buffer(view)
    at, z = buffer.project(view.surface.position)
    i, seen = np.arange(48 * 48), np.array(view.surface.valid)
    np.testing.assert_allclose(np.array(at.x)[seen], (i % 48)[seen], atol=1e-3)
    np.testing.assert_allclose(np.array(at.y)[seen], (i // 48)[seen], atol=1e-3)
    np.testing.assert_allclose(np.array(z)[seen], np.array(buffer.z)[seen], rtol=1e-5)
    back = np.array(buffer.surface_at(at))[:, seen]
    np.testing.assert_allclose(back, np.array(view.surface.position)[:, seen], atol=1e-3)
    stands, on = buffer.fetch(mi.Point2f(-1.0, 3.0))
    assert not on[0] and np.isinf(np.array(stands)[0])


def test_half_of_a_ball_on_a_flat_floor_is_hidden_and_no_half_ball():
    _, ball = openness(ssao.multi_frame_ssao, Floor(elevation=60.0))
    assert ball[32, 32] == pytest.approx(0.5, abs=0.02)
    _, half = openness(ssao.multi_frame_ssao, Floor(elevation=60.0), volume="hemisphere")
    assert half[32, 32] > 0.97
    _, traced = openness(ssao.multi_frame_ssao, Floor(elevation=60.0), occluder="exact")
    assert traced[32, 32] == pytest.approx(0.5, abs=0.02)


def test_range_check_and_rotation_and_blur_do_what_they_say():
    scene = Occluders()
    _, plain = openness(ssao.multi_frame_ssao, scene, frames=4)
    _, checked = openness(ssao.multi_frame_ssao, scene, frames=4, range_check=True)
    assert (checked >= plain - 1e-6).all() and checked.mean() > plain.mean() + 0.05
    _, turned = openness(ssao.multi_frame_ssao, scene, frames=4, rotation="per pixel")
    _, blurred = openness(ssao.multi_frame_ssao, scene, frames=4, rotation="per pixel", blur=2)
    rough = [np.abs(np.diff(x[40:60, 40:60], axis=1)).mean() for x in (plain, turned, blurred)]
    assert rough[1] > 1.3 * rough[0] and rough[2] < 0.5 * rough[1]


def test_table_is_well_spread_and_fills_the_ball():
    view = Occluders().view(8)
    poisson, uniform = (np.array(ssao.bake(view, kernel=k)).T for k in ("poisson", "uniform"))
    for points in (poisson, uniform):
        assert points.shape == (ssao.TABLE, 3)
        assert np.linalg.norm(points, axis=1).max() <= 1
    nearest = [
        np.sort(np.linalg.norm(x[:, None] - x, axis=2), axis=1)[:, 1].min() for x in (poisson, uniform)
    ]
    assert nearest[0] > 5 * nearest[1]
    assert np.mean(np.linalg.norm(uniform, axis=1)) == pytest.approx(0.75, abs=0.02)
    ordered = np.linalg.norm(np.array(ssao.bake(view, order="by length")), axis=0)
    assert (np.diff(ordered) >= 0).all()


@pytest.mark.parametrize("technique", [hbao, gtao])
def test_a_flat_floor_is_open(technique):
    _, found = openness(technique, Floor(elevation=60.0))
    middle = found[8:56, 8:56]
    assert middle.mean() > 0.99 and middle.min() > 0.95


@pytest.mark.parametrize("elevation", [89.0, 50.0])
def test_gtao_beside_a_wall_is_exact_for_all_that_the_screen_shows(elevation):
    knobs = {"slices": 16, "steps": 96, "radius": 1000.0, "fade": 1.0}
    view, found = openness(gtao, Wall(elevation=elevation), 128, **knobs)
    p = np.array(view.surface.position)
    y, z = (p[i].reshape(128, 128) for i in (1, 2))
    middle = np.zeros((128, 128), bool)
    middle[:, 56:72] = True
    floor = middle & (np.abs(z) < 1e-3) & (y < 0.35) & (y > -0.6)
    away = 0.4 - y
    exact = 0.5 * (1 + away / np.sqrt(away**2 + 1))
    assert floor.sum() > 50
    assert np.abs(found - exact)[floor].mean() < 0.012
    _, near = openness(gtao, Wall(elevation=elevation), 128, **{**knobs, "radius": 0.2})
    assert near[floor].mean() > found[floor].mean() + 0.1


def test_horizons_of_hbao_fade_and_start_at_the_bias():
    _, published = openness(hbao, Occluders())
    _, raw = openness(hbao, Occluders(), bias="none")
    assert raw.mean() < published.mean() - 0.01


def test_twins_of_a_shorter_view_agree_where_the_camera_is_moved_back():
    sizes = [openness(gtao, Floor(elevation=30.0), n)[1].mean() for n in (32, 64)]
    assert sizes[0] == pytest.approx(sizes[1], abs=0.01)
    assert dr.width(depth_buffer(Floor().view(16)).z) == 256
