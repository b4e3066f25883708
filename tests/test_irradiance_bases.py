"""Irradiance in a few numbers, and what stands in for light on a model: against figures known beforehand."""

import dataclasses
import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.ambient import ambient_cube as cube_module
from approximations.ambient import two_lights_folded as folded_module
from approximations.ambient.ambient_cube import HALF_AXES, AmbientCube, ambient_cube, evaluate_cube
from approximations.ambient.half_lambert import energy_factor, fitted_factor, half_lambert
from approximations.ambient.lambert_ambient import bake as probe_bake
from approximations.ambient.lambert_ambient import lambert_ambient
from approximations.ambient.phong_rim import phong_rim
from approximations.ambient.prefiltered_environment import bake as filter_probe
from approximations.ambient.prefiltered_environment import filtered, prefiltered_environment
from approximations.ambient.sh_irradiance import bake as harmonics_bake
from approximations.ambient.sh_irradiance import sh_irradiance
from approximations.ambient.split_sum import reflected, split_sum
from approximations.ambient.two_lights_folded import two_lights_folded
from approximations.kit import cube_map
from approximations.kit.spherical_harmonics import COSINE, evaluate, irradiance
from reference.closed_form import ball
from scenes.ball_in_room import BallInRoom
from scenes.contract import Camera, PointLight, Surface, View
from scenes.environment_ball import EnvironmentBall, GlossyBall
from scenes.lamps import BallUnderLamps, PolishedBall


def sphere(n):
    """n unit vectors spread evenly, (n, 3)."""
    z = (2 * np.arange(n) + 1) / n - 1
    phi = np.arange(n) * math.pi * (3 - math.sqrt(5))
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)


def vector(v):
    """(n, 3) NumPy to a Dr.Jit vector."""
    return mi.Vector3f(np.asarray(v, np.float32).T.copy())


def white(normals, position=None, **light):
    """White points that face `normals` at the origin, or where `position` says."""
    n, ones = len(normals), dr.ones(mi.Float, len(normals))
    at = mi.Point3f(vector(np.zeros((n, 3)) if position is None else position))
    surface = Surface(ones > 0, at, vector(normals), mi.Color3f(ones), ones)
    camera = Camera(mi.Point3f(0), mi.Vector3f(0, 0, -1), mi.Vector3f(0, 0, -1), 0.01, 1e4)
    return View(n, 1, camera, surface=surface, **light)


def values(colour):
    return np.array(colour, np.float64).T


def cube_of(light, normals):
    """E of a facing irradiance 1 from `light`, through the cube filled at its axes."""
    c = np.maximum(HALF_AXES @ light, 0)
    return values(evaluate_cube([mi.Color3f(x) for x in c.tolist()], vector(normals)))[:, 0]


# Ambient cube (T23)


def test_cube_filled_at_the_axes_errs_under_a_point_light_as_known():
    n = sphere(2000)
    errors = np.array([cube_of(l, n) - np.maximum(n @ l, 0) for l in sphere(200)])
    assert np.sqrt((errors**2).mean()) == pytest.approx(0.149, abs=1e-3)
    diagonal = np.array([1.0, 1.0, 1.0]) / math.sqrt(3)
    worst = np.abs(cube_of(diagonal, n) - np.maximum(n @ diagonal, 0)).max()
    assert max(worst, np.abs(errors).max()) == pytest.approx(0.42, abs=5e-3)


def test_cube_fitted_to_all_normals_errs_under_a_point_light_as_known():
    directions, weight = cube_map.texel_directions(cube_module.NORMALS)
    fitted_at, weight = values(directions), np.array(weight, np.float64)
    lights = np.vstack([sphere(300), np.ones((1, 3)) / math.sqrt(3)])
    colours = cube_module.fitted_colours(np.maximum(fitted_at @ lights.T, 0), fitted_at, weight)
    n = sphere(3000)
    halves = np.stack([np.maximum(n, 0), np.minimum(n, 0)], axis=2)
    errors = np.square(halves).reshape(-1, 6) @ colours - np.maximum(n @ lights.T, 0)
    assert np.sqrt((errors**2).mean()) == pytest.approx(0.135, abs=1e-3)
    assert np.abs(errors).max() == pytest.approx(0.39, abs=5e-3)


