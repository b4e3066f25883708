"""Diffusion in clouds: what layers let pass, how bright they are inside, and what the stepped edge counts."""

import dataclasses

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.diffusion_cloud import bake, diffusion_light, diffusion_source
from approximations.kit.diffusion import _outward, solve
from reference.source_function import once_scattered_by_slab
from scenes.cloud import CloudSlab, CloudSphere
from scenes.cumulus import Cumulus

FOUR_PI = 4 * np.pi


def zenith(**fields):
    return CloudSlab(**{"sun_elevation": 90.0, "g": 0.0, **fields})


def through(scene, cells=256, peak="delta"):
    """Share of the sun's light that crosses a layer, and phi, at the middles of its cells from below: the
    share is the same everywhere if none is absorbed."""
    baked = bake(scene.view(2), resolution=cells, peak=peak)
    values = np.array(baked.volume.texture.tensor(), np.float64)[:, 0, 0]
    sine = scene.to_sun()[2]
    deep = scene.rainy[0] * (1 - (np.arange(cells) + 0.5) / cells) / sine
    return np.exp(-(1 - baked.ahead) * deep) - values[:, 3] / sine, values[:, 0]


def at_depths(scene, depths, **knobs):
    """4 pi S of a layer at those depths, one row each, seen from the sun's side to against the sun."""
    view = scene.probes(len(depths))
    z = np.repeat(1 - np.array(depths) / scene.optical_depth, len(depths)).astype(np.float32)
    view = dataclasses.replace(
        view, camera=dataclasses.replace(view.camera, origin=mi.Point3f(0, 0, mi.Float(z)))
    )
    found = diffusion_source(view, bake(view, resolution=128), **knobs)
    return FOUR_PI * np.array(found, np.float64)[0].reshape(len(depths), -1)


@pytest.mark.parametrize(
    ("fields", "exact"),
    [
        ({}, 0.050),
        ({"g": 0.2}, 0.063),
        ({"g": 0.85}, 0.272),
        ({"g": 0.85, "optical_depth": 8.0}, 0.642),
        ({"g": 0.85, "precipitation": 4.0}, 0.082),
    ],
)
def test_layers_let_pass_what_they_should(fields, exact):
    """(checked) Transmittances of layers of 32, 8 and 128 under the zenith."""
    net, _ = through(zenith(**{"optical_depth": 32.0, **fields}))
    assert net[128] == pytest.approx(exact, abs=0.003)


@pytest.mark.parametrize("peak", ["delta", "similar", "none"])
def test_no_light_is_lost_on_the_way_through(peak):
    net, _ = through(CloudSlab(sun_elevation=40.0, optical_depth=8.0), 128, peak)
    assert np.ptp(net) < 0.01 * net.mean()


def test_a_half_space_has_three_at_its_surface_and_five_deep_inside():
    """Isotropic, zenith: phi = 5 - 3 e^-d solves phi'' = -3 e^-d with Marshak's phi(0) / 2 = 1; exact are
    H(1) = 2.908 and 5.036."""
    scene = zenith(optical_depth=64.0)
    _, phi = through(scene, 1024)
    deep = 64.0 * (1 - (np.arange(1024) + 0.5) / 1024)
    net = 5 / (3 * (64 + 4 / 3))
    slope = 5 - 3 * np.exp(-deep) - 3 * net * (deep + 2 / 3)
    assert np.allclose(phi, slope, rtol=0.01, atol=0.01)


@pytest.mark.parametrize(
    ("g", "exact"),
    [(0.0, [3.07, 3.58, 3.99, 4.25, 4.46, 4.09, 3.50]), (0.85, [2.99, 3.14, 3.19, 3.10, 3.26, 3.08, 2.68])],
)
def test_seen_from_the_suns_side_a_layer_is_as_bright_as_it_should_be(g, exact):
    found = at_depths(zenith(g=g), [0.05, 0.25, 0.55, 0.95, 1.95, 5.25, 9.25])[:, 0]
    assert np.allclose(found, exact, rtol=0.13)
    assert np.allclose(found[4:], exact[4:], rtol=0.03)


