"""What drive effects do to the voltage at the ceramic, against ways of computing it that share no code with them."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lsim

from inkjet_env.plant import Excitation, Plant, catalogue
from inkjet_env.plant.effect import complete, coordinates, values_at
from inkjet_env.plant.effects.slew_limit import slew_limited
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.plant.lag import lagged
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
PERIOD_S = 1 / HEAD.frequency_Hz
STEP_S = PERIOD_S / 100
EFFECTS = {effect.id: effect for effect in catalogue() if effect.stage == "drive"}
PULSE = np.interp(np.arange(600), [20, 35, 70, 85, 130, 150], [0, 80, 80, -50, -50, 0.0])
ZIGZAG = np.random.default_rng(1).normal(0, 30, 60)


def shot_of(drive_V=PULSE, initial_state="demagnetised", channel="self_sensing", **kwargs):
    return Excitation(channel, initial_state, STEP_S, drive_V, **kwargs)


def at_ceramic(effect_id, values, excitation):
    """Voltage at the ceramic, at the nodes."""
    return Plant(HEAD, effects=((EFFECTS[effect_id], complete(EFFECTS[effect_id], **values)),)).at_ceramic_V(excitation)


def order_in_nodes(effect_id, values, drive_V=PULSE, initial_state="demagnetised"):
    """Orders with which the sensor's signal converges as nodes are added, and its error at 2 nodes a sample."""
    plant = Plant(HEAD, effects=((EFFECTS[effect_id], complete(EFFECTS[effect_id], **values)),))
    signals = {
        substeps: plant.signal(shot_of(drive_V, initial_state, substeps=substeps)) for substeps in (2, 4, 8, 128)
    }
    exact = signals.pop(128)
    errors = np.array([np.linalg.norm(s - exact) / np.linalg.norm(exact) for s in signals.values()])
    return np.log2(errors[:-1] / errors[1:]), errors[0]


# amplifier bandwidth


@pytest.mark.parametrize("second_order", [0.0, 0.5])
@pytest.mark.parametrize("bandwidth_Hz", [2e3, 3e5, 1e9])
def test_amplifier_is_the_low_pass_of_the_drive(bandwidth_Hz, second_order):
    """Of one pole, and Butterworth's of two."""
    excitation = shot_of()
    w = 2 * np.pi * bandwidth_Hz
    law = ([w], [1, w]) if second_order == 0 else ([w**2], [1, np.sqrt(2) * w, w**2])
    exact = lsim(law, excitation.drive_at_nodes_V, excitation.time_s)[1]
    values = {"bandwidth_Hz": bandwidth_Hz, "second_order": second_order}
    assert at_ceramic("amplifier_bandwidth", values, excitation) == pytest.approx(exact, abs=1e-9)


def test_amplifier_in_steady_state_follows_every_tone_as_it_should():
    n = 400
    angle = 2 * np.pi * 3 * np.arange(n) / n
    tone_Hz, bandwidth_Hz = 3 / (n * STEP_S), 2e5
    exact = 50 * (np.exp(1j * np.repeat(angle, 2)[::2]) / (1 + 1j * tone_Hz / bandwidth_Hz)).imag
    values = {"bandwidth_Hz": bandwidth_Hz, "second_order": 0.0}
    found = at_ceramic("amplifier_bandwidth", values, shot_of(50 * np.sin(angle), "periodic"))
    assert found[::2] == pytest.approx(exact, abs=2e-4 * 50)


def test_signal_behind_the_amplifier_converges_with_the_fourth_power_of_the_nodes():
    orders, error = order_in_nodes("amplifier_bandwidth", {"bandwidth_Hz": 3e5, "second_order": 0.0})
    assert orders.min() > 3.5
    assert error < 1e-6


# slew limit


def limited_by_brute_force(drive_V, most, substeps):
    """Small steps towards the drive, none longer than the limit allows; at the nodes of ``drive_V``."""
    fine = np.interp(np.arange((drive_V.size - 1) * substeps + 1) / substeps, np.arange(drive_V.size), drive_V)
    value, found = drive_V[0], []
    for u in fine:
        value += min(max(u - value, -most / substeps), most / substeps)
        found.append(value)
    return np.array(found)[::substeps]


