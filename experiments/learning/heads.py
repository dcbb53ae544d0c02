"""Heads as the environment draws them, evaluated in parallel, for training and testing."""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkjet_env.envs.task import WaveformTask, make_task
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.head_ensemble import HeadEnsemble
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

TEST_SEED, TRAIN_SEED = 10**12, 10_000
"""First seeds of the test heads and of the training heads; they are far apart, so that the two never share a head."""
POINTS_A_START = 100
"""Number of uniform points per descent; the descents start from the best of them all."""


PARAMETERS = 4
"""Number of parameters of a head."""


@functools.cache
def the_task() -> WaveformTask:
    """The environment's task with randomly drawn heads, ``context="random"``."""
    return make_task(context="random")


def drawn(count: int, seed: int) -> NDArray[np.float32]:
    """Observations of heads, shape (count, 4), drawn as the environments do, each from the seed and its number."""
    return the_task().contexts([np.random.default_rng([seed, k]) for k in range(count)])


def heads_with_effects(count: int, seed: int) -> tuple[HeadEnsemble, Real]:
    """Heads with one effect each, of the catalogue in turn, and their parameters as observations, shape (count, 4)."""
    parameters = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, PARAMETERS))
    heads = []
    for one, effect in zip(parameters, itertools.cycle(catalogue()), strict=False):
        base = the_task().head(one)
        assert isinstance(base, Printhead)
        heads.append(AugmentedPrinthead(base, ((effect, effect.example_values(base)),)))
    return HeadEnsemble(tuple(heads), (1.0,) * count), parameters


def stretched(points: Real, made_for: ArrayLike, observations: ArrayLike) -> Real:
    """Points adapted to other heads: their durations are scaled by the ratio of the resonance periods, shape (n, 7).

    A head that differs only in its period responds with the same peaks, all scaled by that ratio: the damping ratio is
    per period, the hysteresis is rate-independent, and b1 is per second.

    Parameters
    ----------
    points : ndarray, shape (n, 7)
        Points in ``[-1, 1]``; the result is clipped to the same box.
    made_for, observations : array_like, shape (n, 4)
        Observations of the heads for which the points were made, and of those for which they are adapted.
    """
    task = the_task()
    waveforms = task.bounds.from_unit(points)
    periods = task.head_values(made_for)[:, :1] / task.head_values(observations)[:, :1]
    waveforms[:, 2:] *= periods
    cut: Real = np.clip(task.bounds.to_unit(waveforms), -1.0, 1.0)
    return cut


@dataclass(frozen=True, eq=False)
class Heads:
    """Heads evaluated in parallel: row k of the points belongs to head k.

    Parameters
    ----------
    observations : ndarray, shape (n, 4)
        The heads as the environment shows them: four numbers in ``[-1, 1]`` each.
    """

    observations: NDArray[np.float32]

    @functools.cached_property
    def rows(self) -> Real:
        """The heads in the form of the compiled simulator."""
        return the_task().heads(self.observations)

    def evaluate(self, points: Real) -> Real:
        """Costs in volts, shape (n,), of points in ``[-1, 1]``, shape (n, 7); a point outside is clipped to the box."""
        from inkjet_env.printhead import batch

        return batch.costs(the_task().bounds.from_unit(points), self.rows)

    def evaluate_with_gradient(self, points: Real) -> tuple[Real, Real]:
        """Costs in volts, shape (n,), and their gradients in volts per unit of the box, shape (n, 7).

        In a clipped coordinate the gradient is zero.
        """
        from inkjet_env.printhead import batch

        bounds = the_task().bounds
        costs, gradients = batch.costs_and_gradients(bounds.from_unit(points), self.rows)
        return costs, gradients * bounds.slope(points)

    def one(self, k: int) -> OneHead:
        """Head k as a separate problem."""
        return OneHead(self.observations[k : k + 1])


class OneHead(Heads):
    """One head, for any number of points."""


def descended(head: OneHead, starts: int, seed: int) -> tuple[Real, float, int]:
    """Best end point of L-BFGS-B on one head, started from the best uniform points: point, cost in volts, evaluations.

    From an arbitrary point it mostly ends at the zero waveform, whose cost and gradient are zero.
    """
    from scipy.optimize import minimize

    def value_and_slope(point: Real) -> tuple[float, Real]:
        costs, gradients = head.evaluate_with_gradient(point[None, :])
        return float(costs[0]), gradients[0]

    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (POINTS_A_START * starts, 7))
    best, cost, spent = np.zeros(7), math.inf, len(points)
    for start in points[np.argsort(head.evaluate(points))[:starts]]:
        end = minimize(value_and_slope, start, jac=True, method="L-BFGS-B", bounds=[(-1.0, 1.0)] * 7)
        spent += int(end.nfev)
        if end.fun < cost:
            best, cost = np.clip(end.x, -1.0, 1.0), float(end.fun)
    return best, cost, spent
