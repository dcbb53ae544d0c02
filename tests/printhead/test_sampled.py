"""Any sampled drive: exact at its samples, whatever the sampling rate."""

import numpy as np
import pytest

from inkjet_env.printhead import Printhead, Waveform, respond_sampled

HEAD = Printhead.published()
WAVEFORM = Waveform(90, -70, 2e-6, 8e-6, 4e-6, 9e-6, 3e-6)


@pytest.mark.parametrize("initial_state", ["periodic", "demagnetised"])
@pytest.mark.parametrize("step_s", [1e-6, 1e-7])
def test_samples_and_peaks_equal_the_closed_form_at_any_rate(initial_state, step_s):
    time_s = np.arange(0, round(350e-6 / step_s) + 1) * step_s
    sampled = respond_sampled(HEAD, time_s, WAVEFORM.drive_V(time_s), initial_state)
    exact = HEAD.respond(WAVEFORM, initial_state, window_s=time_s[-1])
    np.testing.assert_allclose(sampled.sensor_V, exact.sensor_V(time_s), atol=1e-10)
    np.testing.assert_allclose(sampled.peaks_V, exact.peaks_V, atol=1e-10)
    np.testing.assert_allclose(sampled.peak_times_s, exact.peak_times_s, rtol=1e-8)
    assert sampled.cost() == pytest.approx(exact.cost(), abs=1e-9)


def test_uneven_samples_at_the_knots_alone_are_enough():
    knots_s, knots_V = WAVEFORM.knots()
    sampled = respond_sampled(HEAD, knots_s, knots_V)
    np.testing.assert_allclose(sampled.sensor_V, HEAD.respond(WAVEFORM).sensor_V(knots_s), atol=1e-11)


def test_the_steady_state_is_what_many_periods_settle_to():
    time_s = np.arange(1000) * 1e-7
    drive_V = WAVEFORM.drive_V(time_s)
    steady = respond_sampled(HEAD, time_s, drive_V, ringing="steady")
    periods = 30
    long = respond_sampled(HEAD, np.arange(1000 * periods) * 1e-7, np.tile(drive_V, periods))
    np.testing.assert_allclose(steady.sensor_V, long.sensor_V[-1000:], atol=1e-9)


def test_a_constant_drive_is_silent():
    response = respond_sampled(HEAD, np.arange(50) * 1e-6, np.full(50, 30.0))
    assert not response.sensor_V.any()
    assert response.peaks_V.size == 0


def test_time_may_start_anywhere():
    time_s = np.arange(400) * 5e-7
    drive_V = WAVEFORM.drive_V(time_s)
    early, late = respond_sampled(HEAD, time_s, drive_V), respond_sampled(HEAD, time_s + 2.0, drive_V)
    np.testing.assert_allclose(late.sensor_V, early.sensor_V, atol=1e-6)
    assert late.peak_times_s[0] > 2.0


@pytest.mark.parametrize(
    ("time_s", "drive_V", "message"),
    [
        ([0, 1e-6], [0, np.nan], "drive_V must be finite; got nan at sample 2 of 2"),
        ([0, 2e-6, 1e-6], [0, 1, 2], "sample 3 is at 1e-06 s after 2e-06 s. Sort"),
        ([0, 1e-6], [0, -1e308], "drive_V must be within ±100000 V; got -1e\\+308 V at sample 2 of 2"),
        ([0], [1], "two columns of at least 2 samples"),
        ([0, 1e-6], [1, 2, 3], "two columns of at least 2 samples"),
        ([0, 10], [0, 1], "time_s must not step by more than 1 s; .* seconds"),
    ],
)
def test_bad_samples_are_named(time_s, drive_V, message):
    with pytest.raises(ValueError, match=message):
        respond_sampled(HEAD, time_s, drive_V)


def test_a_steady_state_needs_a_repeated_drive():
    with pytest.raises(ValueError, match='ringing="steady" needs initial_state="periodic"'):
        respond_sampled(HEAD, [0, 1e-6], [0, 1], "demagnetised", ringing="steady")
