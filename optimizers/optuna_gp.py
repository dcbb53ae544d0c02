"""Bayesian optimisation with Optuna."""

from __future__ import annotations

import numpy as np
import optuna
from threadpoolctl import threadpool_limits

from inkjet_env.optimizers.base import Optimizer, checked_count
from inkjet_env.typing import Real


class OptunaGp(Optimizer):
    """Bayesian optimisation with a Gaussian process: Optuna's `GPSampler` with default settings, one point at a time.

    Akiba et al., KDD (2019) 2623; Jones, Schonlau & Welch, J. Global Optim. 13 (1998) 455. It starts with uniform
    points, then takes the point that maximises the logarithm of the expected improvement (Ament et al.,
    arXiv:2310.20708) under a Matérn-5/2 kernel with one length scale per parameter and a fitted noise variance. Its
    own computing time grows with the cube of the number of evaluations: seconds for 100, hours for thousands. It is
    meant for objectives that take minutes each.

    Parameters
    ----------
    dimension, budget, seed : int
        See `Optimizer`.
    startup : int
        Number of uniform points at the start, Optuna's ``n_startup_trials``; 10 by default, as there.
    """

    name = "optuna-gp"

    def __init__(self, dimension: int, budget: int, seed: int, *, startup: int = 10) -> None:
        super().__init__(dimension, budget, seed)
        names = [f"x{k}" for k in range(self.dimension)]
        self._box: dict[str, optuna.distributions.BaseDistribution] = {
            name: optuna.distributions.FloatDistribution(-1.0, 1.0) for name in names
        }
        storage = optuna.storages.InMemoryStorage()
        sampler = optuna.samplers.GPSampler(
            seed=int(np.random.SeedSequence(self.seed).generate_state(1)[0]),
            n_startup_trials=checked_count("startup", startup),
        )
        level = optuna.logging.get_verbosity()
        optuna.logging.set_verbosity(optuna.logging.WARNING)  # otherwise it logs every new study
        self._study = optuna.create_study(storage=storage, sampler=sampler)
        optuna.logging.set_verbosity(level)
        self._trial: optuna.trial.Trial | None = None

    def propose(self) -> Real:
        """The next point."""
        with threadpool_limits(1):  # more threads only slow down matrices this small
            self._trial = self._study.ask(self._box)
        return np.clip([[self._trial.params[name] for name in self._box]], -1.0, 1.0)

    def learn(self, points: Real, costs: Real, gradients: Real | None) -> None:
        """Add the cost to the study."""
        if self._trial is not None:
            self._study.tell(self._trial, float(costs[0]))
