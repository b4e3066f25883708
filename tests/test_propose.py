"""Threshold lines that a run proposes: widened as thresholds/README.md says, and read back by the gate."""

import pytest
import tomllib

from compare.gate import load_thresholds
from compare.propose import bias_bounds, lines, rmse_bounds, up


def errors(rmse, bias, half=0.0):
    return {
        "rmse": {"value": rmse, "low": rmse - half, "high": rmse + half},
        "bias": {"value": bias, "low": bias - half, "high": bias + half},
    }


def record(role="default", **changed):
    plain = {"overlap": "smoothstep", "cosine": "normalised", "sky_cosine": "none", "rays": 64}
    from approximations.contract import find_technique
    from scenes.sunlit import Valley

    knobs = find_technique("ambient_aperture").settings({})
    assert set(knobs) == set(plain)
    return {
        "technique": "ambient_aperture",
        "scene": "Valley",
        "quantity": "radiance",
        "roles": [role],
        "knobs": knobs | changed,
        "fields": Valley().fields(),
        "errors": errors(0.5, -0.1, 0.01),
    }


def test_an_error_is_widened_by_eight_percent_and_one_of_rounding_by_three_times():
    assert rmse_bounds(errors(0.5, 0)) == {"at_most": 0.54}
    assert rmse_bounds(errors(2e-5, 0)) == {"at_most": pytest.approx(6e-5)}
    assert rmse_bounds(errors(0.0, 0)) == {}


def test_a_bias_has_room_of_a_hundredth_and_a_half_or_six_percent_of_itself_to_both_sides():
    assert bias_bounds(errors(0.1, 0.1)) == {"at_least": 0.085, "at_most": 0.115}
    assert bias_bounds(errors(0.1, -1.0)) == {"at_least": -1.06, "at_most": -0.94}


@pytest.mark.parametrize(("x", "expected"), [(0.12345, 0.124), (1.0, 1.0), (123.4, 124.0), (9.991e-5, 1e-4)])
def test_bounds_are_rounded_up(x, expected):
    assert up(x) == pytest.approx(expected)


def test_lines_are_thresholds_that_the_gate_reads(tmp_path):
    found = lines(
        [record(), record("knob:overlap", overlap="lens"), record("stress:slope")], "ambient_aperture"
    )
    assert len(found) == 4
    file = tmp_path / "t.toml"
    file.write_text("threshold = [\n" + "\n".join(found) + "\n]\n")
    assert tomllib.loads(file.read_text())["threshold"][2]["knobs"] == {"overlap": "lens"}
    read = load_thresholds(file)
    assert [t.metric for t in read] == ["rmse", "bias", "rmse", "bias"]
    assert read[0].at_most == pytest.approx(0.551)
