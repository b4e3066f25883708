"""Per-pixel lists and unsorted blending on glass sheets."""

import dataclasses

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.kit.draw_calls import draw_calls
from approximations.transparency import per_pixel_lists as ppl
from approximations.transparency.per_pixel_lists import depth_key, pack_rgba8, per_pixel_lists, unpack_rgba8
from approximations.transparency.unsorted_blending import unsorted_blending
from reference.closed_form.glass import hits, pinhole, radiance
from reference.truth import box_filter
from scenes.contract import Fragments, View
from scenes.glass import GlassSheets

EXACT = {"depth_bits": "exact", "data": "exact"}


def picture(view, image):
    return np.array(image, dtype=np.float64).T.reshape(view.height, view.width, 3)


def rms(scene, technique, size=96, **knobs):
    view = scene.view(size)
    truth = radiance(scene, size)
    return np.sqrt(np.mean((picture(view, technique(view, **knobs)) - truth) ** 2)) / truth.mean()


def stack(depth, colour, alpha=0.5, background=0.25):
    """One pixel whose layers are drawn one by one at these NDC depths, all in grey."""
    n = len(depth)
    grey = np.asarray(colour, dtype=np.float32)
    fragments = Fragments(
        pixel=dr.zeros(mi.UInt32, n),
        depth=mi.Float(np.asarray(depth, dtype=np.float32)),
        distance=mi.Float64(np.asarray(depth, dtype=np.float64)),
        colour=mi.Color3f(np.stack([grey] * 3)),
        alpha=dr.full(mi.Float, alpha, n),
        background=dr.full(mi.Color3f, background, 1),
        draws=(1,) * n,
    )
    return View(1, 1, None, fragments=fragments)


def over(colours, alpha=0.5, background=0.25):
    """Nearest first, from the back, in float64."""
    result = background
    for c in reversed(list(colours)):
        result = alpha * float(np.float32(c)) + (1 - alpha) * result
    return result


def redrawn(view, order):
    """The same view with its draw calls in another order."""
    starts = np.cumsum([0, *view.fragments.draws])
    index = mi.UInt32(np.concatenate([np.arange(starts[i], starts[i + 1]) for i in order]).astype(np.uint32))
    f = view.fragments
    moved = {
        name: dr.gather(type(value), value, index)
        for name, value in vars(f).items()
        if name not in ("background", "draws")
    }
    draws = tuple(f.draws[i] for i in order)
    return dataclasses.replace(view, fragments=dataclasses.replace(f, **moved, draws=draws))


def built(view, layout):
    pixels = view.width * view.height
    lists = ppl.clear(pixels, dr.width(view.fragments.pixel), "32", "exact", layout)
    for draw in draw_calls(view.fragments):
        ppl.insert(lists, draw, "32")
    return lists


def walk(lists, pixels, longest):
    """Pixel, key and slot of every entry: all newest ones, then all second ones; fails on an endless list."""
    found, links = [], lists.links
    pixel = np.arange(pixels)
    key, cell = links.first(mi.UInt32(pixel))
    for _ in range(longest + 1):
        on = cell.numpy() != links.END
        pixel, key, cell = pixel[on], key.numpy()[on], mi.UInt32(cell.numpy()[on])
        if not pixel.size:
            return tuple(np.concatenate(column) for column in zip(*found, strict=True))
        found.append((pixel, key, links.slot(cell).numpy()))
        key, cell = links.after(cell)
    raise AssertionError("a list does not end")


