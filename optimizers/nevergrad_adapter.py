"""Optimisers from nevergrad."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import nevergrad
import numpy as np

from inkjet_env.optimizers.base import Optimizer, checked_count
from inkjet_env.optimizers.nevergrad_threads import repeatable_nevergrad
from inkjet_env.optimizers.process_randomness import OwnRandomness
from inkjet_env.typing import Real


class Nevergrad(Optimizer):
    """Any optimiser of nevergrad's registry, by its name there.

    Rapin & Teytaud, github.com/facebookresearch/nevergrad, 2018. It searches an `Array` bounded to the box (by
    nevergrad's default, "bouncing") and starts at the centre. Some optimisers differ from their namesakes: `PSO` moves
    in coordinates stretched by an arctangent. `NGOpt` chooses among the others by dimension and budget.

    Parameters
    ----------
    dimension, budget, seed : int
        See `Optimizer`.
    method : str
        Name in `nevergrad.optimizers.registry`.
    workers : int
        Number of points asked for together. With 1, nevergrad's default, it learns from every single evaluation. With
        instruments that work beside each other, their number.
    """

    in_any_order = True

    def __init__(self, dimension: int, budget: int, seed: int, *, method: str, workers: int = 1) -> None:
        super().__init__(dimension, budget, seed)
        self.name = f"nevergrad-{method}"
        self._workers = checked_count("workers", workers)
        self._randomness = OwnRandomness(self.seed)
        with self._surroundings():
            box = nevergrad.p.Array(init=np.zeros(self.dimension), lower=-1.0, upper=1.0)
            box.random_state = np.random.RandomState(np.random.MT19937(self.seed))
            self._search = nevergrad.optimizers.registry[method](box, self.budget, self._workers)
        self._candidates: list[nevergrad.p.Parameter] = []
        self._costs: list[float] = []
        self._under_way: dict[bytes, list[nevergrad.p.Parameter]] = {}

    def propose(self) -> Real:
        """Tell nevergrad the last costs, then ask it for one point per worker."""
        with self._surroundings():
            for candidate, cost in zip(self._candidates, self._costs, strict=True):
                self._search.tell(candidate, cost)
            self._candidates = [self._search.ask() for _ in range(min(self._workers, self.remaining))]
        # "Bouncing" may exceed the wall of the box by one rounding error.
        return np.clip([candidate.value for candidate in self._candidates], -1.0, 1.0)

    def learn(self, points: Real, costs: Real, gradients: Real | None) -> None:
        """Store the costs until the next `propose`."""
        self._costs = costs.tolist()

    def propose_another(self) -> Real | None:
        """Ask nevergrad for one point; None while each of its workers has one."""
        if sum(map(len, self._under_way.values())) == self._workers:
            return None
        with self._surroundings():
            candidate = self._search.ask()
        point = np.clip(candidate.value, -1.0, 1.0)
        self._under_way.setdefault(point.tobytes(), []).append(candidate)
        return point

    def learn_another(self, point: Real, cost: float) -> None:
        """Tell nevergrad the cost of one of its points."""
        with self._surroundings():
            self._search.tell(self._under_way[point.tobytes()].pop(), cost)

    @contextmanager
    def _surroundings(self) -> Iterator[None]:
        """Private random streams, no threads, and no warnings about settings that the user did not choose."""
        with self._randomness, repeatable_nevergrad(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
