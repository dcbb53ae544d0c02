"""Low-passes of one pole and two: against tones, laps, another program's, and each other."""

import numpy as np
import pytest
from scipy.signal import lsim

from inkjet_env.plant.lag import lagged
from inkjet_env.plant.low_pass import low_passed, time_constant_s

WALK = np.cumsum(np.random.default_rng(0).standard_normal(400))


def answer(ratio, second_order):
    """Of the low-pass to a tone, its frequency over the bandwidth."""
    s = 2j * np.pi * ratio * time_constant_s(1.0, second_order)
    return 1 / (1 + s + second_order * s**2)


@pytest.mark.parametrize("second_order", [0.0, 1e-7, 0.1, 0.5, 1.0])
def test_half_the_power_passes_at_the_bandwidth(second_order):
    assert abs(answer(1.0, second_order)) ** 2 == pytest.approx(0.5, rel=1e-12)
    assert abs(answer(1e-6, second_order)) == pytest.approx(1.0, abs=1e-9)


def test_half_is_butterworths():
    ratio = np.array([0.1, 0.5, 2.0, 10.0])
    assert np.abs(answer(ratio, 0.5)) ** 2 == pytest.approx(1 / (1 + ratio**4), rel=1e-12)


@pytest.mark.parametrize("second_order", [0.0, 0.5])
@pytest.mark.parametrize("per_period", [9, 100])
def test_low_pass_of_a_tone_is_wrong_by_what_is_said(per_period, second_order):
    angle = 2 * np.pi * np.arange(7 * per_period) / per_period
    for bandwidth in (1.0, 2.0, 10.0, 100.0):  # over the tone's
        exact = (np.exp(1j * angle) * answer(1 / bandwidth, second_order)).real
        time_s = time_constant_s(bandwidth, second_order)
        found = low_passed(np.cos(angle), time_s, second_order, 1 / per_period, True, cubic=True)
        assert np.abs(found - exact).max() < 4e-3 * (9 / per_period) ** 4


@pytest.mark.parametrize("cubic", [True, False])
@pytest.mark.parametrize("second_order", [0.0, 0.3])
def test_low_pass_in_steady_state_is_the_last_of_many_laps(second_order, cubic):
    lap = np.sin(np.linspace(0, 4, 60)) ** 2
    steady = low_passed(lap, 40.0, second_order, 1.0, True, cubic)
    laps = low_passed(np.tile(lap, 30), 40.0, second_order, 1.0, False, cubic)
    assert laps[-2 * 60 : -60] == pytest.approx(steady, abs=1e-12)


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("z", [1e-3, 0.1, 3.0, 60.0, 1e6])
def test_one_pole_is_the_lag_in_closed_form_and_two_become_it(z, periodic):
    """Over so many time constants a step."""
    exact = lagged(WALK, 1 / z, 1.0, periodic)
    assert low_passed(WALK, 1 / z, 0.0, 1.0, periodic) == pytest.approx(exact, abs=1e-11)
    gaps = [np.abs(low_passed(WALK, 1 / z, q, 1.0, periodic) - exact).max() for q in (1e-3, 1e-5)]
    assert gaps[1] < 0.02 * gaps[0] + 1e-8


@pytest.mark.parametrize("second_order", [0.01, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("time_s", [0.3, 30.0])
def test_two_poles_between_linear_values_are_another_programs(time_s, second_order):
    law = ([1.0], [second_order * time_s**2, time_s, 1.0])
    exact = lsim(law, WALK - WALK[0], np.arange(400.0))[1] + WALK[0]
    assert low_passed(WALK, time_s, second_order, 1.0, False) == pytest.approx(exact, abs=1e-11)


def test_no_time_constant_is_no_low_pass():
    assert low_passed(WALK, 0.0, 0.5, 1.0, True) is WALK
    assert time_constant_s(np.inf, 0.5) == 0.0