# The truth -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scene", [GlassSheets(), GlassSheets(sheets=11, alpha=0.3, tilt=50, arrangement=3)])
def test_closed_form_agrees_with_stochastic_transparency(scene):
    size, batches = 24, 32
    truth = box_filter(radiance(scene, size * 12), 12)
    loaded = mi.load_dict(scene.mitsuba(size))
    volpath = mi.load_dict({"type": "volpath", "max_depth": -1, "rr_depth": 100000})
    drawn = np.stack(
        [np.array(mi.render(loaded, integrator=volpath, spp=16, seed=i), float) for i in range(batches)]
    )
    blocks = np.stack([box_filter(image - truth, 4) for image in drawn])
    z = blocks.mean(0) / (blocks.std(0, ddof=1) / np.sqrt(batches))
    assert np.abs(z).max() < 5
    assert 0.6 < np.mean(z**2) < 1.5


def test_opaque_sheets_show_the_nearest_alone():
    scene = GlassSheets(alpha=1.0, sheets=6)
    rays = pinhole(scene, 32)
    depth = np.stack([hits(s, rays) for s in scene.layers()])
    met = np.isfinite(depth.min(0))
    nearest = np.array([s.colour for s in scene.layers()])[depth.argmin(0)]
    assert met.any() and not met.all()
    np.testing.assert_array_equal(radiance(scene, 32)[met], nearest[met])


def test_sheets_cross_so_that_their_order_differs_from_pixel_to_pixel():
    scene = GlassSheets()
    depth = np.stack([hits(s, pinhole(scene, 64)) for s in scene.layers()])
    a, b = depth[:, None], depth[None]
    both = np.isfinite(a) & np.isfinite(b)
    assert ((both & (a < b)).any((2, 3)) & (both & (a > b)).any((2, 3))).any()


def test_doubling_the_brightness_doubles_fragments_and_truth():
    one, two = GlassSheets(), GlassSheets(brightness=2)
    np.testing.assert_allclose(radiance(two, 16), 2 * radiance(one, 16), rtol=1e-14)
    a, b = one.view(16).brighter(2).fragments, two.view(16).fragments
    np.testing.assert_allclose(a.colour.numpy(), b.colour.numpy(), rtol=1e-6)
    np.testing.assert_allclose(a.background.numpy(), b.background.numpy(), rtol=1e-6)


# BUILD ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", ["plain", "packed"])
def test_lists_end_and_hold_every_layer_of_every_pixel_once(layout):
    scene, size = GlassSheets(sheets=12), 48
    view = scene.view(size)
    lists = built(view, layout)
    pixel, key, slot = walk(lists, size * size, scene.sheets)
    assert len(np.unique(slot)) == len(slot) == dr.width(view.fragments.pixel)

    depth = np.stack([hits(s, pinhole(scene, size)).ravel() for s in scene.layers()])
    sheet, at = np.nonzero(np.isfinite(depth))
    n, f = scene.near, scene.FAR
    z = (f + n) / (f - n) - 2 * f * n / ((f - n) * depth[sheet, at])
    colours = np.float32([s.colour for s in scene.layers()])
    stored = dr.gather(mi.Vector4f, lists.data, mi.UInt32(slot)).numpy()
    which = np.argmin(np.abs(stored[:3].T[:, None] - colours).sum(-1), axis=1)

    listed, cast = np.lexsort((which, pixel)), np.lexsort((sheet, at))
    np.testing.assert_array_equal(pixel[listed], at[cast])
    np.testing.assert_array_equal(which[listed], sheet[cast])
    np.testing.assert_array_equal(stored[3], np.float32(scene.alpha))
    wanted = 0xFFFFFFFF * (1 - z[cast]) / 2
    assert np.abs(key[listed] - wanted).max() <= 2**32 * 2.0**-25  # half a unit in the last place of z


@pytest.mark.parametrize("layout", ["plain", "packed"])
def test_a_list_runs_from_the_newest_fragment_to_the_oldest(layout):
    view = stack([0.1, 0.5, 0.3], [0.0, 0.25, 1.0])
    _, key, slot = walk(built(view, layout), 1, 3)
    np.testing.assert_array_equal(key, depth_key(mi.Float([0.3, 0.5, 0.1]), "32").numpy())
    np.testing.assert_array_equal(slot, [2, 1, 0])


