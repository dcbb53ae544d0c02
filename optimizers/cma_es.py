"""CMA-ES, by pycma."""

from __future__ import annotations

from collections.abc import Sequence

import cma
import numpy as np

from inkjet_env.optimizers.base import Optimizer, checked_count
from inkjet_env.typing import Real

STEP = 0.5
"""Initial step size of a search from a random start, in half widths of the box."""


class CmaEs(Optimizer):
    """CMA-ES with restarts of growing population (IPOP), from the package ``cma`` (pycma).

    Hansen & Ostermeier, Evol. Comput. 9 (2001) 159; restarts after Auger & Hansen, Proc. CEC 2005: when pycma's own
    criteria stop a search, the next begins elsewhere with twice the population, until the budget is spent. Starts are
    uniform in the box; the initial step size is 0.5, a quarter of the box's width. pycma's `BoundTransform` enforces
    the box; all other settings are pycma's defaults.

    Parameters
    ----------
    dimension, budget, seed : int
        See `Optimizer`; at least 2 dimensions.
    start : sequence of d floats, optional
        Start of the first search, in the box (a warm start); the later ones start at random points.
    first_step : float
        Initial step size of the first search, in half widths of the box; above 0, at most 2.
    population : int, optional
        Population of the first search, at least 2; pycma's ``4 + ⌊3 ln d⌋`` unless given.

    Raises
    ------
    ValueError
        Fewer than two dimensions, which pycma does not support, or a start outside the box.
    """

    name = "cma-es"

    def __init__(
        self,
        dimension: int,
        budget: int,
        seed: int,
        *,
        start: Sequence[float] | None = None,
        first_step: float = STEP,
        population: int | None = None,
    ) -> None:
        super().__init__(dimension, budget, seed)
        if self.dimension < 2:
            raise ValueError(f"dimension must be at least 2 for cma-es; got {dimension}.")
        self._start = None if start is None else np.array(start, dtype=np.float64)
        if self._start is not None and not (self._start.shape == (dimension,) and (np.abs(self._start) <= 1).all()):
            raise ValueError(f"start must be {dimension} numbers in [-1, 1]; got {start}.")
        if not 0 < first_step <= 2:
            raise ValueError(f"first_step must be above 0 and at most 2; got {first_step!r}.")
        self._first_step = float(first_step)
        self._population = None if population is None else checked_count("population", population, least=2)
        self._search: cma.CMAEvolutionStrategy | None = None
        self._candidates: list[Real] = []

    def _begin(self, population: int | None, first_step: float | None = None) -> cma.CMAEvolutionStrategy:
        options = {
            "bounds": [-1.0, 1.0],
            "randn": lambda *shape: self.rng.standard_normal(shape),
            "seed": np.nan,  # leaves NumPy's process-wide generator untouched
            "verbose": -10,  # silent, and does not read files in the working directory
            "verb_disp": 0,
            "verb_log": 0,
        }
        if population is not None:
            options["popsize"] = population
        start = self.rng.uniform(-1.0, 1.0, self.dimension)
        start, self._start = (self._start, None) if self._start is not None else (start, None)
        return cma.CMAEvolutionStrategy(start, first_step or STEP, options)

    def _restart(self, ended: cma.CMAEvolutionStrategy) -> cma.CMAEvolutionStrategy:
        """The next search after one that pycma's criteria or `_spent` have ended."""
        return self._begin(2 * ended.popsize)

    def _spent(self, search: cma.CMAEvolutionStrategy) -> bool:
        """Whether a search has used its share of evaluations."""
        return False

    def propose(self) -> Real:
        """One population."""
        if self._search is None:
            self._search = self._begin(self._population, self._first_step)
        elif self._search.stop() or self._spent(self._search):
            self._search = self._restart(self._search)
        self._candidates = self._search.ask()
        return np.array(self._candidates)

    def learn(self, points: Real, costs: Real, gradients: Real | None) -> None:
        """Update mean, step and covariance."""
        if self._search is not None:
            self._search.tell(self._candidates, costs.tolist())


class BipopCmaEs(CmaEs):
    """CMA-ES with two kinds of restarts (BIPOP); the kind with fewer evaluations so far goes next.

    Hansen, GECCO Companion (2009) 2389: one kind doubles the population each time. The other draws a population
    between the default and half of the largest, ``λ (λ_large / 2λ)^(U²)``, and an initial step ``10^(-2U)`` times as
    large; it gets at most half as many evaluations as the last large one. U is uniform on [0, 1]. Each search itself
    is pycma's.
    """

    name = "bipop-cma-es"

    def __init__(self, dimension: int, budget: int, seed: int) -> None:
        super().__init__(dimension, budget, seed)
        self._default: int = 0
        self._largest: int = 0
        self._large, self._small, self._last_large = 0, 0, 0
        self._now_small, self._allowed = False, self.budget

    def _restart(self, ended: cma.CMAEvolutionStrategy) -> cma.CMAEvolutionStrategy:
        used = int(ended.countevals)
        if not self._largest:  # the first search belongs to neither kind
            self._default = self._largest = int(ended.popsize)
        elif self._now_small:
            self._small += used
        else:
            self._large += used
            self._last_large = used
        self._now_small = self._small < self._large
        if not self._now_small:
            self._largest *= 2
            self._allowed = self.budget
            return self._begin(self._largest)
        between = (0.5 * self._largest / self._default) ** (self.rng.uniform() ** 2)
        self._allowed = max(1, self._last_large // 2)
        return self._begin(max(2, int(self._default * between)), STEP * 10 ** (-2 * self.rng.uniform()))

    def _spent(self, search: cma.CMAEvolutionStrategy) -> bool:
        return int(search.countevals) >= self._allowed
