"""The battery spans what it says it does."""

import csv
import math
import re

import numpy as np
import pytest

from inkjet_env.printhead import DriverLimits, Printhead, respond_sampled
from inkjet_env.rig import (
    DriveLine,
    battery_within,
    default_battery,
    displacement_battery,
    plan_csvs,
    self_sensing_battery,
    strain_gauge_battery,
)
from inkjet_env.rig.answer import answer_V
from inkjet_env.rig.battery import LARGEST_DRIVE_V, odd_multisine

HEAD = Printhead.published()
FAST = self_sensing_battery(HEAD.frequency_Hz)
SLOW = strain_gauge_battery()


def driven(lines):
    return [line for line in lines if line.drive_V.any()]


def test_a_campaign_is_of_the_promised_size():
    assert 24 <= sum(line.repeats for line in FAST) <= 30
    assert 7 <= sum(line.repeats for line in SLOW) <= 8


def test_labels_are_unique_and_every_line_says_what_it_is_for():
    labels = [(line.channel, line.label) for line in default_battery()]
    assert len(set(labels)) == len(labels)
    assert all(len(line.purpose) > 20 for line in default_battery())


def test_drives_use_both_signs_up_to_the_rated_voltage_and_never_more():
    for lines in (FAST, SLOW):
        largest, least = max(line.drive_V.max() for line in lines), min(line.drive_V.min() for line in lines)
        assert 90 <= largest <= 100
        assert -100 <= least <= -90


def test_single_pulses_step_through_five_amplitudes_of_either_sign():
    single = [line.drive_V for line in FAST if re.fullmatch(r"trapezoid-(minus)?\d+V", line.label)]
    assert [u.max() for u in single if u.min() == 0] == [20, 40, 60, 80, 100]
    assert [u.min() for u in single if u.max() == 0] == [-40, -100]


def test_every_excitation_a_diagnosis_asks_for_is_there():
    assert {line.excitation for line in FAST} == {"trapezoid", "bipolar", "pulse_pair", "multisine", "step", "zero"}
    assert {line.excitation for line in SLOW} == {"sine", "minor_loops", "step", "zero"}
    assert (
        {line.initial_state for line in FAST} == {line.initial_state for line in SLOW} == {"periodic", "demagnetised"}
    )


def test_each_channel_is_silent_at_least_twice_and_repeats_something_loud():
    for lines in (FAST, SLOW):
        assert sum(line.repeats for line in lines if not line.drive_V.any()) >= 2
        assert any(line.repeats > 1 for line in driven(lines))


def test_a_drive_starts_and_ends_at_rest_where_it_is_fired_as_pulses():
    for line in FAST:
        if line.excitation in ("trapezoid", "bipolar", "pulse_pair"):
            assert line.drive_V[0] == line.drive_V[-1] == 0, line.label
    assert all(line.drive_V[0] == 0 for line in FAST + SLOW if line.initial_state == "demagnetised")


@pytest.mark.parametrize("frequency_Hz", [5e3, 51.7e3, 400e3])
def test_times_scale_with_the_expected_resonance(frequency_Hz):
    for line in driven(self_sensing_battery(frequency_Hz)):
        assert 95 <= 1 / (line.step_s * frequency_Hz) <= 105  # samples a period
        periods = line.drive_V.size * line.step_s * frequency_Hz
        low, high = (38, 42) if line.excitation == "multisine" else (5.7, 20)
        assert low <= periods <= high, line.label


def test_multisines_have_odd_lines_only_equal_and_from_a_tenth_to_two_and_a_half_of_the_resonance():
    for line in (line for line in FAST if line.excitation == "multisine"):
        spectrum = np.abs(np.fft.rfft(line.drive_V))
        there = np.flatnonzero(spectrum > 1e-9 * spectrum.max())
        assert np.array_equal(there, np.arange(3, 103, 2))
        assert np.ptp(spectrum[there]) < 1e-9 * spectrum.max()
        frequency_Hz = there / line.repetition_period_s
        assert frequency_Hz[0] <= 0.1 * HEAD.frequency_Hz
        assert frequency_Hz[-1] >= 2.5 * HEAD.frequency_Hz


