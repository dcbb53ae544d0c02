"""Tests that every optimiser must pass, one of your own too.

In a test file of yours, for pytest::

    from inkjet_env.optimizers.testing import OptimizerTests
    from my_lab import Annealing


    class TestAnnealing(OptimizerTests):
        optimizer = Annealing
"""

from __future__ import annotations

import functools
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar
from unittest import mock

import numpy as np

from inkjet_env.optimizers.asynchronous import LateRun, Reading, minimise_late
from inkjet_env.optimizers.base import Optimizer
from inkjet_env.optimizers.loop import Interrupted, NonFiniteCostError, ReplayMismatchError, Run, minimise
from inkjet_env.optimizers.registry import make
from inkjet_env.typing import Real

CENTRE = np.array([0.3, -0.2, 0.1, 0.5, -0.4, 0.0, 0.25])
DIMENSION = len(CENTRE)
SEED = 5


class Bowl:
    """The cost ``10 |x − centre|²`` with its gradient; it counts its evaluations.

    Parameters
    ----------
    stop_at : int, optional
        Number of the evaluation at which Ctrl-C is pressed.
    nan_at : int, optional
        Number of the evaluation whose cost is not a number.
    """

    def __init__(self, stop_at: int | None = None, nan_at: int | None = None) -> None:
        self.evaluations, self.stop_at, self.nan_at = 0, stop_at, nan_at

    def evaluate(self, points: Real) -> Real:
        """Costs, shape (n,), of points, shape (n, 7)."""
        self.evaluations += len(points)
        if self.stop_at is not None and self.evaluations >= self.stop_at:
            raise KeyboardInterrupt
        costs: Real = 10 * ((points - CENTRE) ** 2).sum(axis=1)
        if self.nan_at is not None and self.evaluations >= self.nan_at:
            costs[self.nan_at - 1 - self.evaluations] = np.nan
        return costs

    def evaluate_with_gradient(self, points: Real) -> tuple[Real, Real]:
        """Costs, shape (n,), and their gradients, shape (n, 7)."""
        return self.evaluate(points), 20 * (points - CENTRE)


class LateBowl:
    """A bowl that is read by several instruments: readings come in another order, and each ninth one is lost.

    Parameters
    ----------
    seed : int
        Seed of the order.
    stop_at : int, optional
        Number of the reading at which Ctrl-C is pressed.
    """

    def __init__(self, seed: int = 0, stop_at: int | None = None) -> None:
        self.rng, self.stop_at, self.waits = np.random.default_rng(seed), stop_at, 0
        self.under_way: dict[int, float] = {}

    def start(self, number: int, point: Real) -> None:
        """Begin an evaluation."""
        self.under_way[number] = float(Bowl().evaluate(point[None])[0])

    def wait(self) -> Reading:
        """A reading of any evaluation that is under way."""
        self.waits += 1
        if self.waits == self.stop_at:
            raise KeyboardInterrupt
        number = int(self.rng.choice(list(self.under_way)))
        cost = self.under_way.pop(number)
        return Reading(number, math.nan if self.waits % 9 == 0 and self.waits > 9 else cost)


