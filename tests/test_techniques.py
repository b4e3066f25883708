"""What every technique must do, generated from its declaration: nothing here names a technique."""

import numpy as np
import pytest

from approximations.contract import all_techniques
from compare import metrics
from compare.measure import as_image, baked, evaluate, make_view
from compare.task import PROFILES, plan
from reference import store
from scenes.contract import QUANTITIES, make_scene

SIZE = 24
TECHNIQUES = list(all_techniques().values())
PAIRS = [(t, s) for t in TECHNIQUES for s in t.on]


def on_scene(pair):
    return f"{pair[0].name}-{pair[1].__name__}" if isinstance(pair, tuple) else str(pair)


def image(technique, scene, view=None, size=SIZE, **knobs):
    """The technique at one sample a pixel, on its scene or on another view of it, baked for that view."""
    frame, bake = technique.split(technique.settings(knobs))
    probes = technique.estimates.probes
    if view is None:
        view, extra = make_view(scene, size, probes), baked(technique, scene, size, probes, bake)
    else:
        extra = (technique.run_bake(view, bake),) if technique.bake_function else ()
    return as_image(technique(view, *extra, **frame), size, technique.name)


@pytest.mark.parametrize("pair", PAIRS, ids=on_scene)
def test_image_is_finite_and_not_negative_with_every_default(pair):
    technique, scene = pair
    assert not metrics.flaws(image(technique, scene()), signed=technique.estimates.kind == "length")


@pytest.mark.parametrize("pair", PAIRS, ids=on_scene)
def test_the_same_setting_gives_the_same_image(pair):
    technique, scene = pair
    assert np.array_equal(image(technique, scene()), image(technique, scene()))


@pytest.mark.parametrize("pair", PAIRS, ids=on_scene)
def test_every_knob_setting_runs_and_changes_nothing_else_than_the_image(pair):
    technique, scene = pair
    shape = image(technique, scene()).shape
    for knob, values in technique.variations().items():
        for value in values:
            assert image(technique, scene(), **{knob: value}).shape == shape


@pytest.mark.parametrize(
    ("technique", "claim"),
    [(t, c) for t in TECHNIQUES for c in t.claims],
    ids=lambda x: getattr(x, "name", None) or x.kind,
)
def test_claim_holds(technique, claim):
    if claim.kind == "exact":
        scene = make_scene(claim.scene, claim.fields)
        quantity = claim.quantity or technique.estimates
        found = evaluate(technique, scene, technique.estimates, technique.settings(claim.knobs), 32)
        truth, _ = store.obtain(scene, quantity, 32)
        e = metrics.errors(found, truth, quantity, None)["rmse"]
        assert e.low < claim.bound, f"{e.value:.4g} against {claim.bound}"
        return
    for scene in technique.on:
        plain = image(technique, scene())
        if claim.kind == "at most":
            assert plain.max() <= claim.bound
            continue
        view = make_view(scene(), SIZE, technique.estimates.probes)
        doubled = image(technique, scene(), view.brighter(2.0))
        assert np.allclose(doubled, 2 * plain, rtol=1e-5)


@pytest.mark.parametrize("technique", TECHNIQUES, ids=lambda t: t.name)
def test_declaration_is_whole(technique):
    assert technique.source and technique.replaces and technique.neglects
    assert technique.baseline or technique.covers
    assert technique.baseline or technique.domain_function is not None
    assert all(technique.estimates in s.quantities for s in technique.on)
    assert all(q in QUANTITIES.values() for q in technique.also)
    unit = {"radiance": "W m^-2", "ratio": "0 to 1", "length": "(m)"}[technique.estimates.kind]
    assert unit in technique.function.__doc__


def test_the_quick_plan_sweeps_every_knob_every_stage_and_every_stressed_field():
    tasks = plan(TECHNIQUES, PROFILES["quick"])
    roles = {(t.technique, t.scene, r) for t in tasks for r in t.roles}
    for technique in TECHNIQUES:
        for scene in technique.on:
            name = scene.__name__
            assert (technique.name, name, "default") in roles
            for knob, values in technique.variations().items():
                assert not values or (technique.name, name, f"knob:{knob}") in roles
            for i in range(1, 1 + len(technique.stages())):
                assert (technique.name, name, f"ladder:{i}") in roles
            for field in technique.stress.get(name, ()):
                assert (technique.name, name, f"stress:{field}") in roles
    keys = [f"{t.key('llvm_ad_rgb')}-{q}" for t in tasks for q in t.quantities]
    assert len(keys) == len(set(keys))
