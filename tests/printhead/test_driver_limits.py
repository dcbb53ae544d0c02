"""A driver's limits are told where a waveform exceeds them, and only there."""

import math

import numpy as np
import pytest

from inkjet_env.printhead import DriverLimits, Waveform

TIME_S, DRIVE_V = Waveform(40.0, -25.0, 2e-6, 8e-6, 3e-6, 9e-6, 2.5e-6).knots()


def test_without_limits_everything_is_allowed():
    assert DriverLimits().excesses(TIME_S, DRIVE_V) == []


@pytest.mark.parametrize(
    ("limits", "told"),
    [
        ({"highest_V": 39}, "goes to 40 V; the driver's highest voltage is 39 V."),
        ({"lowest_V": 0}, "goes to -25 V; the driver's lowest voltage is 0 V."),
        ({"rise_V_per_us": 19}, "rises at 20 V/us from 0 us on; the driver can at most 19 V/us."),
        ({"fall_V_per_us": 21}, "falls at 21.6667 V/us from 10 us on; the driver can at most 21 V/us."),
        ({"shortest_us": 2.2}, "has a segment of 2 us at 0 us; the driver's shortest is 2.2 us."),
        ({"step_us": 1}, "has a corner at 24.5 us; the driver's corners lie on steps of 1 us."),
        (
            {"lowest_V": -60, "highest_V": 68, "bits": 4},
            "goes to -25 V; the driver's voltages are multiples of 8 V.",
        ),
        ({"longest_us": 24}, "lasts 24.5 us; the driver's longest waveform lasts 24 us."),
    ],
)
def test_each_limit_is_told_where_it_is_exceeded_and_not_at_its_value(limits, told):
    assert DriverLimits(**limits).excesses(TIME_S, DRIVE_V) == [told]


@pytest.mark.parametrize(
    "limits",
    [
        {"highest_V": 40}, {"lowest_V": -25}, {"rise_V_per_us": 20}, {"fall_V_per_us": 65 / 3}, {"shortest_us": 2},
        {"step_us": 0.5}, {"step_us": 0.01}, {"longest_us": 24.5}, {"lowest_V": -40, "highest_V": 40, "bits": 4},
    ],
)  # fmt: skip
def test_a_waveform_at_its_limits_is_allowed(limits):
    assert DriverLimits(**limits).excesses(TIME_S, DRIVE_V) == []


def test_a_later_start_does_not_lengthen_a_waveform():
    assert DriverLimits(longest_us=24.5).excesses(TIME_S + 1.0, DRIVE_V) == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("highest=3", "a driver has no limit 'highest'; there are"),
        ("highest_V=x", "highest_V must be a number; got 'x'"),
        ("highest_V=nan", "highest_V must be a number; got nan"),
        ("step_us=-1", "step_us must be at least 0; got -1"),
        ("rise_V_per_us=0", "rise_V_per_us must be above 0; got 0"),
        ("bits=8", "give lowest_V and highest_V too"),
        ("lowest_V=0,highest_V=5,bits=2.5", "bits must be a whole number of at most 32; got 2.5"),
        ("lowest_V=5,highest_V=5", "lowest_V must be below highest_V"),
    ],
)
def test_limits_that_cannot_be_are_refused(text, said):
    with pytest.raises(ValueError, match=said):
        DriverLimits.from_text(text)


def test_limits_are_read_from_text():
    limits = DriverLimits.from_text("lowest_V=0, highest_V=48,rise_V_per_us=20")
    assert limits == DriverLimits(0.0, 48.0, 20.0)
    assert math.isinf(limits.fall_V_per_us)
    assert len(limits.excesses(TIME_S, DRIVE_V * np.array([1, 2, 2, 1, 1, 1]))) == 3
