"""Clouds: scenes, three routes to their light, and the chapter's curves on them."""

import dataclasses
import warnings

import mitsuba as mi
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss, legval
from PythonicDISORT import pydisort

from approximations.clouds.cloud_light import cloud_light, cloud_source
from approximations.kit.phase import henyey_greenstein
from reference import slab_monte_carlo as walk
from reference import source_function
from reference.source_function import in_slab, once_scattered_by_slab, once_scattered_by_sphere
from scenes.cloud import CloudSlab, CloudSphere

FOUR_PI = 4 * np.pi
EXACT_ONCE = {"energy": "beer", "phase": "exact", "steps": 1024}
ZENITH = np.array([0.0, 0.0, 1.0])


def image(technique, view, **knobs):
    return np.array(technique(view, **knobs))[0].astype(float).reshape(view.height, view.width)


def render(scene, size, spp, orders=-1):
    integrator = mi.load_dict({"type": "volpath", "max_depth": orders, "rr_depth": 100000})
    world = mi.load_dict(scene.mitsuba(size))
    return np.array(mi.render(world, integrator=integrator, spp=spp, seed=3))[:, :, 0].astype(float)


def disort(depth, g, albedo=1.0, streams=48):
    """Diffuse reflectance, all transmittance, and 4 pi S(d, c) of a slab under a sun at the zenith, c the
    cosine between the way from eye to sample and the vertical: by discrete ordinates."""
    moments = g ** np.arange(streams)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mu, up, down, mean, _ = pydisort(depth, min(albedo, 1 - 1e-9), streams, moments, 1.0, 1.0, 0.0)
    x, w = leggauss(streams // 2)
    nodes, weights = np.r_[-(x + 1) / 2, (x + 1) / 2], np.r_[w, w] / 2
    sort, along = np.argsort(mu), np.argsort(nodes)
    assert np.allclose(mu[sort], nodes[along])
    nodes, weights = nodes[along], weights[along]

    def source(d, c):
        light = np.asarray(mean(np.array([d]))).reshape(streams, -1)[sort, 0] * weights
        order = range(streams)
        lit = np.array([legval(nodes, np.eye(streams)[k]) @ light for k in order])
        seen = np.array([legval(-c, np.eye(streams)[k]) for k in order])
        diffuse = 0.5 * np.sum((2 * np.arange(streams) + 1) * moments * lit * seen)
        return FOUR_PI * (diffuse + walk.phase(np.array(c), g) * np.exp(-d))

    return up(0.0), float(np.sum(down(depth))), source


def ambartsumian(albedo, mu=1.0, n=64):
    """Chandrasekhar's H(mu) for isotropic scattering, by iterating 1/H = sqrt(1-a) + a/2 int x H/(x+mu)."""
    x, w = leggauss(n)
    x, w = (x + 1) / 2, w / 2
    h = np.ones(n)
    for _ in range(200):
        h = (h + 1 / (np.sqrt(1 - albedo) + albedo / 2 * ((w * x * h) / (x[:, None] + x)).sum(1))) / 2
    return 1 / (np.sqrt(1 - albedo) + albedo / 2 * np.sum(w * x * h / (x + mu)))


def walked_source(depth, d, c, g, albedo=1.0, n=8000, l=ZENITH, seed=1):
    """4 pi S by random walks and its standard error."""
    p = np.tile([0.0, 0.0, depth - d], (n, 1))
    w = np.tile([np.sqrt(1 - c * c), 0.0, c], (n, 1))
    rng = np.random.default_rng(seed)
    s = FOUR_PI * walk.source_function(p, w, walk.slab(depth), l, albedo, g, rng)
    return s.mean(), s.std() / np.sqrt(n)


# scenes


@pytest.mark.parametrize("scene", [CloudSlab(seen="below"), CloudSphere()])
def test_span_is_where_rays_cross_the_shape_that_mitsuba_has(scene):
    view = scene.view(9)
    near, far = map(np.array, scene.span(view.camera.origin, view.camera.direction))
    world = mi.load_dict({"type": "scene", "cloud": scene.shape()})
    hit = world.ray_intersect(mi.Ray3f(view.camera.origin, view.camera.direction))
    again = world.ray_intersect(hit.spawn_ray(view.camera.direction))
    entry = np.where(np.isfinite(np.array(hit.t)), np.array(hit.t), 0)
    assert np.allclose(near, entry, atol=2e-4)
    assert np.allclose((far - near)[entry > 0], np.array(again.t)[entry > 0], atol=1e-3)
    assert np.all(far[entry == 0] == 0)


def test_probes_run_from_the_lit_top_down_and_from_the_suns_side_round():
    scene = CloudSlab(sun_elevation=30.0)
    camera = scene.probes(5).camera
    depth = 32 * (1 - np.array(camera.origin)[2]).reshape(5, 5)
    assert np.allclose(depth[[0, -1], 0], [0.02, 0.999 * 32], rtol=1e-4)
    assert np.allclose(depth[2], np.sqrt(0.02 * 0.999 * 32), rtol=1e-4)
    w = np.array(camera.direction).reshape(3, 5, 5)
    cosine = np.einsum("c,cij->ij", scene.to_sun(), w)
    assert np.allclose(cosine, np.linspace(-1, 1, 5), atol=1e-6)
    assert np.allclose(np.linalg.norm(w, axis=0), 1, atol=1e-6)


def test_the_lit_limb_is_on_the_left_and_the_sun_at_zero_is_behind_the_camera():
    assert CloudSphere(sun_angle=90.0).to_sun() == pytest.approx([-1, 0, 0], abs=1e-12)
    assert CloudSphere(sun_angle=0.0).to_sun() == pytest.approx([0, -1, 0], abs=1e-12)
    lit = render(CloudSphere(optical_depth=64.0), 8, 256)
    assert lit[:, :4].sum() > 3 * lit[:, 4:].sum()


# routes to the truth


@pytest.mark.parametrize(
    ("depth", "g", "albedo", "reflectance", "transmittance"),
    [
        (32, 0.0, 1.0, 0.950, 0.050),
        (32, 0.2, 1.0, 0.937, 0.063),
        (32, 0.85, 1.0, 0.728, 0.272),
        (8, 0.85, 1.0, 0.358, 0.642),
        (32, 0.85, 0.99, 0.467, 0.099),
    ],
)
def test_slab_fluxes_by_walks_and_ordinates_are_the_known_ones(depth, g, albedo, reflectance, transmittance):
    back, through, _ = disort(depth, g, albedo)
    assert (back, through) == pytest.approx((reflectance, transmittance), abs=0.0015)
    photons = 10000
    walked = walk.slab_fluxes(depth, 1.0, albedo, g, photons, np.random.default_rng(7))
    assert walked == pytest.approx((back, through), abs=4 * np.sqrt(back * (1 - back) / photons))


def test_isotropic_source_at_the_boundary_is_the_h_function():
    assert ambartsumian(1.0) == pytest.approx(2.908, abs=0.001)
    source = disort(2000.0, 0.0)[2]
    assert source(1e-9, 0.0) == pytest.approx(ambartsumian(1.0), rel=0.003)
    assert source(20.0, 0.0) == pytest.approx(np.sqrt(3) * ambartsumian(1.0), rel=0.02)
    s, se = walked_source(80.0, 0.0, -1.0, 0.0, albedo=0.9, n=40000)
    assert s == pytest.approx(ambartsumian(0.9), abs=4 * se)
    assert se < 0.01


@pytest.mark.parametrize(
    ("g", "c", "values"),
    [
        (0.0, -1.0, [3.07, 3.99, 4.46, 4.09, 2.30]),
        (0.2, -1.0, [3.12, 3.97, 4.39, 4.04, 2.29]),
        (0.85, -1.0, [2.99, 3.19, 3.26, 3.08, 1.77]),
        (0.85, 1.0, [80.9, 56.4, 23.6, 6.67, 3.12]),
    ],
)
def test_source_by_depth_is_the_anchor_table(g, c, values):
    source = disort(32.0, g)[2]
    for d, known in zip([0.05, 0.55, 1.95, 5.25, 17.25], values, strict=True):
        assert source(d, c) == pytest.approx(known, rel=0.05)
    s, se = walked_source(32.0, 0.55, c, g, n=4000)
    assert s == pytest.approx(source(0.55, c), abs=4 * se)


def test_mitsubas_source_function_agrees_with_ordinates():
    scene = CloudSlab(sun_elevation=90.0, optical_depth=8.0, g=0.6)
    batches = np.array([in_slab(scene, 4, 2048, k)[:, :, 0] for k in range(6)]) * FOUR_PI
    s, se = batches.mean(0), batches.std(0, ddof=1) / np.sqrt(6)
    camera = scene.probes(4).camera
    d, c = 8 * (1 - np.array(camera.origin)[2]), np.array(camera.direction)[2]
    source = disort(8.0, 0.6)[2]
    known = np.array([source(*probe) for probe in zip(d, c, strict=True)]).reshape(4, 4)
    assert np.all(np.abs(s - known) < 7 * se + 0.01 * known)
    assert abs(np.mean(s - known)) < 4 * np.sqrt(np.mean(se**2) / 16) + 0.003 * known.mean()
    assert np.mean(se / known) < 0.05


@pytest.mark.parametrize("rain", ["denser", "absorbing"])
def test_mitsubas_source_function_agrees_with_walks_in_rain_under_a_low_sun(rain):
    scene = CloudSlab(sun_elevation=30.0, optical_depth=4.0, g=0.5, precipitation=3.0, rain=rain)
    s = in_slab(scene, 3, 16384, 5)[:, :, 0].reshape(-1) * FOUR_PI
    camera = scene.probes(3).camera
    z, w, l = np.array(camera.origin)[2], np.array(camera.direction).T, np.array(scene.to_sun())
    rng, n, albedo = np.random.default_rng(2), 6000, 1.0 if rain == "denser" else 1 / 3
    p = np.repeat(np.c_[0 * z, 0 * z, 12 * z], n, axis=0)
    known = walk.source_function(p, np.repeat(w, n, axis=0), walk.slab(12.0), l, albedo, 0.5, rng)
    known = FOUR_PI * known.reshape(9, n)
    assert np.all(np.abs(s - known.mean(1)) < 5 * known.std(1) / np.sqrt(n))


@pytest.mark.parametrize(
    ("sun_angle", "depth", "x", "value"),
    [
        (90, 16, -0.9, 0.88),
        (90, 16, -0.4, 1.42),
        (90, 16, 0.4, 0.70),
        (90, 64, -0.7, 2.5),
        (0, 16, 0.8, 0.51),
    ],
)
def test_radiance_of_the_ball_is_the_anchor_table(sun_angle, depth, x, value):
    n, radius = 6000, depth / 2
    p = np.tile([radius * x, -radius * np.sqrt(1 - x * x), 0.0], (n, 1))
    w = np.tile([0.0, 1.0, 0.0], (n, 1))
    l = np.array(CloudSphere(sun_angle=float(sun_angle)).to_sun())
    s = FOUR_PI * walk.radiance(p, w, walk.ball(radius), l, 1.0, 0.85, np.random.default_rng(11))
    assert s.mean() == pytest.approx(value, abs=4 * np.hypot(s.std() / np.sqrt(n), 0.06 * value))


def test_mitsubas_ball_is_as_bright_as_walks_say():
    scene = CloudSphere(optical_depth=8.0, sun_angle=120.0, g=0.5, albedo=0.95)
    n, rng = 30000, np.random.default_rng(4)
    x, z = rng.uniform(-1.1, 1.1, (2, n))
    hit = x * x + z * z < 1
    p = 4 * np.c_[x, -np.sqrt(np.maximum(1 - x * x - z * z, 0)), z][hit]
    w = np.tile([0.0, 1.0, 0.0], (len(p), 1))
    light = np.zeros(n)
    light[hit] = walk.radiance(p, w, walk.ball(4.0), np.array(scene.to_sun()), 0.95, 0.5, rng)
    assert render(scene, 16, 256).mean() == pytest.approx(light.mean(), abs=5 * light.std() / np.sqrt(n))


def once_scattered(scene, size):
    form = once_scattered_by_slab if isinstance(scene, CloudSlab) else once_scattered_by_sphere
    return form(scene, size)[:, :, 0]


SLABS = [
    CloudSlab(optical_depth=4.0, g=0.6, albedo=0.95, sun_elevation=50.0),
    CloudSlab(optical_depth=1.5, g=0.6, sun_elevation=80.0, seen="below"),
]


BALLS = [
    CloudSphere(optical_depth=3.0, g=0.6, sun_angle=60.0),
    CloudSphere(optical_depth=2.0, g=0.3, sun_angle=150.0, precipitation=2.0, rain="absorbing"),
]


@pytest.mark.parametrize("scene", SLABS + BALLS)
def test_light_scattered_once_is_the_integral_along_the_ray(scene):
    known = once_scattered(scene, 64).reshape(8, 8, 8, 8).mean(axis=(1, 3))
    image = render(scene, 8, 4096, orders=2)
    assert np.abs(image - known).max() < 0.08 * known.max()
    assert image.mean() == pytest.approx(known.mean(), rel=0.01)


def test_light_scattered_once_as_far_as_figures_are_known():
    """Under the zenith f (1 - e^-(1/m + 1)) / (1 + m), tau = 1; into the sun's own direction f / 2."""
    slab = CloudSlab(optical_depth=1.0, g=0.0, sun_elevation=90.0)
    m = -np.array(slab.view(4).camera.direction)[2].reshape(4, 4)
    assert np.allclose(FOUR_PI * once_scattered(slab, 4), (1 - np.exp(-1 / m - 1)) / (1 + m), rtol=1e-6)
    ball = CloudSphere(optical_depth=64.0, sun_angle=0.0, g=0.0, precipitation=9.0)
    assert FOUR_PI * once_scattered(ball, 3)[1, 1] == pytest.approx(0.5, rel=1e-4)


# the technique


@pytest.mark.parametrize("scene", [*SLABS, BALLS[0]])
def test_with_every_stage_exact_beer_is_single_scattering(scene):
    known = once_scattered(scene, 16)
    assert np.allclose(image(cloud_light, scene.view(16), **EXACT_ONCE), known, rtol=2e-4)
    coarse = image(cloud_light, scene.view(16), **EXACT_ONCE | {"steps": 2})
    assert np.abs(coarse - known).max() > 5e-3 * known.max()


def test_energy_and_lobe_at_probes_are_the_model_columns_of_the_anchor_table():
    scene = CloudSlab(sun_elevation=90.0)
    view = scene.probes(3)
    d = [0.05, 0.55, 1.95]
    z = np.repeat(1 - np.array(d) / 32, 3).astype(np.float32)
    camera = dataclasses.replace(view.camera, origin=mi.Point3f(0, 0, mi.Float(z)))
    view = dataclasses.replace(view, camera=camera)
    lobe = np.array([0.556, 0.905, 1.875])  # backwards, to the side, forwards
    beer = FOUR_PI * image(cloud_source, view, energy="beer")
    assert np.allclose(beer, np.outer([0.951, 0.577, 0.142], lobe), rtol=3e-3)
    both = FOUR_PI * image(cloud_source, view)
    assert np.allclose(both, np.outer([0.181, 0.770, 0.279], lobe), rtol=3e-3)
    powder = FOUR_PI * image(cloud_source, view, energy="powder")
    assert np.allclose(2 * powder * beer / lobe, both, rtol=3e-3)


@pytest.mark.parametrize(("p", "peak"), [(1.0, 0.770), (3.0, 0.372), (6.0, 0.211), (9.0, 0.147)])
def test_rain_in_beers_factor_lowers_the_peak_as_known(p, peak):
    view = CloudSlab(sun_elevation=90.0, g=0.0, precipitation=p).probes(128)
    source = FOUR_PI * image(cloud_source, view, phase="exact")
    assert source.max() == pytest.approx(peak, abs=1e-3)
    in_both = FOUR_PI * image(cloud_source, view, phase="exact", rain_in="both")
    assert in_both.max() == pytest.approx(0.770, abs=1e-3)


def test_printed_lobe_is_pi_squared_too_bright_and_the_equation_keeps_energy():
    view = CloudSlab().view(4)
    ratio = image(cloud_light, view, phase="printed") / image(cloud_light, view)
    assert np.allclose(ratio, np.pi**2, rtol=1e-4)
    x, w = leggauss(200)
    for g in (-0.5, 0.2, 0.85):
        lobe = np.array(henyey_greenstein(mi.Float64(x), g))
        assert 2 * np.pi * np.sum(w * lobe) == pytest.approx(1, rel=1e-9)
        assert 2 * np.pi * np.sum(w * x * lobe) == pytest.approx(g, rel=1e-9)


@pytest.mark.parametrize("scene", [CloudSlab(), CloudSphere()])
def test_in_a_cloud_of_one_density_any_march_to_the_sun_is_exact(scene):
    view = scene.view(16)
    six = image(cloud_light, view)
    assert np.allclose(image(cloud_light, view, light_steps=1), six, rtol=2e-3, atol=1e-6 * six.max())


def test_march_to_the_sun_samples_amid_its_steps():
    """In a density that falls as z^2 towards the top, three samples miss the integral by h^2 / 12 d'."""
    view = CloudSlab(sun_elevation=90.0).probes(16)
    cloud = dataclasses.replace(view.cloud, extinction=lambda p: p.z * p.z)
    z = np.array(view.camera.origin, dtype=np.float64)[2]
    h = (1 - z) / 3
    depth = h * sum((z + (i + 0.5) * h) ** 2 for i in range(3))
    found = image(cloud_source, dataclasses.replace(view, cloud=cloud), energy="beer", g=0.0, light_steps=3)
    assert np.allclose(FOUR_PI * found.reshape(-1), np.exp(-depth), rtol=1e-4)


def test_with_the_sun_behind_the_eye_powder_darkens_no_edge_of_an_opaque_cloud():
    """(checked) Beer gives B = (1 - e^-2t) / 2 and Beer-powder 2 B^2, t the optical depth of the chord."""
    scene = CloudSphere(sun_angle=0.0, optical_depth=3.0)
    view = scene.view(32)
    near, far = map(np.array, scene.span(view.camera.origin, view.camera.direction))
    b = ((1 - np.exp(-2 * 1.5 * (far - near))) / 2).reshape(32, 32)
    lobe = walk.phase(np.array(-1.0), 0.2)
    settings = {"steps": 512}
    assert np.allclose(image(cloud_light, view, energy="beer", **settings), b * lobe, atol=1e-4 * lobe)
    assert np.allclose(image(cloud_light, view, **settings), 2 * b * b * lobe, atol=1e-4 * lobe)


@pytest.mark.parametrize(
    ("depth", "energy", "values"),
    [
        (16.0, "beer", [0.79, 0.66, 0.49, 0.32, 0.09, 0.001]),
        (16.0, "beer_powder", [0.25, 0.51, 0.50, 0.39, 0.15, 0.001]),
        (64.0, "beer", [0.77, 0.62, 0.46, 0.29, 0.03, 0.0]),
        (64.0, "beer_powder", [0.37, 0.49, 0.46, 0.34, 0.05, 0.0]),
    ],
)
def test_side_lit_ball_is_the_anchor_table(depth, energy, values):
    """(checked) Towards the lit limb Beer brightens; the truth and Beer-powder darken."""
    view = CloudSphere(optical_depth=depth).view(2)
    origin = mi.Point3f(mi.Float([-0.98, -0.9, -0.7, -0.4, 0.0, 0.4]), -3, 0)
    camera = dataclasses.replace(view.camera, origin=origin, direction=mi.Vector3f(0, 1, 0))
    view = dataclasses.replace(view, width=6, height=1, camera=camera)
    lit = FOUR_PI * image(cloud_light, view, energy=energy, steps=4096)[0]
    assert np.allclose(lit, values, atol=0.011)


@pytest.mark.parametrize("scene", [CloudSlab(), CloudSphere(sun_angle=160.0)])
def test_defaults_stay_far_darker_than_all_orders(scene):
    assert image(cloud_light, scene.view(32)).mean() < 0.5 * render(scene, 16, 32).mean()


def test_the_ball_s_single_scattering_has_converged_at_every_depth_of_its_axis(monkeypatch):
    for depth in (0.1, 64.0, 200.0):
        ball = CloudSphere(optical_depth=depth)
        monkeypatch.setattr(source_function, "PANELS", 12)
        plain = once_scattered_by_sphere(ball, 24)
        monkeypatch.setattr(source_function, "PANELS", 40)
        finer = once_scattered_by_sphere(ball, 24)
        assert np.abs(plain - finer).max() < 1e-4 * finer.mean()
