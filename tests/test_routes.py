"""Second routes to every truth: they agree, and a fault in either of the two is found."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest

from reference import slab_monte_carlo, surface_monte_carlo
from reference.closed_form import caps, coloured_glass, fog, valley
from reference.truth import CLOSED_FORMS, SAMPLERS, find_sampler
from reference.verify import routes, routes_closed_form, routes_monte_carlo
from reference.verify.agreement import Sampled
from reference.verify.checks import SIGNIFICANCE
from reference.verify.run import all_checks, judge
from scenes.contract import QUANTITIES, Scene, all_scenes
from scenes.sunlit import SphereOverPlane, Valley

ROUTES = {name: check for name, check in all_checks().items() if check.kind == "route"}
SEED = 1


RENDERED = functools.cache(routes.rendered)
SOUND = functools.cache(lambda name: ROUTES[name].comparisons(SEED))


@pytest.fixture(autouse=True)
def _renders_are_made_once(monkeypatch):
    for module in (routes, routes_monte_carlo):
        monkeypatch.setattr(module, "rendered", RENDERED)


def judged(name, comparisons):
    """The comparisons of a check, as a whole run of the routes judges them."""
    return [judge(c, SIGNIFICANCE / len(ROUTES) / len(comparisons)) for c in comparisons]


def differs(name):
    """Which comparisons of a check, made anew, disagree."""
    return [r["truth"] for r in judged(name, ROUTES[name].comparisons(SEED)) if r["verdict"] == "differs"]


@pytest.mark.parametrize("name", ROUTES)
def test_two_routes_agree(name):
    assert not [row for row in judged(name, SOUND(name)) if row["verdict"] != "agrees"]


@pytest.mark.parametrize("name", ROUTES)
def test_an_error_a_little_above_what_a_check_says_it_catches_is_caught(name):
    for comparison, sound in zip(SOUND(name), judged(name, SOUND(name)), strict=True):
        b = comparison.second
        factor = 1 + 1.5 * max(sound["catches"], 1e-4)
        faulty = replace(comparison, second=Sampled(factor * b.mean, factor**2 * b.variance, b.batches))
        assert judged(name, [faulty])[0]["verdict"] == "differs", comparison.label


ELSEWHERE = {
    "own Monte Carlo",
    "closed form",
    "RGB",
    "contour integrals of texels",
    "contour integrals of strips",
}
LESS_POWER = {
    "AreaLitPlane": 0.02,
    "BallRoom": 0.02,
    "IrradianceTrack": 0.08,
    "MaterialBorder": 0.02,
    "PictureLitPlane": 0.1,
    "PillarRoom": 0.02,
    "PolishedFloorRoom": 0.015,
    "RoundLitPlane": 0.015,
    "SolidsUnderSky": 0.03,
    "StainedRoom": 0.03,
    "Terrain": 0.04,
    "WindowRoom": 0.03,
}
"""Scenes where 1 % of the whole image would go unseen, for lack of samples that a test can wait for or where
the two routes may differ a little by right; and what is caught."""


def test_one_percent_of_the_energy_is_caught_on_every_scene():
    """By one check at least of those that hold its truth against an answer from elsewhere."""
    caught = set()
    for name, check in ROUTES.items():
        if set(check.routes) & ELSEWHERE:
            for row in judged(name, SOUND(name)):
                scene = row["truth"].split("(")[0].split()[0]
                caught |= {scene} if row["catches"] <= LESS_POWER.get(scene, 0.011) else set()
    assert caught >= set(all_scenes())


def test_every_scene_and_every_declared_truth_has_a_second_route():
    covered = {scene for check in ROUTES.values() for scene in check.scenes}
    assert covered == set(all_scenes())
    second = {"own Monte Carlo", "closed form"}
    by_scene = {scene for check in ROUTES.values() if set(check.routes) & second for scene in check.scenes}
    declared = {(scene, quantity) for scene, quantity in (*CLOSED_FORMS, *SAMPLERS)}
    assert {scene.__name__ for scene, _ in declared if scene is not Scene} <= by_scene
    assert all(any(q in name for name in ROUTES) for scene, q in declared if scene is Scene)
    assert all(find_sampler(scene, QUANTITIES[quantity]) for scene, quantity in SAMPLERS)


def scaled(function, factor):
    """A function whose results are all `factor` times as large."""
    return lambda *args, **kwargs: factor * function(*args, **kwargs)


def uniform_hemisphere(n, rng):
    return surface_monte_carlo.about(n, rng.random(n.shape[1]), rng)


def test_a_wrong_cosine_is_caught(monkeypatch):
    monkeypatch.setattr(surface_monte_carlo, "cosine_weighted", uniform_hemisphere)
    assert len(differs("surfaces_against_walks")) == 6


def test_one_percent_of_energy_lost_by_surfaces_is_caught(monkeypatch):
    exact = surface_monte_carlo.first_hits

    def lossy(known, o, w):
        t, n, rho = exact(known, o, w)
        return t, n, 0.99 * rho

    monkeypatch.setattr(surface_monte_carlo, "first_hits", lossy)
    assert len(differs("surfaces_against_walks")) == 6


def test_a_biased_roulette_is_caught(monkeypatch):
    """Walks are cut with probability 2 % from the second hit on, and those that go on are not made up for."""
    exact, rng = surface_monte_carlo.cosine_weighted, np.random.default_rng(3)

    def cut(n, walk_rng):
        w = exact(n, walk_rng)
        return np.where(rng.random(n.shape[1]) < 0.02, -n, w)

    monkeypatch.setattr(surface_monte_carlo, "cosine_weighted", cut)
    assert any("Valley radiance" in name for name in differs("surfaces_against_walks"))


def test_a_pixel_grid_shifted_by_half_a_pixel_is_caught(monkeypatch):
    exact = surface_monte_carlo.eye_rays

    def shifted(sensor, size, samples=1, rng=None):
        o, w = exact(sensor, size, samples, rng)
        to_world = np.array(sensor["to_world"].matrix, np.float64)
        across = to_world[:3, 0:1] * math.tan(math.radians(sensor["fov"]) / 2) / size
        return o, surface_monte_carlo.unit(w / (to_world[:3, 2] @ w) + across)

    monkeypatch.setattr(surface_monte_carlo, "eye_rays", shifted)
    assert len(differs("surfaces_against_walks")) == 6


def test_a_cloud_that_absorbs_one_percent_is_caught(monkeypatch):
    exact = slab_monte_carlo.radiance
    monkeypatch.setattr(
        slab_monte_carlo,
        "radiance",
        lambda p, w, exit_depth, l, albedo, g, rng: exact(p, w, exit_depth, l, 0.99 * albedo, g, rng),
    )
    monkeypatch.setattr(routes_monte_carlo, "CLOUDS", routes_monte_carlo.CLOUDS[:1])
    assert differs("clouds_against_walks")


@pytest.mark.parametrize(
    ("module", "function", "factor", "check"),
    [
        (valley, "valley_direct", 0.99, "caps_against_direct"),
        (caps, "vector_irradiance", 1.01, "caps_against_direct"),
        (caps, "lens_area", 0.98, "caps_against_directions"),
        (caps, "horizon_irradiance", 1.02, "caps_against_directions"),
        (coloured_glass, "radiance", 0.99, "coloured_glass_against_volpathmis"),
        (fog, "optical_depth", 1.01, "fog_against_volpath"),
        (routes_closed_form, "once_scattered_by_slab", 0.99, "once_scattered_against_volpath"),
        (routes_closed_form, "once_scattered_by_sphere", 0.99, "once_scattered_against_volpath"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_a_closed_form_that_is_off_by_a_percent_or_two_is_caught(
    monkeypatch, module, function, factor, check
):
    monkeypatch.setattr(module, function, scaled(getattr(module, function), factor))
    assert differs(check)


def test_light_of_a_second_reflection_is_not_direct(monkeypatch):
    exact = routes.rendered

    def deeper(scene, quantity, drawn, spp, **changes):
        changes |= {"max_depth": 3} if "max_depth" in changes else {}
        return exact(scene, quantity, drawn, spp, **changes)

    monkeypatch.setattr(routes, "rendered", deeper)
    assert len(differs("direct_against_path")) == 2


def test_own_hits_are_mitsubas(rng):
    import mitsuba as mi

    for scene in (SphereOverPlane(gap=0.4), Valley()):
        loaded = mi.load_dict({"type": "scene", **scene.surfaces()}, optimize=False)
        o = np.array([[0.3], [-0.2], [5.0]]) + rng.normal(0, 0.3, (3, 4000))
        w = surface_monte_carlo.unit(rng.normal(size=(3, 4000)) - [[0], [0], [2.0]])
        si = loaded.ray_intersect(mi.Ray3f(mi.Point3f(o), mi.Vector3f(w)))
        t, n, _ = surface_monte_carlo.first_hits(surface_monte_carlo.shapes(scene.surfaces()), o, w)
        met = np.isfinite(t)
        assert np.mean(met != np.array(si.is_valid())) < 1e-3
        both = met & np.array(si.is_valid())
        assert np.allclose(np.array(si.t)[both], t[both], rtol=1e-4)
        assert np.allclose(np.array(si.n)[:, both], n[:, both], atol=1e-3)