def test_packed_heads_carry_the_key_of_the_newest_fragment_and_cells_come_after_the_heads():
    main = built(GlassSheets().view(16), "packed").links.main.numpy()
    heads = main[:256]
    met = heads != 0
    assert ((heads[met] & np.uint64(0xFFFFFFFF)) >= 256).all()
    assert ((heads[met] >> np.uint64(32)) > 0).all()


def test_nearer_is_bigger_and_the_planes_have_the_extreme_keys():
    z = mi.Float([-1, -0.25, 0, 0.75, 1])
    assert depth_key(z, "24").numpy().tolist() == [0xFFFFFF, 10485759, 8388607, 2097151, 0]
    assert depth_key(z, "32").numpy().tolist() == [0xFFFFFF00, 0xA0000000, 0x80000000, 0x20000000, 0]


@pytest.mark.parametrize("near", [0.1, 1e-3])
def test_24_bits_merge_depths_closer_than_d_squared_over_near_2_to_the_24(near):
    f, d = 100.0, 5.0
    step = d * d / (near * 2**24)
    ndc = lambda d: (f + near) / (f - near) - 2 * f * near / ((f - near) * d)  # noqa: E731
    apart = d + 2.5 * step
    keys = depth_key(mi.Float(ndc(d + step * np.linspace(0, 8, 801)).astype(np.float32)), "24").numpy()
    assert 8 <= len(np.unique(keys)) <= 10
    assert depth_key(mi.Float(ndc(d)), "24")[0] > depth_key(mi.Float(ndc(apart)), "24")[0]


def test_rgba8_rounds_to_the_nearest_level_and_clamps():
    assert pack_rgba8(mi.Vector4f(1, 0, 0, 1)).numpy().tolist() == [0xFF0000FF]
    x = np.linspace(0, 1, 4001, dtype=np.float32)
    back = unpack_rgba8(pack_rgba8(mi.Vector4f(x, x[::-1].copy(), x * x, 0.5))).numpy()
    for channel, wanted in zip(back, (x, x[::-1], x * x, 0.5), strict=True):
        assert np.abs(channel - wanted).max() <= 0.5 / 255 + 1e-7
    clamped = unpack_rgba8(pack_rgba8(mi.Vector4f(-3, 7, 1e9, 2))).numpy()[:, 0]
    assert clamped.tolist() == [0, 1, 1, 1]


# RENDER --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sort", ["bubble", "insertion"])
@pytest.mark.parametrize("count", [1, 2, 3, 17, 64])
def test_sorted_compositing_equals_a_float64_sort(rng, sort, count):
    z, grey = rng.permutation(np.linspace(-0.9, 0.9, count)), rng.random(count)
    image = per_pixel_lists(stack(z, grey, alpha=0.1), sort=sort, data="exact", depth_bits="24")
    assert image.x[0] == pytest.approx(over(grey[np.argsort(z)], alpha=0.1), rel=2e-6)


@pytest.mark.parametrize("bits", ["24", "32", "exact"])
def test_layout_and_kind_of_sort_do_not_change_the_image(bits):
    view = GlassSheets(sheets=12, spacing=1e-5).view(48)
    images = [
        per_pixel_lists(view, layout=layout, sort=sort, depth_bits=bits).numpy()
        for layout in ("plain", "packed")
        for sort in ("bubble", "insertion")
    ]
    for image in images[1:]:
        np.testing.assert_array_equal(image, images[0])


def test_the_order_of_drawing_does_not_matter_while_keys_differ():
    view = GlassSheets(near=1.0).view(48)
    a, b = view, redrawn(view, [5, 2, 7, 0, 3, 6, 1, 4])
    np.testing.assert_array_equal(per_pixel_lists(a).numpy(), per_pixel_lists(b).numpy())
    assert np.abs(unsorted_blending(a).numpy() - unsorted_blending(b).numpy()).max() > 0.1


