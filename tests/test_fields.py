"""Distance fields: known answers of the source's formulas, of the transforms and of the volumes."""

import dataclasses
import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import special

from approximations.ambient.blurred_volume import bake as bake_blurred
from approximations.ambient.blurred_volume import blurred_volume
from approximations.ambient.colour_bleeding import bake as bake_colours
from approximations.ambient.colour_bleeding import colour_bleeding
from approximations.ambient.curvature_occlusion import bake as bake_curvature
from approximations.ambient.curvature_occlusion import curvature_occlusion
from approximations.ambient.light_flow import _flow as flow
from approximations.ambient.merged_fields import bake as bake_locals
from approximations.ambient.merged_fields import merged_fields
from approximations.ambient.sdf_sky_light import bake as bake_sky
from approximations.ambient.sdf_sky_light import sdf_sky_light
from approximations.kit.distance_transform import chamfer, signed_distance
from approximations.kit.slice_atlas import as_atlas, fetch
from approximations.kit.solids import distance_to, distance_to_all, share_inside
from approximations.kit.volume import (
    Grid,
    as_volume,
    blurred,
    cell_centres,
    grid_over,
    halved,
    look_up,
    on_grid,
    stored,
)
from reference.closed_form import fields
from reference.closed_form.caps import openness_beside_sphere
from reference.truth import box_filter
from reference.visibility import sky_visibility
from scenes.contract import AreaLight, Camera, Solid, Surface, View
from scenes.fields import BallOverFloor, Groove, SolidsUnderSky
from scenes.rooms import ColouredRoom

FLOOR = Solid("box", (0.0, 0.0, -50.0), (100.0, 100.0, 50.0))


def points(rows):
    return mi.Point3f(np.asarray(rows, np.float32).T.copy())


def receivers(p, n, solids, bounds):
    """Points with normals among solids, as a view."""
    p, n = points(p), mi.Vector3f(points(n))
    ones = dr.ones(mi.Float, dr.width(p))
    surface = Surface(ones > 0, p, n, mi.Color3f(ones), ones)
    camera = Camera(p, n, mi.Vector3f(0, 0, 1), 0.0, 1e4)
    return View(dr.width(p), 1, camera, surface=surface, sky=1.0, solids=solids, bounds=bounds)


def sky_light(view, baked=None, **knobs):
    frame = {k: v for k, v in knobs.items() if k not in ("field", "resolution", "bits")}
    bake = {k: v for k, v in knobs.items() if k in ("field", "resolution", "bits")}
    return np.array(sdf_sky_light(view, baked or bake_sky(view, **bake), **frame), float)


# Transforms (9.4)


def brute_force(inside):
    """Listing 2: for each cell the nearest centre of the other state."""
    at = np.stack(np.indices(inside.shape), axis=-1).reshape(-1, 3).astype(float)
    state = inside.ravel()
    squared = ((at[:, None] - at[None]) ** 2).sum(axis=2)
    squared[state[:, None] == state[None]] = np.inf
    return (np.where(state, -1, 1) * np.sqrt(squared.min(axis=1))).reshape(inside.shape)


def test_linear_time_transform_is_the_search_through_all_pairs(rng):
    inside = rng.random((9, 11, 8)) < 0.1
    inside[2:6, 3:7, 2:5] = True
    np.testing.assert_allclose(signed_distance(inside, "euclidean"), brute_force(inside), atol=1e-12)


def test_transform_jumps_from_one_to_minus_one_across_the_surface():
    inside = np.zeros((8, 8, 8), bool)
    inside[:4] = True
    column = signed_distance(inside, "euclidean")[:, 3, 3]
    assert column.tolist() == [-4, -3, -2, -1, 1, 2, 3, 4]


