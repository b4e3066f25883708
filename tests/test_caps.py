"""Spherical caps: closed forms against counted directions, formulas in use against closed forms."""

import mitsuba as mi
import numpy as np
import pytest

from approximations.kit import caps as kit
from reference.closed_form import caps

Z = np.array([0.0, 0.0, 1.0])
HALF = np.array(0.5 * np.pi)


def unit(*v):
    return np.array(v) / np.linalg.norm(v)


def tilted(d):
    """The direction d (rad) from +z, towards +x."""
    d = np.asarray(d, float)
    return np.stack([np.sin(d), 0 * d, np.cos(d)], axis=-1)


def f64(x):
    return mi.Float64(np.asarray(x, np.float64))


@pytest.fixture(scope="module")
def directions():
    """A million even directions on the sphere."""
    w = np.random.default_rng(35).normal(size=(1_000_000, 3))
    return w / np.linalg.norm(w, axis=1, keepdims=True)


def counted(directions, *members):
    """Area and vector irradiance of an intersection of caps, each with its standard error."""
    inside = np.all([directions @ a > np.cos(r) for a, r in members], axis=0)[:, None]
    samples = 4 * np.pi * np.hstack([inside, inside * directions])
    mean, error = samples.mean(axis=0), samples.std(axis=0) / len(samples) ** 0.5
    return mean[0], error[0], mean[1:], error[1:]


LENSES = [
    (1.0, 0.5, 1.0),  # crossing
    (1.2, 1.2, 0.3),  # one axis inside the other's cap
    (1.5, 1.4, 2.6),  # a sliver
    (1.5707, 0.27, 1.5),  # a sun on the horizon
    (0.3, 1.0, 0.5),  # contained
    (1.0, 0.3, 0.7 - 1e-12),  # contained, touching
    (0.3, 1.0, 1.5),  # apart
]


@pytest.mark.parametrize(("r0", "r1", "d"), LENSES)
def test_lens_area_and_irradiance_match_counted_directions(directions, r0, r1, d):
    area, area_error, phi, phi_error = counted(directions, (Z, r0), (tilted(d), r1))
    assert abs(caps.lens_area(r0, r1, d) - area) <= 4 * area_error
    assert np.all(np.abs(caps.vector_irradiance((Z, r0), (tilted(d), r1)) - phi) <= 4 * phi_error)


def test_lens_is_the_smaller_cap_inside_and_nothing_outside():
    assert caps.lens_area(0.3, 1.0, 0.5) == caps.cap_area(0.3)
    assert caps.lens_area(0.3, 1.0, 1.31) == 0
    phi = caps.vector_irradiance((Z, np.array(1.0)), (tilted(0.5), np.array(0.3)))
    np.testing.assert_allclose(phi, np.pi * np.sin(0.3) ** 2 * tilted(0.5), atol=1e-15)
    assert np.all(caps.vector_irradiance((Z, np.array(1.0)), (tilted(1.31), np.array(0.3))) == 0)


def test_lens_never_jumps_where_the_penumbra_ends():
    big, small = np.meshgrid(np.radians(np.arange(1, 91)), np.radians([0.265, 1, 10, 30]))
    whole = caps.cap_area(np.minimum(big, small))
    assert np.all(caps.lens_area(big, small, big + small) <= 1e-9 * whole)
    np.testing.assert_allclose(caps.lens_area(big, small, np.abs(big - small)), whole, rtol=1e-9)


def test_two_hemispheres_share_a_lune():
    d = np.linspace(0.01, 3.13, 50)
    np.testing.assert_allclose(caps.lens_area(HALF, HALF, d), 2 * (np.pi - d), rtol=1e-12)
    phi = caps.vector_irradiance((Z, HALF), (tilted(d), HALF))
    np.testing.assert_allclose(phi, 0.5 * np.pi * (Z + tilted(d)), atol=1e-13)


