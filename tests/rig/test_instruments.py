"""The instruments without noise and steps are the equations they stand for."""

import dataclasses
import math

import numpy as np
import pytest

from inkjet_env.printhead import PlayOperators, Printhead, Waveform, respond_sampled
from inkjet_env.rig import SelfInduction, StrainGauge, Vibrometer
from inkjet_env.rig.answer import absolute_hysteretic_V, deflection_V
from inkjet_env.rig.self_induction import single_pole

HEAD = Printhead.published()
STEP_S = 2e-7
TIME_S = np.arange(600) * STEP_S
DRIVE_V = Waveform(80, -60, 4e-6, 8e-6, 6e-6, 9e-6, 3e-6).drive_V(TIME_S - 3e-6)


def test_the_strain_gauge_tells_gain_times_hysteretic_drive_plus_offset():
    rig = StrainGauge()
    hysteretic_V = np.linspace(-100, 100, 5)
    through_the_bridge = hysteretic_V * 0.86e-6 * 2.1 * 5 / 4 + 5 / 4 * 50e-6  # strain, gauge, a quarter of the bridge
    at_converter = ((through_the_bridge + 10e-6) * 501 - 0.035) * 10 + 1.65  # U1, U2A, U2B, U2D
    np.testing.assert_allclose(rig.signal_V(hysteretic_V), at_converter, rtol=1e-12)
    np.testing.assert_allclose(rig.signal_V(hysteretic_V), rig.gain * hysteretic_V + rig.offset_V, rtol=1e-12)


def test_the_default_strain_gauge_holds_the_rated_drive():
    rig = StrainGauge()
    rig.converter.quantised(rig.signal_V([-105.0, 105.0]))


def test_fitting_the_strain_gauge_changes_its_gain_alone():
    fitted = StrainGauge().fitted_to(40.0)
    assert fitted.gain * 40.0 == pytest.approx(0.75 * 1.65)
    assert dataclasses.replace(fitted, stage_gain=10.0) == StrainGauge()


def test_the_strain_gauges_noise_is_the_bridges_and_the_amplifiers():
    rig = StrainGauge()
    at_input = math.sqrt(4 * 1.380649e-23 * 298 * 350 + 8e-9**2)
    assert rig.noise.density == pytest.approx(at_input * 5010)
    assert rig.noise.bandwidth_Hz == pytest.approx(628.3, rel=1e-4)  # of a single pole at 400 Hz
    power = rig.noise.power_per_bin(100_000, 20.0)  # 0.1 … 10 Hz
    frequency_Hz = np.fft.rfftfreq(100_000, 1 / 20.0)
    bands = (frequency_Hz >= 0.1).sum() * (frequency_Hz[1])
    flicker = power[frequency_Hz >= 0.1].mean() - power[0]
    slow_V = math.sqrt(flicker * bands + (8e-9 * 5010) ** 2 * 9.9) / 5010
    assert 6.6 * slow_V == pytest.approx(0.2e-6, rel=0.2)  # the INA128's data sheet, peak to peak


def test_a_resistor_without_amplifier_has_no_flicker_and_no_resistor_no_noise():
    assert StrainGauge(amplifier_noise_V_per_rtHz=0.0).noise.corner_Hz == 0
    assert StrainGauge(amplifier_noise_V_per_rtHz=0.0, temperature_K=0.0).noise.density == 0


def test_a_strain_gauge_that_is_deaf_is_refused():
    with pytest.raises(ValueError, match="gain must be finite and not 0"):
        StrainGauge(excitation_V=0.0)


@pytest.mark.parametrize("initial_state", ["periodic", "demagnetised"])
def test_the_hysteretic_drive_has_the_level_that_play_operators_give_it(initial_state):
    drive_V = 70 * np.sin(np.linspace(0.3, 6.5, 200)) + 10
    plays = PlayOperators.of_branch_law(HEAD.branch_law, 4000).hysteretic_V(drive_V, initial_state)
    np.testing.assert_allclose(absolute_hysteretic_V(HEAD, drive_V, initial_state), plays, atol=1e-4)


def test_compensation_is_exact_at_zero_mismatch():
    sensor_V = respond_sampled(HEAD, TIME_S, DRIVE_V).sensor_V
    assert SelfInduction().feedthrough_s == 0
    assert np.array_equal(SelfInduction().signal_V(sensor_V, DRIVE_V, STEP_S, True), sensor_V)


def test_mismatch_adds_resistance_times_capacitance_times_slope():
    rig = SelfInduction(capacitance_F=2.1e-9, compensating_F=2.0e-9, sensing_ohm=500.0)
    drive_V = np.array([0, 0, 0, 10, 20, 30, 30, 30, 15, 0.0])
    slope_V_per_s = np.array([0, 0, 5, 10, 10, 5, 0, -7.5, -15, -7.5]) / STEP_S  # at corners the mean of both sides
    added_V = rig.signal_V(np.ones(10), drive_V, STEP_S, periodic=True) - 1
    np.testing.assert_allclose(added_V, 500 * 0.1e-9 * slope_V_per_s, rtol=1e-9, atol=1e-9)


