"""The loop between an objective and an optimiser: the only place that spends the budget."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.optimizers.base import Optimizer, checked_count
from inkjet_env.typing import Real


class Objective(Protocol):
    """The function to minimise. For optimisers that use gradients it also has `evaluate_with_gradient`."""

    def evaluate(self, points: Real) -> Real:
        """Costs, shape (n,), of points, shape (n, d). A point's cost must not depend on the other points."""


@dataclass(frozen=True, eq=False)
class Run:
    """All evaluations of a run, in order.

    Parameters
    ----------
    points : ndarray, shape (n, d)
        Evaluated points in ``[-1, 1]``.
    costs : ndarray, shape (n,)
        Cost of each point, in the unit of the objective.
    gradients : ndarray, shape (n, d), or None
        Gradient of the cost at each point; None where the optimiser does not use gradients.
    complete : bool
        Whether the budget is spent; False for a run that was interrupted or is still in progress.
    optimizer_seconds, objective_seconds : float
        Time spent in the optimiser's `ask` and `tell`, and in the objective.
    """

    points: Real
    costs: Real
    gradients: Real | None
    complete: bool
    optimizer_seconds: float
    objective_seconds: float

    @property
    def evaluations(self) -> int:
        """Number of evaluations; a cost together with its gradient counts as one."""
        return len(self.costs)

    @property
    def best_point(self) -> Real | None:
        """The first point with the lowest cost, shape (d,); None if nothing was evaluated."""
        return self.points[int(np.argmin(self.costs))].copy() if self.evaluations else None

    @property
    def best_cost(self) -> float:
        """The lowest cost; infinite if nothing was evaluated."""
        return float(np.min(self.costs, initial=math.inf))

    @property
    def history(self) -> list[list[float]]:
        """``[evaluations, best cost so far]`` at each improvement, and once more at the end."""
        best = np.minimum.accumulate(self.costs)
        improved = np.flatnonzero(np.diff(best, prepend=math.inf) < 0)
        if self.evaluations and improved[-1] != self.evaluations - 1:
            improved = np.append(improved, self.evaluations - 1)
        return [[int(i) + 1, float(best[i])] for i in improved]


class ObjectiveError(ValueError):
    """The objective returned values that cannot be the costs or gradients of its points."""


class NonFiniteCostError(ObjectiveError):
    """The objective returned a cost or a gradient that is not finite."""


class PointOutsideBoxError(ValueError):
    """An optimiser asked for a point outside ``[-1, 1]``."""


class ReplayMismatchError(ValueError):
    """In a replay, an optimiser asked for points that differ from those recorded."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a run; `run` holds the evaluations made until then."""

    def __init__(self, run: Run) -> None:
        super().__init__(f"interrupted after {run.evaluations} evaluations")
        self.run = run


