"""Light in clouds: octaves, the cone towards the sun, the sky's light, and what they are held against."""

import dataclasses
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.special import expn

from approximations.clouds.cloud_ambient import _e2, cloud_ambient
from approximations.clouds.cloud_light import cloud_source
from approximations.clouds.cone_light import EVERY_STEP, cone_light
from approximations.clouds.scattering_octaves import octave_light, octave_source
from approximations.kit.cloud_lighting import cone_vector
from reference.closed_form.cloud_grid import cloud_transmittance, optical_depth, sun_transmittance
from reference.slab_monte_carlo import phase
from reference.source_function import in_grid, once_scattered_by_sphere
from scenes.cloud import CloudSlab, CloudSphere
from scenes.cumulus import Cumulus
from scenes.cumulus_sky import CumulusUnderSky

FOUR_PI = 4 * np.pi


@dataclass(frozen=True)
class Even(Cumulus):
    """A box of one density in a sky of radiance 1."""

    SKY = (1.0, 1.0, 1.0)
    GROUND = (1.0, 1.0, 1.0)

    def densities(self):
        return np.ones((54, 96, 96), np.float32)


def image(technique, view, **knobs):
    return np.array(technique(view, **knobs)).reshape(-1, view.height, view.width)[0].astype(float)


def at_depths(scene, depths):
    """Probes of a layer under the zenith at those depths, seen from the sun's side, across and against it."""
    view = scene.probes(len(depths))
    z = np.repeat(1 - np.array(depths) / scene.optical_depth, len(depths)).astype(np.float32)
    camera = dataclasses.replace(view.camera, origin=mi.Point3f(0, 0, mi.Float(z)))
    return dataclasses.replace(view, camera=camera)


def with_extinction(view, extinction):
    return dataclasses.replace(view, cloud=dataclasses.replace(view.cloud, extinction=extinction))


# octaves


def test_octaves_are_single_scattering_in_ever_thinner_and_more_even_clouds():
    d = np.array([0.05, 0.55, 1.95])
    found = image(octave_source, at_depths(CloudSlab(sun_elevation=90.0), d), octaves=3, contribution=0.7)
    known = sum(
        0.7**i * phase(np.array([-1.0, 0.0, 1.0]), 0.85 * 0.5**i) * np.exp(-d[:, None] * 0.5**i)
        for i in range(3)
    )
    assert np.allclose(found, known, rtol=1e-3)


def test_eight_octaves_scatter_nearly_twice_the_suns_light_at_the_lit_side():
    found = image(octave_source, at_depths(CloudSlab(sun_elevation=90.0, g=0.0), [0.0, 0.0]))
    assert np.allclose(FOUR_PI * found, 2 - 2**-7, rtol=1e-4)


def test_half_of_the_light_of_two_lobes_goes_by_the_one_towards_the_sun():
    view = at_depths(CloudSlab(sun_elevation=90.0), [0.0, 0.0, 0.0])
    found = image(octave_source, view, octaves=1, lobes="two")[0]
    cosine = np.array([-1.0, 0.0, 1.0])
    assert np.allclose(found, (phase(cosine, 0.85) + phase(cosine, -0.5)) / 2, rtol=1e-4)


@pytest.mark.parametrize(("d", "exact"), [(0.95, 4.25), (1.95, 4.46), (5.25, 4.09), (17.25, 2.30)])
def test_octaves_are_nearer_to_all_orders_than_beer_and_powder_deep_inside(d, exact):
    """(checked) Exact source of an isotropic layer 32 deep; the curve has 0.658, 0.279, 0.010 and 0."""
    view = at_depths(CloudSlab(sun_elevation=90.0, g=0.0), [d, d])
    octaves = FOUR_PI * image(octave_source, view)[0, 0]
    curve = FOUR_PI * image(cloud_source, view, phase="exact")[0, 0]
    assert curve < octaves < exact


def test_the_first_octave_alone_is_light_scattered_once():
    scene = CloudSphere(optical_depth=3.0, g=0.6, sun_angle=60.0)
    known = once_scattered_by_sphere(scene, 16)[:, :, 0]
    found = image(octave_light, scene.view(16), octaves=1, steps=1024)
    assert np.allclose(found, known, rtol=3e-4)


