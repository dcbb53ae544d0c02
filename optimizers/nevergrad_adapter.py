"""The optimisers of nevergrad."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import nevergrad
import numpy as np

from optimizers.base import Optimizer, Real, checked_count
from optimizers.nevergrad_threads import repeatable_nevergrad
from optimizers.process_randomness import OwnRandomness


class Nevergrad(Optimizer):
    """Any optimiser of nevergrad's registry, by its name there.

    Rapin & Teytaud, github.com/facebookresearch/nevergrad, 2018. It searches an `Array` bounded to the box (by
    nevergrad's default, "bouncing"), started at the centre. Mind that some differ from their namesakes: `PSO` moves in
    coordinates stretched by an arctangent. `NGOpt` chooses among the others by dimension and budget.

    Parameters
    ----------
    method : str
        Name in `nevergrad.optimizers.registry`.
    workers : int
        Points that are asked for side by side. One, nevergrad's default, lets it learn from every single evaluation.
    """

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

    def propose(self) -> Real:
        """Tell the last costs, then ask for one point for each worker."""
        with self._surroundings():
            for candidate, cost in zip(self._candidates, self._costs, strict=True):
                self._search.tell(candidate, cost)
            self._candidates = [self._search.ask() for _ in range(min(self._workers, self.remaining))]
        # The bounce back into the box may miss its wall by one rounding.
        return np.clip([candidate.value for candidate in self._candidates], -1.0, 1.0)

    def learn(self, points: Real, costs: Real, gradients: Real | None) -> None:
        """Keep the costs until nevergrad's next turn."""
        self._costs = costs.tolist()

    @contextmanager
    def _surroundings(self) -> Iterator[None]:
        """Own random streams, no threads, no advice on settings (of no use to who did not choose them)."""
        with self._randomness, repeatable_nevergrad(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