def minimise(
    objective: Objective,
    optimizer: Optimizer,
    budget: int,
    *,
    recorded: Run | tuple[ArrayLike, ...] | None = None,
    on_batch: Callable[[Run], object] | None = None,
) -> Run:
    """Let a fresh optimiser spend its budget on an objective, and close it.

    Parameters
    ----------
    objective : Objective
        ``evaluate(points) -> costs``, shapes (n, d) and (n,). For an optimiser that uses gradients,
        ``evaluate_with_gradient(points) -> (costs, gradients)``, shapes (n,) and (n, d); a gradient comes with its
        cost and the two count as one evaluation.
    optimizer : Optimizer
        An optimiser that has not been asked yet.
    budget : int
        Total number of evaluations; it must equal the optimiser's own budget.
    recorded : Run or tuple (points, costs) or (points, costs, gradients), optional
        The evaluations of an interrupted run of the same optimiser with the same seed. They are replayed without
        calling the objective and count towards the budget; the run then continues as if it had never stopped.
    on_batch : callable, optional
        Called after every batch with the run so far. Its arrays are views; copy them to keep them.

    Returns
    -------
    Run
        The run, of exactly ``budget`` evaluations.

    Raises
    ------
    ValueError
        The budget is below 1 or not the optimiser's own, the optimiser is not fresh, the record does not fit, or the
        objective lacks a gradient that the optimiser needs.
    ObjectiveError
        The objective returns an array of the wrong shape.
    NonFiniteCostError
        A cost or gradient is not finite. The message names the evaluation, counted from 1, and the point.
    PointOutsideBoxError
        The optimiser asks for a point outside the box. The message names the evaluation and the point.
    ReplayMismatchError
        The optimiser asks for points that differ from those recorded: another seed, version or objective.
    Interrupted
        On `KeyboardInterrupt`; its ``run`` holds the evaluations made, ready to be passed as ``recorded``.
    """
    try:
        _check_fresh(optimizer, budget)
        if optimizer.uses_gradient and not hasattr(objective, "evaluate_with_gradient"):
            raise ValueError(f"{optimizer.name} needs an objective with evaluate_with_gradient; this one has none.")
        ledger = _Ledger(objective, optimizer, _checked_record(recorded, optimizer))
        try:
            while ledger.count < optimizer.budget:
                ledger.one_batch()
                if on_batch is not None:
                    on_batch(ledger.run())
        except KeyboardInterrupt:
            raise Interrupted(ledger.run()) from None
        return ledger.run()
    finally:
        optimizer.close()


class _Ledger:
    """The evaluations of one run, batch by batch."""

    def __init__(self, objective: Objective, optimizer: Optimizer, recorded: tuple[Real, Real, Real | None]) -> None:
        self.objective, self.optimizer, self.recorded = objective, optimizer, recorded
        self.points = np.empty((optimizer.budget, optimizer.dimension))
        self.costs = np.empty(optimizer.budget)
        self.gradients = np.empty_like(self.points) if optimizer.uses_gradient else None
        self.count = 0
        self.optimizer_seconds = 0.0
        self.objective_seconds = 0.0

    def run(self) -> Run:
        """The run so far, as views."""
        made = slice(0, self.count)
        gradients = None if self.gradients is None else self.gradients[made]
        complete = self.count == self.optimizer.budget
        return Run(
            self.points[made], self.costs[made], gradients, complete, self.optimizer_seconds, self.objective_seconds
        )

    def one_batch(self) -> None:
        """Ask for a batch, look up or evaluate its costs, store them and tell the optimiser."""
        begin_s = time.perf_counter()
        points = self.optimizer.ask()
        self.optimizer_seconds += time.perf_counter() - begin_s
        self._check_points(points)
        batch = slice(self.count, self.count + len(points))
        self.points[batch] = points
        known = self._look_up(batch)
        if known < batch.stop:
            self._evaluate(slice(known, batch.stop))
        self.count = batch.stop  # last, so that an interrupt sees whole batches only
        begin_s = time.perf_counter()
        self.optimizer.tell(points, self.costs[batch], None if self.gradients is None else self.gradients[batch])
        self.optimizer_seconds += time.perf_counter() - begin_s

    def _check_points(self, points: Real) -> None:
        left = self.optimizer.budget - self.count
        if points.ndim != 2 or points.shape[1] != self.optimizer.dimension or not 1 <= len(points) <= left:
            raise ValueError(
                f"{self.optimizer.name} must ask for 1 to {left} points of {self.optimizer.dimension} numbers; "
                f"it asked for an array of shape {points.shape}."
            )
        outside = ~(np.abs(points) <= 1).all(axis=1)
        if outside.any():
            first = int(np.argmax(outside))
            raise PointOutsideBoxError(
                f"{self.optimizer.name} left the box [-1, 1] at evaluation {self.count + first + 1}, "
                f"point {points[first].tolist()}."
            )

    def _look_up(self, batch: slice) -> int:
        """Fill in the recorded costs; return the index of the first evaluation that was not recorded."""
        points, costs, gradients = self.recorded
        known = min(batch.stop, max(batch.start, len(costs)))
        part = slice(batch.start, known)
        differs = (points[part] != self.points[part]).any(axis=1)
        if differs.any():
            first = int(np.argmax(differs)) + batch.start
            raise ReplayMismatchError(
                f"{self.optimizer.name} asked for {self.points[first].tolist()} at evaluation {first + 1}, but "
                f"{points[first].tolist()} is recorded. Replay needs the same optimiser, options, budget, seed and "
                "versions. Otherwise start again without the record."
            )
        self.costs[part] = costs[part]
        if self.gradients is not None and gradients is not None:
            self.gradients[part] = gradients[part]
        return known

    def _evaluate(self, part: slice) -> None:
        asked = self.points[part].copy()  # the objective may modify its argument
        begin_s = time.perf_counter()
        if self.gradients is None:
            costs = self.objective.evaluate(asked)
        else:
            costs, gradients = self.objective.evaluate_with_gradient(asked)  # type: ignore[attr-defined]
        self.objective_seconds += time.perf_counter() - begin_s
        self.costs[part] = self._checked("costs", costs, (len(asked),), part.start)
        if self.gradients is not None:
            self.gradients[part] = self._checked("gradients", gradients, asked.shape, part.start)

    def _checked(self, label: str, values: ArrayLike, shape: tuple[int, ...], start: int) -> Real:
        found = np.asarray(values, dtype=np.float64)
        if found.shape != shape:
            raise ObjectiveError(f"the objective must return {label} of shape {shape}; got {found.shape}.")
        wrong = ~np.isfinite(found).reshape(len(found), -1).all(axis=1)
        if wrong.any():
            first = int(np.argmax(wrong))
            raise NonFiniteCostError(
                f"{label} must be finite; got {found[first].tolist()} at evaluation {start + first + 1}, "
                f"point {self.points[start + first].tolist()}."
            )
        return found


