"""The instrument of cost: work is deterministic and counts every turn of a loop."""

import drjit as dr
import mitsuba as mi
import pytest

from compare import cost


def loop(turns: int, size: int = 4096) -> mi.Float:
    i, x = mi.UInt32(0), dr.arange(mi.Float, size)
    _, x = dr.while_loop((i, x), lambda i, x: i < turns, lambda i, x: (i + 1, dr.sin(x) + 1))
    return x


def test_work_of_a_loop_grows_with_its_turns():
    few, many = cost.work(lambda: loop(8)), cost.work(lambda: loop(64))
    assert many["operations"] / few["operations"] == pytest.approx(8, rel=0.15)


def test_the_static_count_would_not_see_the_turns():
    with cost.recording():
        few = cost.run(lambda: loop(8))
        many = cost.run(lambda: loop(64))
    count = [sum(k["operation_count"] for k in ks if k["type"] is dr.KernelType.JIT) for ks in (few, many)]
    assert count[0] == count[1]


def test_work_is_the_same_on_every_run():
    assert cost.work(lambda: loop(5)) == cost.work(lambda: loop(5))


def test_rays_are_counted():
    scene = mi.load_dict({"type": "scene", "s": {"type": "sphere"}})

    def frame(rays: int):
        ray = mi.Ray3f(mi.Point3f(dr.arange(mi.Float, 1000), 0, -5), mi.Vector3f(0, 0, 1))
        hit = dr.full(mi.Float, 0, 1000)
        for k in range(rays):
            ray.o.y = 0.1 * k
            hit += dr.select(scene.ray_test(ray), 1.0, 0.0)
        return hit

    assert cost.work(lambda: frame(1))["rays"] == 1000
    assert cost.work(lambda: frame(3))["rays"] == 3000


def test_bytes_follow_the_arrays_that_are_read_and_written():
    a = dr.arange(mi.Float, 1 << 16) + 0.5
    dr.eval(a)
    once = cost.work(lambda: a * 2)["bytes"]
    assert once == (1 << 16) * 8


def test_frame_cost_has_intervals_and_a_calibration_beside_it():
    found = cost.frame_cost(lambda: loop(16), 4096)
    for name in ("frame_ms", "calibration_ms", "frame_over_calibration"):
        e = found[name]
        assert 0 < e["low"] <= e["value"] <= e["high"]
    assert found["operations_per_pixel"] == found["operations"] / 4096
