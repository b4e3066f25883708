"""Spectra to RGB, and RGB rendering held against spectral rendering."""

import itertools
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import jsonschema
import mitsuba as mi
import numpy as np
import pytest

from compare import gate, stochastic
from compare.colour import declared, rgb_rendering, sampled
from compare.measure import measure
from compare.task import PATH_TRACER, PROFILES, RGB_RENDERING, ROOT, Task, find_measured, plan
from reference.closed_form.coloured_glass import radiance, rgb_radiance
from reference.colour import (
    OBSERVER,
    conversions,
    illuminant,
    observer,
    spectrum_to_rgb,
    to_rgb,
    xyz_to_rgb,
)
from reference.moments import from_batches
from reference.render import render_once, sample, to_array
from reference.spectral import load_rgb
from reference.transport import coloured, integrator, media
from reference.truth import Truth, box_filter
from reference.verify.agreement import Sampled, agreement
from scenes.coloured import (
    DYES,
    FILM_Y,
    WAVELENGTHS,
    Atmosphere,
    ColouredGlass,
    DeepInterreflection,
    colour_science,
    light,
    patch,
    sunlight,
)
from scenes.contract import RADIANCE, BadInput

SCENES = (ColouredGlass, DeepInterreflection, Atmosphere)


def sample_rgb(scene, quantity, size):
    """One batch of the scene in three channels, f(spp, seed)."""
    loaded = load_rgb(scene, quantity, size)
    return lambda spp, seed: render_once(loaded, spp, seed)


def batches(draw, spp, count, seed=1):
    """Independent images, (count, H, W, 3)."""
    return np.stack([draw(spp, s) for s in itertools.islice(stochastic.frame_seeds(seed), count)])


# --- spectra to linear sRGB ------------------------------------------------------------------------


def test_white_is_one_in_every_channel():
    assert spectrum_to_rgb(WAVELENGTHS, np.ones(95), "reflectance") == pytest.approx([1, 1, 1], abs=3e-4)
    assert spectrum_to_rgb(WAVELENGTHS, light("daylight"), "emission") == pytest.approx([1, 1, 1], abs=5e-4)
    red, _, blue = spectrum_to_rgb(WAVELENGTHS, light("incandescent"), "emission")
    assert red > 1.5 and blue < 0.3


@pytest.mark.parametrize(
    "values", [light("daylight"), light("incandescent"), sunlight()], ids=["D", "A", "sun"]
)
def test_lights_have_luminance_one(values):
    nm, xyz = observer()
    assert np.interp(nm, WAVELENGTHS, values) @ xyz[:, 1] / FILM_Y == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("name", ["red", "cyan", "orange yellow"])
def test_a_reflectance_is_what_colour_science_makes_of_it_by_another_method(name):
    colour = colour_science()
    nm = observer()[0]
    table = colour.SpectralDistribution(np.interp(nm, WAVELENGTHS, patch(name)), nm)
    white = colour.SpectralDistribution(illuminant(), nm)
    cmfs = colour.MSDS_CMFS[OBSERVER]
    astm = colour.sd_to_XYZ(table, cmfs, white, method="ASTM E308") / 100
    found = spectrum_to_rgb(WAVELENGTHS, patch(name), "reflectance")
    assert found == pytest.approx(xyz_to_rgb(astm), abs=1e-3)
    assert found == pytest.approx(colour.XYZ_to_RGB(astm, "sRGB", apply_cctf_encoding=False), abs=1e-3)


def test_an_emission_is_what_colour_science_integrates():
    colour = colour_science()
    nm = observer()[0]
    values = np.interp(nm, WAVELENGTHS, sunlight())
    xyz = colour.sd_to_XYZ(
        colour.SpectralDistribution(values, nm),
        colour.MSDS_CMFS[OBSERVER],
        k=1 / FILM_Y,
        method="Integration",
    )
    assert spectrum_to_rgb(WAVELENGTHS, sunlight(), "emission") == pytest.approx(xyz_to_rgb(xyz), rel=1e-6)


@pytest.mark.parametrize("dye", DYES)
def test_the_rules_of_extinction_hold_what_they_say(dye):
    sigma = DYES[dye]

    def seen(depth):
        return spectrum_to_rgb(WAVELENGTHS, np.exp(-sigma * depth), "reflectance")

    thin = 1e-4
    slope = (seen(0) - seen(thin)) / thin
    assert spectrum_to_rgb(WAVELENGTHS, sigma, "extinction", "band") == pytest.approx(slope, abs=1e-3)
    three = spectrum_to_rgb(WAVELENGTHS, sigma, "extinction", "wavelengths")
    assert three == pytest.approx(np.interp([680, 550, 440], WAVELENGTHS, sigma))
    nm, xyz = observer()
    weight = illuminant() * xyz[:, 1]
    depth = weight.sum() / (np.interp(nm, WAVELENGTHS, sigma) @ weight)
    held = np.exp(-depth * spectrum_to_rgb(WAVELENGTHS, sigma, "extinction", "depth"))
    assert held == pytest.approx(np.maximum(seen(depth), 1e-4), abs=2e-3)


