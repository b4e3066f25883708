"""Noise in textures and the density made of it: ranges, sizes, remaps, profiles, readings of print."""

import time

import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.cloud_density import bake as density_bake
from approximations.clouds.cloud_density import cloud_density
from approximations.clouds.cloud_noise import bake as noise_bake
from approximations.clouds.cloud_noise import packed_noise
from approximations.kit.cloud_model import (
    bytes_of,
    detail_noise,
    in_bits,
    packed,
    packed_curl,
    perlin_sum,
    profile,
    remap,
    shape_noise,
)
from reference.closed_form.cloud_density import density_in_section
from reference.closed_form.cloud_noise import noise_on_plane
from reference.verify.routes_cloud_noise import density_against_tree, noise_against_tree
from scenes.cloud_noise import worley
from scenes.density_section import DensitySection
from scenes.noise_tile import NoiseTile


def channels(noise, size, storage="exact"):
    return np.array(packed(noise, size, storage).tensor()).reshape(size**3, -1)


def noise_error(scene, frame=None, **knobs):
    view = scene.probes(48)
    found = np.array(packed_noise(view, noise_bake(view, **knobs), **(frame or {}))).reshape(48, 48, 1)
    return np.sqrt(np.mean((found - noise_on_plane(scene, 48)) ** 2))


def test_means_and_ranges_of_the_channels():
    anywhere = mi.Point3f(np.random.default_rng(1).random((3, 200_000)).astype(np.float32))
    shape, detail = (np.array(noise(anywhere)) for noise in (shape_noise, detail_noise))
    assert shape.mean(1) == pytest.approx([0.738, 0.477, 0.477, 0.477], abs=0.003)
    assert shape.min(1) == pytest.approx([0.36, 0.04, 0.015, 0.0], abs=0.05)
    assert shape.max(1) == pytest.approx([0.974, 0.91, 0.92, 0.967], abs=0.05)
    assert detail.mean(1) == pytest.approx([0.466, 0.475, 0.475], abs=0.003)


def test_readings_of_the_first_channel_keep_their_order():
    read = {
        f: channels(lambda q, f=f: shape_noise(q, 8, f), 32)[:, 0] for f in ("dilated", "printed", "product")
    }
    p = channels(lambda q: [perlin_sum(q, 8)], 32)[:, 0]
    assert (read["dilated"] >= p).all() and (read["printed"] <= p).all() and (read["product"] <= p).all()
    assert read["printed"].min() < -2 and 0.4 < (read["printed"] < 0).mean() < 0.48
    w = (read["dilated"] - p) / (1 - p)
    assert np.allclose(read["product"], w * p, atol=1e-5)
    assert np.allclose(read["printed"], (p - w) / (1 - w), atol=1e-3)


def test_folded_billows_reach_nought_and_stay_in_range():
    billows = channels(lambda q: shape_noise(q, 8, "billows"), 32)[:, 0]
    assert 0 <= billows.min() < 0.001 and billows.max() < 1


def test_shape_texture_is_8_mib_and_is_built_in_seconds():
    assert bytes_of(128, 4, 8) == 8 * 2**20 and bytes_of(32, 3, 8) == 96 * 2**10
    start = time.process_time()
    channels(shape_noise, 64)
    assert time.process_time() - start < 20 / 8  # of the texels, and of the time, of 128^3


def test_textures_repeat_and_give_their_texels_in_the_middles():
    texture = packed(shape_noise, 32, "exact")
    at = (np.array([[3, 0, 31], [7, 0, 16], [30, 31, 2]]) + 0.5) / 32
    for shift in (0, 1, -2):
        found = np.array(texture.eval(mi.Point3f(at + shift))[0])
        assert found == pytest.approx(np.array(shape_noise(mi.Point3f(at))[0]), abs=2e-5)


def test_bits_round_to_the_nearest_of_their_steps():
    x = np.linspace(0, 1, 1001)
    assert np.abs(in_bits(x, "8 bits") - x).max() == pytest.approx(0.5 / 255, rel=0.05)
    assert np.abs(in_bits(x, "16 bits") - x).max() < 0.51 / 65535
    assert in_bits(np.array([-0.5, 1.5]), "8 bits") == pytest.approx([0, 1])
    assert len(np.unique(in_bits(np.linspace(0, 1, 100_001), "8 bits"))) == 256
    assert (in_bits(x - 3, "exact") == x - 3).all()


def test_curl_noise_fits_its_texture():
    curl = np.array(packed_curl(64, "exact").tensor())
    assert np.abs(curl).max() < 2 and 0.5 < curl.std() < 0.9
    assert np.abs(curl.mean(axis=(0, 1))).max() < 0.02


def test_remap_maps_the_ends_and_grows():
    v = mi.Float([0.2, 0.5, 0.8, 1.4])
    assert np.array(remap(v, 0.2, 0.8, 3.0, 5.0)) == pytest.approx([3, 4, 5, 7], rel=1e-6)
    assert float(remap(0.6, 0.5, 1, 0, 1)) == pytest.approx(0.2)


def test_profiles_are_those_of_their_types_and_blends_differ_between():
    def at(h, type, blend="functions"):
        return np.array(profile(mi.Float(h), type, blend))

    h = np.linspace(0, 1, 501)
    for type, heights in ((0, (0.05, 0.09)), (0.5, (0.2, 0.48)), (1, (0.0625, 0.78))):
        for blend in ("functions", "parameters"):
            found = at(h, type, blend)
            inside = (h > heights[0]) & (h < heights[1])
            assert (found[inside] > 0.999).all() and found.min() > -1e-6 and found[0] < 1e-6
    # integral of smoothstep(a, b) - smoothstep(c, d) over h: (c + d - a - b) / 2
    assert at(h, 1).mean() == pytest.approx((0.78 + 1 - 0.01 - 0.0625) / 2, abs=0.003)
    assert at(h, 0.5).mean() == pytest.approx((0.48 + 0.625 - 0.02 - 0.2) / 2, abs=0.003)