def test_linear_environment_through_the_cube_errs_as_known():
    b, n = np.array([0.48, -0.6, 0.64]), sphere(4000)
    view = white(n, environment=lambda w: mi.Color3f(dr.inv_pi * (1 + dr.dot(mi.Vector3f(b), w))))
    truth = 1 + 2 / 3 * n @ b
    baked = cube_module.bake(view)
    found = math.pi * values(ambient_cube(view, baked))[:, 0]
    assert np.sqrt(((found - truth) ** 2).mean()) == pytest.approx(0.122, abs=1e-3)
    k = np.array([[1.0, 1.0, 1.0]]) / math.sqrt(3)
    left = evaluate_cube([mi.Color3f(x) for x in (HALF_AXES @ k[0]).tolist()], vector(k))
    assert values(left)[0, 0] == pytest.approx(0.577, abs=1e-3)


def test_axes_of_the_cube_are_not_swapped():
    colours = [mi.Color3f(k) for k in range(1, 7)]
    assert values(evaluate_cube(colours, vector(HALF_AXES)))[:, 0].tolist() == [1, 2, 3, 4, 5, 6]


def test_bake_of_the_cube_is_the_irradiance_at_the_axes():
    scene = EnvironmentBall(turn=60.0, sharpness=5.0)
    found = np.array([values(c)[0] for c in cube_module.bake(scene.view(2)).colours])
    np.testing.assert_allclose(found, ball.irradiance(scene, HALF_AXES.astype(float)), rtol=2e-3)


def test_fitted_cube_is_nearer_than_the_one_filled_at_the_axes():
    scene, n = EnvironmentBall(), sphere(500)
    truth = ball.irradiance(scene, n)
    errors = []
    for fill in ("axes", "least squares"):
        cube = cube_module.bake(scene.view(2), fill=fill)
        errors.append(np.sqrt(((values(evaluate_cube(cube.colours, vector(n))) - truth) ** 2).mean()))
    assert errors[1] < 0.95 * errors[0]


# Cube maps