# depths through a grid


def test_depth_through_an_even_box_is_its_extinction_times_the_way():
    scene = Even(optical_depth=3.0)
    up = optical_depth(
        scene, np.array([[10.0, -20.0, 0.0], [5.0, 5.0, 2000.0]]), np.tile([0.0, 0.0, 1.0], (2, 1))
    )
    assert np.allclose(up, [3.0, 1.5], rtol=1e-12)
    aslant = optical_depth(scene, np.array([[0.0, 0.0, 1100.0]]), np.array([[0.6, 0.0, 0.8]]))
    assert aslant == pytest.approx(3.0 * (1600 / 0.6) / 1800 if 1600 / 0.6 < 2250 else 3.75, rel=1e-12)
    missed = optical_depth(scene, np.array([[0.0, 0.0, 0.0]]), np.array([[0.0, 0.0, -1.0]]))
    assert missed == 0


def test_depth_through_the_cumulus_is_what_fine_steps_find(rng):
    scene = Cumulus(precipitation=2.0)
    low, high = np.array(scene.LOW), np.array(scene.HIGH)
    p, w = rng.uniform(low, high, (6, 3)), rng.normal(size=(6, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    t = (np.arange(50000) + 0.5) * 0.1
    for x, d, exact in zip(p, w, optical_depth(scene, p, w), strict=True):
        q = x + t[:, None] * d
        at = ((q - low) / (high - low) * scene.VOXELS - 0.5).T[::-1]
        density = map_coordinates(scene.densities().astype(float), at, order=1, mode="nearest")
        density *= np.all((q >= low) & (q <= high), axis=1)
        assert 0.1 * 2 * scene.sigma_t * density.sum() == pytest.approx(exact, rel=1e-4, abs=1e-3)


def test_a_cloud_hides_the_more_the_deeper_it_is_and_nothing_in_the_corners():
    thin, thick = (cloud_transmittance(Cumulus(optical_depth=d), 16)[:, :, 0] for d in (2.0, 8.0))
    assert np.allclose(thick, thin**4, rtol=1e-9)
    assert np.all(thick[[0, 0, -1, -1], [0, -1, 0, -1]] == 1)
    assert thick.min() < 0.02


@pytest.mark.parametrize("fields", [{}, {"optical_depth": 0.1}, {"seen": "below"}, {"seen": "within"}])
def test_probes_stand_in_the_cloud_on_rays_of_the_camera(fields):
    """Half of the light that a ray loses is lost by its probe, or within one and a half steps behind it."""
    made = Cumulus(**fields)
    probes, extinction = made.probes(16), made.extinction()
    p, w = probes.camera.origin, probes.camera.direction
    assert np.array(extinction(p)).min() > 0
    x, d = (np.array(a, dtype=np.float64).T for a in (p, w))
    eye = np.broadcast_to(made.eye()[0], x.shape)
    assert np.allclose(np.cross(x - eye, d), 0, atol=1e-2)
    whole = optical_depth(made, eye, d)
    near, far = (np.array(t, dtype=np.float64) for t in made.span(mi.Point3f(*made.eye()[0]), w))
    step = (far - near)[:, None] / made.PROBE_STEPS
    before, behind = (
        (1 - np.exp(optical_depth(made, q, d) - whole)) / (1 - np.exp(-whole))
        for q in (x, x + 1.5 * step * d)
    )
    assert (before < 0.52).all() and (behind > 0.49).all()


def test_where_all_comes_from_all_sides_alike_a_cloud_is_not_seen():
    """Radiance 1 from everywhere and no absorption: 1 everywhere."""
    s = in_grid(Even(optical_depth=1.0, lit_by="sky", g=0.5), 4, 1024, 2)
    assert s.shape == (4, 4, 3)
    assert np.allclose(s, 1, atol=0.05)
    assert s.mean() == pytest.approx(1, abs=0.005)


# the cone


def test_with_every_step_the_cone_is_the_exact_depth():
    scene = Cumulus()
    known = sun_transmittance(scene, 16)[:, :, 0]
    assert np.abs(image(cone_light, scene.probes(16), **EVERY_STEP) - known).max() < 1e-3
    assert np.abs(image(cone_light, scene.probes(16)) - known).max() > 0.1


@pytest.mark.parametrize(
    ("knobs", "steps"),
    [
        ({}, 6 + 1),
        ({"path": "printed"}, 7 + 1),
        ({"far": "none"}, 6),
        ({"far": "interval"}, 6 + 24),
        ({"samples": 2, "path": "printed", "far": "none"}, 3),
    ],
)
def test_in_one_density_the_depth_counts_the_samples(knobs, steps):
    view = with_extinction(Cumulus().probes(2), lambda p: 0 * p.x + 1e-3)
    assert np.allclose(image(cone_light, view, step=50.0, **knobs), np.exp(-0.05 * steps), rtol=1e-5)


def test_samples_stray_as_the_text_says_or_walk_as_the_listing_does():
    """Of a density that rises evenly across the way to the sun only the offsets remain."""
    scene = Cumulus(sun_elevation=90.0)
    view = scene.probes(2)
    x = np.array(view.camera.origin)[0].reshape(2, 2)
    n = np.array(cone_vector(mi.UInt32(np.arange(7) % 6), 6))[0]
    offsets = 80.0 * np.arange(7) * n
    view = with_extinction(view, lambda p: 1e-5 * (p.x + 2000))
    for path, strayed in (("cone", offsets[:6]), ("printed", np.cumsum(offsets)), ("straight", np.zeros(6))):
        d = 1e-5 * 40 * (len(strayed) * (x + 2000) + strayed.sum())
        knobs = {"path": path, "step": 40.0, "spread": 2.0, "far": "none"}
        assert np.allclose(image(cone_light, view, **knobs), np.exp(-d), rtol=1e-4)


def test_samples_stand_at_the_ends_of_their_steps_or_amid_and_one_far_out():
    view = Cumulus(sun_elevation=90.0).probes(2)
    z = np.array(view.camera.origin)[2].reshape(2, 2)
    view = with_extinction(view, lambda p: 1e-6 * p.z)
    knobs = {"path": "straight", "step": 100.0}
    for at, far, along in (
        ("ends", "none", [100, 200, 300, 400, 500, 600]),
        ("middles", "none", [50, 150, 250, 350, 450, 550]),
        ("ends", "step", [100, 200, 300, 400, 500, 600, 1800]),
    ):
        d = 1e-4 * sum(z + a for a in along)
        assert np.allclose(image(cone_light, view, at=at, far=far, **knobs), np.exp(-d), rtol=1e-4)


# the sky's light


def test_the_second_exponential_integral_is_the_known_one():
    t = np.r_[0, np.geomspace(1e-6, 60, 500)].astype(np.float32)
    assert np.allclose(np.array(_e2(mi.Float(t))), expn(2, t), atol=1e-3)


def test_the_skys_light_in_an_even_layer_falls_from_both_sides():
    scene = Even(optical_depth=6.0, lit_by="sky")
    sigma = 6 / 1800
    view = with_extinction(scene.probes(3), lambda p: dr.select(scene.inside(p), mi.Float(sigma), 0))
    up = sigma * (2900 - np.array(view.camera.origin)[2].reshape(3, 3))
    inside = (up > 0.01) & (up < 5.99)
    assert inside.any()
    known = (expn(2, up) + expn(2, 6 - up)) / 2
    assert np.allclose(image(cloud_ambient, view, model="plane")[inside], known[inside], atol=1e-3)
    similar = (expn(2, 0.15 * up) + expn(2, 0.15 * (6 - up))) / 2
    found = image(cloud_ambient, view, model="plane", depth="similar")
    assert np.allclose(found[inside], similar[inside], atol=1e-3)
    assert np.allclose(image(cloud_ambient, view, share=0.7), 0.7)


def test_by_height_light_is_the_grounds_at_the_base_and_the_skys_at_the_top():
    view = CumulusUnderSky().probes(4)
    h = np.clip((np.array(view.camera.origin)[2] - 1150) / 1700, 0, 1).reshape(4, 4)
    found = np.array(cloud_ambient(view)).reshape(3, 4, 4)
    assert h.min() < 0.35 < 0.6 < h.max()
    for k in range(3):
        assert np.allclose(found[k], 0.5 * ((1 - h) * Cumulus.GROUND[k] + h * Cumulus.SKY[k]), rtol=1e-4)
