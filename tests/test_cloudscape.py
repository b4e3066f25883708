"""The cloud renderer as a whole: its rungs, what the exact ones reproduce, and the image filled in."""

import dataclasses

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.cloudscape import ONCE_SCATTERED, cloudscape
from approximations.kit.cloud_lighting import light_energy
from approximations.kit.phase import henyey_greenstein
from compare.task import ladder
from reference.closed_form.cloud_grid import depth_to_sun, optical_depth
from scenes.cumulus import Cumulus

SIZE = 12
DENSE = {"reconstruction": "exact", "march": "exact", "sun": "exact"}


def image(view, **knobs):
    return np.array(cloudscape(view, **knobs))[0].astype(float).reshape(view.height, view.width)


def rays(view):
    o, w = (np.array(a, dtype=np.float64).T for a in (view.camera.origin, view.camera.direction))
    return np.broadcast_to(o, w.shape), w


def lobe(view, g):
    return np.array(henyey_greenstein(dr.dot(view.camera.direction, view.sun.direction), g))


def test_the_ladder_makes_the_image_exact_and_then_its_light():
    settings = cloudscape.settings({})
    stages = [{k for k, v in rung.items() if v == "exact"} for rung in ladder(cloudscape, settings)]
    order = ["reconstruction", "march", "sun", "lighting"]
    assert stages == [set(order[:n]) for n in range(5)]


@pytest.mark.parametrize("lighting", ["beer-powder", "exact"])
def test_dense_rungs_are_the_transfer_integral_of_exact_depths_in_float64(lighting):
    """Through the middle of every step of 4 m: depth from the eye and depth to the sun cell by cell."""
    scene = Cumulus(optical_depth=12.0)
    view = scene.view(SIZE)
    o, w = rays(view)
    near, far = (np.array(a, dtype=np.float64) for a in scene.span(view.camera.origin, view.camera.direction))
    whole = optical_depth(scene, o, w)
    chosen = np.argsort(whole)[-24:-3:3]
    found = image(view, **DENSE, lighting=lighting).ravel()[chosen]
    g, known = scene.g if lighting == "exact" else 0.2, []
    for i in chosen:
        t = np.arange(near[i], far[i], 4.0)
        x = o[i] + t[:, None] * w[i]
        left = np.exp(optical_depth(scene, x, np.broadcast_to(w[i], x.shape)) - whole[i])
        middle = x[:-1] + 2.0 * w[i]
        d = depth_to_sun(scene, middle)
        energy = np.exp(-d) if lighting == "exact" else 2 * np.exp(-d) * (1 - np.exp(-2 * d))
        known.append(np.sum((left[:-1] - left[1:]) * energy))
    assert found == pytest.approx(np.array(known) * lobe(view, g)[chosen], rel=0.02)


@pytest.mark.parametrize("lighting", ["beer", "beer-powder"])
def test_seen_along_the_sunlight_a_cloud_of_any_density_depends_on_its_depth_alone(lighting):
    """(1 - e^(-2 tau)) / 2 of Beer's law, B, and 2 B^2 of Beer and powder: opaque pixels are all alike."""
    scene = Cumulus(optical_depth=3.0)
    view = scene.view(SIZE)
    sun = dataclasses.replace(view.sun, direction=-view.camera.direction)
    view = dataclasses.replace(view, sun=sun)
    beer = (1 - np.exp(-2 * optical_depth(scene, *rays(view)))) / 2
    known = beer if lighting == "beer" else 2 * beer**2
    found = image(view, **DENSE, lighting=lighting).ravel() / lobe(view, 0.2)
    assert beer.max() > 0.45
    assert found == pytest.approx(known, abs=0.004)


def test_beer_and_powder_never_exceed_their_maximum():
    d = mi.Float(np.linspace(0, 4, 4001))
    assert dr.max(light_energy(d, 1.0, "beer_powder"))[0] == pytest.approx(4 / 3**1.5, rel=1e-5)
    view = Cumulus().view(SIZE)
    assert np.all(image(view) <= 4 / 3**1.5 * lobe(view, 0.2).reshape(SIZE, SIZE) * (1 + 1e-5))


def test_pixels_that_were_marched_keep_their_values_and_blocks_of_one_are_all_marched():
    view = Cumulus().view(24)
    full = image(view, reconstruction="exact")
    assert image(view, block=1) == pytest.approx(full, rel=1e-4, abs=1e-7)
    filled = image(view, block=4)
    assert filled[2::4, 2::4] == pytest.approx(full[2::4, 2::4], rel=1e-4, abs=1e-7)
    between = filled[6:15, 6:15]
    assert between[:, 2] == pytest.approx((between[:, 0] + between[:, 4]) / 2, rel=1e-3, abs=1e-6)


def test_beyond_the_last_whole_block_the_image_is_its_nearest_pixel():
    view = Cumulus(seen="within").view(10)
    found = image(view)
    assert found[9, 9] == pytest.approx(found[6, 6], rel=1e-5)
    assert found[6, 6] == pytest.approx(image(view, reconstruction="exact")[6, 6], rel=1e-4)
    assert np.ptp(image(view, block=64)) < 1e-5 * found.max()


def test_a_sum_of_densities_grows_with_the_number_of_steps():
    view = Cumulus().view(SIZE)
    few, many = (image(view, rule="literal", steps=n).mean() for n in (64, 128))
    assert 1.4 < many / few < 2.0
    assert image(view, steps=64).mean() == pytest.approx(image(view).mean(), rel=0.05)


def test_all_parts_together_are_light_that_is_scattered_once():
    assert all(v == "exact" for v in ONCE_SCATTERED.values())
    assert set(ONCE_SCATTERED) == set(cloudscape.stages())
