"""Particle swarms: the standard one, and the one printed in the paper."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from inkjet_env.optimizers.base import Optimizer, checked_count
from inkjet_env.typing import Real


class ParticleSwarm(Optimizer):
    """Particle swarm with random factors and a global best, in constriction form.

    The update is Eq. (10) of docs/explanation/model.md with random factors::

        v ← c1 v + c2 r2 (pbest − x) + c3 r3 (gbest − x),   x ← x + v        (10)

    r2 and r3 are uniform on [0, 1] and drawn for every particle, coordinate and generation; all particles move before
    any best is updated. Initial positions are uniform in the box, initial velocities half the distance to another
    uniform point. Kennedy & Eberhart, Proc. ICNN 1995; the constriction coefficients c1 = 0.7298, c2 = c3 = 1.49618
    are those of Clerc & Kennedy, IEEE Trans. Evol. Comput. 6 (2002) 58. A particle that would leave the box stops at
    its wall: that coordinate is set to the bound and its velocity to zero, as in the Standard PSO of 2007 (Clerc, HAL
    hal-00764996, 2012).

    Where costs come in any order, each particle moves as soon as its own cost is there, towards the best that is known
    then: Koh et al., Int. J. Numer. Meth. Eng. 67 (2006) 578.

    Parameters
    ----------
    dimension, budget, seed : int
        See `Optimizer`.
    particles : int
        Size of the swarm, at least 1; 40 by default, so that a budget of 2,000 gives 50 generations.
    c1, c2, c3 : float
        Inertia, and the attraction to the particle's own best and to the swarm's best.

    Raises
    ------
    ValueError
        No particle, or a coefficient that is not a finite number.
    """

    name = "pso"
    in_any_order = True

    def __init__(
        self,
        dimension: int,
        budget: int,
        seed: int,
        *,
        particles: int = 40,
        c1: float = 0.7298,
        c2: float = 1.49618,
        c3: float = 1.49618,
    ) -> None:
        super().__init__(dimension, budget, seed)
        for label, value in (("c1", c1), ("c2", c2), ("c3", c3)):
            if not (isinstance(value, (int, float)) and math.isfinite(value)):
                raise ValueError(f"{label} must be a finite number; got {value!r}.")
        self._coefficients = c1, c2, c3
        shape = (checked_count("particles", particles), self.dimension)
        self._x = self.rng.uniform(-1.0, 1.0, shape)
        self._v = (self.rng.uniform(-1.0, 1.0, shape) - self._x) / 2
        self._best_x = self._x.copy()
        self._best_cost = np.full(shape[0], math.inf)
        self._ready = list(range(shape[0]))
        self._under_way: list[int] = []

    def propose(self) -> Real:
        """The whole swarm."""
        return self._x

    def learn(self, points: Real, costs: Real, gradients: Real | None) -> None:
        """Update the bests, then move every particle."""
        self._move(np.arange(len(costs)), costs)

    def _move(self, of: Any, costs: Real) -> None:
        """Update the bests of some particles with the costs at their places, then move them."""
        better = costs < self._best_cost[of]
        self._best_x[of[better]], self._best_cost[of[better]] = self._x[of[better]], costs[better]
        swarm_best = self._best_x[np.argmin(self._best_cost)]
        c1, c2, c3 = self._coefficients
        r2, r3 = self._factors(len(of))
        x = self._x[of]
        v = c1 * self._v[of] + c2 * r2 * (self._best_x[of] - x) + c3 * r3 * (swarm_best - x)  # Eq. (10)
        moved = x + v
        self._x[of] = np.clip(moved, -1.0, 1.0)
        v[moved != self._x[of]] = 0.0
        self._v[of] = v

    def propose_another(self) -> Real | None:
        """The place of the next particle that has moved."""
        if not self._ready:
            return None
        self._under_way.append(self._ready.pop(0))
        return self._x[self._under_way[-1]].copy()

    def learn_another(self, point: Real, cost: float) -> None:
        """Move the particle that is there."""
        k = next(k for k in self._under_way if np.array_equal(self._x[k], point))
        self._under_way.remove(k)
        self._move(np.array([k]), np.array([cost]))
        self._ready.append(k)

    def _factors(self, count: int) -> Any:
        return self.rng.random((2, count, self.dimension))


class PrintedParticleSwarm(ParticleSwarm):
    """The particle swarm as printed in Zhu et al. (Micromachines 15, 2024, 1192), without random factors.

    The update is Eq. (10) of docs/explanation/model.md::

        v ← c1 v + c2 (pbest − x) + c3 (gbest − x),   x ← x + v        (10)

    Start and walls are those of `ParticleSwarm`; only the initial positions and velocities are random, every later move
    is deterministic. The paper prints neither c1, c2, c3 nor the population. Here c1 = 0.7298 and c2 = c3 = 0.74809:
    the usual coefficients with the random factors at their mean of one half, so that the two swarms differ only in
    the randomness. (With c2 = c3 = 1.49618 and no factors, a particle would overshoot a fixed best threefold.)
    """

    name = "pso-printed"

    def __init__(
        self,
        dimension: int,
        budget: int,
        seed: int,
        *,
        particles: int = 40,
        c1: float = 0.7298,
        c2: float = 1.49618 / 2,
        c3: float = 1.49618 / 2,
    ) -> None:
        super().__init__(dimension, budget, seed, particles=particles, c1=c1, c2=c2, c3=c3)

    def _factors(self, count: int) -> Any:
        return 1.0, 1.0
