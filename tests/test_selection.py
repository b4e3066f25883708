"""What a quick look at everything takes, and what it leaves to runs by name."""

from compare.measure import bake_key
from compare.selection import select, technique_tasks, thinned
from compare.task import Task, find_measured, in_order
from scenes.contract import find_scene


def task(knob=None, x=None, *roles):
    fields = {} if x is None else {"slope": x}
    return Task("some", "Valley", 64, fields, {"a": knob}, ("radiance",), roles)


def test_of_a_knob_what_a_threshold_watches_is_taken():
    watched = [task(i, None, "knob:a", *(["threshold"] if i == 1 else [])) for i in range(3)]
    assert thinned(watched) == [watched[1]]


def test_of_an_axis_the_ends_and_the_middle_are_taken():
    points = [task(0, float(x), "stress:slope") for x in (40, 10, 50, 20, 30)]
    assert [t.fields["slope"] for t in thinned(points)] == [10, 50, 30]


def test_a_quick_look_has_every_ladder_and_axis_and_all_that_is_judged_or_shown():
    tasks = technique_tasks(select(["ambient_aperture", "cloud_density"], None), "quick")
    kept = thinned(tasks)
    assert len(kept) < len(tasks)
    found, all_ = ({(t.technique, t.scene, r) for t in c for r in t.roles} for c in (kept, tasks))
    assert all(role.startswith("knob:") for *_, role in all_ - found)
    shown = {"default", "threshold", "path tracer"}
    assert [t for t in tasks if shown & set(t.roles)] == [t for t in kept if shown & set(t.roles)]


def test_a_bake_that_sees_no_view_serves_all_scenes_and_sizes():
    blind, seeing = find_measured("cloud_density"), find_measured("ambient_aperture")
    scenes = find_scene("DensitySection")(), find_scene("DensitySection")(cover=0.9)
    assert len({bake_key(blind, s, n, {"storage": "exact"}) for s in scenes for n in (8, 16)}) == 1
    assert len({bake_key(blind, scenes[0], 8, {"storage": x}) for x in ("exact", "8 bits")}) == 2
    assert len({bake_key(seeing, s, n, {}) for s in scenes for n in (8, 16)}) == 4


def test_tasks_that_share_a_bake_follow_each_other():
    bakes = [64, 128, 64, 128]
    tasks = [
        Task("cloud_density", "DensitySection", 8, {}, {"resolution": n, "wispy": i})
        for i, n in enumerate(bakes)
    ]
    assert [t.knobs["wispy"] for t in in_order(tasks)] == [0, 2, 1, 3]