def test_chamfer_is_between_5_7_percent_too_short_and_10_6_percent_too_long():
    solid = np.ones((61, 61, 61), bool)
    solid[30, 30, 30] = False
    euclidean = signed_distance(~solid, "euclidean")
    ratio = (chamfer(solid) / euclidean)[solid] - 1
    assert ratio.min() == pytest.approx(-0.057, abs=5e-4)
    assert ratio.max() == pytest.approx(0.106, abs=5e-4)


def test_chamfer_counts_steps_along_axes_and_diagonals():
    solid = np.ones((5, 5, 5), bool)
    solid[0, 0, 0] = False
    a, b, c = np.sort(np.indices(solid.shape).reshape(3, -1), axis=0)
    np.testing.assert_array_equal(chamfer(solid).ravel(), (5 * a + 4 * (b - a) + 3 * (c - b)) / 3)


def test_binary_image_without_a_body_is_far_from_everything():
    assert (signed_distance(np.zeros((4, 4, 4), bool), "euclidean") == 12).all()


@pytest.mark.parametrize("metric", ["euclidean", "chamfer", "chessboard", "city block"])
def test_transform_of_the_complement_is_the_negative(metric, rng):
    inside = rng.random((10, 10, 10)) < 0.4
    np.testing.assert_array_equal(signed_distance(inside, metric), -signed_distance(~inside, metric))


# Solids


@pytest.mark.parametrize("solid", SolidsUnderSky().solids(), ids=lambda s: f"{s.shape} {s.half[0]}")
def test_distance_of_a_solid_is_that_of_the_closed_form(solid, rng):
    p = rng.uniform(-2, 2, (500, 3))
    np.testing.assert_allclose(
        np.array(distance_to(solid, points(p))), fields.signed_distance(solid, p), atol=3e-6
    )


def test_distance_is_the_nearest_of_many_surface_points(rng):
    solid = SolidsUnderSky().solids()[3]
    face = rng.uniform(-1, 1, (60000, 3))
    axis = rng.integers(0, 3, len(face))
    face[np.arange(len(face)), axis] = rng.choice([-1, 1], len(face))
    surface = (face * solid.half) @ np.array(solid.axes) + solid.centre
    p = rng.uniform(-1.5, 2.5, (50, 3))
    nearest = np.sqrt(((p[:, None] - surface[None]) ** 2).sum(axis=2)).min(axis=1)
    np.testing.assert_allclose(np.abs(fields.signed_distance(solid, p)), nearest, atol=0.02)


def test_share_of_a_cell_inside_is_its_volume_below_the_plane():
    heights = np.array([-0.6, -0.3, 0.0, 0.3, 0.6])
    p = np.stack([0 * heights, 0 * heights, heights], axis=1)
    share = np.array(share_inside((FLOOR,), points(p), 1.0, 10))
    np.testing.assert_allclose(share, np.clip(0.5 - heights, 0, 1), atol=1e-6)


# Volumes


def test_lookup_is_exact_for_a_linear_field_and_clamped_outside(rng):
    grid = Grid((-1.0, 0.0, 2.0), 0.25, (5, 6, 7))
    c = cell_centres(grid)
    volume = as_volume(grid, on_grid(grid, 1 + 2 * c.x - 3 * c.y + 0.5 * c.z))
    low, high = np.array(grid.low) + 0.125, np.array(grid.low) + 0.25 * np.array([7, 6, 5]) - 0.125
    p = rng.uniform(low - 1, high + 1, (300, 3))
    inner = np.clip(p, low, high)
    expected = 1 + 2 * inner[:, 0] - 3 * inner[:, 1] + 0.5 * inner[:, 2]
    np.testing.assert_allclose(np.array(look_up(volume, points(p))), expected, atol=2e-5)


def test_mips_keep_the_mean_and_twice_the_cell():
    grid = grid_over(([0, 0, 0], [2, 1, 1]), 8)
    assert grid.shape == (4, 4, 8)
    values = np.arange(128.0).reshape(grid.shape)
    half, means = halved(grid, values)
    assert (half.cell, half.shape) == (0.5, (2, 2, 4))
    assert means.mean() == values.mean()
    assert means[0, 0, 0] == values[:2, :2, :2].mean()
    _, odd = halved(Grid(grid.low, 1.0, (3, 4, 8)), values[:3])
    np.testing.assert_array_equal(odd[1], halved(grid, values[[2, 2, 2, 2]])[1][0])


