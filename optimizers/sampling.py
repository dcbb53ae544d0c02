"""Sampling without learning: the baseline that any optimiser should beat."""

from __future__ import annotations

from inkjet_env.optimizers.base import Optimizer
from inkjet_env.typing import Real

BATCH = 64


class Random(Optimizer):
    """Points drawn uniformly and independently: Bergstra & Bengio, J. Mach. Learn. Res. 13 (2012) 281."""

    name = "random"
    in_any_order = True

    def propose(self) -> Real:
        """The next random points."""
        return self.rng.uniform(-1.0, 1.0, (BATCH, self.dimension))

    def learn(self, points: Real, costs: Real, gradients: Real | None) -> None:
        """Do nothing: the search does not learn."""

    def propose_another(self) -> Real:
        """The next random point."""
        return self.rng.uniform(-1.0, 1.0, self.dimension)

    def learn_another(self, point: Real, cost: float) -> None:
        """Do nothing: the search does not learn."""


class Sobol(Optimizer):
    """A scrambled Sobol sequence from `scipy.stats.qmc.Sobol` (Joe & Kuo 2008; scrambling after Matoušek 1998)."""

    name = "sobol"
    in_any_order = True

    def __init__(self, dimension: int, budget: int, seed: int) -> None:
        from scipy.stats import qmc

        super().__init__(dimension, budget, seed)
        self._sequence = qmc.Sobol(self.dimension, rng=self.rng)

    def propose(self) -> Real:
        """The next points of the sequence; a batch is a power of two, which keeps the sequence balanced."""
        return 2.0 * self._sequence.random(BATCH) - 1.0

    def learn(self, points: Real, costs: Real, gradients: Real | None) -> None:
        """Do nothing: the search does not learn."""

    def propose_another(self) -> Real:
        """The next point of the sequence."""
        return 2.0 * self._sequence.random(1)[0] - 1.0

    def learn_another(self, point: Real, cost: float) -> None:
        """Do nothing: the search does not learn."""
