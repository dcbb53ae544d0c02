"""Creep against the sum over every change, its transform, and the sum's own error."""

import math

import numpy as np
import pytest
from scipy.special import exp1, gamma

from inkjet_env.plant import Excitation, Plant
from inkjet_env.plant.effect import complete
from inkjet_env.plant.effects import creep
from inkjet_env.plant.effects.creep import Creep, crept
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
PULSE = np.interp(np.arange(600), [20, 35, 130, 150], [0, 80, 80, 0.0])


def creeping(creep_per_decade, onset_s):
    return Plant(HEAD, effects=((Creep(), complete(Creep(), creep_per_decade=creep_per_decade, onset_s=onset_s)),))


def by_superposition(signal, onset_s, step_s):
    """Every step of the signal creeps by itself: the exact integral over each of its ramps, summed."""
    times_s = step_s * np.arange(signal.size)

    def area(t):  # of lg(1 + t / onset) from 0
        return ((t + onset_s) * np.log1p(t / onset_s) - t) / math.log(10)

    result = np.zeros(signal.size)
    slopes = np.diff(signal) / step_s
    for i in np.flatnonzero(slopes):
        result[i + 1 :] += slopes[i] * (area(times_s[i + 1 :] - times_s[i]) - area(times_s[i + 1 :] - times_s[i + 1]))
    return result


@pytest.mark.parametrize("onset_s", [1e-4, 1e-2, 0.1, 10.0])
@pytest.mark.parametrize("step_s", [1e-7, 1e-4, 0.02])
def test_creep_is_the_sum_of_what_every_change_creeps(onset_s, step_s):
    signal = np.random.default_rng(3).normal(0, 30, 25).repeat(40).cumsum()
    exact = by_superposition(signal, onset_s, step_s)
    error = np.abs(crept(signal, onset_s, step_s, periodic=False) - exact).max()
    assert error < 2e-5 * np.ptp(signal)


def test_a_held_step_creeps_by_the_same_in_every_decade():
    step_s = 1e-3
    excitation = Excitation("strain_gauge", "demagnetised", step_s, np.interp(np.arange(30_001), [1, 2], [0.0, 60.0]))
    signal = creeping(0.02, 5e-3).signal(excitation)
    held = Plant(HEAD).signal(excitation)[-1]
    times_s = np.array([0.1, 0.3, 1.0, 3.0, 10.0, 29.0])
    expected = held * (1 + 0.02 * np.log10(1 + (times_s + 0.5 * step_s) / 5e-3))
    assert signal[2 + np.round(times_s / step_s).astype(int)] == pytest.approx(expected, rel=2e-6)  # the ramp's middle


@pytest.mark.parametrize("spacing", [2.0, 1.5, 1.2, 1.0])
def test_the_sum_of_lags_is_wrong_by_what_poissons_formula_says(spacing, monkeypatch):
    """By twice the term ``|Γ(2πi / h)|`` of each sign, over ln 10, which falls as exp(-π² / h)."""
    monkeypatch.setattr(creep, "SLOWEST", 1e-5)
    monkeypatch.setattr(creep, "SPACING", spacing)
    signal, step_s = np.interp(np.arange(4000), [0, 1], [0.0, 1.0]), 1e-3
    errors = [
        np.abs(crept(signal, onset_s, step_s, periodic=False) - by_superposition(signal, onset_s, step_s)).max()
        for onset_s in 0.05 * np.exp(spacing * np.arange(8) / 8)  # where the rates lie from it matters
    ]
    assert max(errors) == pytest.approx(4 * abs(gamma(2j * np.pi / spacing)) / math.log(10), rel=0.05)


@pytest.mark.parametrize("onset_s", [1e-3, 0.1, 3.0])
def test_a_tone_in_steady_state_creeps_by_the_transform_of_the_logarithm(onset_s):
    n, period_s = 4000, 0.5
    angle = 2 * np.pi * np.arange(n) / n
    z = 2j * np.pi * onset_s / period_s
    exact = (np.exp(1j * angle) * np.exp(z) * exp1(z)).real / math.log(10)  # s ∫ lg(1 + t / t0) e^{-st} dt
    assert crept(np.cos(angle) + 7, onset_s, period_s / n, periodic=True) == pytest.approx(exact, abs=2e-5)


def test_creep_in_steady_state_is_the_last_of_many_laps_but_for_the_mean():
    lap = PULSE[::3]
    laps = np.tile(lap, 400)
    last = crept(laps, 2e-3, 1e-5, periodic=False)[-200:]
    steady = crept(lap, 2e-3, 1e-5, periodic=True)
    assert last - last.mean() == pytest.approx(steady - steady.mean(), abs=2e-3 * np.ptp(steady))


def test_a_fast_recording_hardly_creeps():
    excitation = Excitation("self_sensing", "demagnetised", 1 / (100 * HEAD.frequency_Hz), PULSE)
    signal = Plant(HEAD).signal(excitation)
    change = creeping(0.02, 0.1).signal(excitation) - signal
    assert 0 < np.abs(change).max() < 1e-5 * np.abs(signal).max()


def test_retarded_elements_go_on_after_a_step_as_their_exponentials():
    step_s = 1e-3
    excitation = Excitation("strain_gauge", "demagnetised", step_s, np.interp(np.arange(9001), [0, 1], [0.0, 60.0]))
    values = complete(Creep(), onset_s=0.1, retarded_1=0.03, time_1_s=0.05, retarded_2=-0.01, time_2_s=2.0)
    signal = Plant(HEAD, effects=((Creep(), values),)).signal(excitation)
    held = Plant(HEAD).signal(excitation)[-1]
    t = step_s * (np.arange(1, 9001) - 0.5)  # since the ramp's middle
    expected = held * (1 + 0.03 * -np.expm1(-t / 0.05) - 0.01 * -np.expm1(-t / 2.0))
    assert signal[2:] == pytest.approx(expected[1:], rel=2e-5)


def test_retarded_elements_of_a_tone_in_steady_state_are_a_low_pass_of_it():
    n, period_s = 2000, 0.4
    tone_V = 40 * np.cos(2 * np.pi * np.arange(n) / n)
    excitation = Excitation("strain_gauge", "periodic", period_s / n, tone_V)
    values = complete(Creep(), onset_s=0.1, retarded_1=0.05, time_1_s=0.03)
    held_V = np.ascontiguousarray(excitation.drive_at_nodes_V)
    found = Creep().hysteresis(values, held_V, held_V, HEAD, excitation) - held_V
    angle = 2 * np.pi * np.arange(held_V.size) / held_V.size
    expected = (0.05 * 40 * np.exp(1j * angle) / (1 + 2j * np.pi * 0.03 / period_s)).real
    assert found == pytest.approx(expected, abs=2e-5)


def test_what_creeps_how_is_said():
    assert "per decade" in Creep().description(complete(Creep(), creep_per_decade=0.02, onset_s=0.1))
    said = Creep().description(complete(Creep(), onset_s=0.1, retarded_1=0.03, time_1_s=0.05, retarded_2=-0.01))
    assert "per decade" not in said
    assert "on by 3 % within about 50 ms" in said
    assert "back by 1 % within about 3 s" in said
