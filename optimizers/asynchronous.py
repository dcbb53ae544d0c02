"""The loop with instruments that work beside each other: readings come late, in another order, or never."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from inkjet_env.optimizers.base import Optimizer, checked_count
from inkjet_env.optimizers.loop import Interrupted, NonFiniteCostError, Run
from inkjet_env.typing import Real


class Reading(NamedTuple):
    """What became of an evaluation.

    Attributes
    ----------
    number : int
        Number of the evaluation, from 0.
    cost : float
        Its cost, in the unit of the objective; NaN if it will never come.
    """

    number: int
    cost: float


class Benches(Protocol):
    """Instruments that evaluate points, several at once."""

    def start(self, number: int, point: Real) -> None:
        """Begin an evaluation of a point, shape (d,); an evaluation that was lost may be started again."""

    def wait(self) -> Reading:
        """The next reading of those that were started, in whatever order they come; blocks until then."""


class LostReadingsError(RuntimeError):
    """An evaluation was started as often as allowed, and no reading of any evaluation has come so far."""


@dataclass(frozen=True, eq=False)
class LateRun(Run):
    """A run whose evaluations are in the order in which their readings came.

    Attributes
    ----------
    readings : tuple of Reading
        All readings in the order in which they came, lost ones among them: what resumes an interrupted run.
    lost : ndarray of bool, shape (n,)
        Evaluations of which no reading came. Their cost is the worst that was read before.
    """

    readings: tuple[Reading, ...] = ()
    lost: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.bool_))


def minimise_late(
    benches: Benches,
    optimizer: Optimizer,
    budget: int,
    *,
    slots: int,
    attempts: int = 3,
    by_batch: bool = False,
    recorded: Sequence[Reading] = (),
    on_reading: Callable[[LateRun], object] | None = None,
) -> LateRun:
    """Let a fresh optimiser spend its budget on instruments that work beside each other, and close it.

    An optimiser that takes costs in any order (`Optimizer.in_any_order`) is told each one when it comes and asked for
    another point at once, so that no instrument is idle. Others are told when all readings of a batch are there; until
    the last of them the instruments wait.

    Parameters
    ----------
    benches : Benches
        The instruments.
    optimizer : Optimizer
        An optimiser that has not been asked yet, and needs no gradients.
    budget : int
        Total number of evaluations; it must equal the optimiser's own budget.
    slots : int
        Largest number of evaluations under way at once.
    attempts : int
        How often an evaluation whose reading is lost is started. Then it counts with the worst cost that was read
        before, so that the search leaves that place.
    by_batch : bool
        Have an optimiser that takes costs in any order wait for whole batches, too.
    recorded : sequence of Reading, optional
        Readings of an interrupted run of the same optimiser with the same seed, slots, attempts and batches. They are
        not taken again; evaluations that were under way are started anew.
    on_reading : callable, optional
        Called after every reading with the run so far.

    Returns
    -------
    LateRun
        The run, of exactly ``budget`` evaluations.

    Raises
    ------
    ValueError
        A number is out of range, the optimiser is not fresh or needs gradients, or a reading is of no evaluation that
        is under way.
    NonFiniteCostError
        A cost is infinite.
    LostReadingsError
        Nothing has been read, and an evaluation was lost for good.
    Interrupted
        On `KeyboardInterrupt`; its ``run`` is a `LateRun`.
    """
    try:
        if checked_count("budget", budget) != optimizer.budget or optimizer.remaining != optimizer.budget:
            raise ValueError(f"{optimizer.name} must be fresh and have the budget of the run, {budget}.")
        if optimizer.uses_gradient:
            raise ValueError(f"{optimizer.name} needs gradients, which benches do not read. Use another optimiser.")
        in_any_order = optimizer.in_any_order and not by_batch
        counts = checked_count("slots", slots), checked_count("attempts", attempts)
        late = _Late(benches, optimizer, *counts, in_any_order, recorded)
        try:
            while late.count < optimizer.budget:
                late.fill()
                late.read()
                if on_reading is not None:
                    on_reading(late.run())
        except KeyboardInterrupt:
            raise Interrupted(late.run()) from None
        return late.run()
    finally:
        optimizer.close()


class _Late:
    """The evaluations of one run: those that wait for a free slot, those under way, and those that are read."""

    def __init__(
        self,
        benches: Benches,
        optimizer: Optimizer,
        slots: int,
        attempts: int,
        in_any_order: bool,
        recorded: Sequence[Reading],
    ) -> None:
        self.benches, self.optimizer, self.slots, self.attempts = benches, optimizer, slots, attempts
        self.in_any_order = in_any_order
        self.points: list[Real] = []
        self.waiting: list[int] = []
        self.started: dict[int, int] = {}
        """How often each evaluation that is under way was started."""
        self.batch: dict[int, float | None] = {}
        """Costs of the batch that an optimiser waits for, which takes them all at once."""
        self.order: list[int] = []
        self.costs: list[float] = []
        self.lost: list[bool] = []
        self.readings: list[Reading] = []
        self.to_replay = list(recorded)[::-1]

    @property
    def count(self) -> int:
        """Number of evaluations that are done."""
        return len(self.costs)

    def run(self) -> LateRun:
        points = np.array([self.points[k] for k in self.order]).reshape(self.count, self.optimizer.dimension)
        costs, lost = np.array(self.costs, dtype=np.float64), np.array(self.lost, dtype=np.bool_)
        return LateRun(points, costs, None, self.count == self.optimizer.budget, 0.0, 0.0, tuple(self.readings), lost)

    def fill(self) -> None:
        """Ask for points, and start evaluations while there are free slots."""
        while len(self.started) < self.slots and (self.waiting or self._ask()):
            number = self.waiting.pop(0)
            self.started[number] = 1
            self._start(number)

    def _ask(self) -> bool:
        """Ask for more points; False if the optimiser has none before another reading comes."""
        if self.in_any_order:
            if len(self.points) == self.optimizer.budget or (point := self.optimizer.ask_another()) is None:
                return False
            asked = [point]
        else:
            if self.batch:
                return False
            asked = list(self.optimizer.ask())
            self.batch = dict.fromkeys(range(len(self.points), len(self.points) + len(asked)))
        self.waiting += range(len(self.points), len(self.points) + len(asked))
        self.points += asked
        return True

    def _start(self, number: int) -> None:
        """Begin an evaluation, unless what will become of it is recorded."""
        if not any(reading.number == number for reading in self.to_replay):
            self.benches.start(number, self.points[number].copy())

    def read(self) -> None:
        """Take the next reading, and tell the optimiser as soon as it can be told."""
        reading = self.to_replay.pop() if self.to_replay else Reading(*self.benches.wait())
        number, cost = reading.number, float(reading.cost)
        if number not in self.started:
            raise ValueError(f"a reading came of evaluation {number}, which is not under way.")
        if math.isinf(cost):
            raise NonFiniteCostError(
                f"costs must be finite; got {cost} at evaluation {number}, point {self.points[number].tolist()}."
            )
        self.readings.append(Reading(number, cost))
        lost = math.isnan(cost)
        if lost and self.started[number] < self.attempts:
            self.started[number] += 1
            self._start(number)
            return
        if lost:
            if not (read := [known for known, gone in zip(self.costs, self.lost, strict=True) if not gone]):
                raise LostReadingsError(
                    f"evaluation {number} was started {self.attempts} times, and nothing has been read yet. Check the "
                    "instruments."
                )
            cost = max(read)
        del self.started[number]
        self.order.append(number)
        self.costs.append(cost)
        self.lost.append(lost)
        if self.in_any_order:
            self.optimizer.tell_another(self.points[number], cost)
            return
        self.batch[number] = cost
        if None not in self.batch.values():
            points, costs = np.array([self.points[k] for k in self.batch]), np.array(list(self.batch.values()))
            self.batch = {}
            self.optimizer.tell(points, costs)
