"""CMA-ES, by pycma."""

from __future__ import annotations

import cma
import numpy as np

from optimizers.base import Optimizer, Real


class CmaEs(Optimizer):
    """CMA-ES with restarts of growing population (IPOP), by the package ``cma`` (pycma).

    Hansen & Ostermeier, Evol. Comput. 9 (2001) 159; restarts after Auger & Hansen, Proc. CEC 2005: when pycma's own
    criteria stop a search, the next begins elsewhere with twice the population, until the budget is spent. Starts are
    uniform in the box, the first step is 0.5, a quarter of its width. The box is kept by pycma's `BoundTransform`;
    everything else is pycma's default.

    Raises
    ------
    ValueError
        Fewer than two dimensions, which pycma does not do.
    """

    name = "cma-es"
    first_step = 0.5

    def __init__(self, dimension: int, budget: int, seed: int) -> None:
        super().__init__(dimension, budget, seed)
        if self.dimension < 2:
            raise ValueError(f"dimension must be at least 2 for cma-es; got {dimension}.")
        self._search: cma.CMAEvolutionStrategy | None = None
        self._candidates: list[Real] = []

    def _begin(self, population: int | None) -> cma.CMAEvolutionStrategy:
        options = {
            "bounds": [-1.0, 1.0],
            "randn": lambda *shape: self.rng.standard_normal(shape),
            "seed": np.nan,  # leaves NumPy's process-wide generator alone
            "verbose": -10,  # silent, and no look at files in the working directory
            "verb_disp": 0,
            "verb_log": 0,
        }
        if population is not None:
            options["popsize"] = population
        return cma.CMAEvolutionStrategy(self.rng.uniform(-1.0, 1.0, self.dimension), self.first_step, options)

    def propose(self) -> Real:
        """One population."""
        if self._search is None:
            self._search = self._begin(None)
        elif self._search.stop():
            self._search = self._begin(2 * self._search.popsize)
        self._candidates = self._search.ask()
        return np.array(self._candidates)

    def learn(self, points: Real, costs: Real, gradients: Real | None) -> None:
        """Update mean, step and covariance."""
        if self._search is not None:
            self._search.tell(self._candidates, costs.tolist())