def test_a_drive_stands_still_before_and_after_a_single_recording():
    rig = SelfInduction(capacitance_F=3e-9)
    ramp_V = np.arange(4.0)
    expected = rig.feedthrough_s / STEP_S
    once = rig.signal_V(np.zeros(4), ramp_V, STEP_S, periodic=False)
    np.testing.assert_allclose(once, expected * np.array([0.5, 1, 1, 0.5]))
    repeated = rig.signal_V(np.zeros(4), ramp_V, STEP_S, periodic=True)
    np.testing.assert_allclose(repeated, expected * np.array([-1, 1, 1, -1]))


def test_a_bandwidth_attenuates_and_delays_a_sine_as_a_single_pole_does():
    samples, cycles = 4000, 10
    phase = 2 * np.pi * cycles * np.arange(samples) / samples
    frequency_Hz = cycles / (samples * STEP_S)
    rig = SelfInduction(bandwidth_Hz=3 * frequency_Hz)
    filtered = rig.signal_V(np.sin(phase), np.zeros(samples), STEP_S, periodic=True)
    gain = 1 / (1 + 1j / 3)
    np.testing.assert_allclose(filtered, np.imag(gain * np.exp(1j * phase)), atol=3e-5)
    assert rig.bandwidth_error(frequency_Hz) == pytest.approx(abs(1 - gain))


def test_an_infinite_bandwidth_does_no_harm_and_a_real_one_little():
    assert SelfInduction().bandwidth_error(50e3) == 0
    assert SelfInduction(bandwidth_Hz=100e6).bandwidth_error(50e3) == pytest.approx(5e-4, rel=1e-3)


def test_a_single_pole_answers_a_ramp_exactly():
    tau_s = 3 * STEP_S
    ramp = np.arange(20) * STEP_S
    exact = ramp - tau_s * (1 - np.exp(-ramp / tau_s))
    np.testing.assert_allclose(single_pole(ramp, STEP_S / tau_s, periodic=False), exact, atol=1e-20)


@pytest.mark.parametrize(("largest_V", "range_V"), [(0.7, 1.0), (16.0, 20.0), (4.99, 10.0), (0.0, 1.0), (5e-3, 1e-2)])
def test_the_oscilloscopes_range_is_the_next_of_1_2_5(largest_V, range_V):
    assert SelfInduction().fitted_to(largest_V).range_V == pytest.approx(range_V)


def test_a_given_range_stays():
    assert SelfInduction(range_V=3.0).fitted_to(100.0).range_V == 3.0
    assert Vibrometer(range_um=3.0).fitted_to(1e4).range_um == 3.0


def test_the_self_induction_rigs_noise_is_its_parts():
    rig = SelfInduction(range_V=20.0, noise_of_range=1e-4, amplifier_noise_V_per_rtHz=1e-6, noise_bandwidth_Hz=4e6)
    assert rig.noise.rms(1000, 5e6) == pytest.approx(math.hypot(2e-3, 2e-3), rel=1e-4)


@pytest.mark.parametrize("instrument", [SelfInduction(), Vibrometer()])
def test_an_instrument_without_a_range_says_so(instrument):
    with pytest.raises(ValueError, match=r"range_.* must be set before recording.*fitted_to"):
        instrument.converter.quantised([0.0])


def test_values_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="bandwidth_Hz must be above 0 Hz"):
        SelfInduction(bandwidth_Hz=0.0)
    with pytest.raises(ValueError, match="must be finite"):
        SelfInduction(capacitance_F=math.nan)
    with pytest.raises(ValueError, match="um_per_V must be finite and not 0"):
        Vibrometer(um_per_V=0.0)


def test_the_deflection_of_a_first_waveform_equals_the_closed_form():
    waveform = Waveform(80, -60, 4e-6, 8e-6, 6e-6, 9e-6, 3e-6)
    exact = HEAD.respond(waveform, "demagnetised").deflection_V(TIME_S)
    deflection = deflection_V(HEAD, waveform.drive_V(TIME_S), STEP_S, "demagnetised")
    np.testing.assert_allclose(deflection, exact, atol=1e-9)


def test_the_deflections_rate_is_what_self_sensing_hears():
    # b1 s / (…) against a0 / (…): y = (b1 / a0) dx/dt, also in the steady state of a repeated drive.
    deflection = deflection_V(HEAD, DRIVE_V, STEP_S, "periodic")
    sensor_V = respond_sampled(HEAD, TIME_S, DRIVE_V, ringing="steady").sensor_V
    frequency = 2j * np.pi * np.fft.rfftfreq(TIME_S.size, STEP_S)
    rate = np.fft.irfft(frequency * np.fft.rfft(deflection), TIME_S.size)
    np.testing.assert_allclose(rate * HEAD.b1 / HEAD.a0, sensor_V, atol=2e-3 * np.abs(sensor_V).max())


def test_a_resting_head_is_deflected_by_its_hysteretic_drive():
    hold_V = np.concatenate([[0.0], np.full(3000, 50.0)])
    deflection = deflection_V(HEAD, hold_V, STEP_S, "demagnetised")
    assert deflection[-1] == pytest.approx(absolute_hysteretic_V(HEAD, hold_V, "demagnetised")[-1], rel=1e-3)
    assert Vibrometer(um_per_V=0.01, offset_um=0.5).signal_um([30.0]) == pytest.approx([0.8])