@pytest.mark.parametrize("most", [3.0, 20.0, 45.0])
def test_slew_limit_is_exact_at_the_nodes_for_any_zigzag(most):
    found = slew_limited(ZIGZAG, most, periodic=False)
    errors = [np.abs(limited_by_brute_force(ZIGZAG, most, n) - found).max() for n in (50, 100, 200)]
    assert errors[-1] < most / 100  # brute force is of the first order
    assert errors[-1] < 0.7 * errors[0]
    finer = np.interp(np.arange(59 * 7 + 1) / 7, np.arange(60), ZIGZAG)
    assert slew_limited(finer, most / 7, periodic=False)[::7] == pytest.approx(found, abs=1e-11)


def test_slew_limit_is_never_exceeded_and_gentle_edges_pass_untouched():
    steepest = np.abs(np.diff(PULSE)).max() / STEP_S
    for part in (0.2, 0.7):
        limited = at_ceramic("slew_limit", {"slew_rate_V_s": part * steepest}, shot_of())
        assert np.abs(np.diff(limited)).max() / (STEP_S / 2) <= part * steepest * (1 + 1e-9)
    above = at_ceramic("slew_limit", {"slew_rate_V_s": 1.001 * steepest}, shot_of())
    assert above == pytest.approx(shot_of().drive_at_nodes_V, abs=1e-10)


@pytest.mark.parametrize("most", [0.01, 0.3, 3.0, 30.0])
def test_slew_limit_in_steady_state_repeats_and_is_the_last_of_many_laps(most):
    lap = np.where(np.arange(60) < 9, 100.0, 0.0) + np.linspace(0, 5, 60)
    steady = slew_limited(lap, most, periodic=True)
    laps = slew_limited(np.tile(lap, 2 + round(1000 / (60 * most))), most, periodic=False)[-60:]
    assert steady == pytest.approx(laps, abs=1e-6)


def test_signal_behind_the_slew_limit_converges_with_the_nodes():
    """Where it is caught between nodes the corner is cut, and the hysteresis turns there: the first order at worst."""
    orders, error = order_in_nodes("slew_limit", {"slew_rate_V_s": 60.3 * HEAD.frequency_Hz})
    assert orders.mean() > 0.9
    assert error < 2e-3


def softly_slewed_by_integration(drive_V, most, lag):
    from scipy.integrate import solve_ivp

    def rate(time, value):
        return most * np.tanh((np.interp(time, np.arange(drive_V.size), drive_V) - value) / (most * lag))

    values = [drive_V[0]]
    for node in range(drive_V.size - 1):
        ended = solve_ivp(rate, (node, node + 1), values[-1:], rtol=1e-9, atol=1e-11, max_step=0.05)
        values.append(ended.y[0, -1])
    return np.array(values)


@pytest.mark.parametrize("lag", [0.3, 3.0, 20.0])
def test_a_slew_limit_behind_a_linear_range_solves_its_equation(lag):
    assert slew_limited(ZIGZAG, 20.0, False, lag) == pytest.approx(
        softly_slewed_by_integration(ZIGZAG, 20.0, lag), abs=1e-4
    )


def test_limits_of_a_slew_limit_with_a_linear_range():
    hard = slew_limited(ZIGZAG, 20.0, False)
    assert slew_limited(ZIGZAG, 20.0, False, 0.002) == pytest.approx(hard, abs=0.2)
    behind = lagged(ZIGZAG, 4.0, 1.0, False)
    assert slew_limited(ZIGZAG, 1e6, False, 4.0) == pytest.approx(behind, abs=1e-8)  # a tanh of small things
    lap = np.where(np.arange(60) < 9, 100.0, 0.0) + np.linspace(0, 5, 60)
    steady = slew_limited(lap, 3.0, True, 5.0)
    assert steady == pytest.approx(slew_limited(np.tile(lap, 40), 3.0, False, 5.0)[-60:], abs=1e-6)


# delay


@pytest.mark.parametrize("samples", [0.2, 0.5, 2.7, 37.0, -0.3, -5.0, -41.4, 900.0, -900.0])
def test_delay_is_the_asked_drive_evaluated_earlier(samples):
    excitation = shot_of()
    exact = np.interp(excitation.time_s - samples * STEP_S, STEP_S * np.arange(600), PULSE)
    assert at_ceramic("trigger_delay", {"delay_s": samples * STEP_S}, excitation) == pytest.approx(exact, abs=1e-9)
    again = shot_of(PULSE[10:200], "periodic", substeps=4)
    times_s = STEP_S * np.arange(190)
    exact = np.interp(again.time_s - samples * STEP_S, times_s, PULSE[10:200], period=190 * STEP_S)
    assert at_ceramic("trigger_delay", {"delay_s": samples * STEP_S}, again) == pytest.approx(exact, abs=1e-9)