def test_eight_bits_hold_zero_and_step_by_a_127th():
    found = stored(np.linspace(-1.2, 1.2, 5001), 1.0, 8)
    steps = np.diff(np.unique(found))
    assert 0 in found
    assert (found.min(), found.max()) == (-1, 1)
    np.testing.assert_allclose(steps, 1 / 127, rtol=1e-9)


def test_slice_atlas_is_trilinear_at_the_edges_of_tiles_too(rng):
    grid = Grid((0.0, 0.0, 0.0), 1.0, (10, 5, 6))
    values = rng.random(grid.shape)
    p = np.concatenate([rng.uniform(-1, 11, (2000, 3)), np.indices((7, 6, 11)).reshape(3, -1).T])
    expected = trilinear(values, p)
    native = np.array(look_up(as_volume(grid, values), points(p)))
    np.testing.assert_allclose(native, expected, atol=2e-6)
    found = np.array(fetch(as_atlas(grid, values), points(p)))
    np.testing.assert_allclose(found, expected, atol=4e-6)
    for wrong in ({"half_slice": False}, {"clamped": False}):
        assert np.abs(np.array(fetch(as_atlas(grid, values), points(p), **wrong)) - expected).max() > 0.2
    coarse = np.array(fetch(as_atlas(grid, values, table_bits=8), points(p)))
    assert 1e-3 < np.abs(coarse - expected).max() < 0.1


def trilinear(values, p):
    """Clamped trilinear interpolation in float64, cells of 1 m from the origin, p (n, 3) as x, y, z."""
    at = np.clip(p[:, ::-1] - 0.5, 0, np.array(values.shape) - 1)
    k = np.minimum(at.astype(int), np.array(values.shape) - 2)
    f = at - k
    total = 0
    for corner in np.indices((2, 2, 2)).reshape(3, -1).T:
        weight = np.prod(np.where(corner, f, 1 - f), axis=1)
        total = total + weight * values[tuple((k + corner).T)]
    return total


# Curvature (9.5)


def ball_in_box(radius, n=64):
    """Distances from a ball in a unit box of n^3 cells, and points of its surface."""
    grid = grid_over(([-0.5] * 3, [0.5] * 3), n)
    ball = Solid("ball", (0.0, 0.0, 0.0), (radius,) * 3)
    phi = on_grid(grid, distance_to_all((ball,), cell_centres(grid)))
    i = np.arange(4000) + 0.5
    z, turn = 1 - 2 * i / len(i), i * math.pi * (3 - math.sqrt(5))
    r = np.sqrt(1 - z * z)
    return grid, phi, points(radius * np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1))


@pytest.mark.parametrize("radius", [0.15, 0.25])
def test_blur_of_a_sphere_at_its_surface_is_the_closed_form(radius):
    grid, phi, p = ball_in_box(radius)
    sigma = 3.0
    s = math.sqrt(sigma**2 + 1 / 6) * grid.cell
    found = np.array(look_up(as_volume(grid, blurred(phi, sigma)), p)).mean()
    x = radius / (s * math.sqrt(2))
    expected = (
        s * math.sqrt(2 / math.pi) * math.exp(-x * x) + (radius + s * s / radius) * math.erf(x) - radius
    )
    assert found == pytest.approx(expected, rel=0.01)
    assert found == pytest.approx(s * s / radius, rel=0.01)