def test_a_head_answers_an_odd_multisine_on_odd_lines_only():
    for line in (line for line in FAST if line.excitation == "multisine"):
        spectrum = np.abs(np.fft.rfft(answer_V(HEAD, line)))
        assert spectrum[::2].max() < 1e-9 * spectrum[1::2].max(), line.label


def test_multisines_of_different_phases_differ_and_of_one_seed_are_the_same():
    one, again, other = (odd_multisine(4000, 101, 50, np.random.default_rng(seed)) for seed in (0, 0, 1))
    assert np.array_equal(one, again)
    assert np.corrcoef(one, other)[0, 1] < 0.5


def test_slow_loops_are_whole_sines_of_90_volts_at_three_rates():
    loops = [line for line in SLOW if line.excitation == "sine"]
    omega = [2 * np.pi / line.repetition_period_s for line in loops]
    np.testing.assert_allclose(omega, [0.5, 1.0, 5.0])
    for loop in loops:
        np.testing.assert_allclose(
            loop.drive_V, 90 * np.sin(2 * np.pi * loop.time_s / loop.repetition_period_s), atol=1e-9
        )
        assert (loop.drive_V.max(), loop.drive_V.min()) == (90, -90)
    assert all(90 <= 1 / line.step_s <= 1000 for line in SLOW)


def test_minor_loops_nest_within_the_major_one():
    (line,) = (line for line in SLOW if line.excitation == "minor_loops")
    heading = np.sign(np.diff(line.drive_V))
    turning_V = line.drive_V[1:-1][heading[1:] != heading[:-1]]
    np.testing.assert_allclose(turning_V, [90, -90, 90, -60, 90, -30, 90, 0, 90, 30, 90, -90], atol=1e-9)


def test_the_staircase_holds_90_volts_for_three_decades_of_time():
    (line,) = (line for line in SLOW if line.excitation == "step")
    assert (line.drive_V == 90).sum() * line.step_s == pytest.approx(20)
    assert line.step_s <= 20 / 1000


@pytest.mark.parametrize("line", [x for x in driven(FAST) if x.initial_state == "periodic"], ids=lambda x: x.label)
def test_a_periodic_answer_is_what_many_repetitions_settle_to(line):
    laps = 1 + int(np.ceil(20 / (HEAD.a1 / 2 * line.repetition_period_s)))
    time_s = line.step_s * np.arange(laps * line.drive_V.size)
    long = respond_sampled(HEAD, time_s, np.tile(line.drive_V, laps), "demagnetised")
    settled_V = long.sensor_V[-line.drive_V.size :]
    np.testing.assert_allclose(answer_V(HEAD, line), settled_V, atol=1e-6 * np.abs(settled_V).max())


@pytest.mark.parametrize("line", driven(FAST), ids=lambda line: line.label)
def test_every_driven_line_tells_frequency_damping_and_gain(line):
    # Cramér–Rao bound of one recording with noise of 3 mV.
    steps = {"frequency_Hz": 1e-4, "damping_ratio": 1e-3, "gain": 1e-3}
    columns = []
    for name, step in steps.items():
        now = getattr(HEAD, name, 1.0)
        up, down = (answer_V(HEAD.varied(**{name: now * (1 + sign * step)}), line) for sign in (1, -1))
        columns.append((up - down) / (2 * step))
    sensitivity = np.column_stack(columns) / 3e-3
    deviation = np.sqrt(np.diag(np.linalg.inv(sensitivity.T @ sensitivity)))
    assert (deviation < [1e-4, 2e-3, 2e-3]).all(), deviation


@pytest.mark.parametrize("frequency_Hz", [0.0, -5e4, float("nan")])
def test_a_resonance_that_cannot_be_is_refused(frequency_Hz):
    with pytest.raises(ValueError, match="frequency_Hz must be finite and above 0 Hz"):
        self_sensing_battery(frequency_Hz)


