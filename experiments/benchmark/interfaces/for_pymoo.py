"""Problems for pymoo's algorithms."""

from __future__ import annotations

from typing import Any

import numpy as np
from pymoo.core.problem import Problem as _Problem

from inkjet_env.experiments.benchmark.interfaces.objective import DIMENSION, Objective
from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.typing import Real


class PymooProblem(_Problem):
    """A problem over ``[-1, 1]⁷`` whose cost in volts is minimised; a generation is evaluated in one call.

    Parameters
    ----------
    problem : str or Problem
        A problem, or the name of one.
    seed : int
        Seed of the reading errors, see `Objective`.
    """

    def __init__(self, problem: str | Problem, seed: int = 0) -> None:
        self.objective = Objective(problem, seed)
        super().__init__(n_var=DIMENSION, n_obj=1, xl=-1.0, xu=1.0)

    def _evaluate(self, x: Real, out: dict[str, Any], *_: Any, **__: Any) -> None:
        out["F"] = self.objective.batch(x)[:, None]

    def _calc_pareto_set(self, *_: Any, **__: Any) -> Real | None:
        best = self.objective.best_known_point
        return None if best is None else best[None, :]

    def _calc_pareto_front(self, *_: Any, **__: Any) -> Real | None:
        best_V = self.objective.best_known_V
        return None if best_V is None else np.array([[best_V]])
