"""Area lights: irradiance in closed form, scenes, and what the techniques get right by construction."""

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.area_lights.centre_point import centre_point
from approximations.area_lights.most_representative_point import most_representative_point, nearest_to_ray
from approximations.area_lights.representative_point import bake, representative_point, shared
from approximations.kit.ggx_cosine import ggx_cosine
from approximations.kit.light_shapes import flat_light, integrate
from reference.closed_form import area_lights
from reference.verify.routes_area_lights import bilinear
from scenes.area_lit import AreaLitPlane, DiffuseAreaLitPlane, PictureLitPlane, RoundLitPlane, pattern
from scenes.contract import AreaLight
from scenes.mitsuba_parts import area_light

X, Y, Z = np.eye(3)
ORIGIN = np.zeros((1, 3))


# Closed forms


def test_a_light_that_fills_the_sky_gives_pi():
    for shape in (area_lights.rectangle, area_lights.disk):
        assert shape(ORIGIN, 0.1 * Z, 1e4 * X, -1e4 * Y)[0] == pytest.approx(math.pi, rel=1e-4)
    assert area_lights.sphere(ORIGIN, 1.0000001 * Z, X, X)[0] == pytest.approx(math.pi, rel=1e-4)


def test_a_disk_overhead_gives_pi_times_the_squared_sine():
    for radius in (0.1, 1.0, 3.0):
        found = area_lights.disk(ORIGIN, 2 * Z, radius * X, -radius * Y)[0]
        assert found == pytest.approx(math.pi * radius**2 / (radius**2 + 4), rel=1e-9)


def test_a_parallel_rectangle_over_its_corner_gives_the_catalogued_form_factor():
    a, b, c = 0.7, 1.2, 0.9
    x, y = a / c, b / c
    factor = (
        x / math.hypot(1, x) * math.atan(y / math.hypot(1, x))
        + y / math.hypot(1, y) * math.atan(x / math.hypot(1, y))
    ) / (2 * math.pi)
    found = area_lights.rectangle(ORIGIN, np.array([a / 2, b / 2, c]), a / 2 * X, -b / 2 * Y)[0]
    assert found == pytest.approx(math.pi * factor, rel=1e-9)


def test_a_disk_off_its_axis_gives_the_catalogued_form_factor():
    h, r, d = 0.8, 0.5, 1.1
    z = 1 + (h / d) ** 2 + (r / d) ** 2
    factor = 0.5 * (1 - (1 + (h / d) ** 2 - (r / d) ** 2) / math.sqrt(z**2 - 4 * (r / d) ** 2))
    found = area_lights.disk(ORIGIN, np.array([d, 0, h]), r * X, -r * Y)[0]
    assert found == pytest.approx(math.pi * factor, rel=1e-9)


def test_halves_of_a_light_add_up_to_it_and_its_back_is_dark():
    p = np.array([[0.3, -0.4, 0.0], [1.5, 0.2, 0.0]])
    centre, u, v = np.array([0.1, 0.2, 0.5]), 0.5 * X, 0.8 * (math.sin(1.0) * Z - math.cos(1.0) * Y)
    whole = area_lights.rectangle(p, centre, u, v)
    halves = sum(area_lights.rectangle(p, centre + s * 0.5 * v, u, 0.5 * v) for s in (-1, 1))
    np.testing.assert_allclose(halves, whole, rtol=1e-12)
    assert not area_lights.rectangle(p, centre, u, -v).any()


def test_a_half_sunken_disk_lights_a_wall_as_its_upper_half():
    many = 4000
    t = np.linspace(0, math.pi, many)
    outline = np.stack([0.5 * np.cos(t), 0 * t + 1, 0.5 * np.sin(t)], axis=-1)
    p = np.array([[0.2, 0.0, 0.0]])
    disk = area_lights.disk(p, Y, 0.5 * X, 0.5 * Z)[0]
    assert disk == pytest.approx(abs(area_lights.polygon(p, outline)[0]), rel=1e-5)


def test_a_thin_tube_gives_what_a_line_of_points_gives():
    p = np.array([[0.3, 0.2, 0.0]])
    centre, u, radius = np.array([0.0, 0.0, 1.0]), 0.7 * X, 1e-3
    s = (np.arange(2000) + 0.5) / 1000 - 1
    to = centre + s[:, None] * u - p
    r = np.linalg.norm(to, axis=1)
    sine = np.linalg.norm(np.cross(to / r[:, None], X), axis=1)
    line = np.sum(2 * radius * sine * to[:, 2] / r**3) * 1.4 / 2000
    assert area_lights.tube(p, centre, u, radius * Y)[0] == pytest.approx(line, rel=2e-3)


