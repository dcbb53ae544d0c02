"""Ask and tell for libraries that call the objective function themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
from greenlet import GreenletExit, getcurrent, greenlet

from inkjet_env.optimizers.base import Optimizer
from inkjet_env.typing import Real


class CallbackOptimizer(Optimizer):
    """An optimiser around a library that calls its objective.

    The library runs on its own stack (a greenlet), which is suspended inside `evaluate` until `tell` supplies the
    costs. A subclass implements `search`; if a search ends before the budget is spent, the next one begins on the
    same random stream.
    """

    def __init__(self, dimension: int, budget: int, seed: int) -> None:
        super().__init__(dimension, budget, seed)
        self._library: greenlet | None = None
        self._answer: Any = None
        self._closed = False
        self._evaluated = False

    def search(self) -> None:
        """Run the library once, from start to its own stopping criterion, with `evaluate` as its objective."""
        raise NotImplementedError

    def evaluate(self, points: Real) -> Any:
        """The objective that the library calls: costs, shape (n,), of points, shape (n, d); plus gradients where used.

        Gradients have shape (n, d).
        """
        if self._closed:
            raise GreenletExit
        self._evaluated = True
        return getcurrent().parent.switch(np.array(points, dtype=np.float64))

    def propose(self) -> Real:
        """Resume the library until its next call of `evaluate`."""
        if self._library is None:
            self._library = greenlet(self._search_for_ever)
        self._library.parent = getcurrent()
        return self._library.switch(*(() if self._answer is None else (self._answer,)))

    def learn(self, points: Real, costs: Real, gradients: Real | None) -> None:
        """Store the costs until the library is resumed."""
        self._answer = (costs, gradients) if self.uses_gradient else costs

    def close(self) -> None:
        """Stop the library at its present call of `evaluate`."""
        self._closed = True
        if self._library is not None:
            self._library.parent = getcurrent()
            self._library.throw()
            self._library = None

    def _search_for_ever(self) -> None:
        while True:
            self._evaluated = False
            self.search()
            if not self._evaluated:
                raise RuntimeError(f"{self.name} ended a search without evaluating a point.")
