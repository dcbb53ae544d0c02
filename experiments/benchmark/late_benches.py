"""Simulated instruments that work beside each other, whose readings take differently long or never come.

What a search on them spends is time. It is counted in evaluations: those that the instruments could make meanwhile if
none were ever idle and each reading took its median time.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from inkjet_env.optimizers.asynchronous import LateRun, Reading, minimise_late
from inkjet_env.optimizers.base import Optimizer
from inkjet_env.optimizers.loop import Objective
from inkjet_env.typing import Real


@dataclass
class LateBenches:
    """A problem that is read by several instruments on a simulated clock; see `inkjet_env.optimizers.asynchronous`.

    Parameters
    ----------
    objective : Objective
        The problem.
    seed : int
        Seed of how long each reading takes and which are lost.
    reading_s : float
        Median time of a reading, in seconds.
    spread : float
        Standard deviation of the logarithm of that time, at least 0.
    lost : float
        Share of readings that never come.
    patience_s : float
        Time in seconds after which a reading is given up; a slower one is lost too.

    Attributes
    ----------
    now_s : float
        Time on the clock, in seconds.
    busy_s : float
        Time that all instruments have worked, in sum.
    came_s : list of float
        Time of each reading, in the order in which they came.
    """

    objective: Objective
    seed: int = 0
    reading_s: float = 1.0
    spread: float = 0.5
    lost: float = 0.05
    patience_s: float = 5.0
    now_s: float = field(default=0.0, init=False)
    busy_s: float = field(default=0.0, init=False)
    came_s: list[float] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        if not (0 <= self.lost < 1 and self.spread >= 0 and 0 < self.reading_s < math.inf and self.patience_s > 0):
            raise ValueError(
                "lost must be a share below 1, spread at least 0, and reading_s and patience_s above 0; got "
                f"{self.lost}, {self.spread}, {self.reading_s} and {self.patience_s}."
            )
        self._rng = np.random.default_rng(self.seed)
        self._due: list[tuple[float, int, float]] = []

    def start(self, number: int, point: Real) -> None:
        """Begin to read the cost of a point, shape (7,)."""
        takes_s = self.reading_s * math.exp(self.spread * self._rng.standard_normal())
        if self._rng.random() < self.lost or takes_s > self.patience_s:
            heapq.heappush(self._due, (self.now_s + self.patience_s, number, math.nan))
            self.busy_s += self.patience_s
            return
        heapq.heappush(self._due, (self.now_s + takes_s, number, float(self.objective.evaluate(point[None])[0])))
        self.busy_s += takes_s

    def wait(self) -> Reading:
        """Let the clock run to the next reading, or to the moment in which one is given up."""
        self.now_s, number, cost = heapq.heappop(self._due)
        self.came_s.append(self.now_s)
        return Reading(number, cost)


def searched_beside(
    objective: Objective, optimizer: Optimizer, instruments: int, seed: int
) -> tuple[LateRun, NDArray[np.int64]]:
    """A search on instruments beside each other, and the time at which each of its costs came.

    Parameters
    ----------
    objective : Objective
        The problem.
    optimizer : Optimizer
        A fresh optimiser, which spends its budget.
    instruments : int
        Number of instruments.
    seed : int
        Seed of how long each reading takes and which are lost.

    Returns
    -------
    run : LateRun
        The run, in the order in which readings came.
    spent : ndarray of int, shape (n,)
        Time of each reading, counted in evaluations from 1; the first reading counts from the beginning.
    """
    benches = LateBenches(objective, seed)
    run = minimise_late(benches, optimizer, optimizer.budget, slots=instruments)
    last = {reading.number: place for place, reading in enumerate(run.readings)}
    came_s = np.array(benches.came_s)[sorted(last.values())]
    spent = np.ceil(came_s * instruments / benches.reading_s).astype(np.int64)
    spent[0] = 1
    return run, spent
