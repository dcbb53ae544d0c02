"""High-pass and time base of the recorder, and images of a hum, against ways that share no code with them."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import lsim

from inkjet_env.plant import Excitation, Plant, catalogue
from inkjet_env.plant.effect import complete
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
PERIOD_S = 1 / HEAD.frequency_Hz
STEP_S = PERIOD_S / 100
EFFECTS = {effect.id: effect for effect in catalogue() if effect.stage == "sensing"}
PULSE = np.interp(np.arange(900), [20, 35, 70, 85, 130, 150], [0, 80, 80, -50, -50, 0.0])


def shot_of(drive_V=PULSE, initial_state="demagnetised", channel="displacement", **kwargs):
    return Excitation(channel, initial_state, STEP_S, drive_V, **kwargs)


def plant(effect_id, **values):
    return Plant(
        HEAD, offsets={"self_sensing": 0.3}, effects=((EFFECTS[effect_id], complete(EFFECTS[effect_id], **values)),)
    )


BASE = Plant(HEAD, offsets={"self_sensing": 0.3})


# high-pass


@pytest.mark.parametrize("channel", ["self_sensing", "displacement"])
@pytest.mark.parametrize("ratio", [0.003, 0.1, 1.0])
def test_the_high_pass_is_its_transfer_function_from_rest(ratio, channel):
    excitation = shot_of(channel=channel)
    signal = BASE.signal(excitation)
    w = 2 * math.pi * ratio * HEAD.frequency_Hz
    exact = lsim(([1, 0], [1, w]), signal - signal[0], STEP_S * np.arange(signal.size))[1] + signal[0]
    found = plant("sensor_highpass", corner_Hz=ratio * HEAD.frequency_Hz).signal(excitation)
    assert found == pytest.approx(exact, abs=1e-9)


def test_the_high_pass_of_a_repeated_signal_is_that_of_its_harmonics_with_the_mean_kept():
    excitation = shot_of(initial_state="periodic")
    signal, corner_Hz = BASE.signal(excitation), 0.1 * HEAD.frequency_Hz
    tones = np.fft.rfftfreq(signal.size, STEP_S)
    passed = np.append(1.0, 1j * tones[1:] / (corner_Hz + 1j * tones[1:]))
    exact = np.fft.irfft(np.fft.rfft(signal) * passed, signal.size)
    found = plant("sensor_highpass", corner_Hz=corner_Hz).signal(excitation)
    assert found == pytest.approx(exact, abs=1e-3 * np.abs(signal).max())


def test_the_high_pass_of_a_free_recording_begins_at_its_mean():
    excitation = shot_of(initial_state="free", start=(10.0, -5.0))
    signal, w = BASE.signal(excitation), 0.2 * HEAD.frequency_Hz
    mean = signal.mean()
    times_s = STEP_S * np.arange(signal.size)
    slow = lsim(([w], [1, w]), signal - mean, times_s)[1]
    found = plant("sensor_highpass", corner_Hz=w / (2 * math.pi)).signal(excitation)
    assert found == pytest.approx(signal - slow, abs=1e-9)


@pytest.mark.parametrize("initial_state", ["demagnetised", "periodic", "free"])
def test_a_low_corner_leaves_the_signal_and_its_offset(initial_state):
    excitation = shot_of(initial_state=initial_state, channel="self_sensing")
    found = plant("sensor_highpass", corner_Hz=1e-6).signal(excitation)
    assert found == pytest.approx(BASE.signal(excitation), abs=1e-9)


# time base


@pytest.mark.parametrize("skew", [3e-3, -3e-3])
def test_a_stretched_recording_is_the_signal_at_the_true_times(skew):
    excitation = shot_of()
    signal = BASE.signal(excitation)
    places = np.minimum((1 + skew) * np.arange(signal.size), signal.size - 1)
    exact = CubicSpline(np.arange(signal.size), signal)(places)
    found = plant("timebase_error", skew=skew).signal(excitation)
    assert found[5:-5] == pytest.approx(exact[5:-5], abs=2e-6 * np.abs(signal).max())


def test_a_stretched_recording_of_a_repeated_drive_goes_on_in_the_next_period():
    lap = PULSE[10:310]
    excitation = shot_of(lap, "periodic")
    signal = BASE.signal(excitation)
    spline = CubicSpline(np.arange(301), np.append(signal, signal[0]), bc_type="periodic")
    found = plant("timebase_error", skew=0.01).signal(excitation)
    assert found == pytest.approx(spline(1.01 * np.arange(300)), abs=2e-6 * np.abs(signal).max())


def test_a_clock_that_warms_up_nears_its_final_rate_from_recording_to_recording():
    excitation = shot_of()
    for order, skew in ((1, 3e-3), (5, 1e-3 + 2e-3 * math.exp(-1)), (1000, 1e-3)):
        warming = plant("timebase_error", skew=1e-3, cold=2e-3, memory_orders=4.0)
        found = warming.signal(shot_of(order=order))
        assert found == pytest.approx(plant("timebase_error", skew=skew).signal(excitation), abs=1e-12)


def test_a_clock_that_is_fast_by_a_share_raises_the_frequency_by_it():
    excitation = shot_of(np.zeros(900), "free", start=(30.0, 0.0))
    slow = Plant(HEAD.varied(frequency_Hz=HEAD.frequency_Hz * 1.002)).signal(excitation)
    found = plant("timebase_error", skew=0.002).signal(excitation)
    assert found[:890] == pytest.approx(slow[:890], abs=1e-4 * 30)


def test_the_error_between_samples_falls_with_the_fourth_power_of_the_step():
    rates = []
    for per_period in (10, 20, 40):
        t = np.arange(20 * per_period) / per_period
        excitation = Excitation("displacement", "periodic", PERIOD_S / per_period, np.zeros(t.size))
        effect = EFFECTS["timebase_error"]
        found = effect.sensing(complete(effect, skew=0.01), np.sin(2 * np.pi * t), None, HEAD, excitation)
        rates.append(np.abs(found - np.sin(2 * np.pi * 1.01 * t)).max())
    assert rates[0] < 5e-3
    assert np.log2(np.array(rates[:-1]) / rates[1:]) == pytest.approx([4, 4], abs=0.2)


# hum


def explained(start, excitations, true_Hz, multiples):
    """Share of a tone with multiples that a start's basis explains, the recordings together."""
    rng, left, whole = np.random.default_rng(5), 0.0, 0.0
    for excitation in excitations:
        angle = 2 * np.pi * true_Hz * excitation.step_s * np.arange(excitation.samples)
        heard = sum(rng.normal() * np.cos(k * angle + rng.uniform(0, 6)) for k in range(1, multiples + 1))
        basis = EFFECTS["mains_hum"].random_effect_basis(start, excitation)
        residual = heard if basis is None else heard - basis @ np.linalg.lstsq(basis, heard, rcond=None)[0]
        left, whole = left + residual @ residual, whole + heard @ heard
    return 1 - left / whole


