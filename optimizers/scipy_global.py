"""Global optimisers from SciPy."""

from __future__ import annotations

from typing import Any

from scipy import optimize

from inkjet_env.optimizers.base import checked_count
from inkjet_env.optimizers.callback import CallbackOptimizer
from inkjet_env.typing import Real

ENDLESS = 10**9


class _ScipyOptimizer(CallbackOptimizer):
    def _cost(self, point: Real) -> float:
        return float(self.evaluate(point[None, :])[0])

    def _box(self) -> list[tuple[float, float]]:
        return [(-1.0, 1.0)] * self.dimension


class DifferentialEvolution(_ScipyOptimizer):
    """Differential evolution with `scipy.optimize.differential_evolution`, one generation at a time.

    Storn & Price, J. Global Optim. 11 (1997) 341. SciPy's defaults (best1bin, 15 individuals per dimension, Latin
    hypercube start), with two exceptions: a whole generation is evaluated together (``updating="deferred"``), and the
    search continues until all costs are equal, then starts again. By default SciPy would stop when the costs differ by
    1 % of their mean (``tol=0.01``) and finish with a finite-difference descent (``polish=True``). Both are off: the
    tolerance without the descent would leave every search one per cent short.

    Parameters
    ----------
    dimension, budget, seed : int
        See `Optimizer`.
    individuals_per_dimension : int
        SciPy's ``popsize``.
    mutation : float or (float, float)
        Weight of a difference, below 2; for a pair, a value between the two is drawn for each generation.
    recombination : float
        Probability that a coordinate comes from the mutant.
    """

    name = "scipy-differential-evolution"

    def __init__(
        self,
        dimension: int,
        budget: int,
        seed: int,
        *,
        individuals_per_dimension: int = 15,
        mutation: float | tuple[float, float] = (0.5, 1.0),
        recombination: float = 0.7,
    ) -> None:
        super().__init__(dimension, budget, seed)
        self._individuals = checked_count("individuals_per_dimension", individuals_per_dimension)
        self._mutation, self._recombination = mutation, recombination

    def search(self) -> None:
        """Run until the whole population has the same cost."""
        optimize.differential_evolution(
            lambda columns: self.evaluate(columns.T),
            self._box(),
            popsize=self._individuals,
            mutation=self._mutation,
            recombination=self._recombination,
            maxiter=ENDLESS,
            rng=self.rng,
            tol=0.0,
            polish=False,
            vectorized=True,
            updating="deferred",
        )


class DualAnnealing(_ScipyOptimizer):
    """Generalised simulated annealing with local searches: `scipy.optimize.dual_annealing` with default settings.

    Xiang et al., Phys. Lett. A 233 (1997) 216. Its local searches are L-BFGS-B with finite differences; each
    difference costs one evaluation. It ends after SciPy's 1,000 iterations and starts again.
    """

    name = "scipy-dual-annealing"

    def search(self) -> None:
        """Run SciPy's 1,000 iterations."""
        optimize.dual_annealing(self._cost, self._box(), maxfun=ENDLESS, rng=self.rng)


class Direct(_ScipyOptimizer):
    """Dividing rectangles (`scipy.optimize.direct`); it uses no random numbers, so every seed gives the same run.

    Jones, Perttunen & Stuckman, J. Optim. Theory Appl. 79 (1993) 157; by default the locally biased variant of
    Gablonsky & Kelley, J. Global Optim. 21 (2001) 27, as in SciPy. SciPy's volume and length tolerances are set to
    zero, so that it uses the whole budget. If it still ends (its rectangles cannot be divided further), it starts
    again with the other of the two rules.
    """

    name = "scipy-direct"

    def __init__(self, dimension: int, budget: int, seed: int, *, locally_biased: bool = True) -> None:
        super().__init__(dimension, budget, seed)
        self._locally_biased = bool(locally_biased)

    def search(self) -> None:
        """Divide rectangles until SciPy stops."""
        limits: dict[str, Any] = {"maxfun": self.budget, "maxiter": self.budget, "vol_tol": 0.0, "len_tol": 0.0}
        optimize.direct(self._cost, self._box(), locally_biased=self._locally_biased, **limits)
        self._locally_biased = not self._locally_biased
