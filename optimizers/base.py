"""The interface of every optimiser: `ask` returns points, `tell` takes their costs."""

from __future__ import annotations

import operator
from typing import ClassVar

import numpy as np

from inkjet_env.typing import Real


class Optimizer:
    """An optimiser over the box ``[-1, 1]^d`` that spends exactly its budget of evaluations.

    A subclass implements `propose` and `learn`. It need not count evaluations: `ask` cuts the last batch to the
    remaining budget, and `learn` is not called after the last batch. One that can learn from single costs in any order
    may also set `in_any_order` and implement `propose_another` and `learn_another`.

    Parameters
    ----------
    dimension : int
        d, the number of coordinates; at least 1.
    budget : int
        Total number of evaluations, at least 1.
    seed : int
        Seed of the random generator, at least 0. The same seed and the same costs give the same points, bit for bit.
    **options
        Keyword arguments of the subclass.

    Raises
    ------
    ValueError, TypeError
        A number is out of range or not an integer.
    """

    name: str = ""
    uses_gradient: ClassVar[bool] = False
    in_any_order: ClassVar[bool] = False

    def __init__(self, dimension: int, budget: int, seed: int) -> None:
        self.dimension = checked_count("dimension", dimension)
        self.budget = checked_count("budget", budget)
        self.seed = checked_count("seed", seed, least=0)
        self.remaining = self.budget
        self.rng = np.random.default_rng(self.seed)
        self._asked: Real | None = None

    def ask(self) -> Real:
        """The next points to evaluate, in parallel if desired: shape (n, d) in ``[-1, 1]``, n at most `remaining`.

        Called again before `tell`, it returns the same points.

        Raises
        ------
        RuntimeError
            The budget is spent.
        ValueError
            `propose` returned something else than points of this dimension.
        """
        if self.remaining == 0:
            raise RuntimeError(f"the budget of {self.budget} evaluations is spent. Make a new optimiser to continue.")
        if self._asked is None:
            points = np.array(self.propose(), dtype=np.float64)
            if points.ndim != 2 or points.shape[1] != self.dimension or not len(points):
                raise ValueError(
                    f"{self.name} must ask for 1 to {self.remaining} points of {self.dimension} numbers; it asked for "
                    f"an array of shape {points.shape}."
                )
            self._asked = points[: self.remaining]
        return self._asked.copy()

    def tell(self, points: Real, costs: Real, gradients: Real | None = None) -> None:
        """Report the costs of the points that `ask` returned last.

        Parameters
        ----------
        points : ndarray, shape (n, d)
            The points as `ask` returned them.
        costs : ndarray, shape (n,)
            Cost of each point, in the unit of the objective; lower is better.
        gradients : ndarray, shape (n, d), optional
            Gradient of the cost at each point; required where `uses_gradient` is true.

        Raises
        ------
        ValueError
            The points are not those asked for, the number of costs differs, or required gradients are missing.
        """
        if self._asked is None or not np.array_equal(points, self._asked):
            raise ValueError("tell needs exactly the points that ask returned last, in the same order.")
        if costs.shape != (len(self._asked),):
            raise ValueError(f"costs must have shape ({len(self._asked)},); got {costs.shape}.")
        if self.uses_gradient and (gradients is None or gradients.shape != self._asked.shape):
            came = "none" if gradients is None else gradients.shape
            raise ValueError(f"{self.name} needs gradients of shape {self._asked.shape}; got {came}.")
        asked, self._asked = self._asked, None
        self.remaining -= len(asked)
        if self.remaining > 0:
            self.learn(asked, costs, gradients)

    def ask_another(self) -> Real | None:
        """One more point to evaluate while costs of others are still to come, shape (d,); None: not before one comes.

        Only where `in_any_order` is true, and in place of `ask` and `tell`.
        """
        point = self.propose_another()
        return None if point is None else np.array(point, dtype=np.float64)

    def tell_another(self, point: Real, cost: float) -> None:
        """Report the cost of one of the points that `ask_another` returned, in any order."""
        self.remaining -= 1
        if self.remaining > 0:
            self.learn_another(point, cost)

    def propose_another(self) -> Real | None:
        """The next single point, shape (d,), or None if there is none before another cost comes."""
        raise NotImplementedError

    def learn_another(self, point: Real, cost: float) -> None:
        """Update the search with the cost of one point."""
        raise NotImplementedError

    def propose(self) -> Real:
        """The next batch, shape (n, d), n at least 1; it may exceed the remaining budget."""
        raise NotImplementedError

    def learn(self, points: Real, costs: Real, gradients: Real | None) -> None:
        """Update the search with the costs of a whole batch."""
        raise NotImplementedError

    def close(self) -> None:
        """Release the optimiser's resources. It may be called more than once."""


def checked_count(label: str, value: int, least: int = 1) -> int:
    """``value`` as an int of at least ``least``; otherwise an error that names the value given."""
    try:
        count = operator.index(value)
    except TypeError:
        raise TypeError(f"{label} must be an integer; got {value!r}.") from None
    if count < least:
        raise ValueError(f"{label} must be at least {least}; got {count}.")
    return count