class OptimizerTests:
    """Tests of the rules of `Optimizer`; a subclass names what is tested.

    Attributes
    ----------
    optimizer : type or str
        The class of the optimiser, or the name by which `inkjet_env.optimizers.make` knows it.
    options : dict
        Keyword arguments of the optimiser.
    budget : int
        Number of evaluations of the test runs, at least 36; enough for several batches.
    deterministic : bool
        Whether the optimiser draws no random numbers, so that all seeds give the same run.
    """

    optimizer: type[Optimizer] | str
    options: ClassVar[dict[str, Any]] = {}
    budget = 150
    deterministic = False

    def _made(self, budget: int, seed: int = SEED) -> Optimizer:
        maker = functools.partial(make, self.optimizer) if isinstance(self.optimizer, str) else self.optimizer
        return maker(DIMENSION, budget, seed, **self.options)

    def _run(self, budget: int | None = None, seed: int = SEED, objective: Any = None, **more: Any) -> Run:
        budget = budget or self.budget
        return minimise(objective or Bowl(), self._made(budget, seed), budget, **more)

    def _whole(self) -> Run:
        """A run of the usual length, made once for each optimiser."""
        key = (self.optimizer, self.budget, repr(self.options))
        if key not in _runs:
            _runs[key] = self._run()
        return _runs[key]

    def test_budget_is_spent_exactly_and_within_the_box(self) -> None:
        for budget in (1, 7, min(83, self.budget)):
            bowl = Bowl()
            run = self._run(budget, objective=bowl)
            assert bowl.evaluations == budget == run.evaluations, f"{bowl.evaluations} evaluations of {budget}"
            assert run.points.shape == (budget, DIMENSION), f"points have shape {run.points.shape}"
            assert run.complete, f"the run of {budget} evaluations is not complete"
            assert (np.abs(run.points) <= 1).all(), "a point lies outside [-1, 1]"

    def test_the_same_seed_gives_the_same_run(self) -> None:
        np.random.seed(1)  # noqa: NPY002  (what others do to the process-wide generator must not matter)
        again, whole = self._run(), self._whole()
        assert np.array_equal(again.points, whole.points), "two runs with one seed have different points"
        assert np.array_equal(again.costs, whole.costs), "two runs with one seed have different costs"

    def test_another_seed_gives_another_run_unless_it_is_deterministic(self) -> None:
        same = np.array_equal(self._run(seed=SEED + 1).points, self._whole().points)
        if self.deterministic:
            assert same, "it is called deterministic, but another seed gives another run"
        else:
            assert not same, "another seed gives the same run; if no random number is drawn, set deterministic = True"

    def test_the_history_holds_the_best_so_far(self) -> None:
        run = self._whole()
        evaluations, best = np.array(run.history).T
        assert evaluations[0] == 1, "the history does not begin with the first evaluation"
        assert evaluations[-1] == self.budget, "the history does not end with the last evaluation"
        assert (np.diff(best[:-1]) < 0).all(), "a cost in the history is no improvement"
        assert best[-1] == run.best_cost == run.costs.min(), "the history does not end with the lowest cost"

    def test_a_cost_that_is_not_finite_ends_the_run(self) -> None:
        error = _raised(NonFiniteCostError, lambda: self._run(objective=Bowl(nan_at=31)))
        point = str(self._whole().points[30].tolist())
        assert "got nan at evaluation 31" in error, f"the error does not name the evaluation: {error}"
        assert point in error, f"the error does not name the point {point}: {error}"

    def test_an_interrupted_run_resumes_bit_for_bit(self) -> None:
        whole = self._whole()
        for share in (0.0, 0.43, 1.0):
            stop_at = 1 + int(share * (self.budget - 2))
            try:
                self._run(objective=Bowl(stop_at=stop_at))
            except Interrupted as interruption:
                part = interruption.run
            else:
                raise AssertionError("Ctrl-C did not interrupt the run")
            bowl = Bowl()
            run = self._run(objective=bowl, recorded=part)
            assert bowl.evaluations == self.budget - part.evaluations, "recorded evaluations were made again"
            assert np.array_equal(run.points, whole.points), "the resumed run has other points than one in one piece"
            assert np.array_equal(run.costs, whole.costs), "the resumed run has other costs than one in one piece"

    def test_a_record_may_end_within_a_batch(self) -> None:
        whole, kept = self._whole(), self.budget * 71 // 150
        arrays = (whole.points, whole.costs, *(() if whole.gradients is None else (whole.gradients,)))
        bowl = Bowl()
        run = self._run(objective=bowl, recorded=tuple(array[:kept] for array in arrays))
        assert bowl.evaluations == self.budget - kept, "recorded evaluations were made again"
        assert np.array_equal(run.points, whole.points), "the resumed run has other points than one in one piece"

    def test_a_record_of_another_seed_is_refused(self) -> None:
        if self.deterministic:
            return
        _raised(ReplayMismatchError, lambda: self._run(seed=SEED + 1, recorded=self._whole()))

    def test_two_side_by_side_do_not_disturb_each_other(self) -> None:
        bowl, pair, seen = Bowl(), [self._made(self.budget, seed) for seed in (SEED, SEED + 1)], []
        while pair[0].remaining:
            for optimizer in pair:
                if not optimizer.remaining:
                    continue
                points = optimizer.ask()
                if optimizer is pair[0]:
                    seen.append(points)
                costs, gradients = bowl.evaluate_with_gradient(points)
                optimizer.tell(points, costs, gradients if optimizer.uses_gradient else None)
        for optimizer in pair:
            optimizer.close()
            optimizer.close()
        assert np.array_equal(np.concatenate(seen), self._whole().points), "a second optimiser changes the first"

    def test_asking_twice_gives_the_same_points_and_a_spent_budget_is_an_error(self) -> None:
        optimizer = self._made(1)
        points = optimizer.ask()
        assert np.array_equal(optimizer.ask(), points), "asking twice gives different points"
        optimizer.tell(points, np.zeros(1), np.zeros((1, DIMENSION)))
        error = _raised(RuntimeError, optimizer.ask)
        assert "the budget of 1 evaluations is spent" in error, f"the error does not say why: {error}"
        optimizer.close()

    def test_readings_may_come_late_in_another_order_or_never(self) -> None:
        optimizer, budget = self._made(self.budget, SEED), self.budget
        if optimizer.uses_gradient:
            optimizer.close()
            return
        whole = minimise_late(LateBowl(), optimizer, budget, slots=5)
        assert whole.evaluations == budget == len(whole.lost), f"{whole.evaluations} evaluations of {budget}"
        assert (np.abs(whole.points) <= 1).all(), "a point lies outside [-1, 1]"
        try:
            minimise_late(LateBowl(stop_at=budget // 2), self._made(budget, SEED), budget, slots=5)
        except Interrupted as interruption:
            part = interruption.run
        assert isinstance(part, LateRun)
        late = LateBowl(seed=1)
        run = minimise_late(late, self._made(budget, SEED), budget, slots=5, recorded=part.readings)
        made = part.evaluations
        assert made > 0, "nothing was read before the interruption"
        assert np.array_equal(run.points[:made], whole.points[:made]), "recorded readings give other points"
        assert np.array_equal(run.costs[:made], whole.costs[:made]), "recorded readings give other costs"
        assert late.waits == len(run.readings) - len(part.readings), "recorded readings were taken again"

    def test_a_run_leaves_no_files_behind(self) -> None:
        with tempfile.TemporaryDirectory() as folder, mock.patch.object(tempfile, "tempdir", folder):
            self._run(36)
            left = [file.name for file in Path(folder).iterdir()]
        assert not left, f"the run left {', '.join(left)} in the folder of temporary files"


def _raised(kind: type[Exception], call: Callable[[], object]) -> str:
    """Message of the exception that a call raises; it must be of this kind."""
    try:
        call()
    except kind as error:
        return str(error)
    raise AssertionError(f"{kind.__name__} was not raised")


_runs: dict[tuple[Any, ...], Run] = {}