def test_a_displacement_battery_is_the_same_drives_for_a_vibrometer():
    lines = displacement_battery(HEAD.frequency_Hz)
    assert {line.channel for line in lines} == {"displacement"}
    assert {"trapezoid", "bipolar", "multisine", "step", "zero"} == {line.excitation for line in lines}
    fast = {line.label: line.drive_V for line in FAST}
    assert all(np.array_equal(line.drive_V, fast[line.label]) for line in lines)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"drive_V": np.array([0, 101.0])}, "line x: drive_V must be within ±100 V.*got 101 V"),
        ({"repeats": 0}, "line x: repeats must be at least 1; got 0"),
        ({"channel": "self-sensing"}, "channel must be one of .* Did you mean 'self_sensing'"),
        ({"initial_state": "free"}, "initial_state must be one of periodic, demagnetised; got 'free'"),
        ({"drive_V": np.array([0.0])}, "at least 2 samples"),
        ({"step_s": 0.0}, "time_s must increase"),
    ],
)
def test_a_line_that_cannot_be_driven_is_refused(changed, message):
    line = {
        "label": "x",
        "channel": "self_sensing",
        "excitation": "step",
        "initial_state": "periodic",
        "step_s": 1e-6,
        "drive_V": np.array([0, 1.0]),
        "purpose": "to be refused",
    }
    with pytest.raises(ValueError, match=message):
        DriveLine(**{**line, **changed})


def test_a_plan_is_a_file_a_line_and_a_list_of_them(tmp_path):
    plan_csvs(tmp_path / "plan", FAST[:3] + SLOW[-2:])
    with open(tmp_path / "plan" / "plan.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 5
    assert {path.name for path in (tmp_path / "plan").iterdir()} == {row["file"] for row in rows} | {"plan.csv"}
    for row, line in zip(rows, FAST[:3] + SLOW[-2:], strict=True):
        time_s, drive_V = np.loadtxt(tmp_path / "plan" / row["file"], delimiter=",", skiprows=1).T
        np.testing.assert_allclose(time_s, line.time_s, rtol=1e-11)
        np.testing.assert_allclose(drive_V, line.drive_V, atol=1e-6)
        assert (row["channel"], row["purpose"], int(row["repeats"])) == (line.channel, line.purpose, line.repeats)
        if line.initial_state == "periodic":
            assert float(row["repetition_period_s"]) == pytest.approx(line.drive_V.size * float(row["sample_step_s"]))
        else:
            assert row["repetition_period_s"] == ""


def test_a_plan_needs_lines_with_labels_of_their_own(tmp_path):
    with pytest.raises(ValueError, match=r"2 would be written to self_sensing-trapezoid-20V\.csv"):
        plan_csvs(tmp_path, [FAST[0], FAST[1], FAST[0]])
    with pytest.raises(ValueError, match="at least one line"):
        plan_csvs(tmp_path, [])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("lowest_V", "highest_V"),
    [(-math.inf, math.inf), (-math.inf, 60.0), (-30.0, 60.0), (0.0, math.inf), (0.0, 40.0), (-50.0, 0.0)],
)
def test_a_battery_within_a_drivers_voltages_keeps_its_amplitudes_apart(lowest_V, highest_V):
    battery = default_battery()
    lines = battery_within(battery, DriverLimits(lowest_V, highest_V))
    for line in lines:
        assert lowest_V - 1e-9 <= line.drive_V.min() <= line.drive_V.max() <= highest_V + 1e-9
        assert np.abs(line.drive_V).max() <= LARGEST_DRIVE_V
    largest_V = {float(f"{np.ptp(line.drive_V):.6g}") for line in lines if line.channel == "self_sensing"}
    assert len(largest_V) > 4
    assert len(lines) >= 0.8 * len(battery)
    if math.isinf(lowest_V) and math.isinf(highest_V):
        assert [line.drive_V.tolist() for line in lines] == [line.drive_V.tolist() for line in battery]
    else:
        assert max(largest_V) > 0.9 * (min(highest_V, 100.0) - max(lowest_V, -100.0)) / 2


def test_a_driver_that_cannot_rest_has_no_battery():
    with pytest.raises(ValueError, match="must hold 0 V, at which a head rests; it goes from 5 to 60 V"):
        battery_within(default_battery(), DriverLimits(lowest_V=5.0, highest_V=60.0))
