"""Optimisers from pymoo."""

from __future__ import annotations

from typing import Any

import numpy as np
from pymoo.algorithms.soo.nonconvex.de import DE
from pymoo.algorithms.soo.nonconvex.pso import PSO
from pymoo.core.algorithm import Algorithm
from pymoo.core.problem import Problem
from pymoo.core.termination import NoTermination

from inkjet_env.optimizers.base import Optimizer, checked_count
from inkjet_env.typing import Real


class _Pymoo(Optimizer):
    """One of pymoo's algorithms, run one generation at a time until the budget is spent.

    Blank & Deb, IEEE Access 8 (2020) 89497.
    """

    def __init__(self, dimension: int, budget: int, seed: int) -> None:
        super().__init__(dimension, budget, seed)
        self._algorithm = self.algorithm()
        box = Problem(n_var=self.dimension, n_obj=1, xl=-1.0, xu=1.0)
        word = int(np.random.SeedSequence(self.seed).generate_state(1)[0])
        self._algorithm.setup(box, termination=NoTermination(), seed=word, verbose=False)
        self._generation: Any = None

    def algorithm(self) -> Algorithm:
        """The algorithm, not yet set up."""
        raise NotImplementedError

    def propose(self) -> Real:
        """One generation."""
        self._generation = self._algorithm.ask()
        points: Real = self._generation.get("X").astype(np.float64)
        return points

    def learn(self, points: Real, costs: Real, gradients: Real | None) -> None:
        """Assign the costs to the generation and advance the algorithm."""
        self._generation.set("F", costs[:, None])
        for individual in self._generation:
            individual.evaluated.update({"F", "G", "H"})
        self._algorithm.tell(infills=self._generation)


class PymooPSO(_Pymoo):
    """Particle swarm with pymoo's defaults: an independent implementation of `pso` with other rules.

    Inertia and attraction adapt to the spread of the swarm (Zhan et al., IEEE Trans. Syst. Man Cybern. B 39 (2009)
    1362), velocities are limited to a fifth of the box, and the swarm's best is perturbed in every generation.

    Parameters
    ----------
    dimension, budget, seed : int
        See `Optimizer`.
    particles : int
        Size of the swarm, at least 2; 25 by default, as in pymoo.
    fastest : float
        Largest velocity, as a fraction of the box's width per generation.
    """

    name = "pymoo-pso"

    def __init__(self, dimension: int, budget: int, seed: int, *, particles: int = 25, fastest: float = 0.2) -> None:
        self._particles, self._fastest = checked_count("particles", particles, least=2), fastest
        super().__init__(dimension, budget, seed)

    def algorithm(self) -> Algorithm:
        """The swarm."""
        return PSO(pop_size=self._particles, max_velocity_rate=self._fastest)


class PymooDE(_Pymoo):
    """Differential evolution with pymoo's defaults: best/1/bin, F 0.5, CR 0.2, and an occasional mutation.

    Storn & Price, J. Global Optim. 11 (1997) 341.

    Parameters
    ----------
    dimension, budget, seed : int
        See `Optimizer`.
    individuals : int
        Size of the population, at least 4; 100 by default, as in pymoo.
    variant : str
        ``DE/<selection>/<differences>/<crossover>`` in pymoo's notation.
    mutation : float
        Weight of a difference: pymoo's F.
    recombination : float
        Probability that a coordinate comes from the mutant: pymoo's CR.
    """

    name = "pymoo-de"

    def __init__(
        self,
        dimension: int,
        budget: int,
        seed: int,
        *,
        individuals: int = 100,
        variant: str = "DE/best/1/bin",
        mutation: float = 0.5,
        recombination: float = 0.2,
    ) -> None:
        self._individuals, self._variant = checked_count("individuals", individuals, least=4), variant
        self._mutation, self._recombination = mutation, recombination
        super().__init__(dimension, budget, seed)

    def algorithm(self) -> Algorithm:
        """The population."""
        return DE(pop_size=self._individuals, variant=self._variant, F=self._mutation, CR=self._recombination)
