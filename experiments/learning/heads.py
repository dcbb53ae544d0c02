"""Heads as the environment draws them, side by side: what learning over heads is trained and tested on."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkjet_env.envs.task import WaveformTask, make_task
from inkjet_env.typing import Real

TEST_SEED, TRAIN_SEED = 10**12, 10_000
"""What is learnt from is drawn from seeds far below what is tested on."""
POINTS_A_START = 100
"""Uniform points for each descent, which begins from one of the best of all."""


@functools.cache
def the_task() -> WaveformTask:
    """Heads as the environment draws them with ``context="random"``."""
    return make_task(context="random")


def drawn(count: int, seed: int) -> NDArray[np.float32]:
    """Observations of heads, shape (count, 4), drawn as environments draw them, each from its number and the seed."""
    return the_task().contexts([np.random.default_rng([seed, k]) for k in range(count)])


def stretched(points: Real, made_for: ArrayLike, observations: ArrayLike) -> Real:
    """Points (n, 7) for other heads than they were made for: their durations stretched as the resonance's period is.

    A head of another period alone answers with the same peaks, all higher or lower by that ratio: damping ratios count
    periods, hysteresis knows no time, and b1 is per second.

    Parameters
    ----------
    points : ndarray, shape (n, 7)
        In ``[-1, 1]``; so is what is returned, cut to the box.
    made_for, observations : array_like, shape (n, 4)
        The heads that they were made for, and those that they are wanted for.
    """
    task = the_task()
    waveforms = task.bounds.from_unit(points)
    periods = task.head_values(made_for)[:, :1] / task.head_values(observations)[:, :1]
    waveforms[:, 2:] *= periods
    cut: Real = np.clip(task.bounds.to_unit(waveforms), -1.0, 1.0)
    return cut


@dataclass(frozen=True, eq=False)
class Heads:
    """Heads side by side: row k of points belongs to head k.

    Parameters
    ----------
    observations : ndarray, shape (n, 4)
    """

    observations: NDArray[np.float32]

    @functools.cached_property
    def rows(self) -> Real:
        """For the compiled simulator."""
        return the_task().heads(self.observations)

    def evaluate(self, points: Real) -> Real:
        """Costs in volts, shape (n,), of points (n, 7) in ``[-1, 1]``."""
        from inkjet_env.printhead import batch

        return batch.costs(the_task().bounds.from_unit(points), self.rows)

    def evaluate_with_gradient(self, points: Real) -> tuple[Real, Real]:
        """The same, with gradients by the points, shape (n, 7)."""
        from inkjet_env.printhead import batch

        bounds = the_task().bounds
        costs, gradients = batch.costs_and_gradients(bounds.from_unit(points), self.rows)
        return costs, gradients * bounds.half_width

    def one(self, k: int) -> OneHead:
        """Head k as a problem of its own."""
        return OneHead(self.observations[k : k + 1])


class OneHead(Heads):
    """One head, any number of points."""


def descended(head: OneHead, starts: int, seed: int) -> tuple[Real, float, int]:
    """Best end of L-BFGS-B from the best of many uniform points on one head: point, cost in volts, evaluations.

    From any point it mostly ends at firing nothing, which costs nothing and has no slope.
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
