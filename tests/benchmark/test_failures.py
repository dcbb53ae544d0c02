"""What fails in a bench: an optimiser is left out, an objective stops the bench."""

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest

from inkjet_env.experiments.benchmark import runner
from inkjet_env.experiments.benchmark.analysis import Comparison
from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.benchmark.report import write_report
from inkjet_env.experiments.benchmark.run_files import RunKey
from inkjet_env.experiments.benchmark.runner import perform, run_bench
from inkjet_env.optimizers.base import Optimizer
from tests.benchmark.small_bench import contents, small_settings


def test_an_optimiser_that_breaks_down_is_reported_and_not_scored(tmp_path, monkeypatch):
    from inkjet_env import optimizers

    monkeypatch.setattr(
        optimizers, "availability", lambda names: {name: "too old" if name == "pso" else None for name in names}
    )
    outcome = run_bench(small_settings(), tmp_path / "r", workers=1)
    assert outcome.unavailable == {"pso": "too old"}
    assert {r.key.optimizer for r in outcome.results} == {"random"}
    page = write_report(Comparison(outcome))[0].read_text()
    assert "too old" in page


@pytest.fixture
def here(monkeypatch):
    """Have a bench do its runs in this process, one job after another."""

    def one_by_one(_, function, jobs, keep):
        for name, arguments in jobs.items():
            keep(name, function(*arguments()))

    monkeypatch.setattr("inkjet_env.experiments.benchmark.runner.workers_of", lambda *_: contextlib.nullcontext())
    monkeypatch.setattr("inkjet_env.experiments.benchmark.runner.worker_count", lambda _: 1)
    monkeypatch.setattr("inkjet_env.experiments.benchmark.runner.run_each", one_by_one)


class Broken(Optimizer):
    """Breaks down when it is told costs."""

    name = "broken"

    def propose(self):
        return np.zeros((1, self.dimension))

    def learn(self, points, costs, gradients):
        raise ZeroDivisionError("my own")


def failing(method):
    """A method of a problem that fails at points of a first coordinate above a half."""

    def fails(self, points):
        if np.max(np.atleast_2d(points)[:, 0]) > 0.5:
            raise ZeroDivisionError("of ours")
        return method(self, points)

    return fails


def test_an_exception_of_an_optimiser_leaves_it_out_and_goes_on(tmp_path, monkeypatch, here):
    entrant = SimpleNamespace(optimizer="random", options={}, made=lambda budget, seed, beside: Broken(7, budget, seed))
    known = runner.entrant
    monkeypatch.setattr(runner, "entrant", lambda name: entrant if name == "random" else known(name))
    outcome = run_bench(small_settings(), tmp_path / "r")
    assert outcome.unavailable == {"random": "failed on nominal, repeat 0: ZeroDivisionError: my own"}
    assert {r.key.optimizer for r in outcome.results} == {"pso"}


OBJECTIVES = [("nominal", "pso"), ("lot-worst", "random"), ("nominal", "lbfgsb-multistart")]


@pytest.mark.parametrize(("problem", "optimizer"), OBJECTIVES)
def test_an_exception_of_the_objective_is_no_fault_of_the_optimiser(monkeypatch, problem, optimizer):
    key, settings = RunKey(optimizer, problem, 0), small_settings(problems=(problem,), optimizers=(optimizer,))
    assert perform(key, settings)[1] is not None
    for method in ("evaluate", "evaluate_with_gradient"):
        monkeypatch.setattr(Problem, method, failing(getattr(Problem, method)))
    told = f"objective of {problem} failed, in repeat 0 of {optimizer}, seed {key.seed(0)}: ZeroDivisionError: of ours"
    with pytest.raises(
        runner.ObjectiveFailedError, match=rf"{told} at evaluation \d+, point \[0\.[5-9]\d+, .*\]$"
    ) as caught:
        perform(key, settings)
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


def test_a_cost_that_is_not_finite_is_no_fault_of_the_optimiser(monkeypatch):
    evaluate = Problem.evaluate
    monkeypatch.setattr(
        Problem, "evaluate", lambda of, points: np.where(points[:, 0] > 0.5, np.nan, evaluate(of, points))
    )
    told = r"nominal failed, in repeat 0 .*: costs must be finite; got nan at evaluation \d+, point \[0\.[5-9]"
    with pytest.raises(runner.ObjectiveFailedError, match=told):
        perform(RunKey("random", "nominal", 0), small_settings())


def test_a_reading_that_fails_is_named_by_the_evaluation_that_reads_it(monkeypatch):
    """Each evaluation of a run is read with an error of its own: a point without its number tells too little."""
    read = Problem.read

    def fails(self, points, seed, first=0):
        if first <= 50 < first + len(points):
            raise ZeroDivisionError("of ours")
        return read(self, points, seed, first)

    monkeypatch.setattr(Problem, "read", fails)
    with pytest.raises(runner.ObjectiveFailedError, match=r"of ours at evaluation 51, point \["):
        perform(RunKey("random", "reading-200mV", 0), small_settings(problems=("reading-200mV",)))


def test_runs_that_were_finished_before_the_objective_fails_are_kept(tmp_path, monkeypatch, here):
    whole, folder = tmp_path / "whole", tmp_path / "r"
    run_bench(small_settings(), whole)
    first = RunKey("pso", "nominal", 1).seed(0)
    known = Problem.as_measured

    def fails_in_one_run(self, seed, first_evaluation=0):
        if seed == first:
            raise ZeroDivisionError("of ours")
        return known(self, seed, first_evaluation)

    with monkeypatch.context() as patched:
        patched.setattr(Problem, "as_measured", fails_in_one_run)
        with pytest.raises(ZeroDivisionError, match="of ours") as caught:
            run_bench(small_settings(), folder)
    assert "At the worker:" in caught.value.__notes__[0]
    assert list(contents(folder)) == ["nominal--pso--000.parquet"]
    run_bench(small_settings(), folder)
    assert contents(folder) == contents(whole)
