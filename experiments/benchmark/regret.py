"""Regret of runs: best cost above the best known one, in volts or in the problem's own scale."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from experiments.benchmark.problem import Problem
from experiments.benchmark.run_files import RunResult
from experiments.benchmark.suite import problem
from inkjet_env.typing import Real

RANDOM_POINTS, RANDOM_DRAWS = 50, 200


def best_known_cost(name: str) -> float:
    """Best known cost of a problem of the suite, in volts; ``ValueError`` where none is on record."""
    known = problem(name).best_known
    if known is None:
        raise ValueError(
            f"problem {name!r} has no best known cost on record. "
            f"Run: python -m experiments.benchmark.studies.search_best_known --problem {name}"
        )
    return known.cost


def final_regrets(results: Sequence[RunResult]) -> dict[str, dict[str, Real]]:
    """Final best cost − best known cost in volts: by optimiser and problem, one value a run, in the runs' order."""
    found: dict[str, dict[str, list[float]]] = {}
    for result in results:
        regret = float(result.costs_V[-1]) - best_known_cost(result.key.problem)
        found.setdefault(result.key.optimizer, {}).setdefault(result.key.problem, []).append(regret)
    return {
        optimizer: {name: np.array(values) for name, values in by_problem.items()}
        for optimizer, by_problem in found.items()
    }


def regret_quartiles(results: Sequence[RunResult], evaluations: ArrayLike) -> Real:
    """Quartiles over runs of the regret of what is kept, shape (3, n), in volts, after so many ``evaluations`` each."""
    curves = [result.kept_V(evaluations) - best_known_cost(result.key.problem) for result in results]
    return np.percentile(curves, [25, 50, 75], axis=0)


@functools.cache
def scale_V(name: str) -> float:
    """Mean regret of the best of 50 random waveforms on a problem, in volts."""
    return best_of_random_V(problem(name)) - best_known_cost(name)


def best_of_random_V(of: Problem) -> float:
    """Mean cost of the best of 50 random waveforms, in volts."""
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (RANDOM_DRAWS * RANDOM_POINTS, 7))
    costs = of.evaluate(points).reshape(RANDOM_DRAWS, RANDOM_POINTS)
    return float(costs.min(axis=1).mean())