def test_among_equal_keys_the_last_drawn_lies_in_front():
    z, grey = [0.5, 0.5, 0.5], [0.0, 0.25, 1.0]
    for sort in ("bubble", "insertion"):
        image = per_pixel_lists(stack(z, grey), data="exact", sort=sort)
        assert image.x[0] == pytest.approx(over(grey[::-1]), rel=1e-6)


def test_overflow_drops_what_was_drawn_first_wherever_it_lies():
    z, grey = np.linspace(0.1, 0.5, 5), np.array([0.0, 0.9, 0.2, 0.7, 0.4])
    nearest_first = per_pixel_lists(stack(z, grey), data="exact", capacity=4)
    farthest_first = per_pixel_lists(stack(z[::-1], grey[::-1]), data="exact", capacity=4)
    assert nearest_first.x[0] == pytest.approx(over(grey[1:]), rel=1e-6)
    assert farthest_first.x[0] == pytest.approx(over(grey[:4]), rel=1e-6)


@pytest.mark.parametrize("knobs", [{"capacity": 4}, {"depth_bits": "24"}])
def test_ties_and_overflow_come_out_the_same_in_every_run(knobs):
    view = GlassSheets(spacing=1e-6, sheets=16).view(128)
    first = per_pixel_lists(view, **knobs).numpy()
    for _ in range(3):
        np.testing.assert_array_equal(per_pixel_lists(view, **knobs).numpy(), first)


def test_the_frame_leaves_its_fragments_alone():
    view = GlassSheets().view(16)
    before = view.fragments.background.numpy().copy()
    unsorted_blending(view)
    np.testing.assert_array_equal(view.fragments.background.numpy(), before)


# Errors --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "fields",
    [{}, {"near": 1e-5}, {"spacing": 1e-6}, {"sheets": 32, "tilt": 60}, {"brightness": 100}, {"alpha": 0.02}],
)
def test_exact_stages_give_the_truth(fields):
    assert rms(GlassSheets(**fields), per_pixel_lists, **EXACT) < 5e-7


def test_eight_bits_own_the_error_of_the_default():
    scene = GlassSheets()
    assert 5e-4 < rms(scene, per_pixel_lists) < 3e-3
    assert rms(scene, per_pixel_lists, data="exact") < 2e-4


@pytest.mark.parametrize("fields", [{"near": 1e-5}, {"spacing": 1e-6}])
def test_depth_precision_fails_for_a_close_near_plane_and_for_touching_sheets(fields):
    scene = GlassSheets(**fields)
    coarse, fine = (rms(scene, per_pixel_lists, data="exact", depth_bits=b) for b in ("24", "32"))
    assert coarse > fine > 0.02
    assert not per_pixel_lists.domain_function(scene).inside


def test_bright_colours_clamp():
    scene = GlassSheets(brightness=2.0)
    assert rms(scene, per_pixel_lists) > 0.2
    assert rms(scene, per_pixel_lists, data="exact") < 2e-4
    assert not per_pixel_lists.domain_function(scene).inside
    assert per_pixel_lists.domain_function(GlassSheets()).inside


def test_unsorted_blending_is_right_only_from_back_to_front():
    z, grey = np.array([0.9, 0.5, 0.3, 0.1]), np.array([0.0, 0.9, 0.2, 0.7])
    assert unsorted_blending(stack(z, grey)).x[0] == pytest.approx(over(grey[::-1]), rel=1e-6)
    assert unsorted_blending(stack(z[::-1], grey[::-1])).x[0] == pytest.approx(over(grey), rel=1e-6)
    assert rms(GlassSheets(), unsorted_blending) > 0.1


def test_at_small_opacity_eight_bits_cost_more_than_the_order():
    scene = GlassSheets(alpha=0.02)
    lists, unsorted = rms(scene, per_pixel_lists), rms(scene, unsorted_blending)
    assert lists > unsorted > rms(scene, per_pixel_lists, data="exact")
