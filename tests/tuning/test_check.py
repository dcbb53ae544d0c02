"""The cost of a waveform as it was recorded on the head, against what it truly costs there."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from inkjet_env.experiments.tuning.check import REPETITIONS, averaged, check_request, expected_V, measured, seen
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Bounds, PeakCost, Printhead, Waveform
from inkjet_env.rig import VirtualRig

HEAD = Printhead.published()
MODE = next(effect for effect in catalogue() if effect.id == "second_mode")
WITH_MODE = AugmentedPrinthead(HEAD, ((MODE, MODE.example_values(HEAD)),))
STEPS = next(effect for effect in catalogue() if effect.id == "generator_steps")
IN_STEPS = AugmentedPrinthead(HEAD, ((STEPS, STEPS.example_values(HEAD) | {"update_s": 2.3e-6, "ahead": 0.5}),))
"""No repetition of a check has the generator's clock at the same place as the one before."""
WAVEFORMS = [Waveform.from_array(row) for row in Bounds().from_unit(np.random.default_rng(4).uniform(-1, 1, (6, 7)))]
WINDOW_S = 350e-6


@pytest.mark.parametrize("head", [HEAD, WITH_MODE], ids=["no effects", "second mode"])
def test_with_the_right_head_the_measured_cost_is_the_true_one_within_its_error(head):
    rig = VirtualRig(head, 2, 50.0)
    off = []
    for k, waveform in enumerate(WAVEFORMS):
        recording = rig.record(check_request("check", waveform, head.frequency_Hz, WINDOW_S), k + 1)
        found = measured(seen(recording, waveform, head, WINDOW_S), head, PeakCost(), WINDOW_S)
        assert found.residual_V == pytest.approx(found.noise_V, rel=0.1)
        assert found.error_V < 0.3
        off.append((found.cost_V - head.respond(waveform).cost()) / found.error_V)
    assert np.median(np.abs(off)) < 1.5
    assert np.sum(np.abs(off) > 4) <= 1  # one of them may lie where the cost jumps


def test_a_generator_whose_clock_runs_on_is_read_as_one_that_begins_with_the_waveform():
    rig = VirtualRig(IN_STEPS, 2, 50.0)
    for k, waveform in enumerate(WAVEFORMS):
        recording = rig.record(check_request("check", waveform, IN_STEPS.frequency_Hz, WINDOW_S), k + 1)
        shown = seen(recording, waveform, IN_STEPS, WINDOW_S)
        found = measured(shown, IN_STEPS, PeakCost(), WINDOW_S)
        fired = IN_STEPS.respond(waveform, window_s=WINDOW_S, period_s=shown.period_s)
        assert found.residual_V == pytest.approx(found.noise_V, rel=0.1)
        assert abs(found.cost_V - fired.cost()) < 4 * found.error_V


def test_a_head_that_predicts_a_little_wrong_is_corrected_by_the_recording():
    rig, wrong = VirtualRig(HEAD, 2, 60.0), HEAD.varied(gain=0.97)
    closer = 0
    for waveform in WAVEFORMS:
        recording = rig.record(check_request("check", waveform, HEAD.frequency_Hz, WINDOW_S), 1)
        shown, true_V = seen(recording, waveform, wrong, WINDOW_S), HEAD.respond(waveform).cost()
        found = measured(shown, wrong, PeakCost(), WINDOW_S)
        off_V = abs(wrong.respond(waveform).cost() - true_V)
        closer += abs(found.cost_V - true_V) < max(0.3 * off_V, 2 * found.error_V)
        assert found.residual_V > 1.2 * found.noise_V
    assert closer >= 5


def test_without_a_steady_state_the_first_repetition_is_expected_from_rest(monkeypatch):
    waveform, rig = WAVEFORMS[2], VirtualRig(WITH_MODE, 2, 50.0)
    request = check_request("check", waveform, WITH_MODE.frequency_Hz, WINDOW_S)
    taken = averaged(rig.record(request, 1), waveform, WITH_MODE.frequency_Hz, WINDOW_S)
    steady_V = expected_V(taken, waveform, WITH_MODE, WITH_MODE.frequency_Hz, WINDOW_S)

    def fails(*_):
        raise ValueError("no steady state") from FloatingPointError()

    monkeypatch.setattr(AugmentedPrinthead, "_settled", fails)
    from_rest_V = expected_V(taken, waveform, WITH_MODE, WITH_MODE.frequency_Hz, WINDOW_S)
    assert np.abs(from_rest_V - steady_V).max() < 1e-3 * np.abs(steady_V).max()
    assert (from_rest_V != steady_V).any()


