"""Scans against simulations one by one, and against what a resonator must show."""

import math

import numpy as np
import pytest

from inkjet_env.jetting import scan
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import PeakCost, Printhead, Waveform, respond_sampled

HEAD = Printhead.published()
BEST = Waveform(100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6)
PULSE = Waveform(60, 0, 2e-6, 8e-6, 2e-6, 0, 0)
SMALL = 13


def with_effect(name, **values):
    effect = next(e for e in catalogue() if e.id == name)
    return AugmentedPrinthead(HEAD, ((effect, values),))


MODE = with_effect("second_mode", frequency_Hz=23e3, damping_ratio=0.08, strength=0.3)


@pytest.fixture(scope="module")
def pulse():
    return scan(HEAD, PULSE, vary=("U1", "t2"), points=SMALL)


def one_by_one(head, waveform, period_s, drops):
    """Signed peaks of the last of many drops, each simulated after the others."""
    step_s = period_s / round(period_s / 4e-8)
    time_s = np.arange(round(drops * period_s / step_s)) * step_s
    drive_V = waveform.drive_V(time_s % period_s)
    if isinstance(head, AugmentedPrinthead):
        response = head.respond_sampled(time_s, drive_V, window_s=None)
    else:
        response = respond_sampled(head, time_s, drive_V)
    last = response.peak_times_s >= (drops - 1) * period_s
    last &= response.peak_times_s < drops * period_s
    return response.peaks_V[last]


@pytest.mark.parametrize("head", [HEAD, MODE], ids=["no effects", "second mode"])
@pytest.mark.parametrize("waveform", [BEST, PULSE], ids=["best", "pulse"])
def test_the_sweep_equals_trains_that_are_simulated_drop_by_drop(head, waveform):
    found = scan(head, waveform, vary=("U1", "t2"), points=SMALL).frequency
    for k in (3, 11, 17, 24):
        frequency_Hz = found.values[k]
        peaks_V = one_by_one(head, waveform, 1 / frequency_Hz, max(4, math.ceil(2e-3 * frequency_Hz)))
        assert found.effective_V[k] == pytest.approx(np.abs(peaks_V).max(), rel=2e-3)


def test_a_single_pulse_is_highest_where_the_ringing_of_its_edges_adds_up(pulse):
    fine = scan(HEAD, PULSE, vary=("U1", "t2"), points=200).width
    half_period_s = 0.5 / HEAD.frequency_Hz
    best_s = fine.values[int(np.nanargmax(fine.effective_V))]
    assert best_s + 0.5 * (PULSE.t1 + PULSE.t3) == pytest.approx(half_period_s, rel=0.05)
    assert pulse.width.values[0] == 0
    assert pulse.width.values[-1] == pytest.approx(2 / HEAD.frequency_Hz)


def test_a_train_resonates_at_the_head_s_frequency_and_its_parts():
    sweep = scan(HEAD, PULSE, vary=("U1", "t2"), points=400).frequency
    highest_Hz = sweep.values[int(np.nanargmax(sweep.effective_V))]
    assert highest_Hz == pytest.approx(HEAD.frequency_Hz, rel=0.02)
    half = (sweep.values > 0.4 * HEAD.frequency_Hz) & (sweep.values < 0.6 * HEAD.frequency_Hz)
    second_Hz = sweep.values[half][int(np.argmax(sweep.effective_V[half]))]
    assert second_Hz == pytest.approx(HEAD.frequency_Hz / 2, rel=0.02)


def test_rare_drops_do_not_meet(pulse):
    alone = PeakCost()(HEAD.respond(PULSE).peaks_V)
    assert pulse.frequency.values[0] == 1e3
    assert pulse.frequency.effective_V[0] == pytest.approx(np.abs(HEAD.respond(PULSE).peaks_V).max(), rel=1e-6)
    assert pulse.frequency.residual_V[0] < 1e-3
    assert pulse.robustness.middle_V == pytest.approx(alone, rel=1e-9)


def test_a_head_without_hysteresis_answers_in_proportion_to_the_voltage():
    found = scan(HEAD.varied(hysteresis_strength=0.0), PULSE, vary=("U1", "t2"), points=SMALL).voltage
    np.testing.assert_allclose(found.effective_V / found.values, found.effective_V[-1] / found.values[-1], rtol=1e-9)


def test_a_map_holds_the_costs_of_the_changed_waveforms(pulse):
    found = pulse.robustness
    assert found.changes[[0, -1]].tolist() == [-0.05, 0.05]
    changed = Waveform(60 * 1.05, 0, 2e-6, 8e-6 * 0.95, 2e-6, 0, 0)
    assert found.cost_V[0, -1] == pytest.approx(HEAD.respond(changed).cost(), rel=1e-9)
    assert found.loss_V == pytest.approx(found.cost_V.max() - HEAD.respond(PULSE).cost())


def test_effects_that_are_off_change_nothing():
    plain = scan(HEAD, BEST, points=SMALL)
    same = scan(AugmentedPrinthead(HEAD, ()), BEST, points=SMALL)
    for name in ("width", "voltage", "frequency"):
        one, other = getattr(plain, name), getattr(same, name)
        np.testing.assert_allclose(one.effective_V, other.effective_V, rtol=1e-3)
    np.testing.assert_allclose(plain.robustness.cost_V, same.robustness.cost_V, atol=0.05)


def test_a_waveform_without_peaks_has_no_effective_one():
    still = scan(HEAD, Waveform(0, 0, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6), points=SMALL)
    assert np.isnan(still.width.effective_V).all()
    assert still.as_json()["pulse_width"]["effective_V"] == [None] * SMALL
    assert still.steady_up_to_Hz == 0.0


def test_the_steady_range_ends_where_the_peak_first_leaves_it(pulse):
    heights_V = pulse.frequency.effective_V
    inside = np.abs(heights_V / heights_V[0] - 1) <= 0.1
    assert not inside.all()
    first = int(np.argmin(inside))
    assert pulse.steady_up_to_Hz == pulse.frequency.values[first - 1]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"vary": ("t2", "t2")}, "two different parameters"),
        ({"vary": ("t2", "t9")}, "vary must be one of"),
        ({"vary": ("t2", "t5")}, "t5 of the waveform is 0"),
        ({"points": 2}, "points must be at least 3; got 2"),
        ({"window_s": math.inf}, "finite window_s"),
        ({"waveform": Waveform(1, 0, 0, 0, 0, 0, 0)}, "the waveform lasts 0 s"),
    ],
)
def test_what_cannot_be_scanned_is_refused(options, said):
    with pytest.raises(ValueError, match=said):
        scan(HEAD, **{"waveform": PULSE, "vary": ("U1", "t2"), **options})