def test_seen_against_the_sun_the_beams_lobe_is_what_makes_it_bright():
    depths, exact = [0.05, 0.25, 0.55, 0.95, 1.95], [80.9, 69.6, 56.4, 42.1, 23.6]
    scene = zenith(g=0.85)
    assert np.allclose(at_depths(scene, depths)[:, -1], exact, rtol=0.05)
    assert at_depths(scene, depths, beam="even")[-1, -1] < 0.65 * exact[-1]


def test_the_net_flux_brightens_the_side_that_light_comes_from():
    tilted, even = (at_depths(zenith(g=0.85), [5.25, 9.25], moments=m) for m in ("two", "one"))
    assert np.all(tilted[:, 0] < even[:, 0]) and np.all(tilted[:, 1] > even[:, 1])


def test_without_diffused_light_it_is_light_scattered_once():
    scene = CloudSlab(optical_depth=2.0, sun_elevation=50.0)
    view = scene.view(8)
    dark = dataclasses.replace(bake(view), ahead=0.0)
    dark.volume = dataclasses.replace(dark.volume, texture=mi.Texture3f(mi.TensorXf(np.zeros((2, 2, 2, 4)))))
    found = np.array(diffusion_light(view, dark, steps=1024), np.float64)[0].reshape(8, 8, 1)
    assert np.allclose(found, once_scattered_by_slab(scene, 8), rtol=1e-3)


def test_the_stepped_edge_of_a_ball_counts_as_its_smooth_area():
    n = 40
    x = (np.indices((n, n, n)) + 0.5) / n * 2 - 1
    ball = (x**2).sum(axis=0) < 0.81
    share, area = _outward(ball, (0, 1, 2)), 0.0
    for a in range(3):
        faces = np.diff(ball.astype(int), axis=a) != 0
        weight = np.where(ball, share[a], 0)
        low, high = (np.take(weight, range(*r), axis=a) for r in ((0, n - 1), (1, n)))
        area += (faces * (low + high)).sum() * (2 / n) ** 2
    assert area == pytest.approx(FOUR_PI * 0.81, rel=0.04)


def test_all_light_that_diffuses_leaves_a_cloud_that_absorbs_none():
    """The edge's outflow phi / 2 adds up to what the cloud took from the sun."""
    rng = np.random.default_rng(1)
    sigma = np.where(rng.random((8, 9, 10)) < 0.7, rng.uniform(1, 5, (8, 9, 10)), 0)
    depth, sun = rng.uniform(0, 2, sigma.shape), np.array([0.48, 0.6, 0.64])
    phi, _ = solve(sigma, depth, 0.1, (0, 1, 2), sun, 1.0, 0.5, 0.5)
    half = 0.5 * sigma * 0.1 / sun.sum() / 2
    taken = 0.1**3 * (0.5 * sigma * np.exp(-0.5 * depth) * np.sinh(half) / np.maximum(half, 1e-9)).sum()
    share, lost = _outward(sigma > 0, (0, 1, 2)), 0.0
    padded = np.pad(sigma > 0, 1)
    for a in range(3):
        for up in (1, -1):
            edge = (sigma > 0) & ~np.roll(padded, -up, axis=a)[1:-1, 1:-1, 1:-1]
            r = 1.5 * 0.1 * 0.5 * sigma
            lost += 0.1**2 * (edge * share[a] * phi / (r + 2)).sum()
    assert lost == pytest.approx(taken, rel=1e-5)
    assert phi[sigma == 0].max() == 0 and phi.min() >= 0


def test_a_ball_is_lit_alike_from_all_sides():
    """Turned with the sun, up to the steps of its edge."""
    found = []
    for angle in (90.0, 45.0):
        view = CloudSphere(sun_angle=angle).view(2)
        l = np.array(view.sun.direction)[:, 0]
        ahead = np.array([0.0, 0.3, 0.7])[:, None] * l
        baked = bake(view, resolution=32)
        at = (mi.Point3f(ahead.T) - baked.volume.low) / baked.volume.span
        found.append(np.array(baked.volume.texture.eval(at)[0]))
    assert np.allclose(found[0], found[1], rtol=0.03)


def test_there_is_no_diffused_light_beside_the_cloud():
    view = Cumulus().view(2)
    baked = bake(view, resolution=16)
    corner = mi.Point3f(-1590.0, -1590.0, 2890.0)
    assert dr.all(baked.volume.texture.eval((corner - baked.volume.low) / baked.volume.span)[0] == 0)