def test_colours_outside_rgb_are_listed_with_their_place():
    clipped = {c.where for c in conversions(ColouredGlass().mitsuba(8)) if c.clipped}
    assert clipped == {"ball_cobalt.interior.sigma_t", "ball_ruby.interior.sigma_t"}
    clipped = [c for c in conversions(DeepInterreflection().mitsuba(8)) if c.clipped]
    assert [c.where for c in clipped] == ["wall_right.bsdf.reflectance"]
    assert clipped[0].exact[0] < 0 == clipped[0].used[0]
    assert not any(c.clipped for c in conversions(Atmosphere().mitsuba(8)))


def test_a_spectrum_of_unknown_meaning_is_refused():
    spectrum = DeepInterreflection().mitsuba(8)["wall_left"]["bsdf"]["reflectance"]
    with pytest.raises(BadInput, match=r"thing\.strange.*expected"):
        to_rgb({"type": "scene", "thing": {"type": "thing", "strange": spectrum}})


def test_extinction_in_three_channels_is_followed_channel_by_channel():
    description = to_rgb(ColouredGlass().mitsuba(8))
    assert all(coloured(m) for m in media(description))
    assert integrator(description, RADIANCE)["type"] == "volpathmis"
    grey = {"sigma_t": {"type": "srgb", "color": [2.0, 2.0, 2.0], "unbounded": True}}
    assert not coloured(grey)


# --- renders ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("form", "sampler"), [(radiance, sample), (rgb_radiance, sample_rgb)], ids=["spectral", "rgb"]
)
def test_closed_form_of_glass_agrees_with_volpathmis_and_a_fault_is_caught(form, sampler):
    scene, size = ColouredGlass(), 32
    drawn = Sampled.of(batches(sampler(scene, RADIANCE, size), 64, 16))
    fine, coarse = (box_filter(form(scene, n * size), n) for n in (16, 4))
    slack = np.abs(fine - coarse) + 1e-3  # quadrature at the rims, and the film's 5 nm table
    assert agreement(drawn, Sampled.exact(fine), within=slack).agrees
    wrong = box_filter(form(replace(scene, thickness=3.1), 16 * size), 16)
    assert not agreement(drawn, Sampled.exact(wrong), within=slack).agrees


GREY = {
    "glass": (ColouredGlass(saturation=0.0), replace(ColouredGlass(), saturation=0.0, thickness=3.15)),
    "room": (DeepInterreflection(saturation=0.0), DeepInterreflection(saturation=0.0, albedo=0.84)),
    "air": (Atmosphere(exponent=0.0), Atmosphere(exponent=0.0, density=1.05)),
}


@pytest.mark.parametrize("name", GREY)
def test_without_colour_rgb_rendering_is_spectral_rendering_and_a_fault_is_caught(name):
    scene, wrong = GREY[name]
    spectral = Sampled.of(batches(sample(scene, RADIANCE, 24), 64, 24, seed=1))
    rgb = Sampled.of(batches(sample_rgb(scene, RADIANCE, 24), 64, 24, seed=2))
    slack = 1e-3 * np.abs(spectral.mean)  # white is (1, 1, 1) to 3e-4, and the room multiplies that
    found = agreement(rgb, spectral, within=slack)
    assert found.agrees, found
    fault = Sampled.of(batches(sample_rgb(wrong, RADIANCE, 24), 64, 24, seed=3))
    assert not agreement(fault, spectral, within=slack).agrees


