"""Operating envelopes: crossings, flaws, ends; and the sweeps that they come from."""

import math

import pytest

from approximations.contract import find_technique
from compare.envelope import FLOOR, Point, envelope, point, sentence, tolerance_of
from compare.stability import rows, sweeps
from scenes.contract import BadInput


def test_an_envelope_ends_where_the_error_crosses_the_tolerance():
    points = [Point(0, 0.8), Point(5, 0.1), Point(10, 0.1), Point(15, 0.4)]
    held = envelope(points, Point(7, 0.1), 0.2)
    assert held["low"] == pytest.approx(5 - 5 * math.log(2) / math.log(8))
    assert held["high"] == pytest.approx(12.5)
    assert (held["breaks_below"], held["breaks_above"]) == ("error", "error")


def test_on_a_log_axis_the_crossing_is_a_share_of_the_ratio():
    held = envelope([Point(100, 0.4)], Point(1, 0.1), 0.2, log=True)
    assert held["high"] == pytest.approx(10)


def test_a_flaw_or_a_crash_ends_an_envelope_at_the_last_good_point():
    points = [Point(1, 0.1), Point(2, 0.1, "NaN"), Point(-1, None, "crashed")]
    held = envelope(points, Point(0, 0.1), 1.0)
    assert (held["low"], held["high"]) == (0, 1)
    assert (held["breaks_below"], held["breaks_above"]) == ("crashed", "NaN")


def test_an_envelope_that_reaches_both_ends_says_so():
    held = envelope([Point(0, 0.1), Point(1, 0.1)], Point(0.5, 0.1), 0.2)
    assert sentence("gap", held, "m") == "gap 0 to 1 m (whole axis)"


def test_beyond_a_break_nothing_counts_even_where_the_error_falls_again():
    held = envelope([Point(1, 0.9), Point(2, 0.1)], Point(0, 0.1), 0.2)
    assert held["high"] < 1


def test_a_technique_outside_its_tolerance_has_an_empty_envelope():
    held = envelope([Point(1, 0.1)], Point(0, 0.5), 0.2)
    assert (held["low"], held["high"], held["breaks_above"]) == (0, 0, "error")
    assert tolerance_of(0.1) == 0.2
    assert tolerance_of(0.0) == FLOOR


def record(x, rmse, status="ok", findings=()):
    return {
        "technique": "ambient_aperture",
        "scene": "Valley",
        "quantity": "radiance",
        "fields": {"slope": x},
        "status": status,
        "errors": None if rmse is None else {"rmse": {"value": rmse}},
        "findings": [{"kind": k} for k in findings],
    }


def test_a_point_tells_crashes_and_flaws_from_remarks():
    assert point(record(1, None, "crashed"), "slope") == Point(1, None, "crashed")
    assert point(record(1, 0.1, findings=["negative"]), "slope").flaw == "negative"
    assert point(record(1, 0.1, findings=["rare bright paths"]), "slope").flaw == ""


def test_rows_hold_the_tolerance_asked_for_or_twice_the_error():
    known = [record(x, e) for x, e in ((5.0, 0.1), (45.0, 0.2), (80.0, 0.8))]
    [plain], [asked] = rows(known, "slope", None), rows(known, "slope", 0.3)
    assert (plain["tolerance"], asked["tolerance"]) == ("40 %", "30 %")
    assert 45 < asked["high"] < plain["high"] < 80
    assert plain["envelope"] == f"slope 5 to {plain['high']:.3g} deg (above: error)"


def test_a_sweep_takes_both_ends_and_the_scenes_own_value():
    found = sweeps(find_technique("ambient_aperture"), "Valley", "slope", 4, 32)
    assert [t.fields["slope"] for t in found["Valley", "slope"]] == [5, 30, 45.0, 55, 80]
    whole = sweeps(find_technique("ambient_aperture"), None, None, 3, 32)
    assert ("Valley", "slope") in whole and ("SphereOverPlane", "gap") in whole


def test_a_sweep_of_nothing_is_wrong_use():
    technique = find_technique("ambient_aperture")
    with pytest.raises(BadInput, match="unknown axis"):
        sweeps(technique, None, "slopes", 3, 32)
    with pytest.raises(BadInput, match="is not for"):
        sweeps(technique, "CloudSlab", None, 3, 32)
    with pytest.raises(BadInput, match="--axis"):
        sweeps(find_technique("constant_ambient"), None, None, 3, 32)