@pytest.mark.parametrize(("radius", "error"), [(0.1, 4e-4), (0.4, 1e-4)])
def test_unfiltered_volume_errs_by_a_sixth_of_a_cell_squared_over_the_radius(radius, error):
    grid, phi, p = ball_in_box(radius)
    found = np.array(look_up(as_volume(grid, phi), p))
    mean = grid.cell**2 / 6 / radius
    assert mean == pytest.approx(error, rel=0.05)
    assert found.mean() == pytest.approx(mean, rel=0.04)
    assert found.min() > -0.05 * mean
    assert found.max() == pytest.approx(1.5 * mean, rel=0.05)
    assert 10 * found.max() < 1 / 127  # one step of 8 bits over -1 to 1


def test_curvature_darkens_grooves_and_brightens_ridges_by_the_same_sign():
    for opening, sign in ((90.0, -1), (270.0, 1)):
        scene = Groove(opening=opening)
        view = receivers([[0, 0, 0]], [[0, 0, 1]], scene.solids(), scene.bounds())
        found = np.array(curvature_occlusion(view, bake_curvature(view, sigma=4.0, bits=32), k=1.0))
        assert sign * (found[0] - 1.5) > 0.2


# Sky light (9.6)


def tilted_plane(degrees):
    t = math.radians(degrees)
    n = (math.sin(t), 0.0, math.cos(t))
    u = (math.cos(t), 0.0, -math.sin(t))
    solid = Solid("box", tuple(-50 * x for x in n), (100.0, 100.0, 50.0), (u, (0.0, 1.0, 0.0), n))
    return receivers([[0, 0, 0]], [n], (solid,), ([-0.5] * 3, [0.5] * 3))


@pytest.mark.parametrize(
    ("degrees", "found"), [(0, 1), (60, 0.704), (90, 0.4955), (120, 0.354 * 0.986), (180, 0.2456)]
)
def test_listing_on_an_isolated_plane_is_an_exponential_of_its_tilt(degrees, found):
    light = sky_light(tilted_plane(degrees), field="exact", formula="listing", alpha=1.0)[0]
    assert light == pytest.approx(math.exp(0.702 * (math.cos(math.radians(degrees)) - 1)), rel=1e-4)
    assert light == pytest.approx(found, abs=6e-3)
    bare = sky_light(tilted_plane(degrees), field="exact", formula="listing", alpha=1.0, gain="none")[0]
    assert bare == pytest.approx(math.exp(0.702 * (1 + math.cos(math.radians(degrees)))), rel=1e-4)


def test_fitted_exponent_is_right_at_0_and_90_degrees_and_too_bright_beyond():
    light = {
        t: sky_light(tilted_plane(t), field="exact", alpha=0.5, k=2 * math.log(2))[0]
        for t in (0, 90, 120, 180)
    }
    assert light == pytest.approx({0: 1, 90: 0.5, 120: 0.354, 180: 0.25}, abs=1e-3)
    truth = {t: 0.5 * (1 + math.cos(math.radians(t))) for t in light}
    assert truth[120] == pytest.approx(0.25)
    assert truth[180] == 0


def test_beside_a_ball_the_text_sees_nothing_from_two_radii_on():
    scene = BallOverFloor()
    x = np.array([0.5, 1.0, 1.5, 1.9, 2.0, 2.5, 3.0])
    p = np.stack([x, 0 * x, 0 * x], axis=1)
    view = receivers(p, np.broadcast_to([0, 0, 1.0], p.shape), scene.solids(), ([-4.0] * 3, [4.0] * 3))
    light = sky_light(view, field="exact", alpha=0.0)
    assert (light[:4] < 0.999).all()
    np.testing.assert_allclose(light[4:], 1, atol=1e-6)
    assert openness_beside_sphere(2.0, 1.0) == pytest.approx(0.91, abs=2e-3)


def test_leaning_all_the_way_leaves_undersides_no_offset():
    view = tilted_plane(180)
    for formula in ("text", "listing"):
        light = sky_light(view, field="exact", formula=formula, alpha=1.0, gain="none")
        deficit = 0.7 if formula == "text" else 0.0
        assert light[0] == pytest.approx(math.exp(-deficit), rel=1e-4)


