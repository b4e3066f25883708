"""Ambient aperture lighting: each stage against its closed form, the Valley's truth against Mitsuba."""

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.ambient.ambient_aperture import Apertures, ambient_aperture, bake
from approximations.ambient.constant_ambient import constant_ambient
from approximations.kit.sampling import hemisphere_direction, random_turn
from reference.closed_form import caps, valley
from reference.truth import box_filter
from scenes.contract import Camera, Sun, Surface, View
from scenes.sunlit import SphereOverPlane, Valley

EXACT = {"overlap": "exact", "cosine": "exact", "sky_cosine": "exact"}
HALF = np.array(0.5 * np.pi)


def vector(v):
    """(n, 3) NumPy to a Dr.Jit vector."""
    return mi.Vector3f(np.asarray(v, np.float32).T.copy())


def tilted(degrees):
    t = math.radians(degrees)
    return [math.sin(t), 0.0, math.cos(t)]


def receivers(normals, light, radius, sky=0.0, sun=True):
    """White points that face `normals` with nothing around them. The sun's radiance is 1, or 0."""
    n = len(normals)
    ones = dr.ones(mi.Float, n)
    surface = Surface(ones > 0, mi.Point3f(vector(np.zeros((n, 3)))), vector(normals), mi.Color3f(ones), ones)
    return View(
        n,
        1,
        Camera(mi.Point3f(0), mi.Vector3f(0, 0, -1), mi.Vector3f(0, 0, -1), 0.01, 1e4),
        surface=surface,
        sun=Sun(mi.Vector3f(light), radius, math.pi * math.sin(radius) ** 2 if sun else 0.0),
        sky=sky,
        visible=lambda p, n, w: dr.full(mi.Bool, True, dr.width(w)),
    )


def irradiance(view, apertures, **knobs):
    """What the technique takes to arrive at each point of albedo 1."""
    return math.pi * np.array(ambient_aperture(view, apertures, **knobs))[0].astype(float)


def image(technique, scene, size, knobs=None, rays=64):
    view = scene.view(size)
    baked = (bake(view, rays=rays),) if technique is ambient_aperture else ()
    return np.array(technique(view, *baked, **(knobs or {}))).T.reshape(size, size, 3).astype(float)


def apertures(axes, radii):
    return Apertures(vector(axes), mi.Float(np.broadcast_to(radii, len(axes)).astype(np.float32)))


# Lambert factor (8.4.3)


@pytest.mark.parametrize(
    ("angle", "normalised", "raw"), [(30, 1.12, 1.08), (60, 1.73, 1.50), (75, 3.07, 2.43), (85, 8.5, 6.2)]
)
def test_averaged_direction_brightens_an_open_plane_as_tabled(angle, normalised, raw):
    light, r = tilted(angle), 0.01
    view = receivers([[0.0, 0.0, 1.0]], light, r)
    open_plane = bake(view, rays=4096)
    exact = caps.horizon_irradiance(math.radians(angle), r)
    found = {
        rule: irradiance(view, open_plane, cosine=rule)[0] / exact
        for rule in ("normalised", "raw", "light", "exact")
    }
    assert found["normalised"] == pytest.approx(normalised, rel=0.006)
    assert found["raw"] == pytest.approx(raw, rel=0.007)
    assert found["light"] == pytest.approx(1, rel=1e-3)
    assert found["exact"] == pytest.approx(1, rel=1e-3)


@pytest.mark.parametrize(("angle", "exact", "averaged"), [(60, 0.0474, 0.0731), (75, 0.0218, 0.0514)])
def test_tilted_aperture_errs_as_worked_out(angle, exact, averaged):
    axis, light, r0, r1 = tilted(20), tilted(angle), math.radians(60), math.radians(10)
    view, one = receivers([[0.0, 0.0, 1.0]], light, r1), apertures([axis], r0)
    truth = caps.vector_irradiance((axis, r0), (light, r1))[2]
    assert truth == pytest.approx(exact, abs=5e-5)
    assert irradiance(view, one, overlap="exact", cosine="exact")[0] == pytest.approx(truth, rel=1e-4)
    assert irradiance(view, one, overlap="exact")[0] == pytest.approx(averaged, abs=1e-4)
    if angle == 60:  # at the centroid's direction, the light's own here
        assert irradiance(view, one, overlap="exact", cosine="light")[0] == pytest.approx(0.0477, abs=5e-5)