def _check_fresh(optimizer: Optimizer, budget: int) -> None:
    if checked_count("budget", budget) != optimizer.budget:
        raise ValueError(f"budget must be the optimiser's own, {optimizer.budget}; got {budget}.")
    if optimizer.remaining != optimizer.budget:
        raise ValueError(f"{optimizer.name} has already received costs. A run needs a fresh optimiser.")


def _checked_record(
    recorded: Run | tuple[ArrayLike, ...] | None, optimizer: Optimizer
) -> tuple[Real, Real, Real | None]:
    if recorded is None:
        return np.empty((0, optimizer.dimension)), np.empty(0), np.empty((0, optimizer.dimension))
    if isinstance(recorded, Run):
        recorded = (recorded.points, recorded.costs, *(() if recorded.gradients is None else (recorded.gradients,)))
    arrays = [np.asarray(part, dtype=np.float64) for part in recorded]
    if len(arrays) != 2 + optimizer.uses_gradient and not (len(arrays) == 3 and not optimizer.uses_gradient):
        wanted = "(points, costs, gradients)" if optimizer.uses_gradient else "(points, costs)"
        raise ValueError(f"recorded must be a Run or {wanted} for {optimizer.name}; got {len(arrays)} arrays.")
    points, costs = arrays[:2]
    shape = (len(points), optimizer.dimension)
    gradients = arrays[2] if optimizer.uses_gradient else None
    if points.shape != shape or costs.shape != shape[:1] or (gradients is not None and gradients.shape != shape):
        raise ValueError(
            f"recorded must hold points (n, {optimizer.dimension}) and a cost (and gradient) for each; "
            f"got shapes {', '.join(str(array.shape) for array in arrays)}."
        )
    if len(costs) > optimizer.budget:
        raise ValueError(f"recorded holds {len(costs)} evaluations, more than the budget of {optimizer.budget}.")
    return points, costs, gradients
