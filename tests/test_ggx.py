"""GGX: its parts and the closed form of point lights against Mitsuba's, the technique's settings."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.area_lights.ggx_punctual import density, ggx_punctual, in_steps
from approximations.kit import ggx
from compare.measure import as_image
from reference.closed_form.point_lit import lit_ball
from reference.verify import routes_point_lit
from scenes.point_lit import PointLitBall

N = mi.Vector3f(0, 0, 1)


def directions(n=400, seed=3):
    """Pairs of unit directions of the upper hemisphere."""
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(2, 3, n))
    w[:, 2] = np.abs(w[:, 2]) + 1e-3
    return tuple(mi.Vector3f((x / np.linalg.norm(x, axis=0)).astype(np.float32)) for x in w)


def mitsuba_lobe(l, v, alpha, **material):
    """f n.l of a roughconductor."""
    kind = {
        "type": "roughconductor",
        "distribution": "ggx",
        "alpha": alpha,
        **(material or {"material": "none"}),
    }
    bsdf = mi.load_dict(kind)
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(l))
    si.wi, si.t = v, 1.0
    return np.array(bsdf.eval(mi.BSDFContext(), si, l))[0]


@pytest.mark.parametrize("alpha", [0.02, 0.1, 0.5, 1.0])
def test_lobe_with_separable_masking_is_mitsubas(alpha):
    l, v = directions()
    h = dr.normalize(l + v)
    d = ggx.distribution_by_sine(N, h, alpha)
    found = np.array(d * ggx.separable(l.z, v.z, alpha) / (4 * v.z))
    np.testing.assert_allclose(found, mitsuba_lobe(l, v, alpha), rtol=2e-4)
    joint = np.array(d * ggx.correlated(l.z, v.z, alpha) / (4 * v.z))
    assert (joint >= found * (1 - 1e-5)).all()


def test_fresnel_of_a_dielectric_is_mitsubas_conductor_without_absorption():
    l, v = directions()
    vh = dr.dot(v, dr.normalize(l + v))
    f0 = 0.04
    plain = mitsuba_lobe(l, v, 0.5)
    found = np.array(ggx.dielectric(f0, vh)) * plain
    np.testing.assert_allclose(found, mitsuba_lobe(l, v, 0.5, eta=1.5, k=0.0), rtol=2e-4, atol=1e-7)
    assert ggx.dielectric(f0, 1.0) == pytest.approx(f0)
    assert ggx.schlick(f0, 1.0) == pytest.approx(f0)
    assert ggx.schlick(f0, 0.0) == pytest.approx(1)


def test_both_forms_of_the_distribution_agree_where_digits_suffice_and_integrate_to_one():
    mu = (np.arange(4000) + 0.5) / 4000
    for alpha in (0.1, 0.4, 1.0):
        h = mi.Vector3f(np.stack([np.sqrt(1 - mu**2), 0 * mu, mu]).astype(np.float32))
        d = np.array(ggx.distribution(h.z, alpha))
        np.testing.assert_allclose(d, np.array(ggx.distribution_by_sine(N, h, alpha)), rtol=1e-3)
        assert 2 * np.pi * np.mean(d * mu) == pytest.approx(1, abs=2e-3)


def test_masking_by_schlick_is_smiths_head_on_and_on_the_roughest_surface():
    for alpha in (0.1, 0.5, 1.0):
        assert ggx.schlick_masking(1.0, 1.0, alpha) == pytest.approx(1)
        assert ggx.separable(1.0, 1.0, alpha) == pytest.approx(1)
    assert ggx.schlick_masking(1.0, 0.1, 1.0) == pytest.approx(2 / 11)
    assert ggx.separable(1.0, 0.1, 1.0) == pytest.approx(2 / 11)
    assert ggx.schlick_masking(1.0, 0.1, 0.5) < ggx.separable(1.0, 0.1, 0.5)


# The technique and the closed form


def lit(scene, size=32, **knobs):
    return as_image(ggx_punctual(scene.view(size), **knobs), size, "ggx")[..., 0]


EXACT = {"stored": "exact", "distribution": "sine", "fresnel": "exact", "buffer": "exact"}


@pytest.mark.parametrize(
    "scene", [PointLitBall(lights=1), PointLitBall(roughness=0.8, f0=0.4, albedo=0.0, lights=1)], ids=repr
)
def test_closed_form_is_what_mitsuba_sees_through_pixel_centres(scene):
    for c in routes_point_lit.compared_with_mitsuba((scene,), seed=1):
        np.testing.assert_allclose(c.first.mean, c.second.mean, rtol=2e-4, atol=1e-7)


def test_exact_stages_give_the_closed_form_and_the_printed_density_loses_it_in_half_precision():
    scene = PointLitBall()
    truth = lit_ball(scene, 32)[..., 0]

    def error(**knobs):
        return np.sqrt(np.mean((lit(scene, **EXACT | knobs) - truth) ** 2)) / truth.mean()

    assert error() < 1e-5
    assert error(precision="half") < 4e-3
    assert error(precision="half", distribution="printed") > 0.02


def test_density_overflows_float16_below_the_width_that_the_range_allows():
    assert 1 / (np.pi * 0.0022**2) > 65504 > 1 / (np.pi * 0.0023**2)
    up = dr.zeros(mi.Vector3f, 1) + N
    for form, a, finite in (
        ("sine", 0.0021, False),
        ("sine", 0.0024, True),
        ("printed", 0.012, False),
        ("printed", 0.02, True),
    ):
        d = density(up, up, mi.Float(a), form, "half")
        assert np.isfinite(np.array(d)).all() == finite, (form, a)


def test_a_roughness_of_zero_is_nothing_over_nothing_as_printed():
    one = density(N, N, mi.Float(0), "printed", "single")
    assert np.isnan(np.array(one)).all()
    assert np.isfinite(lit(PointLitBall(roughness=0.0))).all()


def test_angular_error_of_normals_in_8_bits_is_the_measured_one():
    rng = np.random.default_rng(1)
    n = rng.normal(size=(3, 200_000))
    n /= np.linalg.norm(n, axis=0)
    kept = np.array(dr.normalize(2 * in_steps(0.5 * mi.Vector3f(n.astype(np.float32)) + 0.5, 255) - 1))
    angle = np.degrees(2 * np.arcsin(0.5 * np.linalg.norm(kept - n, axis=0)))
    assert angle.mean() == pytest.approx(0.17, abs=0.01)
    assert angle.max() == pytest.approx(0.38, abs=0.03)


def test_buffer_of_ten_bits_cuts_off_highlights_and_loses_faint_lights():
    bright = PointLitBall(lights=1)
    assert lit_ball(bright, 32).max() > 1.5
    assert lit(bright).max() == 1
    faint = PointLitBall(lights=65, intensity=0.5, f0=0.02, roughness=0.8)
    assert lit(faint).max() == 0
    assert lit(faint, buffer="exact").max() > 0.001


def test_author_would_not_use_it_for_near_mirrors_nor_for_many_faint_lights():
    domain = ggx_punctual.domain_function
    assert domain(PointLitBall()).inside
    assert not domain(PointLitBall(roughness=0.05)).inside
    assert not domain(PointLitBall(lights=64)).inside