def test_weights_times_distances_of_the_listing_sum_to_0_702():
    assert sum(w * 0.03 * 2**i for i, w in enumerate((1, 1.2, 1.4, 1.8))) == pytest.approx(0.702)


# Pseudo-distance (9.5, 9.7)


@pytest.mark.parametrize("level", [0, 1, 2])
def test_error_function_turns_a_blurred_wall_back_into_its_distance(level):
    z = np.linspace(-0.035, 0.035, 11) * 2**level
    view = receivers(np.stack([0 * z, 0 * z, z], axis=1), [[0, 0, 1]] * 11, (FLOOR,), ([-1.0] * 3, [1.0] * 3))
    field = bake_blurred(view, level=level, bits=32)
    found = np.array(blurred_volume(view, field, remap="erfinv"))
    np.testing.assert_allclose(found, z, atol=0.08 * np.abs(z).max())
    linear = np.array(blurred_volume(view, field))
    assert (np.diff(linear) > 0).all()
    assert special.erf(1) * 0.5 * math.sqrt(math.pi) == pytest.approx(0.747, abs=1e-3)
    assert np.abs(linear).max() < field.width * math.sqrt(0.5 * math.pi)


def test_blurred_thin_wall_loses_its_inside_in_proportion_to_its_thickness():
    inside = []
    for thickness in (1 / 64, 1 / 32, 1 / 16):
        wall = Solid("box", (0.0, 0.0, 0.0), (0.5 * thickness, 5.0, 5.0))
        view = receivers([[0, 0, 0]], [[1, 0, 0]], (wall,), ([-1.0] * 3, [1.0] * 3))
        field = bake_blurred(view, sigma=4.0, finer=8, resolution=32, bits=32)
        share = 0.5 - look_up(field.volume, points([[0, 0, 0]]))
        inside.append(np.array(share)[0])
        assert np.array(blurred_volume(view, field))[0] > 0  # no longer inside
    np.testing.assert_allclose(inside[1:], 2 * np.array(inside[:-1]), rtol=0.02)


# Merged fields (9.8)


def test_star_shaped_and_height_fields_are_distances_along_a_ray():
    box = Solid("box", (0.0, 0.0, 0.0), (0.4, 0.3, 0.5))
    p = [[0.9, 0, 0], [0.8, 0.4, 0.0], [0, 0, -1.2], [-0.75, 0.3, 0.1], [0.1, -0.1, 0.8]]
    view = receivers(p, p, (box,), ([-1.5] * 3, [1.5] * 3))
    knobs = {"padding": 4.0, "resolution": 96}
    length = np.linalg.norm(p, axis=1)
    radius = (np.array(box.half) / np.maximum(np.abs(p), 1e-9)).min(axis=1) * length
    star = np.array(merged_fields(view, bake_locals(view, field="star"), **knobs))
    np.testing.assert_allclose(star, length - radius, atol=0.03)
    height = np.array(merged_fields(view, bake_locals(view, field="height"), **knobs))
    np.testing.assert_allclose(height[[0, 2, 4]], [0.5, 0.7, 0.3], atol=0.03)


def test_spread_of_the_radius_is_the_cosine_of_its_slope():
    box = Solid("box", (0.0, 0.0, 0.0), (0.4, 0.4, 0.4))
    p = [[0.8, 0.4, 0.0], [0.8, 0.0, -0.4], [0.1, 0.9, 0.1]]
    view = receivers(p, p, (box,), ([-1.5] * 3, [1.5] * 3))
    plain, narrowed = (
        np.array(merged_fields(view, bake_locals(view, field="star", width=w), padding=4.0))
        for w in ("none", "spread")
    )
    cosine = np.abs(p).max(axis=1) / np.linalg.norm(p, axis=1)
    np.testing.assert_allclose(narrowed / plain, cosine, atol=0.06)


