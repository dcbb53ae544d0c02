"""Problems for IOHprofiler's ``ioh``, whose loggers write what its analyser reads."""

from __future__ import annotations

from typing import Any

import ioh

from inkjet_env.experiments.benchmark.interfaces.objective import DIMENSION, Objective
from inkjet_env.experiments.benchmark.problem import Problem


def real_problem(problem: str | Problem, seed: int = 0) -> Any:
    """A problem over ``[-1, 1]⁷`` as ``ioh.problem.RealSingleObjective``; its optimum is the best known cost.

    Parameters
    ----------
    problem : str or Problem
        A problem, or the name of one.
    seed : int
        Seed of the reading errors, see `Objective`.
    """
    objective = Objective(problem, seed)
    point, cost_V = objective.best_known_point, objective.best_known_V
    optimum: Any = None if point is None else (lambda *_: (point, cost_V))
    return ioh.wrap_problem(
        objective, objective.name, ioh.ProblemClass.REAL, DIMENSION, lb=-1.0, ub=1.0, calculate_objective=optimum
    )
