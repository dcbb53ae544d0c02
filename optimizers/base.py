"""What every optimiser is: something that is asked for points and told their costs."""

from __future__ import annotations

import operator
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]  # not from inkjet_env: whoever wants an optimiser alone imports no Gymnasium


class Optimizer:
    """An optimiser over the box ``[-1, 1]^d`` that spends a budget of evaluations, to the last one, and no more.

    A subclass writes `propose` and `learn`. It need not count: `ask` cuts the last batch to what is left of the
    budget, and nothing is learnt from a batch that no other can follow.

    Parameters
    ----------
    dimension : int
        d, at least 1.
    budget : int
        Evaluations in all, at least 1.
    seed : int
        At least 0. The same seed and the same costs give the same points, bit for bit.
    **options
        Keywords of the subclass.

    Raises
    ------
    ValueError, TypeError
        A number that is out of range or not an integer.
    """

    name: str = ""
    uses_gradient: ClassVar[bool] = False

    def __init__(self, dimension: int, budget: int, seed: int) -> None:
        self.dimension = checked_count("dimension", dimension)
        self.budget = checked_count("budget", budget)
        self.seed = checked_count("seed", seed, least=0)
        self.remaining = self.budget
        self.rng = np.random.default_rng(self.seed)
        self._asked: Real | None = None

    def ask(self) -> Real:
        """Points to evaluate, side by side if one likes: shape (n, d) in ``[-1, 1]``, n at most what is left.

        Asked again before it is told, it repeats itself.

        Raises
        ------
        RuntimeError
            The budget is spent.
        """
        if self.remaining == 0:
            raise RuntimeError(f"the budget of {self.budget} evaluations is spent. Make a new optimiser to go on.")
        if self._asked is None:
            self._asked = np.array(self.propose()[: self.remaining], dtype=np.float64)
        return self._asked.copy()

    def tell(self, points: Real, costs: Real, gradients: Real | None = None) -> None:
        """Tell the costs of the points asked for last.

        Parameters
        ----------
        points : ndarray, shape (n, d)
            As `ask` returned them.
        costs : ndarray, shape (n,)
        gradients : ndarray, shape (n, d), optional
            Needed where `uses_gradient`.

        Raises
        ------
        ValueError
            Other points than those asked for, another number of costs, or no gradients where they are needed.
        """
        if self._asked is None or not np.array_equal(points, self._asked):
            raise ValueError("tell wants the very points that ask returned last, in the same order.")
        if costs.shape != (len(self._asked),):
            raise ValueError(f"costs must have shape ({len(self._asked)},); got {costs.shape}.")
        if self.uses_gradient and (gradients is None or gradients.shape != self._asked.shape):
            came = "none" if gradients is None else gradients.shape
            raise ValueError(f"{self.name} needs gradients of shape {self._asked.shape}; got {came}.")
        asked, self._asked = self._asked, None
        self.remaining -= len(asked)
        if self.remaining > 0:
            self.learn(asked, costs, gradients)

    def propose(self) -> Real:
        """The next batch, shape (n, d), n at least 1, however much budget is left."""
        raise NotImplementedError

    def learn(self, points: Real, costs: Real, gradients: Real | None) -> None:
        """Take in the costs of a whole batch."""
        raise NotImplementedError

    def close(self) -> None:
        """Release what the optimiser holds. It may be called more than once."""


def checked_count(label: str, value: int, least: int = 1) -> int:
    """``value`` as an int of at least ``least``, or an error that says what came instead."""
    try:
        count = operator.index(value)
    except TypeError:
        raise TypeError(f"{label} must be an integer; got {value!r}.") from None
    if count < least:
        raise ValueError(f"{label} must be at least {least}; got {count}.")
    return count
