"""SciPy's global optimisers."""

from __future__ import annotations

from typing import Any

from scipy import optimize

from optimizers.base import Real, checked_count
from optimizers.callback import CallbackOptimizer

ENDLESS = 10**9


class _ScipyOptimizer(CallbackOptimizer):
    def _cost(self, point: Real) -> float:
        return float(self.evaluate(point[None, :])[0])

    def _box(self) -> list[tuple[float, float]]:
        return [(-1.0, 1.0)] * self.dimension


class DifferentialEvolution(_ScipyOptimizer):
    """Differential evolution, by `scipy.optimize.differential_evolution`, a generation at a time.

    Storn & Price, J. Global Optim. 11 (1997) 341. SciPy's defaults (best1bin, 15 individuals a dimension, Latin
    hypercube start), except that a whole generation is evaluated side by side (``updating="deferred"``), and that it
    goes on until the population is one point, then begins anew. SciPy would stop where costs differ by 1 % of their
    mean (``tol=0.01``) and leave the rest to a descent by differences (``polish=True``). Both are off: the tolerance
    without the descent would leave every search a per cent short.

    Parameters
    ----------
    individuals_per_dimension : int
        SciPy's ``popsize``.
    mutation : float or (float, float)
        Weight of a difference, below 2; of two numbers one between them is drawn for each generation.
    recombination : float
        Chance of a coordinate to come from the mutant.
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
        """Run until all of the population have one cost."""
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
    """Generalised simulated annealing with local searches, by `scipy.optimize.dual_annealing`, at its defaults.

    Xiang et al., Phys. Lett. A 233 (1997) 216. Its local searches are L-BFGS-B on finite differences, each difference
    an evaluation. It ends after SciPy's 1,000 iterations and begins anew.
    """

    name = "scipy-dual-annealing"

    def search(self) -> None:
        """Run SciPy's 1,000 iterations."""
        optimize.dual_annealing(self._cost, self._box(), maxfun=ENDLESS, rng=self.rng)


class Direct(_ScipyOptimizer):
    """Dividing rectangles, by `scipy.optimize.direct`; it draws no random numbers, so every seed gives the same run.

    Jones, Perttunen & Stuckman, J. Optim. Theory Appl. 79 (1993) 157; by default the locally biased variant of
    Gablonsky & Kelley, J. Global Optim. 21 (2001) 27, as in SciPy. SciPy's volume and length tolerances are set to
    zero, so that it goes on for the whole budget. Where it still ends (its rectangles cannot be divided further) it
    begins again by the other of the two rules.
    """

    name = "scipy-direct"

    def __init__(self, dimension: int, budget: int, seed: int, *, locally_biased: bool = True) -> None:
        super().__init__(dimension, budget, seed)
        self._locally_biased = bool(locally_biased)

    def search(self) -> None:
        """Divide until SciPy cannot."""
        limits: dict[str, Any] = {"maxfun": self.budget, "maxiter": self.budget, "vol_tol": 0.0, "len_tol": 0.0}
        optimize.direct(self._cost, self._box(), locally_biased=self._locally_biased, **limits)
        self._locally_biased = not self._locally_biased
