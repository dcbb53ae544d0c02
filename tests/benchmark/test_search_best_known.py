from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.grey_level import grey_level
from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.benchmark.studies.search_best_known import plain, polished, settled, valley_polished
from inkjet_env.experiments.benchmark.suite import BENCHED, families, family_of, problem, suite
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Waveform


def drops(solved, waveform):
    """What a waveform costs on each head of a problem, without compiled code."""
    if isinstance(solved.printhead, AugmentedPrinthead):
        return [solved.printhead.respond(waveform, solved.initial_state, solved.window_s).cost(solved.cost)]
    heads = solved.spread.around(solved.printhead) if solved.spread else (solved.printhead,)
    period_s = 1 / solved.jetting_Hz if solved.jetting_Hz else np.inf
    if solved.pulses:
        windows_s = [*[period_s] * (solved.pulses - 1), solved.window_s]
        each = [
            solved.printhead.respond(waveform, window_s=window_s, period_s=period_s, earlier_drops=earlier).peaks_V
            for earlier, window_s in enumerate(windows_s)
        ]
        costs = [[replace(solved.cost, A=weight)(peaks_V) for peaks_V in each] for weight in (1.0, 0.0)]
        return [grey_level(*np.array(costs)[..., None, None], solved.cost.A).item()]
    return [
        head.respond(waveform, solved.initial_state, solved.window_s, period_s=period_s).cost(solved.cost)
        for head in heads
    ]


@pytest.mark.parametrize("name", suite())
def test_recorded_cost_is_the_cost_of_the_recorded_waveform(name):
    solved, known = problem(name), problem(name).best_known
    assert known is not None
    by_mean = solved.spread and solved.spread.judged == "mean"
    plain = (np.mean if by_mean else max)(drops(solved, Waveform.from_array(known.waveform)))
    assert plain == pytest.approx(known.cost, abs=1e-9)
    assert solved.evaluate(solved.bounds.to_unit(known.waveform))[0] == pytest.approx(known.cost, abs=1e-7)


@pytest.mark.parametrize("name", suite())
@pytest.mark.parametrize("size", [1e-1, 1e-3, 1e-5])
def test_no_small_step_improves_the_recorded_waveform(name, size):
    solved, rng = problem(name), np.random.default_rng(7)
    best = solved.bounds.to_unit(solved.best_known.waveform)
    tries = 2000 if solved.has_gradient or solved.measurement_noise_V else 150  # heads with effects are slow
    moves = size * rng.standard_normal((tries, 7)) * (rng.random((tries, 7)) < 0.5)
    costs = solved.evaluate(np.clip(best + moves, -1, 1))
    within_V = 1e-4 if solved.spread else 1e-6  # a mean over heads breaks wherever one of them does
    assert costs.min() >= solved.best_known.cost - within_V


@pytest.mark.parametrize("name", suite())
def test_the_recorded_waveform_costs_the_same_wherever_rounding_takes_it(name):
    """It does not lie on a break; the search looked at the corners of a box, this looks within and on its faces."""
    known, solved = problem(name).best_known, replace(problem(name), measurement_noise_V=0.0)
    rng, best = np.random.default_rng(3), solved.bounds.to_unit(known.waveform)
    moves = 1e-11 * np.clip(rng.uniform(-1.5, 1.5, (64, 7)), -1, 1)
    assert solved.evaluate(np.clip(best + moves, -1, 1)).max() <= known.cost + 1e-6


class Cliff:
    """Falls towards a break that no axis is square to, and is high beyond it."""

    across = np.array([0.3, -0.2, 0.5, 0.1, -0.4, 0.6, 0.2])

    def evaluate(self, points):
        beyond = np.atleast_2d(points) @ self.across - 0.1
        return np.where(beyond < 0, -1.0 + np.abs(beyond), 5.0)


def test_what_lies_on_a_break_costs_what_lies_beyond_it():
    on_it = 0.1 * Cliff.across / (Cliff.across @ Cliff.across)
    evaluate, anything = settled(Cliff()), np.full(2, np.inf)
    points = np.array([on_it - 1e-12 * Cliff.across, on_it - 1e-9 * Cliff.across])
    assert Cliff().evaluate(points) == pytest.approx([-1.0, -1.0], abs=1e-7)
    assert evaluate(points, anything) == pytest.approx([5.0, -1.0], abs=1e-7)
    assert evaluate(points, np.full(2, -2.0)) == pytest.approx([-1.0, -1.0], abs=1e-7)  # too high to be looked at
    found = points
    for step in (1e-10, 1e-2, 1e-4, 1e-6, 1e-8):
        found, costs = polished(evaluate, found, 1000, np.random.default_rng(1), step)
    assert costs.min() == pytest.approx(-1.0, abs=1e-7)
    around = found[costs.argmin()] + 1e-11 * np.random.default_rng(2).uniform(-1, 1, (1000, 7))
    assert Cliff().evaluate(around).max() < -0.999


def test_default_problem_reaches_the_optimum_that_is_known():
    known = problem("nominal").best_known
    assert known.cost <= -22.830
    expected = [100, -100, 1.000e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20.000e-6]
    np.testing.assert_allclose(known.waveform, expected, rtol=0.03)


def test_literal_problems_have_an_answer_other_than_doing_nothing():
    assert problem("literal-5-1").best_known.cost <= -22.1
    assert problem("literal-10-5").best_known.cost <= -31.6


@pytest.mark.parametrize("name", ["drop-4V", "drop-6V"])
def test_the_best_waveform_of_a_wanted_drop_reaches_its_height(name):
    """The weight of a missing volt outweighs what it saves elsewhere: the penalty is exact."""
    solved = problem(name)
    peaks_V = solved.respond(solved.bounds.to_unit(solved.best_known.waveform)).peaks_V
    assert np.abs(peaks_V).max() >= solved.cost.target_height_V - 1e-6


def test_how_costs_are_read_does_not_change_the_best_waveform():
    exact = problem("nominal").best_known.cost
    for name in ("reading-50mV", "reading-200mV", "late-8", "late-32"):
        assert problem(name).best_known.cost == pytest.approx(exact, abs=1e-6)


def test_every_instance_has_one_family():
    assert sorted(suite()) == sorted(one.name for family in families().values() for one in family)
    assert all(problem(name) in families()[family_of(name)] for name in suite())
    assert set(BENCHED) <= set(suite())


def test_an_entry_of_another_problem_is_not_used():
    assert Problem("nominal", window_s=300e-6).best_known is None


def test_settings_rebuild_the_problem():
    for solved in suite().values():
        assert Problem.from_settings(solved.name, solved.settings()).settings() == solved.settings()


def test_unknown_problem_suggests_the_nearest():
    with pytest.raises(ValueError, match=r"problem must be one of .* got 'nominl'. Did you mean 'nominal'\?"):
        problem("nominl")


def test_polish_finds_the_minimum_of_a_bowl_at_the_wall():
    class Bowl:
        def evaluate(self, points):
            return ((np.atleast_2d(points) - np.array([2, 0.5, 0, 0, -0.25, 0, -2])) ** 2).sum(axis=1)

    bottom = [1, 0.5, 0, 0, -0.25, 0, -1]
    points, costs = polished(plain(Bowl()), np.zeros((3, 7)), 2000, np.random.default_rng(0))
    np.testing.assert_allclose(points[np.argmin(costs)], bottom, atol=1e-4)
    np.testing.assert_allclose(valley_polished(Bowl(), np.full(7, 0.1), 1), bottom, atol=1e-4)
