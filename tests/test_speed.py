"""What a frame does is counted right, and what binds it follows from the counts. No time is tested."""

import drjit as dr
import mitsuba as mi
import pytest

from approximations.contract import find_technique
from compare import speed
from scenes.shadow_casters import PoleAndBars
from scenes.sunlit import SphereOverPlane, Valley

N = 1 << 12


@pytest.fixture
def numbers():
    x = dr.arange(mi.Float, N) + 1
    dr.make_opaque(x)
    return x


def test_each_kind_of_work_is_counted_as_often_as_it_is_done(numbers):
    table = dr.full(mi.Float, 2, 64)
    dr.make_opaque(table)

    def frame():
        y = dr.sqrt(numbers) / (numbers + 3)
        return y + dr.gather(mi.Float, table, mi.UInt32(numbers) & 63)

    found = speed.counts(frame)
    assert (found["root"], found["divide"], found["gather"], found["ray"]) == (N, N, N, 0)
    assert found["stream"] == 8 * N
    assert found["arithmetic"] == found["operations"] - 3 * N


def test_loops_are_counted_turn_by_turn(numbers):
    def frame(turns):
        state = (mi.UInt32(0), numbers)
        return dr.while_loop(state, lambda i, x: i < turns, lambda i, x: (i + 1, 1 / x))[1]

    assert speed.counts(lambda: frame(16))["divide"] == 16 * N
    assert speed.counts(lambda: frame(16))["stream"] == speed.counts(lambda: frame(4))["stream"]


def test_rays_are_counted():
    view = SphereOverPlane().view(32)
    found = speed.counts(lambda: view.trace(view.camera.origin, view.camera.direction))
    assert found["ray"] == 32 * 32


def test_a_slow_frame_fails_unless_something_else_binds_it():
    assert speed.verdict("arithmetic", 0.31) == speed.verdict("stream", 0.31) == "good"
    assert speed.verdict("stream", 0.29) == "slow"
    assert speed.verdict("gather", 0.1) == "bound by random access"


def test_a_row_names_the_ceiling_that_takes_longest():
    row = speed.frame_row(find_technique("ambient_aperture"), Valley(), 64)
    assert row["share"] == max(row["shares"].values())
    assert row["binds"] == max(row["shares"], key=row["shares"].get)


def test_work_grows_with_the_pixels():
    found = speed.growth(find_technique("constant_ambient"), Valley(), (32, 64, 128))
    assert found["exponent_of_operations"] == pytest.approx(1, abs=1e-9)
    assert len(found["ms"]) == 3


def test_what_a_frame_does_whatever_its_size_does_not_hide_how_the_rest_grows():
    found = speed.growth(find_technique("rotated_poisson_pcf"), PoleAndBars(), (16, 32, 64))
    assert found["exponent_of_operations"] == pytest.approx(1, abs=0.01)


def test_rows_are_kept_beside_those_of_other_techniques(tmp_path):
    one = {"technique": "a", "scene": "S", "frame_ms": 1}
    speed.save(tmp_path, [one, {**one, "technique": "b"}])
    speed.save(tmp_path, [{**one, "frame_ms": 2}])
    kept = {r["technique"]: r["frame_ms"] for r in speed.read(tmp_path)}
    assert kept == {"a": 2, "b": 1}
    assert speed.read(tmp_path / "none") == []
