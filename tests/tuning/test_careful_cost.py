"""The careful cost: the worst of what peaks that are known within a margin may cost."""

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.tuning.careful_cost import Careful, CarefulCost, margin_of, shoulders
from inkjet_env.experiments.tuning.drop_signal import Signal, without_wiggles
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.head_ensemble import HeadEnsemble
from inkjet_env.printhead import PeakCost, Printhead

HEAD = Printhead.published()
MODE = next(effect for effect in catalogue() if effect.id == "second_mode")
WITH_MODE = AugmentedPrinthead(HEAD, ((MODE, MODE.example_values(HEAD)),))
POINTS = np.random.default_rng(0).uniform(-1, 1, (20, 7))
STEP_V = 5e-3
"""What the steps of a sampled signal may change in a cost, in volts."""


def test_of_two_peaks_of_one_height_the_worse_is_taken_to_be_effective():
    peaks = [6.871, -6.8712, 0.0, -1.0]
    assert PeakCost()(peaks) == pytest.approx(-5 * 6.8712 + 5 * 0.0 + 6.871 + 1.0)
    assert CarefulCost(margin_V=0.001)(peaks) == pytest.approx(-5 * 6.871 + 5 * 6.8712 + 1.0)
    assert CarefulCost(margin_V=0.0001)(peaks) == pytest.approx(PeakCost()(peaks))


def test_a_wiggle_that_may_not_be_there_does_not_save_the_cost():
    peaks = [6.0, -8.0, 0.01, 0.008, 1.2, -0.5]
    assert CarefulCost(margin_V=0.005)(peaks) == pytest.approx(PeakCost()([6.0, -8.0, 1.2, -0.5]))
    assert CarefulCost(margin_V=0.001)(peaks) == pytest.approx(PeakCost()(peaks))
    costly = [6.0, -8.0, -7.99, -8.0, 1.2, -0.5]  # and one that costs may be there
    assert CarefulCost(margin_V=0.05)(costly) >= PeakCost()(costly)


def test_wiggles_are_left_out_smallest_first():
    peaks_V = np.array([5.0, 1.0, 1.4, 1.3, 2.0, -3.0])
    np.testing.assert_array_equal(peaks_V[without_wiggles(peaks_V, 0.5)], [5.0, 1.0, 2.0, -3.0])
    np.testing.assert_array_equal(without_wiggles(peaks_V, 0.5, 5), np.arange(6))  # one more may be at an end
    np.testing.assert_array_equal(without_wiggles(np.array([5.0, 1.0]), 9.0), [0, 1])
    np.testing.assert_array_equal(without_wiggles(np.array([]), 1.0), [])


def hump(height_V):
    """Two peaks and, between them, a hump on the way down: a shoulder, or a wiggle if it is high enough."""
    time = np.linspace(0.0, 10.0, 1001)
    return Signal(6 * np.cos(0.9 * time) + height_V * np.exp(-(((time - 1.7) / 0.2) ** 2)), 1e-7)


def test_a_shoulder_counts_as_a_wiggle_that_may_be_there():
    frequency_Hz, window_s = 0.9 / (2 * np.pi * 1e-5), 9e-5
    flat, wiggle = hump(1.23), hump(1.6)
    assert wiggle.peaks(window_s)[0].size == flat.peaks(window_s)[0].size + 2
    careful = CarefulCost(margin_V=0.05)
    assert careful.of_signal(flat, frequency_Hz, window_s) > PeakCost()(flat.peaks(window_s)[1]) + 3
    assert CarefulCost(margin_V=0.05, share=0.5).of_signal(flat, frequency_Hz, window_s) == pytest.approx(
        (careful.of_signal(flat, frequency_Hz, window_s) + PeakCost()(flat.peaks(window_s)[1])) / 2
    )
    steep = hump(0.5)
    assert careful.of_signal(steep, frequency_Hz, window_s) == pytest.approx(PeakCost()(steep.peaks(window_s)[1]))
    at = shoulders(flat.signal_V, 1.0)
    assert at.size == 1
    assert abs(at[0] - 156) < 5


@pytest.mark.parametrize("cost", [PeakCost(), PeakCost(-50, 5, target_height_V=3.0), PeakCost(effective="first")])
def test_without_a_margin_it_is_the_cost_itself_and_with_one_never_less(cost):
    for head in (HEAD, WITH_MODE):
        problem = Problem("head", head, cost)
        exact = problem.evaluate(POINTS)
        np.testing.assert_allclose(Careful(problem, 0.0).evaluate(POINTS), exact, rtol=0, atol=STEP_V)
        assert (Careful(problem, 0.3).evaluate(POINTS) >= exact - STEP_V).all()


def test_an_ensemble_is_judged_by_its_risk():
    heads = HeadEnsemble((HEAD, HEAD.varied(gain=0.9), WITH_MODE), (2.0, 1.0, 1.0))
    problem = Problem("ensemble", HEAD, ensemble=heads, risk="worst")
    np.testing.assert_allclose(Careful(problem, 0.0).evaluate(POINTS), problem.evaluate(POINTS), rtol=0, atol=STEP_V)


def test_the_margin_is_three_times_what_the_fit_leaves_beyond_the_noise():
    fit = {"noise_rms_V": 0.03, "base_heldout_rms_V": 0.05, "augmented_heldout_rms_V": 0.029}
    assert margin_of(fit, corrected=False) == pytest.approx(3 * 0.04)
    assert margin_of(fit, corrected=True) == 0
    assert margin_of({"noise_rms_V": 0.03, "heldout_rms_V": 0.05}, corrected=True) == pytest.approx(0.12)
