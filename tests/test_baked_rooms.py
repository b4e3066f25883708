"""Light baked into rooms: known answers of each technique, and the pieces that they share."""

import math

import mitsuba as mi
import numpy as np
import pytest

from approximations.ambient.radiosity_normal_mapping import BASIS, basis_weights


def cone(n, degrees, rng):
    """n unit vectors (n, 3) spread evenly over the cap about +z."""
    z = 1 - rng.random(n) * (1 - math.cos(math.radians(degrees)))
    r, phi = np.sqrt(1 - z * z), 2 * np.pi * rng.random(n)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)


def weights_of(normals, form):
    found = basis_weights(mi.Vector3f(normals.T.astype(np.float32).copy()), form)
    return np.stack([np.array(w, np.float64) for w in found], axis=1)


@pytest.mark.parametrize(
    ("form", "rms", "bias", "most"),
    [("clamped", 0.182, 0.126, 0.50), ("squared", 0.178, -0.068, 0.42), ("normalised", 0.178, -0.067, 0.42)],
)
def test_one_light_anywhere_over_normals_within_45_degrees(form, rms, bias, most, rng):
    n, l = cone(200_000, 45, rng), cone(200_000, 90, rng)
    irradiance = np.maximum(l @ np.array(BASIS).T, 0)
    error = (weights_of(n, form) * irradiance).sum(axis=1) - np.maximum((n * l).sum(axis=1), 0)
    assert math.sqrt((error**2).mean()) == pytest.approx(rms, abs=0.002)
    assert error.mean() == pytest.approx(bias, abs=0.002)
    assert np.abs(error).max() == pytest.approx(most, abs=0.01)


@pytest.mark.parametrize(("form", "flat"), [("clamped", 1.37), ("squared", 0.79), ("normalised", 0.79)])
def test_constant_sky_on_the_flat_surface(form, flat):
    one = (1 + 1 / math.sqrt(3)) / 2
    assert weights_of(np.array([[0, 0, 1.0]]), form).sum() * one == pytest.approx(flat, abs=0.005)
