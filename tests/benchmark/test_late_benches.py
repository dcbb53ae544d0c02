"""Problems of the family ``late``: what a comparison records of a search whose readings come in any order."""

import numpy as np
import pytest

from inkjet_env import optimizers
from inkjet_env.experiments.benchmark.late_benches import searched_beside
from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.benchmark.run_files import RunKey, RunResult, label_of, read_run, write_run
from inkjet_env.experiments.benchmark.runner import perform
from inkjet_env.experiments.benchmark.settings import BenchSettings
from inkjet_env.experiments.benchmark.suite import problem

BUDGET = 160


def searched(name, instruments=8):
    optimizer = optimizers.make(name, budget=BUDGET, seed=3)
    return searched_beside(problem("late-8"), optimizer, instruments, seed=3)


def test_time_is_counted_in_evaluations():
    run, spent = searched("random")
    assert run.evaluations == BUDGET
    assert spent[0] == 1
    assert (np.diff(spent) >= 0).all()
    # a reading takes 1.13 of the median time on average, and one in twenty is given up after five
    assert BUDGET < spent[-1] < 2 * BUDGET
    again, same = searched("random")
    assert (same == spent).all()
    assert (again.costs == run.costs).all()


def test_who_waits_for_whole_batches_spends_more_time():
    assert searched("cma-es")[1][-1] > 1.5 * searched("random")[1][-1]


def test_alone_an_instrument_reads_one_after_another():
    run, spent = searched("cma-es", instruments=1)
    assert len(run.readings) >= run.evaluations
    assert (np.diff(spent) > 0).any()


def test_a_run_holds_what_came_in_time(tmp_path):
    settings = BenchSettings(("late-8",), ("random", "nevergrad-TwoPointsDE"), repeats=1, budget=BUDGET, seed=5)
    for name in settings.optimizers:
        key, result, seconds, failure = perform(RunKey(name, "late-8", 0), settings)
        assert not failure
        assert seconds["total"] > 0
        assert result.budget == BUDGET
        assert result.evaluations[0] == 1
        assert (np.diff(result.evaluations) > 0).all()
        assert result.evaluations[-1] <= BUDGET
        assert (np.diff(result.told_V) < 0).all()
        assert problem("late-8").evaluate(result.points) == pytest.approx(result.costs_V)
        for part in ("runs", "timings"):
            (tmp_path / part).mkdir(exist_ok=True)
        label = label_of(key, settings.to_json())
        write_run(tmp_path, result, label, seconds)
        assert (read_run(tmp_path, key, label).told_V == result.told_V).all()


def test_of_improvements_at_the_same_time_the_last_counts_and_none_after_the_end():
    costs = problem("nominal").evaluate(np.zeros((4, 7))) - np.arange(4.0)
    key = RunKey("random", "late-8", 0)
    run = RunResult.of(key, np.zeros((4, 7)), costs, np.array([1, 2, 2, 5]))
    assert run.evaluations.tolist() == [1, 2]
    assert run.told_V.tolist() == costs[[0, 2]].tolist()
    assert run.budget == 4


def test_instruments_read_no_gradients():
    late = problem("late-8")
    assert not late.has_gradient
    with pytest.raises(ValueError, match="instruments read no gradients"):
        late.evaluate_with_gradient(np.zeros((1, 7)))
    with pytest.raises(ValueError, match="not with measurement_noise_V; got 2"):
        Problem("both", measurement_noise_V=0.1, instruments=2)