def recorded(step_s, lines_Hz):
    return Excitation("self_sensing", "demagnetised", step_s, np.zeros(1500), residual_lines_Hz=lines_Hz)


@pytest.mark.parametrize(("supply_Hz", "multiples"), [(65e3, 5), (240e3, 4), (480e3, 3)])
def test_a_start_reaches_a_switching_supply_with_multiples_beyond_the_nyquist_frequency(supply_Hz, multiples):
    excitations = [recorded(1e-6, (supply_Hz, 0.0123e6))]
    starts = EFFECTS["mains_hum"].starts(HEAD, excitations)
    assert max(explained(start, excitations, supply_Hz, multiples) for start in starts) > 0.99


def test_a_start_reaches_a_supply_that_is_seen_at_an_image_where_other_rates_tell():
    true_Hz = 730e3
    excitations = [recorded(1e-6, (270e3,)), recorded(0.4e-6, (270e3,))]
    starts = EFFECTS["mains_hum"].starts(HEAD, excitations)
    assert max(explained(start, excitations, true_Hz, 1) for start in starts) > 0.99
    assert len(starts) <= 48


def test_at_one_sampling_rate_an_image_is_no_further_start():
    excitations = [recorded(1e-6, (270e3,))]
    assert all(start["frequency_Hz"] < 500e3 for start in EFFECTS["mains_hum"].starts(HEAD, excitations))