def test_three_hemispheres_share_an_octant():
    octant = caps.vector_irradiance(*((axis, HALF) for axis in np.eye(3)))
    np.testing.assert_allclose(octant, np.full(3, 0.25 * np.pi), rtol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_irradiance_of_four_caps_matches_counted_directions(directions, seed):
    rng = np.random.default_rng(seed)
    members = [(unit(*(rng.normal(size=3) + [0, 0, 3])), rng.uniform(0.6, 1.6)) for _ in range(4)]
    area, _, phi, error = counted(directions, *members)
    assert area > 0
    assert np.all(np.abs(caps.vector_irradiance(*members) - phi) <= 4 * error)


def test_light_on_the_horizon_matches_counted_directions(directions):
    for theta, s in ((1.4, 0.5), (1.8, 0.6), (0.3, 0.4), (1.57, 1.2), (0.5, 1.4)):
        _, _, phi, error = counted(directions, (tilted(theta), s), (Z, HALF))
        assert abs(caps.horizon_irradiance(theta, s) - phi[2]) <= 4 * error[2]


def test_light_on_the_horizon_by_two_routes(rng):
    theta, s = rng.uniform(0, np.pi, 2000), rng.uniform(0.001, 1.57, 2000)
    other = caps.vector_irradiance((tilted(theta), s), (Z, HALF))[:, 2]
    np.testing.assert_allclose(caps.horizon_irradiance(theta, s), other, atol=1e-13)


def test_open_sky_gives_pi_and_whole_cap_pi_sin_squared():
    assert caps.horizon_irradiance(0, 0.5 * np.pi) == pytest.approx(np.pi)
    assert caps.horizon_irradiance(0.4, 0.3) == pytest.approx(np.pi * np.sin(0.3) ** 2 * np.cos(0.4))
    assert caps.horizon_irradiance(2.0, 0.3) == 0


def test_sphere_on_plane_is_a_cap_that_touches_the_horizon():
    x = np.linspace(0.01, 20, 100)
    s = np.arcsin(1 / np.hypot(x, 1))
    by_cap = 1 - caps.horizon_irradiance(0.5 * np.pi - s, s) / np.pi
    np.testing.assert_allclose(caps.openness_beside_sphere(x, 1.0), by_cap, atol=1e-8)
    assert caps.openness_beside_sphere(0, 1.0) == 0


def test_printed_lens_is_negative_and_the_mended_one_is_right():
    for r0, r1, d, printed, mended in (
        (0.5 * np.pi, 0.5 * np.pi, 1, -4.283, 4.283),
        (1.0, 0.5, 1.0, -6.584, 0.3581),
    ):
        args = f64(r0), f64(r1), f64(d)
        assert float(kit.lens_area_printed(*args)[0]) == pytest.approx(printed, abs=5e-4)
        assert float(kit.lens_area(*args)[0]) == pytest.approx(mended, abs=5e-5 if mended < 1 else 5e-4)


def test_lens_in_use_equals_the_closed_form_in_float64(rng):
    n = 20000
    r0, r1 = rng.uniform(0.05, 0.5 * np.pi, (2, n))
    d = rng.uniform(0, np.pi, n)
    x, y, z = tilted(d).T
    ours = np.array(kit.lens_area(f64(r0), f64(r1), f64(d)))
    np.testing.assert_allclose(ours, caps.lens_area(r0, r1, d), atol=1e-9)
    phi = kit.lens_irradiance(
        mi.Vector3d(0, 0, 1), f64(r0), mi.Vector3d(f64(x), f64(y), f64(z)), f64(r1), f64(d)
    )
    exact = caps.vector_irradiance((Z, r0), (tilted(d), r1))
    np.testing.assert_allclose(np.array(phi).T, exact, atol=1e-9)
    assert np.all(np.linalg.norm(exact, axis=1) <= caps.lens_area(r0, r1, d) + 1e-12)


def float32_errors(degrees):
    """Errors of the lens in float32, in units of the small cap's area: apertures of 10 to 85 deg, 1% to
    99% of the penumbra."""
    big, x = np.meshgrid(np.radians(np.arange(10, 86, 5)), np.linspace(0.01, 0.99, 99))
    small = np.full_like(big, np.radians(degrees))
    d = np.abs(big - small) + (1 - x) * 2 * np.minimum(big, small)
    given = [mi.Float(v.ravel().astype(np.float32)) for v in (big, small, d)]
    exact = caps.lens_area(big, small, d).ravel()
    return np.abs(np.array(kit.lens_area(*given)) - exact) / caps.cap_area(np.minimum(big, small)).ravel()


@pytest.mark.parametrize(("degrees", "rms"), [(0.265, 0.98), (1, 0.018)])
def test_float32_lens_of_a_small_light_is_as_bad_as_known(degrees, rms):
    measured = np.sqrt(np.mean(float32_errors(degrees) ** 2))
    assert 0.5 * rms < measured < 2 * rms


def test_float32_lens_of_the_sun_is_off_by_many_suns_where_the_penumbra_ends():
    assert float32_errors(0.265).max() > 3.9


@pytest.mark.parametrize(("degrees", "bound"), [(5, 5e-4), (10, 3e-4)])
def test_float32_lens_of_a_large_light_is_good(degrees, bound):
    assert 0.01 * bound < np.quantile(float32_errors(degrees), 0.99) < bound


def test_float32_cap_keeps_its_digits():
    sun = np.float32(np.radians(0.265))
    exact = caps.cap_area(sun)
    assert float(kit.cap_area(mi.Float(sun))[0]) == pytest.approx(exact, rel=1e-6)
    assert abs(2 * np.pi * (1 - np.cos(sun)) / exact - 1) == pytest.approx(0.0025, rel=0.05)


@pytest.mark.parametrize(
    ("larger", "smaller", "most", "at", "mean", "rms"),
    [
        (90, 0.265, 0.039, 0.76, 0.000, 0.028),
        (60, 0.265, 0.040, 0.76, 0.000, 0.028),
        (60, 10, 0.047, 0.75, 0.006, 0.029),
        (60, 30, 0.070, 0.72, 0.020, 0.040),
        (60, 60, 0.131, 0.75, 0.049, 0.076),
        (30, 10, 0.064, 0.72, 0.019, 0.037),
        (30, 30, 0.153, 0.72, 0.070, 0.092),
        (10, 10, 0.160, 0.72, 0.075, 0.097),
        (90, 90, 0.096, 0.79, 0.000, 0.069),
    ],
)
def test_smoothstep_errs_as_tabled(larger, smaller, most, at, mean, rms):
    big, small = np.radians(larger), np.radians(smaller)
    x = np.linspace(0, 1, 5001)
    d = big - small + (1 - x) * 2 * small
    cubic = np.array(kit.smoothstep_area(f64(big), f64(small), f64(d)))
    error = (cubic - caps.lens_area(big, small, d)) / caps.cap_area(small)
    assert error.max() == pytest.approx(most, abs=6e-4)
    assert x[error.argmax()] == pytest.approx(at, abs=0.006)
    assert error.mean() == pytest.approx(mean, abs=6e-4)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(rms, abs=6e-4)


def test_smoothstep_against_a_straight_edge_is_odd_about_the_middle():
    x = np.linspace(0, 1, 10001)
    error = x * x * (3 - 2 * x) - caps.half_plane_share(x)
    np.testing.assert_allclose(error, -error[::-1], atol=1e-12)
    assert error.max() == pytest.approx(0.0394, abs=5e-5)
    assert x[error.argmax()] == pytest.approx(0.764, abs=5e-4)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(0.0277, abs=5e-5)


@pytest.mark.parametrize(
    ("light", "aperture", "most"),
    [(0.265, 60, 3e-4), (0.265, 30, 8e-4), (0.265, 10, 3e-3), (5, 60, 5e-3), (5, 30, 1.6e-2), (5, 10, 5e-2)],
)
def test_small_light_sees_the_aperture_as_a_straight_edge(light, aperture, most):
    big, small = np.radians(aperture), np.radians(light)
    x = np.linspace(0, 1, 2001)
    lens = caps.lens_area(big, small, big + small * (1 - 2 * x)) / caps.cap_area(small)
    assert np.abs(caps.half_plane_share(x) - lens).max() == pytest.approx(most, rel=0.1)
