"""Shadow cubes: against figures known beforehand, and what the closed form of their truth rests on."""

import dataclasses
import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.kit.cube_map import texel_directions
from approximations.kit.shadow_cube import ShadowCube, shadow_cube, sun_mean
from approximations.shadows import cubemap_shadows as plain
from approximations.shadows import merged_cubemap_shadows as merged
from approximations.shadows import tinted_cubemap_shadows as tinted
from compare.measure import evaluate
from reference.closed_form import caps
from reference.closed_form import sun_through_window as window
from reference.verify import routes_window
from reference.verify.run import judge
from scenes.contract import Sun
from scenes.window_room import BallRoom, StainedRoom, WindowRoom


def values(x):
    return np.array(x, np.float64).T


def image(technique, scene, size=24, **knobs):
    return evaluate(technique, scene, technique.estimates, technique.settings(knobs), size)


# The closed form


def test_a_disk_cut_by_one_line_keeps_its_segment():
    x = np.linspace(0, 1, 21)
    share = window.cut_disk(0.3, 0.3 * (2 * x - 1)[None], np.full((1, 21), 0.7))
    np.testing.assert_allclose(share, caps.half_plane_share(x), atol=1e-12)


def test_a_disk_cut_by_many_lines_keeps_what_points_say(rng):
    q, towards = rng.uniform(-0.4, 1.2, (5, 40)), rng.uniform(-np.pi, np.pi, (5, 40))
    r, phi = np.sqrt((np.arange(40000) + 0.5) / 40000), np.arange(40000) * math.pi * (3 - math.sqrt(5))
    inside = np.ones((40, 40000), bool)
    for d, t in zip(q, towards, strict=True):
        inside &= r * np.cos(phi - t[:, None]) + d[:, None] >= 0
    np.testing.assert_allclose(window.cut_disk(1.0, q, towards), inside.mean(axis=1), atol=1e-3)


def test_a_square_in_a_large_disk_is_found_whole():
    towards = np.array([[0.0], [0.5], [1.0], [1.5]]) * np.pi
    assert window.cut_disk(2.0, np.full((4, 1), 0.5), towards)[0] == pytest.approx(1 / (4 * math.pi))


@pytest.mark.parametrize("check", [routes_window.window_against_shadow_rays])
def test_closed_forms_agree_with_shadow_rays(check):
    assert [judge(c, 1e-3)["verdict"] for c in check(1)] == ["agrees"] * 4


# Lookup (section 29)


def cube(texels, half=1.0):
    corner = mi.Point3f(half)
    return shadow_cube(texels, mi.Point3f(0), (-corner, corner), steps=None)


