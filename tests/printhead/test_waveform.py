"""The waveform, its box, and what is refused at the border."""

import numpy as np
import pytest

from inkjet_env.printhead import Bounds, Waveform, as_waveform_array

GOOD = (80.0, -60.0, 2e-6, 8e-6, 3e-6, 5e-6, 4e-6)


def changed(index, value):
    values = list(GOOD)
    values[index] = value
    return values


def test_knots_are_the_six_corners_and_the_drive_is_linear_between_them():
    waveform = Waveform(*GOOD)
    time_s, drive_V = waveform.knots()
    np.testing.assert_allclose(np.diff(time_s), GOOD[2:], rtol=1e-14)
    np.testing.assert_array_equal(drive_V, [0, 80, 80, -60, -60, 0])
    middle = (time_s[2] + time_s[3]) / 2
    assert waveform.drive_V(middle) == pytest.approx(10.0)
    assert waveform.drive_V([-1e-6, 1.0]).tolist() == [0.0, 0.0]
    assert waveform.duration_s == pytest.approx(22e-6)


def test_array_round_trip_keeps_every_bit():
    assert Waveform.from_array(Waveform(*GOOD).to_array()) == Waveform(*GOOD)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (changed(0, -1.0), r"U1 must be at least 0 V; got -1 V\. .*U2"),
        (changed(1, 1.0), r"U2 must be at most 0 V; got 1 V\. .*U1"),
        (changed(2, -1e-6), r"t1 must be a duration of at least 0 s; got -1e-06 s\. Check the sign and the order"),
        (changed(6, -1e-9), r"t5 must be a duration of at least 0 s"),
        (changed(3, np.nan), r"t2 must be finite; got nan s\. Replace"),
        (changed(1, -np.inf), r"U2 must be finite"),
        (GOOD[:6], r"shape \(7,\) or \(n, 7\).*got shape \(6,\)"),
        ([["a"] * 7], "must be numbers"),
    ],
)
def test_a_broken_rule_is_named_with_what_came_and_the_fix(values, message):
    with pytest.raises(ValueError, match=message):
        as_waveform_array(values)


def test_the_row_of_a_bad_waveform_is_named():
    with pytest.raises(ValueError, match=r"t3 must be .* in row 2 of the waveforms"):
        as_waveform_array([GOOD, GOOD, changed(4, -1.0)])


def test_the_box_maps_its_corners_exactly_and_back():
    bounds = Bounds()
    np.testing.assert_array_equal(bounds.from_unit(np.ones(7)), bounds.upper)
    np.testing.assert_array_equal(bounds.from_unit(-np.ones(7)), bounds.lower)
    points = np.random.default_rng(0).uniform(-1, 1, (50, 7))
    np.testing.assert_allclose(bounds.to_unit(bounds.from_unit(points)), points, atol=1e-12)


def test_a_box_of_no_width_pins_the_parameter():
    bounds = Bounds(lower=(100, -100, *[1e-6] * 5), upper=(100, 0, *[20e-6] * 5))
    assert bounds.from_unit(np.zeros(7))[0] == 100.0
    assert bounds.to_unit(bounds.from_unit(np.ones(7)))[0] == 0.0


def test_bounds_the_wrong_way_round_are_refused():
    with pytest.raises(ValueError, match=r"must not exceed bounds\.upper.*t4"):
        Bounds(lower=(0, -100, 1e-6, 1e-6, 1e-6, 30e-6, 1e-6))
    with pytest.raises(ValueError, match="must hold 7 values"):
        Bounds(lower=(0, 1))