# Scenes


def test_mitsuba_and_the_view_have_the_picture_the_same_way_up():
    scene = PictureLitPlane(radiance=1.0)
    light, st = scene.light(), np.random.default_rng(1).random((40, 2))
    n = np.cross(light.u, light.v)
    n /= np.linalg.norm(n)
    o = light.centre + (2 * st[:, :1] - 1) * light.u + (2 * st[:, 1:] - 1) * light.v + 0.1 * n
    loaded = mi.load_dict({"type": "scene", "light": area_light(light, pattern())}, optimize=False)
    si = loaded.ray_intersect(mi.Ray3f(mi.Point3f(o.T), mi.Vector3f(*(float(-x) for x in n))))
    seen = np.array(si.emitter(loaded).eval(si)).T
    given = np.array(scene.view(2).lights[0].texture(mi.Point2f(st.T.astype(np.float32)))).T
    np.testing.assert_allclose(given, seen, atol=1e-4)
    np.testing.assert_allclose(given, [bilinear(*x) for x in st], atol=1e-4)
    assert given.std() > 0.3


def test_the_floor_inside_a_ball_is_no_floor():
    inside = ~np.array(RoundLitPlane(height=0.1).view(32).surface.valid)
    assert 0 < inside.mean() < 0.1


def test_every_view_direction_sees_the_same_square_of_floor():
    grids = [np.array(AreaLitPlane(view_elevation=e).view(16).surface.position) for e in (1.0, 30.0, 90.0)]
    expected = area_lights.floor_points(16).T
    for grid in grids:
        np.testing.assert_allclose(grid, expected, atol=2e-4)


# Kit