def test_delay_by_whole_samples_is_the_recording_moved():
    base = Plant(HEAD)
    late = base.with_effects([(EFFECTS["trigger_delay"], {"delay_s": 7 * STEP_S})])
    assert late.signal(shot_of())[7:] == pytest.approx(base.signal(shot_of())[:-7], abs=1e-12)
    moved = np.roll(base.signal(shot_of(initial_state="periodic")), 7)
    assert late.signal(shot_of(initial_state="periodic")) == pytest.approx(moved, abs=1e-10)


def test_signal_of_a_delayed_drive_converges_with_the_second_power_of_the_nodes():
    """A corner that falls between nodes is cut: the area that is missing falls with their square."""
    plant = Plant(HEAD, effects=((EFFECTS["trigger_delay"], {"delay_s": 0.3 * STEP_S}),))
    exact = Plant(HEAD).signal(replace(shot_of(), step_s=STEP_S / 10, drive_V=np.interp(
        np.arange(5991) / 10 - 0.3, np.arange(600), PULSE)))[::10]  # fmt: skip
    errors = [np.linalg.norm(plant.signal(shot_of(substeps=p)) - exact) / np.linalg.norm(exact) for p in (2, 6, 18)]
    assert errors[0] < 1e-3
    assert np.log(errors[0] / errors[2]) / np.log(9) > 1.7


# fits


TRUTHS = {
    "amplifier_bandwidth": [
        {"bandwidth_Hz": ratio * HEAD.frequency_Hz, "second_order": q}
        for ratio, q in ((1.0, 0.0), (4.0, 0.0), (40.0, 0.0), (5.0, 0.5), (10.0, 0.8))
    ],
    "slew_limit": [
        {"slew_rate_V_s": part * 80 / (15 * STEP_S), "lag_s": lag * STEP_S}
        for part, lag in ((0.15, 0.0), (0.45, 0.0), (0.95, 0.0), (0.4, 5.0))
    ],
    "drive_resonance": [
        {"frequency_Hz": ratio * HEAD.frequency_Hz, "damping_ratio": damping}
        for ratio, damping in ((2.6, 0.05), (9.0, 0.2), (20.0, 0.08))
    ],
    "trigger_delay": [{"delay_s": part * PERIOD_S} for part in (-0.4, -0.003, 0.015, 0.2)],
}


@pytest.mark.parametrize(("name", "truth"), [(name, truth) for name, truths in TRUTHS.items() for truth in truths])
def test_the_best_of_the_fits_from_the_starts_finds_the_truth(name, truth):
    effect = EFFECTS[name]
    gentle = np.interp(np.arange(400), [20, 170, 220, 270], [0, 60, 60, 0.0])
    excitations = [shot_of(), shot_of(-PULSE, "periodic"), shot_of(gentle, channel="displacement")]

    def residual(scaled, size):
        values = values_at(effect, scaled * size)
        plant = Plant(HEAD, effects=((effect, values),))
        return np.concatenate([plant.signal(excitation) - s for excitation, s in zip(excitations, shown, strict=True)])

    truth = complete(effect, **truth)
    shown = [Plant(HEAD, effects=((effect, truth),)).signal(excitation) for excitation in excitations]
    found = []
    for start in effect.starts(HEAD, excitations):
        point = coordinates(effect, start)
        with suppress(*NUMERICAL):  # a trial far from the truth may have no steady state
            fit = least_squares(residual, np.sign(point), args=(np.abs(point),), diff_step=1e-4, max_nfev=30)
            found.append((fit.cost, values_at(effect, fit.x * np.abs(point))))
    best = min(found, key=lambda pair: pair[0])[1]
    assert {name: best[name] for name, value in truth.items() if value} == pytest.approx(
        {name: value for name, value in truth.items() if value}, rel=1e-4
    )
    assert all(abs(best[name]) < 1e-4 for name, value in truth.items() if value == 0)