def test_a_lookup_leaves_the_box_where_the_ray_does(rng):
    p, w = rng.uniform(-1, 1, (3, 500)), rng.normal(size=(3, 500))
    w /= np.linalg.norm(w, axis=0)
    w[0, :50] = 0
    p[0, :10] = 1.0
    s = cube(dr.ones(mi.Float, 6))
    lp, dist = s.corrected(mi.Point3f(p.astype(np.float32)), mi.Vector3f(w.astype(np.float32)))
    lp = values(lp)
    assert np.isfinite(lp).all()
    np.testing.assert_allclose(np.abs(lp[10:]).max(axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(lp[50:], (p + np.array(dist) * w).T[50:], atol=1e-5)


@pytest.mark.parametrize(("elevation", "delta"), [(35.0, 0.1), (50.0, 0.1), (35.0, 0.4)])
def test_a_wall_within_its_box_moves_shadows_as_known(elevation, delta):
    """delta (tan a - tan b) along the wall, here at the window's upper edge, along the middle of the beam."""
    scene = WindowRoom(wall_inset=delta, sun_elevation=elevation, sun_azimuth=0.0)
    view = scene.view(8)
    shadows = plain.bake(view, face=1024)
    top, high = scene.opening()[3], 1.5
    t = math.tan(math.radians(elevation))
    x = np.linspace(-3, 3, 60001)
    p = mi.Point3f(x.astype(np.float32), np.zeros(60001, np.float32), np.zeros(60001, np.float32))
    lit = np.array(plain.open_share(shadows, p, view.sun.direction, "box", 0.0)) > 0.5
    truth = scene.wall() - top / t
    moved = (x[lit].min() - truth) * t  # on the wall, downwards is away from the wall on the floor
    known = delta * ((top - high) / scene.wall() - t)
    assert moved == pytest.approx(-known, abs=0.01)


def test_an_uncorrected_lookup_is_the_same_everywhere():
    view = WindowRoom().view(8)
    shadows = plain.bake(view, face=32)
    p = mi.Point3f([-2.0, 0.0, 2.0], [0.0, 1.0, 2.0], [0.1, 0.5, 1.0])
    assert np.ptp(np.array(plain.open_share(shadows, p, view.sun.direction, "none", 2.0))) == 0


# Level (section 30)


def test_levels_of_footprint_and_distance_are_as_known():
    t = np.array([0.5, 1, 2, 5, 10])
    s = ShadowCube(None, mi.Point3f(0), mi.Point3f(-5), mi.Point3f(5), 512)
    sun = Sun(mi.Vector3f(1, 0, 0), math.radians(1.0), 1.0)
    p = mi.Point3f((5 - t).astype(np.float32), np.zeros(5, np.float32), np.zeros(5, np.float32))
    exact = np.array(plain.lod(s, p, sun, "log", 0.0))
    np.testing.assert_allclose(exact, [-0.16, 0.84, 1.84, 3.16, 4.16], atol=6e-3)
    linear = np.array(plain.lod(s, p, sun, "linear", exact[-1] / 10))
    np.testing.assert_allclose(linear, [0.21, 0.42, 0.83, 2.08, 4.16], atol=6e-3)
    doubled = np.log2(np.array(plain.lod(s, p, sun, "linear", 1.0)))
    np.testing.assert_allclose(doubled, np.log2(t), atol=1e-6)


def test_levels_keep_the_mean_of_alpha():
    w = texel_directions(32)[0]
    whole = cube(dr.select(w.x > 0.7, mi.Float(1), 0))
    first, last = np.array(whole.cube.texels)[: 6 * 34**2], np.array(whole.cube.texels)[-54:]
    inner = first.reshape(6, 34, 34)[:, 1:-1, 1:-1]
    np.testing.assert_allclose(last.reshape(6, 3, 3)[:, 1, 1], inner.mean(axis=(1, 2)), rtol=1e-6)


def test_eight_bits_round_to_a_255th():
    w = texel_directions(16)[0]
    alpha = dr.select(w.x > 0.7, mi.Float(1), 0)
    fine, coarse = (np.array(shadow_cube(alpha, 0, (0, 0), steps=b).cube.texels) for b in (None, 255))
    assert 0 < np.abs(fine - coarse).max() <= 0.5 / 255 + 1e-6
    np.testing.assert_allclose(coarse * 255, np.round(coarse * 255), atol=1e-4)


def test_the_mean_over_the_sun_is_of_directions_within_it_and_above_the_horizon():
    sun, n = Sun(mi.Vector3f(0, 0, 1), math.radians(5.0), 1.0), mi.Vector3f(0, 0, 1)
    zero = dr.zeros(mi.Float, 1)
    moment = sun_mean(sun, n, lambda w: dr.square(w.x / w.z), zero, 1024)
    assert moment[0] == pytest.approx(0.25 * math.tan(math.radians(5.0)) ** 2, rel=1e-3)
    assert sun_mean(sun, mi.Vector3f(1, 0, 0), lambda w: mi.Float(1), zero, 1024)[0] == pytest.approx(
        0.5, abs=0.01
    )


# Tint (section 31)


def test_a_straight_colour_takes_the_wall_into_the_light():
    """At level m, t of a texel wall and 1 - t pane: T - tau = t (1 - t) (c_wall - c_pane)."""
    view = StainedRoom().view(8)
    straight = tinted.bake(view, stored="straight", face=16)
    tau = tinted.bake(view, stored="premultiplied", face=16)
    w = texel_directions(16)[0]
    p, at = dr.zeros(mi.Point3f, dr.width(w)) + straight[0].centre, 2.0
    t = values(straight[1].read(p, w, at))
    read, through = (values(tinted.product(m, p, w, at)) for m in (straight, tau))
    colour, mixed = values(straight[0].read(p, w, at)), np.abs(t - 0.5) < 0.4
    pane = through[mixed] / (1 - t[mixed])[:, None]
    known = (t * (1 - t))[mixed][:, None] * (0.5 - pane)
    assert mixed.sum() > 10
    np.testing.assert_allclose(read[mixed] - through[mixed], known, atol=0.02)
    np.testing.assert_allclose(colour[mixed], t[mixed][:, None] * 0.5 + through[mixed], atol=0.01)


# Merging (section 32)


def test_hard_factors_are_joined_alike_by_product_and_minimum():
    scene = BallRoom(sun_radius=0.1)
    knobs = {"k": 0.0, "map_size": 512}
    a, b = (image(merged.merged_cubemap_shadows, scene, combine=c, **knobs) for c in ("multiply", "min"))
    assert np.abs(a - b).mean() < 2e-3


def test_soft_factors_lie_round_their_joint_share():
    """The minimum is never below the joint share of two shadows, nor the product above the minimum."""
    view = BallRoom(sun_radius=8.0).view(64)
    room, soft = merged.bake(view, face=256), {"still": "exact", "moving": "exact"}
    floor = np.array(view.surface.normal.z) > 0.999
    product, least, joint = (
        np.array(merged.merged_cubemap_shadows(view, room, combine=c, **soft))[floor]
        for c in ("multiply", "min", "exact")
    )
    assert (least >= joint - 1e-5).all() and (product <= least + 1e-5).all()
    assert np.abs(product - joint).max() > 0.05 and np.abs(least - joint).max() > 0.05


def test_a_shadow_map_hides_what_lies_behind_the_ball_and_no_more():
    scene = BallRoom(aside=0.0)
    view = scene.view(8)
    drawn = merged.draw(view, 128)
    middle, l = np.array(scene.ball()["center"]), np.array(scene.toward_sun())
    across = np.cross(l, [0, 0, 1]) / np.linalg.norm(np.cross(l, [0, 0, 1]))
    away = [-1.0 * l, 1.0 * l, -1.0 * l + 0.5 * across, -1.0 * l - 0.33 * across, 5.0 * across]
    p = mi.Point3f((middle + np.array(away)).T.astype(np.float32))
    np.testing.assert_allclose(np.array(drawn.lit(p)), [0, 1, 1, 0, 1])


def test_brighter_light_changes_no_share():
    view = WindowRoom().view(8)
    shadows = plain.bake(view, face=16)
    bright = dataclasses.replace(view, sun=dataclasses.replace(view.sun, irradiance=10.0))
    a, b = (np.array(plain.cubemap_shadows(v, shadows)) for v in (view, bright))
    assert np.array_equal(a, b)