def test_mixed_profiles_have_two_decks_and_mixed_heights_one():
    h = mi.Float(np.linspace(0, 1, 501))
    for blend, decks in (("functions", 2), ("parameters", 1)):
        slope = np.diff(np.array(profile(h, 0.15, blend)))
        slope = slope[np.abs(slope) > 1e-6]
        turns = np.sum((slope[1:] < 0) & (slope[:-1] > 0))
        assert (turns, blend) == (decks, blend)


@pytest.mark.parametrize("channel", "RGBA")
def test_composed_octaves_are_the_closed_form(channel):
    assert noise_error(NoiseTile(channel=channel), {"lookup": "exact"}, resolution=4) < 1e-6


def test_errors_fall_as_the_square_of_the_texel_and_stop_at_half_a_step():
    scene = NoiseTile(cells=2)
    coarse, fine = (noise_error(scene, resolution=n, storage="exact") for n in (32, 64))
    assert 2.8 < coarse / fine < 5
    assert noise_error(scene, {"lookup": "nearest"}, resolution=64) > 1.5 * noise_error(scene, resolution=64)
    assert noise_error(scene, resolution=64, storage="8 bits") > fine
    assert noise_error(NoiseTile(cells=8), resolution=64, storage="exact") > 3 * fine


def test_worley_noise_is_one_at_a_feature_point_and_falls_by_a_cell_a_unit():
    line = np.stack([np.linspace(0, 1, 4001), np.full(4001, 0.3), np.full(4001, 0.7)])
    values = np.array(worley(mi.Point3d(line), 4))
    assert np.abs(np.diff(values)).max() <= 4 / 4000 * 1.0001 and 0 <= values.min() < values.max() < 1


def test_noise_is_that_of_trees_and_lists():
    for c in noise_against_tree(1):
        assert np.abs(c.first.mean - c.second.mean).max() < 1e-12, c.label


@pytest.fixture(scope="module")
def textures():
    return density_bake(resolution=64)


def section(textures, fields=None, **knobs):
    return np.array(cloud_density(DensitySection(**(fields or {})).probes(64), textures, **knobs))


WEATHERS = [
    {},
    {"type": 0.3, "cover": 1.5},
    {"type": 0.1, "cover": 1.6},
    {"precipitation": 0.6},
    {"cover": 0.7},
]


def test_density_from_noise_itself_is_the_closed_form(textures):
    exact = density_in_section(DensitySection(precipitation=0.6), 64).ravel()
    assert np.abs(section(textures, {"precipitation": 0.6}, lookup="exact") - exact).max() < 2e-5


@pytest.mark.parametrize("fields", WEATHERS)
def test_density_from_textures_is_near_the_closed_form(textures, fields):
    exact = density_in_section(DensitySection(**fields), 64).ravel()
    assert 1e-4 < np.sqrt(np.mean((section(textures, fields) - exact) ** 2)) < 0.01


@pytest.mark.parametrize("fields", WEATHERS)
def test_a_cheap_sample_is_nowhere_the_lower(textures, fields):
    cheap, full = (section(textures, fields, sampler=s) for s in ("cheap", "full"))
    assert (cheap >= full - 1e-6).all() and cheap.mean() > 1.05 * full.mean()


def test_more_coverage_makes_more_cloud_and_less_as_printed(textures):
    for coverage, sign in (("reconstructed", 1), ("printed", -1)):
        knobs = {"coverage": coverage, "sampler": "cheap"}
        thin, thick = (section(textures, {"cover": x}, **knobs).reshape(64, 64) for x in (1.0, 1.5))
        middle = slice(24, 40)
        assert sign * (thick - thin)[middle, middle].mean() > 0.1


def test_unclamped_density_is_negative_beside_the_cloud_and_the_same_within(textures):
    clamped, raw = section(textures), section(textures, clamp=False)
    assert raw.min() < -0.5 and (raw < 0).mean() > 0.4
    assert np.allclose(np.clip(raw, 0, 1), clamped, atol=1e-6)


def test_rain_covers_seven_tenths_and_grows_tall(textures):
    dry, wet = (section(textures, {"type": 0.0, "precipitation": r}).reshape(64, 64) for r in (0.0, 1.0))
    assert dry[:32].max() == 0 and wet[16:40, :4].mean() > 0.05
    assert np.array_equal(wet, section(textures, {"type": 1.0, "precipitation": 1.0}).reshape(64, 64))


def test_detail_is_turned_over_at_the_base(textures):
    plain, wisps = (section(textures, wispy=w).reshape(64, 64) for w in (1000.0, 10.0))
    top = slice(0, 55)  # above a tenth of the layer
    assert np.allclose(plain[top], wisps[top], atol=1e-6) and not np.allclose(
        plain[55:], wisps[55:], atol=1e-3
    )


def test_density_is_that_of_trees_and_lists():
    for c in density_against_tree(1):
        assert np.abs(c.first.mean - c.second.mean).max() < 1e-12, c.label


def test_mitsuba_sees_the_field_the_right_way_up():
    for scene in (NoiseTile(span=0.2), DensitySection()):
        world = mi.load_dict(scene.mitsuba(128) | {"integrator": {"type": "path"}})
        seen = np.array(mi.render(world, spp=4, seed=1))[..., :1]
        assert np.corrcoef(seen.ravel(), scene.values(128).ravel())[0, 1] > 0.98
