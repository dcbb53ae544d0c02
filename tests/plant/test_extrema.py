"""Extrema between samples."""

import numpy as np
import pytest

from inkjet_env.plant.extrema import extrema


@pytest.mark.parametrize("offset", [0.0, 0.3, 0.5, 0.77])
def test_extrema_of_a_ringing_are_those_of_its_formula(offset):
    step_s, rate = 1 / 200, 2 * np.pi
    time_s = (np.arange(1970) + offset) * step_s
    times_s, values = extrema(np.exp(-0.3 * time_s) * np.cos(rate * time_s), step_s)
    exact_s = (np.arange(1, 21) * np.pi - np.arctan2(0.3, rate)) / rate
    exact_s = exact_s[(exact_s > time_s[0]) & (exact_s < time_s[-1])]
    exact = np.exp(-0.3 * exact_s) * np.cos(rate * exact_s)
    assert times_s + offset * step_s == pytest.approx(exact_s, abs=0.02 * step_s)
    assert values == pytest.approx(exact, rel=1e-5)


def test_a_rising_or_a_still_signal_has_none():
    for signal in (np.linspace(0, 1, 50), np.full(50, 3.0), np.zeros(50), np.repeat([0.0, 1.0, 1.0, 2.0], 10)):
        assert extrema(signal, 1.0)[1].size == 0


def test_a_flat_top_counts_once_at_its_middle():
    times_s, values = extrema(np.array([0.0, 1.0, 2.0, 2.0, 2.0, 1.0, 0.0]), 0.5)
    assert times_s.tolist() == [1.5]
    assert values.tolist() == [2.0]


def test_no_extremum_is_higher_than_a_jump():
    signal = np.concatenate([np.linspace(0, 5, 40), [2.5], np.linspace(0, -1, 40)])
    _, values = extrema(signal, 1.0)
    assert values == pytest.approx([5.0], abs=0.02)