def test_field_steps_at_the_border_of_a_padded_box():
    ball = Solid("ball", (0.0, 0.0, 0.0), (0.2,) * 3)
    view = receivers([[0.45, 0, 0], [0.65, 0, 0]], [[1, 0, 0]] * 2, (ball,), ([-1.0] * 3, [1.0] * 3))
    near, beyond = np.array(merged_fields(view, bake_locals(view), padding=0.3))
    assert near == pytest.approx(0.25, abs=0.01)
    assert beyond == pytest.approx(1.0)  # half the volume's edge
    assert (np.array(merged_fields(view, bake_locals(view), merge="max")) == 1).all()


# Colour bleeding and light flow (9.9)


def test_floor_is_reddish_by_the_red_wall_and_greenish_by_the_green_one():
    scene = ColouredRoom(blocks=False)
    room = scene.view(4)
    view = receivers([[-0.85, -0.5, 0], [0.85, -0.5, 0]], [[0, 0, 1]] * 2, room.solids, room.bounds)
    view = dataclasses.replace(view, lights=room.lights)
    left, right = np.array(colour_bleeding(view, bake_colours(view, bits=32))).T
    assert left[0] > 1.2 * left[1]
    assert right[1] > 1.2 * right[0]
    assert left[0] == pytest.approx(right[1], rel=0.05)
    dull = np.array(colour_bleeding(view, bake_colours(view, bias=0.0)))
    assert np.abs(dull).max() == 0


def lamps(*places):
    return tuple(AreaLight("sphere", list(p), [0.1, 0, 0], [0, 0.1, 0], 1.0) for p in places)


def test_light_flows_away_from_a_lamp_and_not_at_all_between_two():
    view = receivers([[0, 0, 0]], [[0, 0, 1]], (FLOOR,), ([-1.0] * 3, [1.0] * 3))
    grid = grid_over(view.bounds, 9)
    middle = (4, 4, 4)
    one = flow(dataclasses.replace(view, lights=lamps([3, 0, 0])), grid, "exact")
    np.testing.assert_allclose(one[middle], [-1, 0, 0], atol=1e-5)
    two = flow(dataclasses.replace(view, lights=lamps([3, 0, 0], [-3, 0, 0])), grid, "exact")
    assert np.linalg.norm(two[middle]) < 1e-3
    assert two[4, 4, 8] @ [1, 0, 0] < -0.99  # the nearer lamp wins
    coarse = flow(dataclasses.replace(view, lights=lamps([3, 0.5, 1])), grid, "coarse")
    exact = flow(dataclasses.replace(view, lights=lamps([3, 0.5, 1])), grid, "exact")
    assert (coarse * exact).sum(axis=-1).min() > 0.995


# Truths


@pytest.mark.parametrize(
    "scene", [BallOverFloor(), BallOverFloor(gap=1.3), Groove(), Groove(opening=40.0)], ids=repr
)
def test_openness_in_closed_form_matches_rays(scene):
    function = fields.openness_round_ball if isinstance(scene, BallOverFloor) else fields.openness_of_groove
    size, batches, spp = 24, 16, 64
    exact = box_filter(function(scene, size * 16), 16)[..., 0]
    drawn = np.stack([sky_visibility(scene, size, spp, s)[..., 0] for s in range(batches)])
    z = (drawn.mean(axis=(1, 2)) - exact.mean()).mean() / (drawn.mean(axis=(1, 2)).std(ddof=1) / batches**0.5)
    assert abs(z) < 4
    spread = np.maximum(drawn.std(axis=0, ddof=1) / batches**0.5, 2e-3)
    assert np.mean(np.abs(drawn.mean(axis=0) - exact) > 4 * spread) < 0.02


def test_ridge_is_open_and_flat_groove_nearly():
    assert (fields.openness_of_groove(Groove(opening=200.0), 8) == 1).all()
    assert fields.openness_of_groove(Groove(opening=179.0), 32).min() > 0.98
