"""Regret of runs: best cost minus the best known cost, in volts or in the problem's own scale.

In the problem's scale the regret is Eq. (1) of docs/explanation/statistics.md::

    ρ = (J − J*) / s,   s = E[min of 50 random waveforms' costs] − J*        (1)

with the cost J of the waveform kept, the best known cost J* and the scale s, all in volts.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.benchmark.run_files import RunResult
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.typing import Real

RANDOM_POINTS, RANDOM_DRAWS = 50, 200


def best_known_cost(name: str) -> float:
    """Best known cost of a problem, in volts; ``ValueError`` if none is on record."""
    known = problem(name).best_known
    if known is None:
        raise ValueError(
            f"problem {name!r} has no best known cost on record, from which regrets are counted. "
            f"Run: python -m inkjet_env.experiments.benchmark.studies.search_best_known --problem {name}"
        )
    return known.cost


def regrets_V(runs: Sequence[RunResult], evaluations: ArrayLike) -> Real:
    """True cost of each run's best waveform after ``evaluations``, minus the best known cost, in volts.

    Parameters
    ----------
    runs : sequence of RunResult
        Runs on problems with a best known cost.
    evaluations : array_like of int, any shape
        Numbers of evaluations, at most a run's budget.

    Returns
    -------
    ndarray, shape (runs, *evaluations.shape)
        Regrets in volts.
    """
    return np.array([run.kept_V(evaluations) - best_known_cost(run.key.problem) for run in runs])  # J − J* of Eq. (1)


def regret_quartiles_V(runs: Sequence[RunResult], evaluations: ArrayLike) -> Real:
    """Quartiles over the runs of `regrets_V`, shape (3, *evaluations.shape), in volts."""
    return np.percentile(regrets_V(runs, evaluations), [25, 50, 75], axis=0)


@functools.cache
def scale_V(name: str) -> float:
    """Mean regret of the best of 50 random waveforms on a problem, in volts: the scale s of Eq. (1)."""
    return best_of_random_V(problem(name)) - best_known_cost(name)  # s of Eq. (1)


def best_of_random_V(of: Problem) -> float:
    """Mean cost of the best of 50 random waveforms, in volts."""
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (RANDOM_DRAWS * RANDOM_POINTS, 7))
    costs = of.evaluate(points).reshape(RANDOM_DRAWS, RANDOM_POINTS)
    return float(costs.min(axis=1).mean())
