"""What a quick look at everything takes, and what it leaves to runs by name."""

from compare.measure import bake_key
from compare.selection import select, technique_tasks, thinned
from compare.task import Task, find_measured
from scenes.contract import find_scene


def task(knob=None, x=None, *roles):
    fields = {} if x is None else {"slope": x}
    return Task("some", "Valley", 64, fields, {"a": knob}, ("radiance",), roles)


def test_of_a_knob_what_a_threshold_watches_is_taken_else_one_setting():
    watched = [task(i, None, "knob:a", *(["threshold"] if i == 1 else [])) for i in range(3)]
    assert thinned(watched) == [watched[1]]
    free = [task(i, None, "knob:a") for i in range(3)]
    assert thinned(free) == [free[2]]


def test_of_an_axis_the_ends_and_the_middle_are_taken():
    points = [task(0, float(x), "stress:slope") for x in (40, 10, 50, 20, 30)]
    assert [t.fields["slope"] for t in thinned(points)] == [10, 50, 30]


def test_a_quick_look_has_every_role_and_all_that_is_judged_or_shown():
    tasks = technique_tasks(select(["ambient_aperture", "cloud_density"], None), "quick")
    kept = thinned(tasks)
    assert len(kept) < len(tasks)
    assert {(t.technique, t.scene, r) for t in kept for r in t.roles} == {
        (t.technique, t.scene, r) for t in tasks for r in t.roles
    }
    shown = {"default", "threshold", "path tracer"}
    assert [t for t in tasks if shown & set(t.roles)] == [t for t in kept if shown & set(t.roles)]


def test_a_bake_that_sees_no_view_serves_all_scenes_and_sizes():
    blind, seeing = find_measured("cloud_density"), find_measured("ambient_aperture")
    scenes = find_scene("DensitySection")(), find_scene("DensitySection")(cover=0.9)
    assert len({bake_key(blind, s, n, {"storage": "exact"}) for s in scenes for n in (8, 16)}) == 1
    assert len({bake_key(blind, scenes[0], 8, {"storage": x}) for x in ("exact", "8 bits")}) == 2
    assert len({bake_key(seeing, s, n, {}) for s in scenes for n in (8, 16)}) == 4
