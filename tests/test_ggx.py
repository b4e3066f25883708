"""GGX: its parts and the closed form of point lights against Mitsuba's, the technique's settings."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.kit import ggx

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
