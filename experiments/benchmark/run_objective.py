"""The objective of one run of the comparison; its failures are reported separately from its optimiser's."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from inkjet_env.experiments.benchmark.run_files import RunKey
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.typing import Real


class ObjectiveFailedError(RuntimeError):
    """A problem's objective failed, which is not the optimiser's fault; the message names problem, seed and point."""


class RunObjective:
    """The objective of a run; any exception it raises becomes an `ObjectiveFailedError`.

    Parameters
    ----------
    key : RunKey
        The run: its problem is evaluated; optimiser and repeat are named in error messages.
    seed : int
        Seed of the run.
    """

    def __init__(self, key: RunKey, seed: int) -> None:
        self.key, self.seed = key, seed
        self.count = 0
        asked = problem(key.problem)
        measured = asked.as_measured(seed)
        self.evaluate = self._watched(measured, "evaluate")
        if asked.has_gradient:
            self.evaluate_with_gradient = self._watched(measured, "evaluate_with_gradient")

    def failed(self, how: str) -> ObjectiveFailedError:
        """The exception that describes how the objective failed in this run."""
        key = self.key
        return ObjectiveFailedError(
            f"the objective of {key.problem} failed, in repeat {key.repeat} of {key.optimizer}, seed {self.seed}: {how}"
        )

    def _watched(self, measured: Any, name: str) -> Callable[[Real], Any]:
        def call(points: Real) -> Any:
            try:
                found = getattr(measured, name)(points)
            except Exception as error:
                where = self._first_failure(name, points)
                raise self.failed(f"{type(error).__name__}: {error} at {where}") from error
            self.count += len(points)
            return found

        return call

    def _first_failure(self, name: str, points: Real) -> str:
        """The first point at which the objective fails on its own; all points if it fails at none of them alone."""
        for k, point in enumerate(points):
            alone = problem(self.key.problem).as_measured(self.seed, self.count + k)
            try:
                getattr(alone, name)(point[None])
            except Exception:
                return f"evaluation {self.count + k + 1}, point {point.tolist()}"
        return f"evaluation {self.count + 1}, points {points.tolist()}"