def test_frames_with_scattered_seeds_have_independent_pixels_and_those_in_a_row_have_not():
    scene, spp, size = DeepInterreflection(), 4, 32
    loaded = load_rgb(scene, RADIANCE, size, sampler="multijitter")

    def neighbours(seeds):
        drawn = np.stack([to_array(mi.render(loaded, spp=spp, seed=s)) for s in seeds])[:, 12:]
        mean = drawn.mean(axis=0)
        half = (drawn[: len(drawn) // 2].mean(axis=0) - mean) / np.sqrt(drawn.var(axis=0) + 1e-12)
        return np.corrcoef(half[:, 1:].ravel(), half[:, :-1].ravel())[0, 1]

    assert abs(neighbours(list(itertools.islice(stochastic.frame_seeds(1), 64)))) < 0.1
    assert neighbours(range(64)) > 0.15


# --- errors of a sampled estimate ------------------------------------------------------------------


def test_errors_of_a_sampled_estimate_are_freed_of_both_noises_and_their_intervals_hold(rng):
    shape, k, trials = (12, 12, 3), 16, 300
    true = 1 + rng.random(shape)
    limit = 1.1 * true + 0.1 * rng.standard_normal(shape)
    exact = from_exact(true)
    plain = stochastic.metrics.errors(limit, exact, RADIANCE, None)
    names = ("bias", "rmse", "gain", "rmse_gain")
    held, values = dict.fromkeys(names, 0), {n: [] for n in names}
    for _ in range(trials):
        a, r = (
            from_batches(mean + size * noise(rng, (k, *shape))) for mean, size in ((limit, 0.5), (true, 0.3))
        )
        found = stochastic.errors(a, r, RADIANCE, None)
        for n in names:
            held[n] += found[n].low <= plain[n].value <= found[n].high
            values[n].append(found[n].value)
    for n in names:
        assert 0.9 <= held[n] / trials <= 0.99, n
        assert np.mean(values[n]) == pytest.approx(plain[n].value, abs=0.012), n
    naive = stochastic.metrics.errors(a.mean, r, RADIANCE, None)["rmse"]
    assert not naive.low <= plain["rmse"].value <= naive.high


def noise(rng, shape):
    """Normal noise that the channels of a pixel share in part."""
    return rng.standard_normal(shape) + rng.standard_normal((*shape[:-1], 1))


def from_exact(mean):
    return Truth(mean, np.zeros_like(mean), np.eye(3), None, 0)


def test_noise_is_that_of_a_single_frame():
    estimate, finer = (sampled(rgb_rendering(DeepInterreflection(), RADIANCE, 16, spp=n), 1) for n in (4, 64))
    truth = from_exact(finer.mean)
    ratio = stochastic.noise(estimate, truth) / stochastic.noise(finer, truth)
    assert ratio == pytest.approx(4, rel=0.3)


# --- the measured row ------------------------------------------------------------------------------


def test_every_spectral_scene_is_planned_with_its_sweeps_and_the_path_tracer():
    tasks = plan([find_measured(RGB_RENDERING)], PROFILES["quick"])
    roles = {(t.technique, t.scene, r) for t in tasks for r in t.roles}
    for scene in SCENES:
        name = scene.__name__
        assert (RGB_RENDERING, name, "default") in roles
        assert (PATH_TRACER, name, "path tracer") in roles
        for axis in declared().stress[name]:
            assert (RGB_RENDERING, name, f"stress:{axis}") in roles
        assert ((RGB_RENDERING, name, "knob:extinction") in roles) == (scene is not DeepInterreflection)


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setenv("LIGHTPROOF_STORE", str(tmp_path))


def test_records_fit_the_schema_and_hold_error_noise_and_cost(store):
    schema = json.loads((ROOT / "compare/measurement.schema.json").read_text())
    task = Task(
        RGB_RENDERING,
        "DeepInterreflection",
        16,
        {},
        declared().settings({"spp": 64}),
        ("radiance",),
        ("knob:spp",),
        batches=16,
    )
    tracer = replace(task, technique=PATH_TRACER, knobs={"spp": 4}, roles=("path tracer",))
    with tempfile.TemporaryDirectory() as folder:
        (record,), (curve,) = (measure(t, Path(folder)) for t in (task, tracer))
    for r in (record, curve):
        jsonschema.validate(json.loads(json.dumps(r)), schema)
        assert "negative" not in {f["kind"] for f in r["findings"]}
    e = record["errors"]
    assert record["stochastic"] and record["noise"] > 0.05
    assert 0.04 < e["bias"]["low"] < e["bias"]["high"] < 0.07
    assert 0.08 < e["rmse"]["low"] < e["rmse"]["high"] < 0.15
    assert record["costs"]["frame_ms"]["value"] > 0
    assert curve["truth"]["key"] == record["truth"]["key"]
    assert abs(curve["errors"]["bias"]["value"]) < 0.03


def test_a_threshold_can_name_rgb_rendering(tmp_path):
    path = tmp_path / "thresholds.toml"
    path.write_text(
        '[[threshold]]\ntechnique = "rgb_rendering"\nscene = "ColouredGlass"\nquantity = "radiance"\n'
        'metric = "rmse"\nat_most = 0.07\nat_least = 0.05\npays = "spectrum"\n'
    )
    (threshold,) = gate.load_thresholds(path)
    (task,) = gate.tasks([threshold], [find_measured(RGB_RENDERING)])
    assert threshold.asks(task, "radiance") and task.size == 128
    with pytest.raises(BadInput, match="rgb_rendering"):
        find_measured("rgb_renderin")