def test_a_check_lets_the_head_come_to_rest():
    request = check_request("check", WAVEFORMS[0], HEAD.frequency_Hz, WINDOW_S)
    length_s = request.drive_V.size * request.step_s / REPETITIONS
    assert length_s >= WINDOW_S + 20 / HEAD.frequency_Hz
    assert request.step_s == pytest.approx(1 / (100 * HEAD.frequency_Hz), rel=0.05)
    assert request.drive_V.max() == pytest.approx(WAVEFORMS[0].U1, rel=0.05)


def test_a_tie_that_the_noise_decides_is_not_taken_for_the_better_half():
    """Two peaks of one height: the cost depends by tens of volts on which is the larger by a hair."""

    def waveform(U2):
        return Waveform(100, U2, 1e-6, 10.5e-6, 20e-6, 9.6e-6, 20e-6)

    def lead(U2):
        first, second = np.abs(HEAD.respond(waveform(U2)).peaks_V[:2])
        return first - second

    U2 = brentq(lead, -80.0, -60.0, xtol=1e-12)
    apart = [HEAD.respond(waveform(U2 + by)).cost() for by in (-1e-6, 1e-6)]
    assert max(apart) - min(apart) > 10
    recording = VirtualRig(HEAD, 2, 40.0).record(check_request("check", waveform(U2), HEAD.frequency_Hz, WINDOW_S), 1)
    found = measured(seen(recording, waveform(U2), HEAD, WINDOW_S), HEAD, PeakCost(), WINDOW_S)
    assert min(apart) + 2 < found.cost_V < max(apart) + 2
    assert found.error_V > 3


@pytest.mark.parametrize("step", [1.0, 0.4, 1.37])
def test_a_check_may_be_sampled_by_an_instrument_of_its_own(step):
    """The mean over the whole repetitions has less noise, whatever the step."""
    waveform, rig = WAVEFORMS[1], VirtualRig(HEAD, 3, 40.0)
    request = check_request("check", waveform, HEAD.frequency_Hz, WINDOW_S)
    whole = rig.record(request, 1)
    time_s = np.arange(0, whole.time_s[-1] - 1e-4, step * request.step_s)
    noise = np.random.default_rng(1).normal(0, 0.02, time_s.size)
    clean = VirtualRig(HEAD, 3, np.inf).record(request, 1)
    other = replace(
        clean, time_s=time_s, drive_V=np.interp(time_s, clean.time_s, clean.drive_V),
        sensor=np.interp(time_s, clean.time_s, clean.sensor) + noise,
    )  # fmt: skip
    once = averaged(other, waveform, HEAD.frequency_Hz, WINDOW_S)
    assert once.time_s.size * once.step_s == pytest.approx(whole.time_s.size * whole.step_s / REPETITIONS)
    exact = np.interp(once.time_s, clean.time_s, clean.sensor)
    assert np.std(once.sensor - exact) == pytest.approx(0.02 / np.sqrt(REPETITIONS - 1), rel=0.25)
    found = measured(seen(other, waveform, HEAD, WINDOW_S), HEAD, PeakCost(), WINDOW_S)
    assert found.cost_V == pytest.approx(HEAD.respond(waveform).cost(), abs=max(4 * found.error_V, 0.2))


def test_a_check_that_is_too_short_is_refused():
    request = check_request("check", WAVEFORMS[0], HEAD.frequency_Hz, WINDOW_S)
    taken = VirtualRig(HEAD, 1, 40.0).record(request, 1)
    short = replace(taken, time_s=taken.time_s[:900], drive_V=taken.drive_V[:900], sensor=taken.sensor[:900])
    with pytest.raises(ValueError, match=r"check takes .* s, and one repetition of its drive .* s\. Record it again"):
        seen(short, WAVEFORMS[0], HEAD, WINDOW_S)
