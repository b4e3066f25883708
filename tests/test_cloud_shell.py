"""A shell of cloud: known lengths, cancellation, the second crossing, and the picture of sheets."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.spherical_shell import EXACT, shell_segments, spherical_shell
from reference.closed_form.cloud_shell import shell_transmittance, spheres
from reference.verify.routes_cloud_shell import shell_against_points
from reference.verify.run import judge
from scenes.cloud_shell import CloudShell, Shell

KNOWN = {90: 3500, 30: 6990, 10: 19800, 5: 37700, 2: 74600, 1: 98400, 0: 114200}  # m
EARTH = Shell(6371e3, 1500.0, 5000.0)


def lengths(degrees, height, intersection, unit="m"):
    e = np.radians(np.array(degrees, np.float64))
    d = mi.Vector3f(mi.Float(np.cos(e)), 0, mi.Float(np.sin(e)))
    o = mi.Point3f(0, 0, dr.full(mi.Float, height, len(e)))
    return [np.array(b - a, np.float64) for a, b in shell_segments(EARTH, o, d, intersection, unit)]


@pytest.mark.parametrize(("intersection", "unit"), [("textbook", "m"), ("textbook", "km"), ("exact", "m")])
def test_ways_through_the_shell_are_the_known_ones(intersection, unit):
    first, second = lengths(list(KNOWN), 0.0, intersection, unit)
    assert np.allclose(first, list(KNOWN.values()), rtol=2e-3)
    assert np.all(second == 0)


def test_entry_along_the_horizon_is_138_km_away():
    start = shell_segments(EARTH, mi.Point3f(0, 0, 0), mi.Vector3f(1, 0, 0), "exact")[0][0]
    assert np.array(start)[0] == pytest.approx(138.3e3, rel=1e-3)


def test_the_textbooks_quadratic_is_metres_off_in_either_unit_and_the_product_is_not():
    degrees = np.linspace(0.2, 20, 400)
    m = np.sin(np.radians(degrees))
    known = spheres(6371e3, 5000.0, 0.0, m)[1] - spheres(6371e3, 1500.0, 0.0, m)[1]
    off = {
        k: np.abs(lengths(degrees, 0.0, *k)[0] - known).max()
        for k in [("textbook", "m"), ("textbook", "km"), ("exact", "m")]
    }
    assert off["exact", "m"] < 0.2
    assert 0.5 < off["textbook", "m"] < 100
    assert 0.5 < off["textbook", "km"] < 100


def test_a_flat_layer_is_as_long_as_the_sine_says():
    first, _ = lengths([90, 30, 10], 0.0, "planar")
    assert np.allclose(first, 3500 / np.sin(np.radians([90, 30, 10])), rtol=1e-5)


def test_from_above_a_ray_can_cross_the_shell_twice_or_meet_the_ground():
    """From 9 km the base is touched 2.78 degrees down and the ground 3.04."""
    first, second = lengths([-1.0, -2.9, -4.0], 9000.0, "exact")
    assert first[0] == 0
    assert first[1] == pytest.approx(second[1], rel=1e-3) and first[1] > 30e3
    assert first[2] > 0 and second[2] == 0


def image(scene, size=64, **knobs):
    return np.array(spherical_shell(scene.view(size), **knobs))[0].astype(float).reshape(size, size, 1)


@pytest.mark.parametrize("height", [2.0, 3000.0, 9000.0])
def test_with_every_stage_exact_it_is_the_closed_form(height):
    scene = CloudShell(height=height, elevation=6.0, wavelength=4000.0)
    assert np.allclose(image(scene, **EXACT), shell_transmittance(scene, 64), atol=2e-3)


def test_steps_as_long_as_the_sheets_are_apart_alias():
    far = np.abs(image(CloudShell()) - shell_transmittance(CloudShell(), 64)).max()
    even = CloudShell(rolls=0.0)
    assert far > 0.03
    assert np.abs(image(even) - shell_transmittance(even, 64)).max() < 1e-3


def test_closed_form_is_what_strewn_points_find():
    assert all(judge(c, 1e-3)["verdict"] == "agrees" for c in shell_against_points(3))
