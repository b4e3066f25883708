"""Clouds over many frames: what is exact at rest, how long a ghost lasts, and what each guess is good for."""

import dataclasses
import itertools
import math

import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.cloud_reprojection import cloud_reprojection, permutation, pictures
from approximations.clouds.jittered_accumulation import jittered_accumulation, starts
from approximations.kit.reprojection import earlier, pixels, ray, screen
from compare import cost
from reference.closed_form.fog import pinhole_rays
from reference.closed_form.moving_clouds import depth_along, moving_transmittance
from reference.verify.routes_moving_clouds import moving_clouds_against_points
from reference.verify.run import judge
from scenes.mitsuba_parts import diffuse, uniform_sky
from scenes.moving_clouds import HILLS, PUFFS, Flight, MovingClouds

SIZE = 64
REST = {"turn": 0.0, "travel": 0.0, "wind": 0.0}


def image(view, **knobs):
    return np.array(cloud_reprojection(view, **knobs), np.float64)[0].reshape(SIZE, SIZE)


def off(fields, **knobs):
    """Root mean square error of the last frame, hills and 8 pixels above them left out."""
    scene = MovingClouds(**(REST | fields))
    error = image(scene.view(SIZE), **knobs) - moving_transmittance(scene, SIZE)[..., 0]
    return np.sqrt((error[: SIZE * 5 // 8] ** 2).mean())


def flown(view, flight, **motion):
    """The same view with another past."""
    return dataclasses.replace(
        view, cloud=dataclasses.replace(view.cloud, model=dataclasses.replace(flight, **motion))
    )


@dataclasses.dataclass(frozen=True)
class Vanishing(Flight):
    """Puffs that stood still, and were taken away when `frames` frames were yet to come."""

    frames: int = 0

    def blown(self, ago):
        return [0.0, 0.0, 0.0] if ago > self.frames else [1e6, 0.0, 0.0]


def vanished(frames, **knobs):
    view, plain = MovingClouds(**REST).view(SIZE), MovingClouds(**REST).flight()
    past = Vanishing(**dataclasses.asdict(plain), frames=frames)
    held = dataclasses.replace(view, cloud=dataclasses.replace(view.cloud, model=past))
    return 1 - image(held, distance="infinity", filter="nearest", **knobs)


def test_puffs_keep_apart_and_inside_their_layer_and_hills_stand_before_them():
    for a, b in itertools.combinations(PUFFS, 2):
        assert math.dist(a[:3], b[:3]) > a[3] + b[3]
    assert all(z - r > MovingClouds.BASE and z + r < MovingClouds.TOP for _, _, z, r in PUFFS)
    assert max(math.hypot(*c) + r for *c, r in HILLS) < MovingClouds.BASE


@pytest.mark.parametrize(("block", "frames"), [(2, 4), (4, 16)])
def test_at_rest_all_pixels_have_had_their_turn_after_as_many_frames_as_a_block_has(block, frames):
    view = MovingClouds(**REST).view(SIZE)
    full = image(view, image="exact")
    assert np.abs(image(view, block=block, frames=frames) - full).max() < 1e-4
    assert np.abs(image(view, block=block, frames=frames - 1) - full).max() > 1e-2


@pytest.mark.parametrize("order", ["bayer", "scan"])
def test_every_pixel_of_a_block_has_one_turn(order):
    for block in (1, 2, 4):
        assert sorted(permutation(block, order)) == [(x, y) for x in range(block) for y in range(block)]


def test_the_first_turns_of_bayer_are_spread_over_the_block():
    first = permutation(4, "bayer")[:4]
    assert {(x // 2, y // 2) for x, y in first} == {(0, 0), (1, 0), (0, 1), (1, 1)}
    assert len({(x // 2, y // 2) for x, y in permutation(4, "scan")[:4]}) == 2


@pytest.mark.parametrize(("block", "frames"), [(2, 4), (4, 16)])
def test_a_ghost_loses_an_equal_share_a_frame_and_is_gone_after_as_many_as_a_block_has_pixels(block, frames):
    """A cloud that is marched for the last time in frame n is last seen in frame n + b^2 - 1."""
    whole = vanished(-1).sum()
    for passed in (1, frames // 2, frames - 1, frames):
        left = vanished(passed - 1, block=block).sum() / whole
        assert left == pytest.approx(1 - passed / frames, abs=0.02 if passed < frames else 1e-6)


def test_a_share_of_history_makes_a_ghost_last():
    assert vanished(15).max() < 1e-6
    assert vanished(15, blend=0.5).max() == pytest.approx(0.5 * vanished(-1).max(), rel=0.05)


def test_past_cameras_see_with_the_rays_of_the_sensor():
    scene = MovingClouds(turn=3.0, travel=50.0)
    view = scene.view(16)
    camera = screen(view, 0)
    i = np.arange(256)
    d = np.array(ray(camera, mi.Point2f(mi.Float(i % 16), mi.Float(i // 16))))
    assert np.allclose(d, np.array(view.camera.direction), atol=1e-5)


def test_a_point_is_found_where_an_earlier_camera_saw_it():
    """A step of 50 m to the right: what is 1 km ahead stood 50 m / (1 km cos 30) further to the right."""
    view = MovingClouds(**(REST | {"travel": 50.0})).view(SIZE)
    now, then = screen(view, 0), screen(view, 1)
    forward = mi.Vector3f(0, math.cos(math.radians(30)), 0.5)
    at = np.array(earlier(then, now, forward, mi.Float(1000), mi.Vector3f(0)))[:, 0]
    step = 2 * math.tan(math.radians(20)) / SIZE
    assert at == pytest.approx([SIZE / 2 - 0.5 + 0.05 / step, SIZE / 2 - 0.5], abs=1e-3)
    upwind = np.array(earlier(then, now, forward, mi.Float(1000), mi.Vector3f(50, 0, 0)))[:, 0]
    assert upwind == pytest.approx([SIZE / 2 - 0.5] * 2, abs=1e-3)


def test_a_turn_leaves_distances_out_of_it():
    view = MovingClouds(**(REST | {"turn": 1.0})).view(SIZE)
    shell, infinity = (image(view, distance=d) for d in ("shell", "infinity"))
    assert np.sqrt(((shell - infinity) ** 2).mean()) < 3e-3
    assert np.sqrt(((shell - image(view, image="exact")) ** 2).mean()) > 0.015


def test_flight_needs_the_depth_of_the_clouds_and_a_low_image_needs_nothing():
    shell, depth, infinity = (off({"travel": 20.0}, distance=d) for d in ("shell", "depth", "infinity"))
    assert depth < 0.5 * shell and shell < infinity
    assert off({"travel": 20.0}, image="low") == off({"wind": 20.0}, image="low")


def test_wind_is_followed_where_the_depth_is_known():
    ignored, followed = (off({"wind": 20.0}, distance="depth", wind=w) for w in ("ignored", "followed"))
    assert followed < 0.35 * ignored


def test_hills_leave_clear_sky_behind_them():
    scene = MovingClouds(**(REST | {"travel": 20.0}))
    truth = moving_transmittance(scene, SIZE)[..., 0]
    near = image(scene.view(SIZE), distance="depth") - truth
    assert near[SIZE * 5 // 8 :].max() > 0.5
    assert near[: SIZE * 5 // 8].max() < 0.5


def test_what_moves_lags_and_so_changes_too_late():
    """The error of the change from one frame to the next, over the change itself, with the wind alone."""
    scene = MovingClouds(**(REST | {"wind": 20.0}))
    o, w = pinhole_rays(*scene.eye(), scene.FIELD_OF_VIEW, SIZE)
    exact = [np.exp(-depth_along(scene, o, w, np.array(scene.flight().blown(n)))) for n in (1, 0)]
    change = exact[1] - exact[0]

    def flicker(block, wind):
        *_, before, last = pictures(scene.view(SIZE), 24, block, "bayer", "depth", wind, "bilinear", 0.0, 32)
        found = np.array(last).reshape(SIZE, SIZE) - np.array(before).reshape(SIZE, SIZE)
        return np.sqrt(((found - change) ** 2).mean() / (change**2).mean())

    assert flicker(1, "ignored") < 0.03
    assert flicker(4, "ignored") > 1
    assert flicker(4, "followed") < 0.8 * flicker(4, "ignored")


def test_a_frame_is_about_ten_times_as_cheap_as_a_march_of_all_pixels():
    """GPU Pro 7, II.4, 4.6: 20 ms against 2 ms. Less than 16 times, for the history of all pixels."""
    view = MovingClouds().view(SIZE)

    def work(**knobs):
        return cost.work(lambda: cloud_reprojection(view, **knobs))["operations"]

    assert 8 < work(image="exact") / (work(frames=3) - work(frames=2)) < 16


def test_mitsubas_puffs_are_the_closed_forms():
    """With hills and sky of radiance 1 and no albedo, radiance is transmittance."""
    scene = MovingClouds()
    lamp = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
    parts = {k: v for k, v in scene.mitsuba(16).items() if k != "sun"}
    for name, part in parts.items():
        if name.startswith("hill"):
            parts[name] = {**part, "bsdf": diffuse(0.0), "emitter": lamp}
        if name.startswith("puff"):
            parts[name] = {**part, "interior": {**part["interior"], "albedo": 0.0}}
    volpath = {"type": "volpath", "max_depth": 64, "rr_depth": 1000}
    loaded = mi.load_dict({**parts, "sky": uniform_sky(1.0), "integrator": volpath})
    found = np.array(mi.render(loaded, spp=128, seed=1), np.float64)[..., 0]
    truth = moving_transmittance(scene, 64)[..., 0].reshape(16, 4, 16, 4).mean(axis=(1, 3))
    assert found.mean() == pytest.approx(truth.mean(), abs=0.006)
    assert np.abs(found - truth).max() < 0.15


def test_closed_form_is_what_strewn_points_find():
    assert all(judge(c, 1e-3)["verdict"] == "agrees" for c in moving_clouds_against_points(3))


def accumulated(fields, **knobs):
    view = MovingClouds(**(REST | fields)).view(SIZE)
    return np.array(jittered_accumulation(view, **knobs), np.float64)[0].reshape(SIZE, SIZE)


def test_a_jittered_march_is_too_clear_and_frames_do_not_mend_it():
    truth = moving_transmittance(MovingClouds(), SIZE)[..., 0]
    few, many = (accumulated({}, frames=n, share=0.001, steps=4).mean() - truth.mean() for n in (16, 64))
    fine = accumulated({}, frames=64, share=0.001, steps=32).mean() - truth.mean()
    assert few > 0.02 and many == pytest.approx(few, rel=0.05)
    assert abs(fine) < 1e-4


def test_jitter_hides_bands_as_well_as_frames_are_many():
    truth = moving_transmittance(MovingClouds(), SIZE)[..., 0]
    none, one, many = (
        np.sqrt(((accumulated({}, noise=noise, frames=n, share=0.001) - truth) ** 2).mean())
        for noise, n in (("none", 16), ("gradient", 1), ("gradient", 16))
    )
    assert many < 0.4 * one and many < 0.4 * none


@pytest.mark.parametrize("noise", ["gradient", "white"])
def test_starts_are_even_over_a_step_and_anew_in_each_frame(noise):
    x = pixels(SIZE, SIZE)
    first, second = (np.array(starts(x, SIZE, mi.UInt32(n), noise)) for n in (0, 1))
    counts = np.histogram(first, bins=8, range=(0, 1))[0]
    assert counts.sum() == SIZE * SIZE and counts.min() > 0.85 * SIZE * SIZE / 8
    assert np.abs(first - second).mean() > 0.3
    if noise == "gradient":
        tiles = first.reshape(SIZE, SIZE)[:63, :63].reshape(21, 3, 21, 3).mean(axis=(1, 3))
        assert tiles.std() < 0.5 * first.std() / 3


def test_accumulation_ends_a_ghost_by_a_share_a_frame():
    view, plain = MovingClouds(**REST).view(SIZE), MovingClouds(**REST).flight()
    past = Vanishing(**dataclasses.asdict(plain), frames=4)
    gone = dataclasses.replace(view, cloud=dataclasses.replace(view.cloud, model=past))
    knobs = {"share": 0.3, "steps": 32, "noise": "none", "frames": 40}
    left = 1 - np.array(jittered_accumulation(gone, **knobs))[0]
    whole = 1 - np.array(jittered_accumulation(view, **knobs))[0]
    assert left.sum() == pytest.approx(0.7**5 * whole.sum(), rel=0.01)
