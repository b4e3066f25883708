"""Efficiency as a ratio: what is compared with what, and how its verdict follows. No time is tested."""

import math

import pytest

from reference import bench
from reference.transport import transport
from scenes.cloud import CloudSphere
from scenes.contract import RADIANCE, BadInput
from scenes.sunlit import SphereOverPlane


def row(gain, error, scene="A"):
    low, high = gain * math.exp(-2 * error), gain * math.exp(2 * error)
    return {"scene": scene, "gain": {"value": gain, "low": low, "high": high}, "log_error": error}


@pytest.mark.parametrize(
    ("rows", "verdict"),
    [
        ([row(8, 0.05), row(1.2, 0.05)], "pass"),
        ([row(2.2, 0.2), row(2.1, 0.2)], "not judged"),
        ([row(1.2, 0.05), row(1.3, 0.05)], "fail"),
        ([row(40, 0.05), row(0.8, 0.02)], "fail"),
        ([row(40, 0.05), row(0.96, 0.05)], "not judged"),
    ],
)
def test_the_verdict_needs_whole_intervals_on_the_good_side(rows, verdict):
    assert bench.summary(rows)["verdict"] == verdict


def test_the_geometric_mean_and_the_least_are_those_of_the_rows():
    whole = bench.summary([row(8, 0.1, "A"), row(2, 0.1, "B")])
    assert whole["geometric_mean"]["value"] == pytest.approx(4)
    assert whole["least"]["scene"] == "B"


def test_the_ladder_leads_from_stock_to_ours_one_setting_at_a_time():
    steps = bench.rungs(CloudSphere(), 32)
    assert steps[0] == ("stock", bench.stock(CloudSphere(), 32))
    assert steps[0][1].integrator == {"type": "volpath"} and steps[0][1].sampler == "independent"
    assert [name for name, _ in steps] == ["stock", "entry into media", "roulette", "batch size"]
    assert steps[-1][1] == transport(CloudSphere().mitsuba(32), RADIANCE, 32)
    assert bench.rungs(SphereOverPlane(), 32)[-1][1].sampler == "multijitter"


def test_shares_multiply_to_the_gain_which_strata_make_large():
    found = bench.measure(SphereOverPlane(), 16, 6)
    assert math.prod(found["shares"].values()) == pytest.approx(found["gain"]["value"])
    assert found["noise"][-1] < found["noise"][0] / 2


def test_a_large_image_takes_no_more_memory_for_more_samples():
    found = bench.memory(size=256, batches=2)
    assert found["peak_GiB"] < 1.3 * found["first_GiB"] < 4


def test_a_scene_without_rendered_radiance_is_refused():
    with pytest.raises(BadInput, match="unknown scene"):
        bench.scenes_to_measure(["Vally"])