def test_the_lobe_is_mitsubas():
    rng = np.random.default_rng(2)
    z, a = rng.uniform(0.05, 1, (2, 200)), rng.uniform(0, 2 * np.pi, (2, 200))
    w = np.stack([np.sqrt(1 - z**2) * np.cos(a), np.sqrt(1 - z**2) * np.sin(a), z])
    v, to = (mi.Vector3f(w[:, i].astype(np.float32)) for i in (0, 1))
    for alpha in (0.05, 0.3, 1.0):
        bsdf = mi.load_dict(
            {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": alpha}
        )
        si = dr.zeros(mi.SurfaceInteraction3f, 200)
        si.wi = v
        theirs = np.array(bsdf.eval(mi.BSDFContext(), si, to))[0]
        ours = np.array(ggx_cosine(mi.Vector3f(0, 0, 1), v, to, mi.Float(alpha)))
        np.testing.assert_allclose(ours, theirs, rtol=2e-3, atol=1e-6)


@pytest.mark.parametrize("shape", ["sphere", "disk", "rectangle"])
def test_gauss_points_sum_to_the_closed_form(shape):
    scene = DiffuseAreaLitPlane(shape=shape)
    p, light = area_lights.floor_points(8), scene.light()
    exact = area_lights.SHAPES[shape](p, light.centre, light.u, light.v)
    flat = flat_light(light, mi.Point3f(p.T.astype(np.float32)))
    found = integrate(flat, lambda w, q: mi.Color3f(dr.maximum(w.z, 0)))
    np.testing.assert_allclose(np.array(found)[0], exact, atol=1e-4)


def test_the_solid_angle_of_a_square_that_is_a_face_of_a_cube_is_a_sixth_of_the_sphere():
    light = AreaLight("rectangle", Z, X, -Y, 1.0)
    assert flat_light(light, mi.Point3f(0)).solid_angle()[0] == pytest.approx(4 * math.pi / 6, rel=1e-5)


# Techniques


def image(technique, scene, size=24, **knobs):
    view = scene.view(size)
    extra = (bake(view),) if technique is representative_point else ()
    return np.array(technique(view, *extra, **knobs)).reshape(3, size, size)


@pytest.mark.parametrize(
    ("half", "middle", "reach", "expected"),
    [(1, 0, 0.5, (0, 1)), (1, 1, 0.5, (0.75, 0.5)), (1, 3, 0.5, (1, 0)), (1, -0.2, 5, (0, 2))],
)
def test_what_two_intervals_share(half, middle, reach, expected):
    found = shared(mi.Float(half), mi.Float(middle), mi.Float(reach))
    assert [x[0] for x in found] == pytest.approx(expected)


def test_the_nearest_point_of_a_segment_to_a_ray():
    r = mi.Vector3f(0, 0, 1)
    found = nearest_to_ray(mi.Vector3f(-1, 1, 2), mi.Vector3f(3, 1, 2), r)
    assert np.array(found).ravel() == pytest.approx([0, 1, 2], abs=1e-6)
    beyond = nearest_to_ray(mi.Vector3f(1, 1, 2), mi.Vector3f(3, 1, 4), r)
    assert np.array(beyond).ravel() == pytest.approx([1, 1, 2], abs=1e-6)


@pytest.mark.parametrize("tilt", [0.0, 60.0])
@pytest.mark.parametrize("elevation", [30.0, 90.0])
def test_a_light_that_fills_the_cone_is_right_overhead_and_too_bright_where_it_faces_a_slanting_ray(
    elevation, tilt
):
    fields = {"size": 20.0, "height": 4.0, "tilt": tilt, "view_elevation": elevation}
    scene = AreaLitPlane(albedo=0.0, specular=0.5, roughness=0.1, **fields)
    e, light = math.radians(elevation), scene.light()
    m = np.cross(light.v, light.u) / np.linalg.norm(np.cross(light.u, light.v))
    too_bright = m @ (0, math.cos(e), math.sin(e)) / math.sin(e)
    for cone, expected in (("round", too_bright), ("lobe", 1)):
        found = image(representative_point, scene, 8, cone=cone).mean() / (0.5 * scene.radiance)
        assert found == pytest.approx(expected, rel=0.03)


def test_a_mirror_reflects_the_radiance_itself_where_the_share_of_the_cone_counts():
    scene = AreaLitPlane(albedo=0.0, roughness=0.0, specular=0.5)
    assert image(representative_point, scene, specular="share").max() == pytest.approx(
        0.5 * scene.radiance, rel=1e-3
    )


def test_a_highlight_dimmed_for_its_light_falls_with_the_square_of_alpha():
    fields = {"albedo": 0.0, "roughness": 0.05, "size": 0.4}
    dim, plain = (
        image(most_representative_point, RoundLitPlane(**fields), 64, dimming=d).max()
        for d in ("widened", "none")
    )
    assert dim < 0.01 * plain


def test_blurs_of_a_picture_end_in_its_mean():
    scene = PictureLitPlane()
    view = scene.view(4)
    (picture,) = bake(view)
    texels = np.array(picture.tensor())
    assert texels.shape == (6, 32, 32, 3)
    np.testing.assert_allclose(
        texels[-1], np.broadcast_to(pattern().mean(axis=(0, 1)), (32, 32, 3)), rtol=0.03
    )
    assert (np.diff(texels.std(axis=(1, 2)).mean(axis=1)) < 0).all()


@pytest.mark.parametrize("scene", [AreaLitPlane, RoundLitPlane], ids=lambda s: s.__name__)
@pytest.mark.parametrize("technique", [representative_point, most_representative_point, centre_point])
def test_image_is_finite_and_not_negative_at_the_ends_of_the_axes(technique, scene):
    if technique is most_representative_point and scene is AreaLitPlane:
        pytest.skip("it has balls and tubes alone")
    ends = [{f: end} for f in ("roughness", "view_elevation", "tilt", "size", "height") if f in scene.axes()
            for end in (scene.axes()[f].low, scene.axes()[f].high)]  # fmt: skip
    for fields in [*ends, *({"shape": s} for s in scene.field_types()["shape"].__args__)]:
        found = image(technique, scene(**fields), 16)
        assert np.isfinite(found).all(), fields
        assert found.min() >= 0, fields


def test_authors_keep_to_lights_that_are_smaller_than_their_distance():
    assert representative_point.domain_function(AreaLitPlane()).inside
    for outside in (AreaLitPlane(size=3.0), AreaLitPlane(tilt=120.0), RoundLitPlane(shape="tube")):
        assert not representative_point.domain_function(outside).inside
    assert not representative_point.domain_function(RoundLitPlane(height=0.3)).inside
    assert not most_representative_point.domain_function(RoundLitPlane(height=0.3)).inside