def test_texel_directions_fill_the_sphere_and_find_their_own_texel():
    for n in (1, 4, 16):
        w, solid_angle = cube_map.texel_directions(n)
        assert n == 1 or float(dr.sum(solid_angle)[0]) == pytest.approx(4 * math.pi, rel=0.25 / n**2)
        face, u, v = (np.array(c) for c in cube_map.face_coordinates(w))
        k = np.arange(6 * n * n)
        assert np.array_equal(face, k // n**2)
        np.testing.assert_allclose(u, (2 * (k % n) + 1) / n - 1, atol=1e-6)
        np.testing.assert_allclose(v, (2 * (k // n % n) + 1) / n - 1, atol=1e-6)


def test_lookup_is_exact_at_texel_centres_of_every_level():
    levels = [mi.Float(np.random.default_rng(n).uniform(size=6 * n * n)) for n in (8, 4, 2, 1)]
    cube = cube_map.cube_map(levels)
    for k, (n, texels) in enumerate(zip((8, 4, 2, 1), levels, strict=True)):
        found = np.array(cube_map.lookup(cube, cube_map.texel_directions(n)[0], float(k)))
        np.testing.assert_allclose(found, np.array(texels), atol=2e-6)


def test_lookup_has_no_seams():
    cube = cube_map.cube_map(cube_map.mip_chain(mi.Float(np.random.default_rng(1).uniform(size=6 * 64))))
    t = np.random.default_rng(2).uniform(-1, 1, 500)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            edge = np.zeros((500, 3))
            edge[:, a], edge[:, b], edge[:, 3 - a - b] = signs[0], signs[1], t
            across = edge.copy()
            edge[:, a] *= 1 + 1e-5
            across[:, a] *= 1 - 1e-5
            for level in (0.0, 1.4):
                gap = cube_map.lookup(cube, vector(edge), level) - cube_map.lookup(
                    cube, vector(across), level
                )
                assert np.abs(np.array(gap)).max() < 3e-4


def test_lookup_of_a_smooth_environment_is_near_it():
    def radiance(w):
        return mi.Color3f(1 + w.x * w.y, 1 + w.z * w.y * w.z, w.x + 2 * w.y)

    cube = cube_map.cube_map([cube_map.environment_map(32, radiance, samples=4)])
    w = vector(sphere(5000))
    assert np.abs(values(cube_map.lookup(cube, w) - radiance(w))).max() < 1.5e-2


# Two lights and the rest (T25)


def test_folded_light_on_a_diagonal_keeps_its_strength_times_0_577():
    diagonal = np.ones(3) / math.sqrt(3)
    far = PointLight(mi.Point3f((1e3 * diagonal).tolist()), mi.Color3f(math.pi * 1e6))
    n = np.vstack([diagonal, [1, 0, 0], np.array([1.0, -1, -1]) / math.sqrt(3)])
    view = white(n, points=(far,), sky=0.0)
    found = values(two_lights_folded(view, (0,), main=0))[:, 0]
    assert found[0] == pytest.approx(0.577, abs=1e-3)
    assert found[1] == pytest.approx(0.577, abs=1e-3)
    assert found[2] == pytest.approx(0.577 / 3, abs=1e-3)  # faces away by 109 degrees
    assert values(two_lights_folded(view, (0,), main=1))[:, 0] == pytest.approx([1, 0.577, 0], abs=2e-3)


def test_ranking_puts_the_named_measure_first():
    lights = ((3.0, 9.0), (1.0, 2.0), (2.0, 6.0))  # distance, intensity
    points = tuple(PointLight(mi.Point3f(0, 0, d), mi.Color3f(i)) for d, i in lights)
    view = white(np.array([[0.0, 0, 1]]), points=points, sky=0.0)
    assert folded_module.bake(view, ranking="irradiance") == (1, 2, 0)
    assert folded_module.bake(view, ranking="intensity") == (0, 2, 1)
    assert folded_module.bake(view, ranking="distance") == (1, 2, 0)


def test_image_jumps_where_two_equal_lights_change_places():
    scene = BallUnderLamps(lamps=3)
    view = scene.view(32)
    swapped = values(two_lights_folded(view, (0, 2, 1))) - values(two_lights_folded(view, (0, 1, 2)))
    assert np.abs(swapped).max() > 0.1 * values(two_lights_folded(view, (0, 1, 2))).mean()
    exact = values(two_lights_folded(view, (0, 2, 1), fold="exact"))
    np.testing.assert_allclose(exact, ball.ball_under_lamps(scene, 32).reshape(-1, 3), atol=1e-5)


# Half Lambert (T26)


def profile(x, **knobs):
    """h at cosines x of a light that gives a facing surface the irradiance pi."""
    n = np.stack([np.sqrt(1 - x * x), 0 * x, x], axis=1)
    view = white(n, points=(PointLight(mi.Point3f(0, 0, 1e3), mi.Color3f(math.pi * 1e6)),))
    return values(half_lambert(view, **knobs))[:, 0]


def test_half_lambert_adds_light_as_known():
    x = (2 * np.arange(20000) + 1) / 20000 - 1
    h, lambert = profile(x), np.maximum(x, 0)
    assert h.mean() == pytest.approx(1 / 3, abs=1e-4)
    assert lambert.mean() == pytest.approx(1 / 4, abs=1e-4)
    assert (h - lambert).max() == pytest.approx(0.25, abs=1e-4)
    assert abs(x[np.argmax(h - lambert)]) < 1e-3
    assert np.sqrt(((h - lambert) ** 2).mean()) == pytest.approx(0.112, abs=5e-4)
    assert fitted_factor(1.0, 2.0) == pytest.approx(0.885, abs=5e-4)
    fitted = profile(x, level="fitted")
    assert np.sqrt(((fitted - lambert) ** 2).mean()) == pytest.approx(0.099, abs=5e-4)


@pytest.mark.parametrize(("wrap", "exponent"), [(1.0, 2.0), (1.0, 1.0), (0.5, 2.0), (0.0, 1.0), (0.3, 3.5)])
def test_factors_of_half_lambert_are_what_they_are_called(wrap, exponent):
    x = (2 * np.arange(20000) + 1) / 20000 - 1
    plain = profile(x, wrap=wrap, exponent=exponent)
    lambert = np.maximum(x, 0)
    assert energy_factor(wrap, exponent) * plain.mean() == pytest.approx(0.25, abs=1e-4)
    best = (plain * lambert).mean() / (plain**2).mean()
    assert fitted_factor(wrap, exponent) == pytest.approx(best, rel=1e-3)


def test_light_gathered_in_an_empty_room_is_what_its_walls_give():
    scene = BallInRoom(room=0.4)
    cube = probe_bake(scene.view(2), paths=64)
    position, intensity = scene.lamp()
    walls = sphere(20000) * scene.RADIUS
    toward = np.array(position) - walls
    cosine = (walls * toward).sum(axis=1) / scene.RADIUS
    first = 0.4 / math.pi * intensity * np.abs(cosine) / np.linalg.norm(toward, axis=1) ** 3
    mean = first.mean() / (1 - 0.4)  # an integrating sphere: every further bounce is uniform
    assert values(cube.colours[0])[0, 0] == pytest.approx(math.pi * mean, rel=0.03)


def test_light_of_a_probe_and_of_lamps_add_up():
    scene = BallInRoom()
    view = scene.view(16)
    none = AmbientCube([mi.Color3f(0)] * 6)
    one = AmbientCube([mi.Color3f(math.pi)] * 6)
    direct = values(lambert_ambient(view, none))[:, :1]
    np.testing.assert_allclose(direct, ball.ball_in_room(scene, 16).reshape(-1, 1), atol=1e-5)
    np.testing.assert_allclose(values(lambert_ambient(view, one))[:, :1] - direct, scene.albedo, atol=1e-5)


# Truths


@pytest.mark.parametrize("sharpness", [0.1, 3.0, 300.0])
def test_irradiance_of_a_lobe_is_its_plain_integral(sharpness):
    """Over the sphere in the lobe's own coordinates: Gauss-Legendre in the cosine, even steps in azimuth."""
    low = max(-1.0, 1 - 40 / sharpness)
    c, weight = np.polynomial.legendre.leggauss(400)
    c, weight = low + (1 - low) * (c + 1) / 2, weight * (1 - low) / 2
    phi = (np.arange(400) + 0.5) / 400 * 2 * np.pi
    lobe = sharpness * np.exp(sharpness * (c - 1)) / (2 * np.pi * -math.expm1(-2 * sharpness))
    theta = np.array([0.0, 0.7, 1.5, 2.2, 3.0])
    s = np.sqrt(1 - c * c)
    cosine = np.cos(theta)[:, None, None] * c[:, None] + np.sin(theta)[:, None, None] * (
        s[:, None] * np.cos(phi)
    )
    plain = (np.maximum(cosine, 0) * (lobe * weight)[:, None]).sum(axis=(1, 2)) * 2 * np.pi / 400
    np.testing.assert_allclose(ball.lobe_irradiance(np.cos(theta), sharpness), plain, atol=2e-5)


@pytest.mark.parametrize(
    "scene",
    [EnvironmentBall(), BallUnderLamps(), BallInRoom(), PolishedBall()],
    ids=lambda s: type(s).__name__,
)
def test_normals_of_the_closed_forms_are_those_of_the_view(scene):
    n, met, d = ball.normals(scene, 16)
    view = scene.view(16)
    assert np.array_equal(met, np.array(view.surface.valid))
    np.testing.assert_allclose(n[met], values(view.surface.normal)[met], atol=1e-5)
    np.testing.assert_allclose(np.broadcast_to(d, (256, 3)), values(view.camera.direction), atol=1e-6)


def test_lamps_give_pi_in_all_at_the_middle():
    for lamps in (1, 5, 16):
        scene = BallUnderLamps(lamps=lamps)
        total = sum(i[0] / scene.TINTS[k % 3][0] / np.dot(p, p) for k, (p, i) in enumerate(scene.lamp_list()))
        assert total == pytest.approx(math.pi)


# Spherical harmonics


@pytest.mark.parametrize(("bands", "rms", "worst"), [(2, 0.144, 0.25), (3, 0.036, 0.094)])
def test_harmonics_err_under_a_point_light_as_known(bands, rms, worst):
    light, n = np.array([[0.6, -0.48, 0.64]]), sphere(4000)
    basis = values(dr.sh_eval(vector(light), bands - 1))[0]
    colours = irradiance([mi.Color3f(c) for c in basis.tolist()])
    errors = values(evaluate(colours, vector(n)))[:, 0] - np.maximum(n @ light[0], 0)
    assert np.sqrt((errors**2).mean()) == pytest.approx(rms, abs=1e-3)
    assert np.abs(errors).max() == pytest.approx(worst, abs=2e-3)


def test_cosine_coefficients_are_those_of_the_closed_form():
    np.testing.assert_allclose(COSINE, ball.cosine_coefficients(4), atol=1e-12)


def test_harmonics_do_not_depend_on_how_the_axes_lie():
    errors = []
    for turn in (0.0, 30.0, 54.7, 120.0):
        scene, n = EnvironmentBall(turn=turn, sharpness=8.0), sphere(1000)
        found = values(evaluate(harmonics_bake(scene.view(2)).colours, vector(n)))
        errors.append(np.sqrt(((found - ball.irradiance(scene, n)) ** 2).mean()))
    assert max(errors) < 1.05 * min(errors)


# Phong and Fresnel (T27)


def test_phong_keeps_its_energy_only_with_the_norm_of_the_lobe():
    """Over all ways out of a lamp straight above: the lobe's integral, times 2 / (e + 1) without norm."""
    v = sphere(40000)
    v = v[v[:, 2] > 0]
    n = np.tile([0.0, 0, 1], (len(v), 1))
    lamp = PointLight(mi.Point3f(0, 0, 1e3), mi.Color3f(1e6))
    view = white(n, points=(lamp,))
    surface = dataclasses.replace(view.surface, specular=mi.Color3f(1.0), alpha=mi.Float(0.3))
    camera = dataclasses.replace(view.camera, direction=-vector(v))
    view = dataclasses.replace(view, surface=surface, camera=camera)
    for e in (1.0, 10.0, 100.0):
        total = {
            norm: values(phong_rim(view, exponent=e, norm=norm, fresnel="schlick"))[:, 0].mean() * 2 * math.pi
            for norm in ("none", "lobe", "reflectance")
        }
        assert total["lobe"] == pytest.approx(1, rel=0.01)
        assert total["none"] == pytest.approx(2 / (e + 1), rel=0.01)
        assert total["reflectance"] == pytest.approx((e + 2) / (e + 1), rel=0.01)


def test_phong_gives_nothing_from_a_lamp_behind_the_surface():
    view = PolishedBall(lamp_angle=150.0).view(32)
    toward = np.array(PolishedBall(lamp_angle=150.0).lamp()[0]) - values(view.surface.position)
    behind = (values(view.surface.normal) * toward).sum(axis=1) <= 0
    assert values(phong_rim(view))[behind].max() == 0


# Reflections of an environment (section 38)


@pytest.mark.parametrize(
    ("f0", "nv", "roughness", "exact", "model"),
    [(1.0, 1.0, 0.5, 0.92, 1.0), (1.0, 1.0, 1.0, 0.31, 1.0), (0.04, 0.1, 0.1, 0.595, 0.548)]
    + [(0.04, 0.1, 0.5, 0.156, 0.312), (0.04, 1.0, 1.0, 0.012, 0.040)],
)
def test_uniform_environment_is_reflected_as_known(f0, nv, roughness, exact, model):
    """The fourth is 0.170 with masking and shadowing correlated; Mitsuba's are apart."""
    a, b = reflected(np.array([nv]), np.array([roughness]), 16384)
    assert f0 * a[0] + b[0] == pytest.approx(exact, abs=6e-3)
    n = np.array([[math.sqrt(1 - nv * nv), 0.0, nv]])
    view = white(n, environment=lambda w: mi.Color3f(1) + 0 * w.x)
    surface = dataclasses.replace(view.surface, specular=mi.Color3f(f0), alpha=mi.Float(roughness**2))
    view = dataclasses.replace(view, surface=surface)
    assert values(prefiltered_environment(view, filter_probe(view)))[0, 0] == pytest.approx(model, abs=6e-4)


@pytest.mark.parametrize("lobe", ["cosine power", "GGX"])
def test_filtered_lobe_is_its_plain_average(lobe):
    """About +z, of a function of the cosine with z, for a rough lobe and a smooth one."""
    for a in (1.0, 0.25):
        found = filtered(lambda w: mi.Color3f(w.z * w.z), mi.Vector3f(0, 0, 1), a, lobe, 4096)
        c = (np.arange(20000) + 0.5) / 20000
        if lobe == "GGX":
            h2 = (1 + c) / 2
            weight = c / (h2 * (a * a - 1) + 1) ** 2  # D(h) n.h n.l / (4 v.h) over dl, with v.h = n.h
        else:
            weight = c ** (0.5 / a**2 - 0.5)
        assert values(found)[0, 0] == pytest.approx((weight * c * c).sum() / weight.sum(), rel=2e-3)


def test_a_mirror_shows_the_environment():
    scene = GlossyBall(roughness=0.0, f0=1.0)
    view = scene.view(32)
    n, met, d = ball.normals(scene, 32)
    r = d - 2 * (n @ d)[:, None] * n
    found = values(prefiltered_environment(view, filter_probe(view, samples=32)))
    np.testing.assert_allclose(found[met], ball.environment(scene, r)[met], rtol=5e-3)


# Light that is baked


@pytest.mark.parametrize(
    ("technique", "scene"),
    [(ambient_cube, EnvironmentBall), (sh_irradiance, EnvironmentBall), (lambert_ambient, BallInRoom)]
    + [(prefiltered_environment, GlossyBall), (split_sum, GlossyBall)],
    ids=lambda x: getattr(x, "name", x.__name__ if isinstance(x, type) else ""),
)
def test_twice_the_light_before_the_bake_is_twice_the_image(technique, scene):
    view = scene().view(16)
    once, twice = (values(technique(v, technique.bake_function(v))) for v in (view, view.brighter(2)))
    np.testing.assert_allclose(twice, 2 * once, rtol=1e-5)