def test_all_stages_exact_is_the_cap_model_in_closed_form(rng):
    m = 400
    normals = rng.normal(size=(m, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    axes = normals + 0.4 * rng.normal(size=(m, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    lean = np.arccos((normals * axes).sum(axis=1))
    radii = rng.uniform(0.2, 1, m) * (0.5 * np.pi - lean)
    keep = radii > 0.05  # apertures above the horizon
    normals, axes, radii = normals[keep], axes[keep], radii[keep]
    light, r1 = tilted(40), 0.5
    view = receivers(normals, light, r1, sky=0.3)
    sun = (normals * caps.vector_irradiance((axes, radii), (np.array(light), np.array(r1)))).sum(axis=1)
    whole = np.pi * np.sin(radii) ** 2 * (normals * axes).sum(axis=1)
    found = irradiance(view, apertures(axes, radii), **EXACT)
    assert np.count_nonzero((sun > 0) & (sun < 0.9 * np.pi * np.sin(r1) ** 2)) > 20
    np.testing.assert_allclose(found, sun + 0.3 * (whole - sun), atol=2e-5)


# Sky (8.4.4)


def test_open_point_gets_two_pi_of_sky_without_cosine_and_pi_with_it():
    view = receivers([[0.0, 0.0, 1.0]], tilted(30), 0.3, sky=0.7, sun=False)
    open_point = apertures([[0.0, 0.0, 1.0]], 0.5 * np.pi)
    found = {
        rule: irradiance(view, open_point, sky_cosine=rule)[0] / 0.7
        for rule in ("none", "axis", "half", "exact")
    }
    assert found == pytest.approx(
        {"none": 2 * math.pi, "axis": 2 * math.pi, "half": math.pi, "exact": math.pi}, rel=1e-6
    )


def test_sun_hides_the_sky_behind_it():
    view, r1 = receivers([[0.0, 0.0, 1.0]], tilted(30), 0.3, sky=0.7), 0.3
    open_point = apertures([[0.0, 0.0, 1.0]], 0.5 * np.pi)
    sun = math.pi * math.sin(r1) ** 2 * math.cos(math.radians(30))
    found = irradiance(view, open_point, **EXACT)[0]
    assert found == pytest.approx(sun + 0.7 * (math.pi - sun), rel=1e-5)
    unweighted = irradiance(view, open_point, overlap="exact", cosine="exact")[0]
    assert unweighted == pytest.approx(sun + 0.7 * (2 * math.pi - caps.cap_area(r1)), rel=1e-5)


# Bake (8.3)


def test_open_plane_bakes_to_a_hemisphere_about_its_normal():
    view = receivers([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -1.0, 0.0]], tilted(0), 0.1)
    baked = bake(view, rays=1024)
    np.testing.assert_allclose(np.array(baked.radius), 0.5 * np.pi, atol=1e-6)
    np.testing.assert_allclose(np.array(baked.axis).T, np.array(view.surface.normal).T, atol=3e-3)


def ground(scene, size):
    """View, and per pixel: whether it is a point of the plane, its position."""
    view = scene.view(size)
    p = np.array(view.surface.position).T.astype(float)
    return view, np.array(view.surface.valid) & (np.abs(p[:, 2]) < 1e-3), p


@pytest.mark.parametrize("gap", [0.0, 0.5])
def test_bake_beside_a_sphere_is_the_hemisphere_less_a_cap(gap):
    view, plane, p = ground(SphereOverPlane(gap=gap), 24)
    baked = bake(view, rays=4096)
    to_sphere = np.array([0, 0, 1 + gap]) - p
    distance = np.linalg.norm(to_sphere, axis=1, keepdims=True)
    s = np.arcsin(1 / np.maximum(distance, 1))
    visible = 2 * np.pi - caps.cap_area(s[:, 0])
    radius = np.arccos(1 - visible / (2 * np.pi))
    phi = np.pi * (np.array([0, 0, 1]) - np.sin(s) ** 2 * to_sphere / distance)
    axis = phi / np.linalg.norm(phi, axis=1, keepdims=True)
    hidden = plane & (s[:, 0] > 0.3)
    assert hidden.sum() > 30
    assert np.abs(np.array(baked.radius) - radius)[plane].max() < 0.01
    cosine = (np.array(baked.axis).T * axis).sum(axis=1)
    assert np.degrees(np.arccos(np.clip(cosine[plane], -1, 1))).max() < 0.6


def test_rays_of_the_bake_weighted_by_cosine_give_the_openness_beside_a_sphere():
    view, plane, p = ground(SphereOverPlane(), 24)
    points, rays = 24 * 24, 1024
    ray, point = dr.meshgrid(dr.arange(mi.UInt32, rays), dr.arange(mi.UInt32, points))
    n = dr.gather(mi.Vector3f, view.surface.normal, point)
    start = dr.gather(mi.Point3f, view.surface.position, point)
    turn = dr.gather(mi.Float, random_turn(points, seed=1), point)
    local = hemisphere_direction(ray, rays, turn)
    seen = view.visible(start, n, mi.Frame3f(n).to_world(local))
    weighted = 2 * np.array(dr.select(seen, local.z, 0)).reshape(points, rays).mean(axis=1)
    openness = caps.openness_beside_sphere(np.hypot(p[:, 0], p[:, 1]), 1.0)
    assert openness[plane].min() < 0.4
    np.testing.assert_allclose(weighted[plane], openness[plane], atol=0.01)


@pytest.mark.parametrize("slope", [20.0, 60.0])
def test_bake_in_a_valley_is_a_lune(slope):
    scene, size = Valley(slope=slope), 24
    view = scene.view(size)
    p, side, valid = valley.first_hits(scene, *valley.camera_rays(scene, size))
    np.testing.assert_allclose(np.array(view.surface.position).T[valid], p[valid], atol=1e-4)
    n, m = valley.wall(scene, side)[1], upper_edge_plane(scene, p, side)
    psi = np.pi - np.arccos((n * m).sum(axis=1))
    baked = bake(view, rays=4096)
    radius = np.arccos(1 - 2 * psi / (2 * np.pi))
    away = valid & (np.abs(p[:, 0]) > 0.02)  # the rays start 1e-4 m off the wall
    assert np.abs(np.array(baked.radius) - radius)[away].max() < 0.01
    cosine = (np.array(baked.axis).T * (n + m)).sum(axis=1) / np.linalg.norm(n + m, axis=1)
    assert np.degrees(np.arccos(np.clip(cosine[away], -1, 1))).max() < 0.6


# The Valley's truth


def upper_edge_plane(scene, p, side):
    """Unit normal, towards the sky, of the plane through p and the other wall's upper edge."""
    edge = scene.WALL * valley.wall(scene, -side)[0] - p * [1, 0, 1]
    m = np.cross(edge, [0.0, 1.0, 0.0]) * side[:, None]
    m *= np.sign(m[:, 2:])
    return m / np.linalg.norm(m, axis=1, keepdims=True)


@pytest.mark.parametrize("slope", [5.0, 45.0, 80.0])
def test_ends_of_the_valley_add_a_millionth_of_the_sky(slope):
    scene = Valley(slope=slope)
    p, side, _ = valley.first_hits(scene, *valley.camera_rays(scene, 32))
    n, m = valley.wall(scene, side)[1], upper_edge_plane(scene, p, side)
    infinite = 0.5 * np.pi * (1 + (n * m).sum(axis=1))
    added = valley.irradiance_of_sky(scene, p, side) - infinite
    assert added.min() > -1e-12
    assert 1e-12 < added.max() < 1e-6 * np.pi


def test_unshaded_wall_gets_the_whole_sun():
    scene = Valley(slope=10, light_elevation=80, light_radius=0.1)
    p, side, _ = valley.first_hits(scene, *valley.camera_rays(scene, 16))
    n = valley.wall(scene, side)[1]
    theta = np.arccos(n @ valley.direction(80, 160))
    np.testing.assert_allclose(
        valley.irradiance_of_sun(scene, p, side), caps.horizon_irradiance(theta, 0.1), rtol=1e-12
    )


def test_valley_is_mirrored_when_the_light_is():
    left = valley.valley_direct(Valley(light_azimuth=160), 32)
    right = valley.valley_direct(Valley(light_azimuth=20), 32)
    np.testing.assert_allclose(left, right[:, ::-1], rtol=1e-5)


@pytest.mark.parametrize("field", sorted(Valley.axes()))
def test_valley_in_closed_form_is_finite_and_not_negative_at_the_ends_of_its_axes(field):
    for end in (Valley.axes()[field].low, Valley.axes()[field].high):
        found = valley.valley_direct(Valley(**{field: end}), 16)
        assert np.isfinite(found).all()
        assert found.min() >= 0


@pytest.mark.parametrize(
    "scene",
    [
        Valley(),
        Valley(slope=70, light_elevation=60),
        Valley(light_radius=1.2, light_azimuth=100),
        Valley(slope=20, light_elevation=5, light_radius=0.1, light_azimuth=170),
        Valley(sun_irradiance=0, sky=1),
    ],
    ids=["default", "deep", "huge sun", "low sun", "sky alone"],
)
def test_valley_in_closed_form_matches_mitsuba(scene):
    assert_matches_mitsuba(scene)


def test_short_valley_lets_light_in_at_its_ends_as_in_mitsuba(monkeypatch):
    monkeypatch.setattr(Valley, "LENGTH", 2.2)
    scene = Valley(light_azimuth=95, light_elevation=10)
    size = 16
    short = valley.valley_direct(scene, size)
    assert_matches_mitsuba(scene)
    monkeypatch.undo()
    assert np.mean(np.abs(short - valley.valley_direct(scene, size))) > 0.05 * short.mean()


def assert_matches_mitsuba(scene):
    """Per-pixel z-scores of pixels that see nothing but walls: centred, of the right spread."""
    size, fine, batches = 16, 16, 16
    exact = box_filter(valley.valley_direct(scene, size * fine), fine)[..., 0]
    hit = valley.first_hits(scene, *valley.camera_rays(scene, size * fine))[2]
    whole = box_filter(hit.reshape(size * fine, size * fine, 1), fine)[..., 0] == 1
    loaded = mi.load_dict(scene.mitsuba(size), optimize=False)  # merged walls have no bounds: the sky leaks
    direct = mi.load_dict({"type": "direct", "emitter_samples": 4, "bsdf_samples": 1})
    renders = [mi.render(loaded, integrator=direct, spp=256, seed=s) for s in range(batches)]
    means = np.array([np.array(r)[..., 0] for r in renders], float)
    z = (means.mean(axis=0) - exact)[whole] / (means.std(axis=0, ddof=1)[whole] / batches**0.5)
    t = (batches - 1) / (batches - 3)  # variance of Student's t
    assert abs(z.sum()) / math.sqrt(t * z.size) < 4
    assert np.mean(z**2) == pytest.approx(t, abs=6 * t / math.sqrt(0.5 * z.size))
    assert np.mean(np.abs(means.mean(axis=0) - exact)[whole]) < 0.01 * exact.mean()


def test_sphere_on_a_plane_under_the_sky_alone_matches_mitsuba():
    scene = SphereOverPlane(sun_irradiance=0, sky=1, albedo=0.5)
    size, fine = 24, 8
    _, plane, p = ground(scene, size * fine)
    openness = caps.openness_beside_sphere(np.hypot(p[:, 0], p[:, 1]), 1.0)
    exact, whole = (
        box_filter(v.reshape(size * fine, size * fine, 1).astype(float), fine)[..., 0]
        for v in (openness, plane)
    )
    direct = mi.load_dict({"type": "direct", "emitter_samples": 0, "bsdf_samples": 1})
    loaded = mi.load_dict(scene.mitsuba(size), optimize=False)
    found = np.array(mi.render(loaded, integrator=direct, spp=2048))[..., 0] / scene.albedo
    np.testing.assert_allclose(found[whole == 1], exact[whole == 1], atol=0.05)
    assert np.mean((found - exact)[whole == 1]) == pytest.approx(0, abs=1e-3)


# The techniques as a whole


def settings():
    yield constant_ambient, {}
    for name, (first, *others) in {
        "overlap": ("smoothstep", "lens", "printed", "exact"),
        "cosine": ("normalised", "raw", "light", "exact"),
        "sky_cosine": ("none", "axis", "half", "exact"),
    }.items():
        yield ambient_aperture, {name: first}
        yield from ((ambient_aperture, {name: value}) for value in others)
    yield ambient_aperture, EXACT


def test_twice_the_light_is_twice_the_image():
    view = SphereOverPlane().view(16)
    baked = bake(view, rays=64)
    for technique, knobs in settings():
        given = (baked,) if technique is ambient_aperture else ()
        once = np.array(technique(view, *given, **knobs))
        twice = np.array(technique(view.brighter(2), *given, **knobs))
        np.testing.assert_allclose(twice, 2 * once, rtol=1e-5)


@pytest.mark.parametrize(
    "scene",
    [
        cls(**{field: end})
        for cls in (SphereOverPlane, Valley)
        for field in ("light_radius", "light_elevation", "gap", "slope", "sun_irradiance")
        if field in cls.axes()
        for end in (cls.axes()[field].low, cls.axes()[field].high)
    ],
    ids=repr,
)
def test_image_is_finite_and_not_negative_at_the_ends_of_the_axes(scene):
    view = scene.view(16)
    baked = bake(view, rays=16)
    for technique, knobs in settings():
        found = np.array(technique(view, *((baked,) if technique is ambient_aperture else ()), **knobs))
        assert np.isfinite(found).all(), knobs
        assert found.min() >= 0 or knobs == {"overlap": "printed"}, knobs


def test_author_would_not_use_it_under_an_occluder_nor_near_the_horizon_nor_in_a_deep_valley():
    inside = [Valley(), Valley(slope=60), Valley(light_elevation=15)]
    outside = [SphereOverPlane(), SphereOverPlane(gap=2), Valley(slope=61), Valley(light_elevation=14)]
    assert all(ambient_aperture.domain_function(scene).inside for scene in inside)
    assert not any(ambient_aperture.domain_function(scene).inside for scene in outside)


def test_exact_stages_make_a_shallow_valley_right_and_printed_ones_do_not():
    scene = Valley(slope=5, light_elevation=90, light_radius=0.005)
    truth = valley.valley_direct(scene, 32)

    def error(knobs):
        return np.sqrt(np.mean((image(ambient_aperture, scene, 32, knobs, 1024) - truth) ** 2)) / truth.mean()

    assert error(EXACT) < 0.005
    assert error({}) > 0.1


def test_each_exact_stage_of_a_shallow_valley_pays():
    scene = Valley(slope=5, light_elevation=45)
    truth = valley.valley_direct(scene, 32)
    steps = [{}, {"sky_cosine": "exact"}, {"sky_cosine": "exact", "cosine": "exact"}]
    errors = [
        np.sqrt(np.mean((image(ambient_aperture, scene, 32, knobs, 256) - truth) ** 2)) for knobs in steps
    ]
    assert errors[0] > 1.5 * errors[1] > 1.5**2 * errors[2]
