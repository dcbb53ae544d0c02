"""Output-error fit of every recording at once: separable least squares on free-run simulation.

Given the resonator ``(a0, a1)`` and the gains of the channels relative to the first, the model is linear in the
coefficients of the branch law, the offsets and the free initial states. So Gauss–Newton steps run in ``ln a0``,
``ln a1`` and the gain ratios, with everything linear solved for at each of them (Golub and Pereyra's variable
projection in Ruhe and Wedin's form). Each recording is first reduced to a small triangle; the remaining work is
negligible. The objective is Eq. (1) of docs/explanation/identification.md:

    χ²(θ) = Σ_j |W_j (y_j - ŷ_j(θ))|²                                                               (1)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from inkjet_env.identification.covariance import Solution, solution_of
from inkjet_env.identification.linearised import Linearised
from inkjet_env.identification.model import Fitted, Model
from inkjet_env.typing import Real

MOST_STEPS = 60
"""Largest number of Gauss–Newton steps."""
CONVERGED = 1e-4
"""Promised decrease of χ² below which the fit has converged."""
LARGEST_STEP = 0.5
"""Largest change of ln a0 or ln a1 in one step."""


def fit_everything(
    fitted: Sequence[Fitted],
    start: Model,
    constraints: Real | None = None,
    coloured: Collection[str] = (),
    passed: Callable[[float], None] = lambda _: None,
) -> Solution:
    """Least squares over all parameters together.

    Parameters
    ----------
    fitted : sequence of Fitted
        Recordings with bases of one degree.
    start : Model
        Starting values of ``a0``, ``a1`` and the ratios, and of the weights where the first step needs them.
    constraints : ndarray, shape (k, d), optional
        Rows with ``constraints @ weights ≥ 0``, or ``≤ 0`` if the gain of the first channel is negative.
    coloured : collection of str
        Channels whose whitened residual is not white, so that its spectrum must enter the covariance.
    passed : callable, optional
        Told the share of a pass over the recordings that is finished, after each; a Gauss–Newton step takes two passes
        or more.

    Returns
    -------
    Solution
        The model at the minimum, with its covariance.
    """
    problem = Linearised(fitted, constraints, passed)
    model = start
    blocks = problem.blocks(model)
    objective, model = _best_linear(problem, blocks, model)
    converged = False
    for _ in range(MOST_STEPS):
        blocks = problem.blocks(model)
        step = _step(problem, blocks, model)
        if step.promise < CONVERGED:
            converged = True
            break
        fraction = min(1.0, LARGEST_STEP / max(1e-300, float(np.abs(step.logarithms).max(initial=0.0))))
        for _ in range(12):
            trial = _moved(problem, model, step, fraction)
            if trial is not None:
                value, trial = _best_linear(problem, problem.blocks(trial, slopes=False), trial)
                if value <= objective:
                    break
            fraction /= 2
        else:
            converged = step.promise < 1e3 * CONVERGED  # rounding limits the last digits
            break
        objective, model = value, trial
    return solution_of(problem, model, converged, coloured)


@dataclass(frozen=True, eq=False)
class _Step:
    """Changes of ``ln a0`` and ``ln a1``, of the ratios except the first, and the promised decrease of χ²."""

    logarithms: Real
    ratios: Real
    promise: float


def _best_linear(problem: Linearised, blocks: Sequence[Real], model: Model) -> tuple[float, Model]:
    """χ² at the best weights and offsets, and the model with them."""
    matrix, target = problem.stacked(blocks, model, nonlinear=False)
    solution, _ = problem.solve(matrix, target)
    offsets = dict(zip(problem.channels, solution[problem.degree :].tolist(), strict=True))
    objective = float(np.sum((target - matrix @ solution) ** 2))  # Eq. (1)
    return objective, replace(model, weights=solution[: problem.degree], offsets=offsets)


def _step(problem: Linearised, blocks: Sequence[Real], model: Model) -> _Step:
    """Gauss–Newton step from a model."""
    matrix, target = problem.stacked(blocks, model, nonlinear=True)
    solution, _ = problem.solve(matrix, target)
    now = np.sum(problem.residuals(blocks, model) ** 2)
    promise = float(now - np.sum((target - matrix @ solution) ** 2))
    d, moving = problem.degree, 2 * problem.moving
    return _Step(solution[d : d + moving], solution[d + moving :][: len(problem.channels) - 1], promise)


def _moved(problem: Linearised, model: Model, step: _Step, fraction: float) -> Model | None:
    """Model after a fraction of a step; None if its resonator is not a damped oscillation."""
    a0, a1 = model.a0, model.a1
    if problem.moving:
        a0, a1 = (np.array([a0, a1]) * np.exp(fraction * step.logarithms)).tolist()
        if not 2e-6 * math.sqrt(a0) <= a1 < 1.999 * math.sqrt(a0):
            return None
    ratios = {
        channel: model.ratios[channel] + (fraction * float(step.ratios[i - 1]) if i else 0.0)
        for i, channel in enumerate(problem.channels)
    }
    return replace(model, a0=a0, a1=a1, ratios=ratios)
