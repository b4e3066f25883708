"""Linearly transformed cosines: the fitted lobes as distributions, and the technique against Mitsuba."""

import math

import mitsuba as mi
import numpy as np
import pytest

from approximations.area_lights.linearly_transformed_cosines import bake, linearly_transformed_cosines
from approximations.kit import ltc_fit
from compare.measure import as_image
from reference.closed_form.area_lights import diffuse_floor
from scenes.area_lit import AreaLitPlane, DiffuseAreaLitPlane

KEPT = np.load(ltc_fit.TABLE)
SIDE = ltc_fit.SIDE


def image(scene, size=8, **knobs):
    view = scene.view(size)
    return as_image(linearly_transformed_cosines(view, bake(view), **knobs), size, "ltc")[..., 0]


def view_of(j):
    cos = max(1 - (j / (SIDE - 1)) ** 2, 1e-3)
    return np.array([math.sqrt(1 - cos * cos), 0, cos])


def matrix(i, j):
    a, b, c, d = KEPT["inverse"][i, j].astype(float)
    return np.linalg.inv(np.array([[a, 0, b], [0, 1, 0], [c, 0, d]]))


@pytest.mark.parametrize(("i", "j"), [(63, 0), (63, 63), (40, 10), (40, 50), (20, 30), (50, 60)])
def test_a_transformed_cosine_integrates_to_one_over_the_sphere(i, j):
    z, phi = np.meshgrid((np.arange(600) + 0.5) / 300 - 1, (np.arange(800) + 0.5) * np.pi / 400)
    s = np.sqrt(1 - z * z)
    w = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1).reshape(-1, 3)
    assert 4 * np.pi * ltc_fit.transformed_cosine(matrix(i, j), w).mean() == pytest.approx(1, abs=2e-3)


def test_the_table_is_what_the_fit_finds_and_the_lobe_leans_away_from_the_eye():
    i, j = 32, 40
    alpha, v = (i / (SIDE - 1)) ** 2, view_of(j)
    m, albedo, _ = ltc_fit.fit_cell(v, alpha, np.array([np.log(alpha)] * 2 + [0.0]))
    k = np.linalg.inv(m)
    found = np.array([k[0, 0], k[0, 2], k[2, 0], k[2, 2]]) / k[1, 1]
    np.testing.assert_allclose(found, KEPT["inverse"][i, j], rtol=0.02, atol=0.02)
    assert albedo == pytest.approx(KEPT["albedo"][i, j], rel=1e-3)
    assert m[0, 2] < 0


@pytest.mark.parametrize(("roughness", "albedo"), [(0.5, 0.92), (1.0, 0.31)])
def test_albedo_head_on_is_the_furnace_of_single_scattering(roughness, albedo):
    row = roughness * (SIDE - 1)
    i = int(row)
    a = KEPT["albedo"][:, 0]
    assert a[i] + (row - i) * (a[min(i + 1, SIDE - 1)] - a[i]) == pytest.approx(albedo, abs=0.005)


@pytest.mark.parametrize(("i", "j"), [(12, 20), (36, 16), (36, 44), (63, 40)])
def test_a_white_furnace_gives_the_albedo_less_what_the_lobe_has_below_the_surface(i, j):
    cos = view_of(j)[2]
    furnace = AreaLitPlane(
        size=20.0,
        height=0.02,
        tilt=0.0,
        radiance=1.0,
        albedo=0.0,
        specular=0.5,
        roughness=i / (SIDE - 1),
        view_elevation=math.degrees(math.asin(cos)),
    )
    lobe = ltc_fit.cosine_samples(400) @ matrix(i, j).T
    share = np.mean(lobe[:, 2] > 0)
    assert image(furnace).mean() == pytest.approx(0.5 * KEPT["albedo"][i, j] * share, rel=0.003)
    assert share > (0.88 if cos < 0.6 else 0.97)


def test_against_mitsuba_at_random_roughness_view_and_polygon():
    rng = np.random.default_rng(5)
    shares = []
    for k in range(8):
        scene = AreaLitPlane(
            roughness=rng.uniform(0.25, 1),
            view_elevation=rng.uniform(25, 90),
            size=rng.uniform(0.2, 1.5),
            height=rng.uniform(0.8, 2),
            tilt=rng.uniform(0, 60),
            albedo=0.0,
        )
        loaded = mi.load_dict({**scene.mitsuba(8), "integrator": {"type": "direct"}})
        truth = np.array(mi.render(loaded, spp=1024, seed=k))[..., 0]
        view = scene.view(32)
        fine = as_image(linearly_transformed_cosines(view, bake(view)), 32, "ltc")[..., 0]
        found = fine.reshape(8, 4, 8, 4).mean(axis=(1, 3))
        shares.append(np.abs(found - truth).mean() / truth.mean())
    assert np.median(shares) < 0.05
    assert np.max(shares) < 0.2


def test_light_below_the_surface_leaks_unless_it_is_cut_twice():
    scene = AreaLitPlane(height=0.1, tilt=90.0, albedo=0.0)
    exact = image(scene, 32, lobe="exact")
    errors = [np.abs(image(scene, 32, horizon=h) - exact).mean() for h in ("both", "clipped")]
    assert errors[0] < 0.8 * errors[1]
    assert image(scene, 32).mean() > 1.05 * image(scene, 32, horizon="both").mean()


def test_author_would_not_use_it_for_tubes_and_mirrors():
    domain = linearly_transformed_cosines.domain_function
    assert domain(AreaLitPlane()).inside and domain(DiffuseAreaLitPlane(shape="disk")).inside
    assert not domain(AreaLitPlane(shape="tube")).inside
    assert not domain(AreaLitPlane(roughness=0.0)).inside


@pytest.mark.parametrize("shape", ["disk", "rectangle", "sphere"])
@pytest.mark.parametrize("height", [0.2, 1.5])
def test_diffuse_light_is_lamberts_contour_integral(shape, height):
    scene = DiffuseAreaLitPlane(shape=shape, height=height, tilt=70.0)
    truth = diffuse_floor(scene, 24)[..., 0]
    assert np.abs(image(scene, 24, edges=48) - truth).mean() < 2e-3 * truth.mean()
