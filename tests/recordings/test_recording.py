"""A recording and a campaign refuse what they cannot mean."""

import pickle

import numpy as np
import pytest

from inkjet_env.recordings import Campaign, Recording
from inkjet_env.recordings.campaign import Source


def recording(name="r001", **changed):
    n = 50
    fields = {
        "time_s": np.arange(n) * 1e-6,
        "drive_V": np.linspace(0, 90, n),
        "sensor": np.sin(np.arange(n)),
        "unit": "V",
        "channel": "self_sensing",
    }
    return Recording(name=name, **fields | changed)


def changed_at(k, value, values):
    values = np.array(values, dtype=float)
    values[k] = value
    return values


TIME_S = np.arange(50) * 1e-6


def test_arrays_are_float64_copies_that_cannot_be_written():
    drive = np.zeros(50, dtype=np.int32)
    r = recording(drive_V=drive, neighbour_V=drive)
    drive[0] = 7
    for values in (r.time_s, r.drive_V, r.sensor, r.neighbour_V):
        assert values.dtype == np.float64
        assert values[0] == 0
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0
    assert r.drive_monitor_V is None


def test_recordings_and_campaigns_can_go_to_another_process():
    campaign = Campaign("c", (recording(condition={"temperature_C": 25}),), sources={"r001": Source("r001.csv")})
    again = pickle.loads(pickle.dumps(campaign))
    assert again["r001"].condition == {"temperature_C": 25.0}
    assert np.array_equal(again["r001"].sensor, campaign["r001"].sensor)
    assert again.sources == campaign.sources


def test_rate_step_and_duration_are_of_the_samples():
    r = recording(time_s=TIME_S - 20e-6)
    assert r.step_s == pytest.approx(1e-6)
    assert r.sample_rate_Hz == pytest.approx(1e6)
    assert r.duration_s == pytest.approx(49e-6)


@pytest.mark.parametrize(("unit", "column"), [("V", "sensor_V"), ("um", "displacement_um"), ("nm", "displacement_nm")])
def test_the_sensor_column_carries_the_unit(unit, column):
    assert recording(unit=unit).sensor_column == column


def test_one_percent_of_a_step_is_uniform_and_two_are_not():
    recording(time_s=changed_at(20, 20.009e-6, TIME_S))
    with pytest.raises(ValueError, match=r"uniform to 1% of a step; sample 21 of 50 is 0\.019.* steps"):
        recording(time_s=changed_at(20, 20.02e-6, TIME_S))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"channel": "selfsensing"}, "Did you mean 'self_sensing'"),
        ({"channel": None}, "channel must be one of"),
        ({"initial_state": "demagnetized"}, "Did you mean 'demagnetised'"),
        ({"unit": "mV"}, "unit must be one of V, um, nm"),
        ({"excitation": 3}, "excitation must be a string"),
        ({"order": 0}, "order must be a whole number from 1 to 1,000,000"),
        ({"order": True}, "order must be"),
        ({"order": 1.5}, "order must be"),
        ({"repeat_of": 1}, "repeat_of must be"),
        ({"condition": [1]}, "condition must map"),
        ({"condition": {"temperature_C": "25"}}, "finite numbers; got 'temperature_C': '25'"),
        ({"condition": {"temperature_C": np.inf}}, "finite numbers"),
        ({"condition": {"temperature_C": 10**400}}, "finite numbers"),
        ({"drive_V": np.zeros(49)}, "as long as time_s, 50 samples; got 49"),
        ({"sensor": np.zeros((50, 1))}, r"shape \(n,\); got shape \(50, 1\)"),
        ({"sensor": None}, "sensor must"),
        ({"sensor": 1j * TIME_S}, "sensor must be real numbers"),
        ({"sensor": ["x"] * 50}, "sensor must be numbers"),
        ({"sensor": changed_at(7, np.nan, TIME_S)}, "sensor must be finite; got nan at sample 8 of 50"),
        ({"neighbour_V": changed_at(7, np.inf, TIME_S)}, "neighbour_V must be finite"),
        ({"time_s": [0.0], "drive_V": [0.0], "sensor": [0.0]}, "at least 2 samples; got 1"),
        ({"time_s": [], "drive_V": [], "sensor": []}, "at least 2 samples; got 0"),
        ({"time_s": 0.0}, "time_s must have shape"),
        ({"time_s": TIME_S[::-1]}, "time_s must increase"),
        ({"time_s": changed_at(7, 6e-6, TIME_S)}, "at sample 8 of 50"),
        ({"time_s": np.linspace(-1, 1, 50) * 1.7e308}, "time_s must be uniform"),
        ({"time_s": 1e9 + TIME_S}, "time_s must"),
    ],
)
def test_what_is_no_recording_is_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        recording(**changed)


@pytest.mark.parametrize("name", ["", "a/b", "..", "a\\b", "a\0", "x" * 151, "µ" * 99, ".hidden", None, "a\nb"])
def test_a_name_that_no_file_can_have_is_refused(name):
    with pytest.raises(ValueError, match="a recording's name must be"):
        recording(name)


def test_recordings_are_found_by_name_and_by_label():
    campaign = Campaign("c", (recording("a"), recording("b", channel="strain_gauge", excitation="sine")))
    assert campaign["b"].channel == "strain_gauge"
    assert [r.name for r in campaign.select()] == ["a", "b"]
    assert [r.name for r in campaign.select(channel="strain_gauge", excitation="sine")] == ["b"]
    assert campaign.select(channel="strain_gauge", excitation="arbitrary") == ()
    assert campaign.select(initial_state="periodic") == ()
    with pytest.raises(KeyError, match="no recording 'rb'"):
        campaign["rb"]


def test_repeats_of_repeats_are_one_group():
    recordings = [recording("a"), recording("b", repeat_of="a"), recording("c", repeat_of="b"), recording("d")]
    groups = Campaign("c", recordings).repeats()
    assert {name: [r.name for r in group] for name, group in groups.items()} == {"a": ["a", "b", "c"]}


@pytest.mark.parametrize(
    ("recordings", "message"),
    [
        ([], "at least one recording"),
        ([recording("a"), recording("a")], "recording 'a' occurs twice"),
        ([recording("r001"), recording("b", repeat_of="r01")], "Did you mean 'r001'"),
        ([recording("a", repeat_of="a")], "cycle: a → a"),
        ([recording("a", repeat_of="b"), recording("b", repeat_of="a")], "cycle: a → b → a"),
    ],
)
def test_campaigns_that_contradict_themselves_are_refused(recordings, message):
    with pytest.raises(ValueError, match=message):
        Campaign("c", recordings)
