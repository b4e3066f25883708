"""The curve of light by depth: known answers of the printed one, the fits, and what is kept of them."""

import dataclasses

import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds import light_curve as model
from approximations.clouds.cloud_light import cloud_source
from approximations.clouds.light_curve import bake, light_curve
from reference import slab_monte_carlo as walk
from scenes.cloud import CloudSlab
from scenes.cumulus import Cumulus
from tools import fit_light_curves as fit

FOUR_PI = 4 * np.pi
SLAB = CloudSlab(sun_elevation=90.0, g=0.0)


def at_depths(d):
    """Probes of an evenly scattering layer under the zenith at these depths."""
    view = SLAB.probes(2)
    z = mi.Float(1 - np.asarray(d) / SLAB.optical_depth)
    camera = dataclasses.replace(
        view.camera, origin=mi.Point3f(0, 0, z), direction=mi.Vector3f(dr_ones(len(d)), 0, 0)
    )
    return dataclasses.replace(view, width=len(d), height=1, camera=camera)


def dr_ones(n):
    return mi.Float(np.ones(n))


def curve(d, **knobs):
    """f(d) of the technique."""
    view = at_depths(d)
    return FOUR_PI * np.array(light_curve(view, bake(), phase="exact", **knobs))[0].astype(float)


def test_the_printed_curve_is_as_known():
    """(checked) Slope 4 at 0, at most 4 / (3 sqrt 3) at ln(3) / 2, Beer's at 0.347, integral 4/3."""
    d = np.linspace(0.0005, 31.9995, 32000)
    f = curve(d, constants="printed")
    assert f.max() == pytest.approx(4 / (3 * np.sqrt(3)), abs=1e-4)
    assert d[f.argmax()] == pytest.approx(np.log(3) / 2, abs=0.02)
    assert f.sum() * 0.001 == pytest.approx(4 / 3, abs=2e-3)
    assert d[np.argmax(f > np.exp(-d))] == pytest.approx(np.log(2) / 2, abs=2e-3)
    assert f[10] / d[10] == pytest.approx(4, rel=0.04)


@pytest.mark.parametrize("scene", [CloudSlab(), Cumulus()])
def test_the_printed_curve_is_that_of_the_chapter(scene):
    view = scene.probes(16)
    known = np.array(cloud_source(view, light_steps=model.LIGHT_STEPS))
    assert np.allclose(np.array(light_curve(view, bake(), constants="printed")), known, rtol=1e-4, atol=1e-7)


def test_fits_find_what_made_the_data(rng):
    d, lobe = np.exp(rng.uniform(np.log(0.02), np.log(30), 3000)), rng.uniform(0.05, 0.15, 3000)
    for known in ((2.0, 2.0, 1.0), (1.6, 5.0, 0.1)):
        s = fit.curve(np.array(known), d) * lobe
        assert fit.fit_constants(s, d, lobe) == pytest.approx(known, rel=1e-3)
        knots = fit.fit_knots(s, d, lobe)
        left = fit.hats(d) @ knots * lobe - s
        assert np.sqrt(np.mean(left**2)) < 0.02 * s.mean()
    i, j = rng.integers(0, fit.BINS[0], 20000), rng.integers(0, fit.BINS[1], 20000)
    s = (1 + i) * np.exp(-0.1 * j)
    assert np.allclose(fit.best_product(s, i, j), s)


def test_no_function_of_depth_is_better_than_the_oracle(rng):
    """Noise of zero mean at every depth: what is left is its own spread."""
    d, lobe = np.exp(rng.uniform(np.log(0.02), np.log(30), 4000)), np.full(4000, 0.08)
    s = lobe * (np.exp(-0.1 * d) + rng.normal(0, 0.3, 4000))
    left = fit.hats(d) @ fit.fit_knots(s, d, lobe) * lobe - s
    assert np.sqrt(np.mean(left**2)) == pytest.approx(0.3 * 0.08, rel=0.03)


def test_the_oracle_passes_through_its_knots_and_is_level_beyond():
    knots = np.geomspace(model.FIRST, model.LAST, model.KNOTS)
    kept = np.load(model.TABLE)["cumulus exact"][3:]
    inner = knots[knots < 31]
    f = curve(inner, constants="oracle", fitted_to="cumulus")
    assert np.allclose(f, kept[: len(inner)], rtol=1e-3, atol=1e-3 * kept.max())
    middle = curve(np.sqrt(inner[1:] * inner[:-1]), constants="oracle", fitted_to="cumulus")
    assert np.allclose(middle, (f[1:] + f[:-1]) / 2, rtol=2e-3, atol=1e-3 * kept.max())
    assert curve([0.001, 0.003], constants="oracle", fitted_to="cumulus") == pytest.approx(kept[0], rel=1e-3)


def test_fits_want_far_less_extinction_than_is_printed():
    fits = {name: c.constants for name, c in bake().items()}
    assert set(fits) == {"slab hg", "slab exact", "cumulus hg", "cumulus exact"}
    for name in ("slab hg", "cumulus hg", "cumulus exact"):
        assert 0.04 < fits[name][2] < 0.15
    assert fits["slab hg"][1] > 100
    assert 2 < fits["cumulus hg"][1] < 10


def test_the_layers_curve_is_as_bright_as_walks_say_over_all_angles():
    """The sum over the directions of the probes, whose angles to the sun have even cosines, at one depth."""
    scene, n, depth = CloudSlab(), 1500, 4.0
    view = scene.probes(64)
    w = np.array(view.camera.direction, dtype=float).T[:64]
    z = 1 - depth * scene.to_sun()[2] / scene.optical_depth
    camera = dataclasses.replace(
        view.camera, origin=mi.Point3f(0, 0, z * dr_ones(64)), direction=mi.Vector3f(w.T)
    )
    view = dataclasses.replace(view, width=64, height=1, camera=camera)
    p = np.tile([0.0, 0.0, z * scene.optical_depth], (64 * n, 1))
    l, rng = np.array(scene.to_sun()), np.random.default_rng(3)
    s = walk.source_function(p, np.repeat(w, n, axis=0), walk.slab(32.0), l, 1.0, 0.85, rng)
    lobe = walk.phase(w @ l, 0.2)
    found = np.array(light_curve(view, bake(), constants="oracle"))[0]
    assert np.sum(found * lobe) == pytest.approx(np.sum(s.reshape(64, n).mean(axis=1) * lobe), rel=0.06)
