"""Whether recorded costs are those of their waveforms."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.typing import Real

BESIDE = 1e-12
"""Distance within the box at which a recorded cost may be right instead: a point that an optimiser has driven to a jump
of the cost lies on one side or the other by the last bits of the simulation, which differ between processors and
compilations."""


def first_other_cost(
    problem: Problem,
    points: Real,
    recorded_V: Real,
    seed: int,
    evaluations: NDArray[np.int64] | None = None,
    true_V: Real | None = None,
) -> str:
    """The first recorded cost that a run with that seed would not report for its point, in words; empty if none.

    Parameters
    ----------
    problem : Problem
        Problem of the run.
    points : ndarray, shape (n, 7)
        Evaluated points in ``[-1, 1]``.
    recorded_V : ndarray, shape (n,)
        Reported costs, in volts.
    seed : int
        Seed of the run.
    evaluations : ndarray of int, shape (n,), optional
        Number of each evaluation, from 1; consecutive from 1 unless given.
    true_V : ndarray, shape (n,), optional
        True costs of the points in volts, where they are known already; used with ``evaluations`` alone.
    """
    if evaluations is None:
        counts, again = np.arange(1, len(recorded_V) + 1), problem.read(points, seed)
    elif problem.measurement_noise_V:
        counts = evaluations
        again = np.array([problem.read(x, seed, int(k) - 1)[0] for x, k in zip(points, counts, strict=True)])
    else:
        counts, again = evaluations, problem.evaluate(points) if true_V is None else true_V
    return first_other(again, recorded_V, points, counts, lambda x, k: problem.read(x, seed, k - 1))


def first_other(
    again: Real, costs: Real, points: Real, evaluations: NDArray[np.int64], measured: Callable[[Real, int], Real]
) -> str:
    """The first of the recorded costs that is neither the one computed again nor one right beside its point."""
    corners = np.array(list(itertools.product((-BESIDE, BESIDE), repeat=points.shape[1])))
    for i in np.flatnonzero(~np.isclose(again, costs, rtol=1e-9, atol=1e-9)):
        beside = np.clip(points[i] + corners, -1.0, 1.0)
        if not any(np.isclose(measured(x[None], int(evaluations[i])), costs[i], rtol=1e-9, atol=1e-9) for x in beside):
            return f"evaluation {evaluations[i]} costs {again[i]:.9g} V here, not the {costs[i]:.9g} V it records"
    return ""
