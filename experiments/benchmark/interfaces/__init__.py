"""The problems of the suite as other libraries take them: plain functions, SciPy, pymoo, Optuna, IOHprofiler, COCO."""

from __future__ import annotations

from typing import Any

from inkjet_env.experiments.benchmark.interfaces.objective import Objective
from inkjet_env.extras import extra

__all__ = ["Objective", "ioh_problem", "optuna_problem", "pymoo_problem"]


def pymoo_problem(problem: Any, seed: int = 0) -> Any:
    """A problem as a ``pymoo.core.problem.Problem`` over ``[-1, 1]⁷``; see `for_pymoo.PymooProblem`."""
    with extra("a problem for pymoo"):
        from inkjet_env.experiments.benchmark.interfaces.for_pymoo import PymooProblem
    return PymooProblem(problem, seed)


def optuna_problem(problem: Any, seed: int = 0) -> Any:
    """A problem with the interface of OptunaHub's ``BaseProblem``; see `for_optuna.OptunaProblem`."""
    with extra("a problem for Optuna"):
        from inkjet_env.experiments.benchmark.interfaces.for_optuna import OptunaProblem
    return OptunaProblem(problem, seed)


def ioh_problem(problem: Any, seed: int = 0) -> Any:
    """A problem as a real-valued problem of IOHprofiler's ``ioh``; see `for_ioh.real_problem`."""
    with extra("a problem for ioh"):
        from inkjet_env.experiments.benchmark.interfaces.for_ioh import real_problem
    return real_problem(problem, seed)
