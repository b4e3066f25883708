"""The march of a view ray: compositing rules, their orders, jitter, and the machine of two samplers."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from approximations.clouds.cloud_compositing import bake, cloud_compositing
from approximations.kit.adaptive_march import adaptive_march
from approximations.kit.start_jitter import TILE, starts, void_and_cluster
from reference.source_function import once_scattered_by_slab
from reference.verify.routes_scattered_clouds import scattered_clouds_against_points
from reference.verify.run import judge
from scenes.cloud import CloudSlab
from scenes.contract import Camera
from scenes.scattered_clouds import ScatteredClouds, table

SLAB = CloudSlab(optical_depth=8.0)


def off(steps, rule, scene=SLAB, **knobs):
    """Error over the truth of the pixel that looks straight down, and of the whole image."""
    size = 5
    view = scene.view(size)
    found = cloud_compositing(view, bake(view), steps=steps, rule=rule, **{"cut": 0.0, **knobs})
    truth = once_scattered_by_slab(scene, size)[..., 0]
    error = np.array(found)[0].reshape(size, size) / truth - 1
    return error[2, 2], error


@pytest.mark.parametrize(("rule", "order"), [("beer", 1), ("beer entering", 1), ("energy-conserving", 2)])
@pytest.mark.parametrize("seen", ["above", "below"])
def test_rules_converge_with_their_orders(rule, order, seen):
    scene = CloudSlab(optical_depth=8.0, seen=seen)
    coarse, fine = (abs(off(n, rule, scene)[0]) for n in (64, 256))
    assert np.log2(coarse / fine) / 2 == pytest.approx(order, abs=0.1)


def test_beers_two_orders_lie_on_either_side_by_the_known_factors():
    """a e^-a / (1 - e^-a) and a / (1 - e^-a) of what the transfer equation makes of the same samples."""
    a = 8.0 / 16
    right = 1 + off(16, "energy-conserving")[0]
    assert (1 + off(16, "beer")[0]) / right == pytest.approx(a / np.expm1(a), rel=1e-4)
    assert (1 + off(16, "beer entering")[0]) / right == pytest.approx(-a / np.expm1(-a), rel=1e-4)


def test_the_literal_sum_does_not_converge():
    """Density 1/8: the first eight samples count 1, 7/8 ... 1/8, in sum 4.5, whatever their distance."""
    for steps in (4096, 8192):
        unweighted = (1 + off(steps, "literal")[0]) * np.array(once_scattered_by_slab(SLAB, 5))[2, 2, 0]
        assert unweighted == pytest.approx(4.5 * lobe(SLAB), rel=0.02)


def lobe(scene):
    cosine, g = -scene.to_sun()[2], scene.g
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def test_an_early_end_costs_no_more_than_what_it_lets_through():
    whole, cut = off(256, "energy-conserving")[1], off(256, "energy-conserving", cut=0.05)[1]
    lost = (whole - cut) * once_scattered_by_slab(SLAB, 5)[..., 0]
    assert np.all(lost > 0) and np.all(lost < 0.05 * 4)


def test_every_rank_of_blue_noise_is_there_once_and_neighbours_start_far_apart():
    ranks = void_and_cluster()
    assert np.array_equal(np.sort(ranks.ravel()), np.arange(TILE * TILE))
    blue = (ranks + 0.5) / TILE**2
    white = np.random.default_rng(0).permutation(blue.ravel()).reshape(TILE, TILE)
    power = [np.abs(np.fft.fft2(x - x.mean())) ** 2 for x in (blue, white)]
    radius = np.hypot(*np.meshgrid(*[np.fft.fftfreq(TILE)] * 2))
    low = (radius > 0) & (radius < 0.2)
    assert power[0][low].mean() < 0.05 * power[1][low].mean()
    for rank in (102, 300, 512):
        mask = ranks < rank
        assert np.abs(mask.reshape(4, 8, 4, 8).mean((1, 3)) - rank / TILE**2).max() < 0.05


def test_starts_are_the_middle_or_spread_over_the_step():
    table = mi.Float(np.arange(TILE * TILE, dtype=np.float32))
    assert starts("none", table, 40, 40) == 0.5
    tiled = np.array(starts("blue noise", table, 40, 33)).reshape(33, 40)
    assert tiled[32, 33] == 1 and tiled[1, 0] == TILE and tiled[0, 1] == 1
    white = np.array(starts("white", table, 64, 64))
    assert white.min() >= 0 and white.max() < 1 and white.mean() == pytest.approx(0.5, abs=0.02)
    pairs = white.reshape(64, 64)
    assert abs(np.corrcoef(pairs[:, 1:].ravel(), pairs[:, :-1].ravel())[0, 1]) < 0.05


def test_blue_noise_averages_out_where_white_does_not():
    """Over 4 x 4 pixels."""
    size = 64
    spread = {}
    for jitter in ("white", "blue noise"):
        at = np.array(starts(jitter, mi.Float(bake(SLAB.view(2))), size, size)).reshape(16, 4, 16, 4)
        spread[jitter] = at.mean((1, 3)).std()
    assert spread["blue noise"] < 0.5 * spread["white"]


def marched(scene, steps, size=32, **machine):
    """The machine on a scene, with full and cheap samples a ray and the share of rays that are cut short."""
    view, counts = scene.view(size), dr.zeros(mi.UInt32, 2)
    cloud, camera = view.cloud, view.camera

    def counted(sampler, kind):
        def sample(x, active):
            dr.scatter_add(counts, mi.UInt32(1), mi.UInt32(kind), active)
            return sampler(x)

        return sample

    looked = machine.pop("looked", True)
    found = adaptive_march(
        camera,
        cloud.span(camera.origin, camera.direction),
        steps,
        counted(cloud.extinction, 0),
        cheap=counted(cloud.model.extinction, 1) if looked else None,
        **machine,
    )
    through, came = np.array(found.through, float), np.array(found.came)
    full, cheap = np.array(counts) / size**2
    return through, full, cheap, came / steps


def test_under_a_clear_sky_looking_halves_the_reads():
    clear = ScatteredClouds(cover=0.0)
    through, full, cheap, came = marched(clear, 64)
    assert (full, cheap) == (0, 64) and np.all(through == 1) and np.all(came == 1)
    assert marched(clear, 64, looked=False)[1:3] == (64, 0)


def test_looking_loses_nothing_where_turns_suffice():
    everywhere = marched(ScatteredClouds(), 64, looked=False)
    looked = marched(ScatteredClouds(), 64, turns=512)
    assert np.allclose(looked[0], everywhere[0], rtol=1e-5)
    assert 2 * looked[1] + looked[2] < 0.8 * 2 * everywhere[1]


def test_a_ray_that_meets_cloud_is_cut_short_by_what_changes_of_state_take():
    """Two steps for a cloud that is met and left before the turns are over."""
    through, full, cheap, came = marched(ScatteredClouds(), 64)
    assert full + cheap == 64
    hit = came < 1
    assert 0.9 < hit.mean() < 1 and np.all(through[~hit] == 1)
    lost = np.round(64 * (1 - came)).astype(int)
    assert lost[hit].min() <= 2 and 5 < lost[hit].mean() < 7
    assert np.all(np.array(marched(ScatteredClouds(), 64, turns=512)[3]) == 1)


def machine(density, hull, steps, turns, zeros=6, in_a_row=True, stride=1, step_back=False):
    """The same in plain Python on lists of samples: the depth, and the step that it came to."""
    at, looking, skipped, empty, depth = 0, True, False, 0, 0.0
    for _ in range(turns):
        if at >= steps:
            break
        if looking:
            if hull[at]:
                at -= stride - 1 if skipped and step_back else 0
                looking, skipped = False, False
            else:
                at, skipped = at + stride, True
            continue
        skipped = False
        if density[at] > 0:
            depth, at = depth + density[at], at + 1
            empty = 0 if in_a_row else empty
            continue
        empty += 1
        if empty == zeros:
            looking, empty = True, 0
        else:
            at += 1
    return depth, min(at, steps)


@pytest.mark.parametrize(
    "knobs",
    [
        {},
        {"in_a_row": False},
        {"zeros": 1},
        {"zeros": 3, "turns": 400},
        {"stride": 4},
        {"stride": 4, "step_back": True, "turns": 400},
    ],
    ids=str,
)
def test_the_machine_turns_as_its_words_say(knobs):
    """On rows of random samples, half of whose hulls are clear."""
    rng, steps, rays = np.random.default_rng(3), 48, 40
    runs = np.repeat(rng.random((rays, steps // 3 + 1)) < 0.4, 3, axis=1)[:, :steps]
    density = np.where(runs & (rng.random(runs.shape) < 0.5), rng.random(runs.shape), 0).astype(np.float32)
    tables = [mi.Float(t.astype(np.float32).ravel()) for t in (density, runs)]

    def read(table):
        return lambda x, active: dr.gather(
            mi.Float, table, steps * mi.UInt32(x.y) + mi.UInt32(dr.minimum(x.x, steps - 1)), active
        )

    row = dr.arange(mi.Float, rays)
    camera = Camera(mi.Point3f(0, row + 0.5, 0), mi.Vector3f(1, 0, 0), None, 0.0, np.inf)
    span = dr.zeros(mi.Float, rays), dr.full(mi.Float, steps, rays)
    found = adaptive_march(camera, span, steps, read(tables[0]), cheap=read(tables[1]), **knobs)
    turns = {"turns": steps, **knobs}
    known = [machine(d, h, steps, **turns) for d, h in zip(density, runs, strict=True)]
    assert np.allclose(-np.log(np.array(found.through)), [d for d, _ in known], atol=1e-4)
    assert np.array_equal(np.minimum(np.array(found.came), steps), [at for _, at in known])


def test_one_clear_sample_never_leaves_a_clear_hull():
    """Nothing but clear hull: the march stands still at its first step."""
    camera = Camera(mi.Point3f(0), mi.Vector3f(1, 0, 0), None, 0.0, np.inf)
    span = mi.Float(0), mi.Float(16)
    for zeros, came in ((1, 0), (2, 5), (6, 11)):
        found = adaptive_march(
            camera, span, 16, lambda x, on: mi.Float(0), cheap=lambda x, on: mi.Float(1), zeros=zeros
        )
        assert np.array(found.came)[0] == came


def test_clouds_of_the_scene_hold_their_balls_and_the_deepest_ray_has_the_depth_named():
    scene = ScatteredClouds(cover=1.0)
    p = mi.Point3f(*(500 * np.random.default_rng(1).random((3, 200000)) * 8).astype(np.float32))
    p.z = scene.BASE + p.z / 2
    sigma, hull = np.array(scene.extinction(p)), np.array(scene.hull(p))
    assert np.all(hull[sigma > 0] > 0) and sigma.max() == pytest.approx(scene.sigma_t, rel=0.01)
    inside = table()[:, 3]
    balls = 2 * 4 / 3 * np.pi * (scene.BALL * inside) ** 3 * 2 / 5
    layers = balls.reshape(8, -1)[:4].mean()
    assert sigma.mean() / scene.sigma_t == pytest.approx(layers, rel=0.03)
    one = ScatteredClouds(optical_depth=3.0)
    assert 4 / 3 * one.BALL * one.LARGEST * one.spacing * one.sigma_t == pytest.approx(3.0)


def test_scattered_clouds_by_points_are_the_closed_form():
    assert all(judge(c, 1e-3)["verdict"] == "agrees" for c in scattered_clouds_against_points(2))


@pytest.mark.parametrize("rule", ["energy-conserving", "beer entering"])
def test_light_is_gathered_where_full_samples_meet_cloud(rule):
    """A source of 1 fills what is not let through; added before it is attenuated, it does more."""
    view = ScatteredClouds().view(16)
    cloud, camera = view.cloud, view.camera
    found = adaptive_march(
        camera,
        cloud.span(camera.origin, camera.direction),
        512,
        lambda x, active: cloud.extinction(x),
        cheap=lambda x, active: cloud.model.extinction(x),
        source=lambda x, active: mi.Color3f(1, 2, 3),
        rule=rule,
        turns=4096,
    )
    gathered, filled = np.array(found.gathered), 1 - np.array(found.through)
    assert np.allclose(gathered[1], 2 * gathered[0], rtol=1e-4) and filled.max() > 0.9
    if rule == "energy-conserving":
        assert np.allclose(gathered[0], filled, atol=1e-5)
    else:
        some = filled > 0.1
        assert np.all(gathered[0][some] > filled[some]) and np.allclose(gathered[0], filled, rtol=0.1)
