"""A sampled drive that is repeated: its steady state is where a train of pulses, one after another, ends."""

import numpy as np
import pytest

from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Printhead, Waveform, respond_sampled
from inkjet_env.printhead.sampled import one_period, shortest_period_s

HEAD = Printhead.published()
EFFECTS = {effect.id: effect for effect in catalogue()}
BEST = Waveform(100, -100, 1e-6, 10.49e-6, 13.74e-6, 9.81e-6, 19.96e-6)
STEP_s = 0.25e-6


def with_effect(name):
    return AugmentedPrinthead(HEAD, ((EFFECTS[name], EFFECTS[name].example_values(HEAD)),))


def three_levels(rest_V=0.0):
    """A drive of three levels, which no waveform of seven parameters is, and its last voltage."""
    time_s, corners_us = STEP_s * np.arange(161), np.array([0, 2, 10, 12, 20, 22, 36, 40])
    return time_s, np.interp(time_s, 1e-6 * corners_us, [0, 40, 40, 90, 90, -30, -30, rest_V])


def pulse_by_pulse(answer, time_s, drive_V, period_s, pulses):
    """Response to the last of so many pulses after rest, from a simulation of all of them."""
    knots_s, knots_V = one_period(time_s, drive_V, period_s)
    long_s = np.concatenate([knots_s[:-1] + k * period_s for k in range(pulses)])
    found = answer(long_s, np.tile(knots_V[:-1], pulses))
    begin_s = (pulses - 1) * period_s
    late = found.peak_times_s >= begin_s
    return found.sensor_V[-(knots_s.size - 1) :], found.peak_times_s[late] - begin_s, found.peaks_V[late]


@pytest.mark.parametrize("rest_V", [0.0, 15.0])
@pytest.mark.parametrize("period_s", [41e-6, 57.3e-6, 300e-6])
def test_the_steady_state_is_that_of_a_train_simulated_pulse_by_pulse(period_s, rest_V):
    time_s, drive_V = three_levels(rest_V)
    pulses = int(3e-3 / period_s) + 1
    sensor_V, times_s, peaks_V = pulse_by_pulse(
        lambda *samples: respond_sampled(HEAD, *samples), time_s, drive_V, period_s, pulses
    )
    found = respond_sampled(HEAD, time_s, drive_V, period_s=period_s)
    np.testing.assert_allclose(found.sensor_V, sensor_V, atol=1e-9)
    before = found.peak_times_s < found.time_s[-1]  # the train's simulation ends at its last sample
    np.testing.assert_allclose(found.peaks_V[before], peaks_V, atol=1e-9)
    np.testing.assert_allclose(found.peak_times_s[before], times_s, atol=1e-13)


@pytest.mark.parametrize("name", ["cubic_stiffness", "second_mode"])
def test_with_effects_too(name):
    head, period_s = with_effect(name), 57.3e-6
    time_s, drive_V = three_levels()
    sensor_V, _, peaks_V = pulse_by_pulse(head.respond_sampled, time_s, drive_V, period_s, 40)
    found = head.respond_sampled(time_s, drive_V, period_s=period_s)
    assert np.abs(found.sensor_V - sensor_V).max() < 2e-3 * np.abs(sensor_V).max()
    np.testing.assert_allclose(found.peaks_V[: peaks_V.size], peaks_V, atol=2e-3 * np.abs(peaks_V).max())


@pytest.mark.parametrize("head", [HEAD, with_effect("cubic_stiffness")], ids=["base", "with an effect"])
@pytest.mark.parametrize("frequency_Hz", [8e3, 15e3, 1 / BEST.duration_s])
def test_the_corners_of_a_waveform_are_answered_as_the_waveform_is(head, frequency_Hz):
    corners_s, corners_V = BEST.knots()
    whole = head.respond(BEST, period_s=1 / frequency_Hz)
    if isinstance(head, Printhead):
        found = respond_sampled(head, corners_s, corners_V, window_s=350e-6, period_s=1 / frequency_Hz)
    else:
        found = head.respond_sampled(corners_s, corners_V, window_s=350e-6, period_s=1 / frequency_Hz)
    np.testing.assert_allclose(found.peaks_V, whole.peaks_V, atol=1e-9)
    np.testing.assert_allclose(found.peak_times_s, whole.peak_times_s, atol=1e-13)


def test_a_constant_end_needs_no_time():
    time_s = STEP_s * np.arange(400)
    drive_V = np.interp(time_s, [0, 1e-6, 9e-6, 10e-6], [0.0, 50.0, 50.0, 0.0]).round(9)
    assert shortest_period_s(time_s, drive_V) == pytest.approx(10e-6)
    knots_s, knots_V = one_period(time_s, drive_V, 10e-6)
    np.testing.assert_allclose(knots_s, STEP_s * np.arange(41))
    np.testing.assert_allclose(knots_V, drive_V[:41])
    with pytest.raises(ValueError, match="does not fit into a period of 9e-06 s"):
        respond_sampled(HEAD, time_s, drive_V, period_s=9e-6)


def test_a_drive_that_ends_elsewhere_is_held_and_returns_in_one_step():
    knots_s, knots_V = one_period(1e-6 * np.arange(4), np.array([0.0, 5.0, 5.0, 2.0]), 6.5e-6)
    np.testing.assert_allclose(knots_s, 1e-6 * np.array([0, 1, 2, 3, 4, 5, 5.5, 6.5]))
    np.testing.assert_allclose(knots_V, [0, 5, 5, 2, 2, 2, 2, 0])
