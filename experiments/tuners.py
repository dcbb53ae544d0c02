"""Who tunes heads in a few tries: an optimiser, an agent, one waveform for all, a list of waveforms."""

from __future__ import annotations

from collections import deque
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from experiments.drawn_heads import Heads, Real, stretched, the_task
from experiments.policies import Policy
from inkjet_env.envs.task import CONTEXT_LOWER, CONTEXT_UPPER
from inkjet_env.envs.tuning import TIME_SCALE_S

MIDDLE = np.zeros((1, 4))
"""The middle of the heads, as the environment shows it: what waveforms of a list are made for."""
PULSE = np.array([1.0, 1.0, -1.0, -1.0, -1.0, -1.0, -1.0])
"""The shortest pulse of the box, after which a head rings freely."""


class Tuner(Protocol):
    """Whoever tunes N heads side by side."""

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """Actions for the next try, shape (n, 7)."""

    def told(self, readings: Real) -> None:
        """Costs as they were read, shape (n,)."""


class Optimisers:
    """An optimiser a head, which is told readings and nothing else.

    Parameters
    ----------
    name : str
    count : int
        Number of heads.
    tries : int
    seed : int
    **options
        Of the optimiser.
    """

    def __init__(self, name: str, count: int, tries: int, seed: int, **options: Any) -> None:
        import optimizers

        self.each = [optimizers.make(name, budget=tries, seed=seed + k, **options) for k in range(count)]
        self.asked: list[Real] = [np.empty((0, 7))] * count
        self.waiting: list[deque[Real]] = [deque() for _ in range(count)]
        self.read: list[list[float]] = [[] for _ in range(count)]

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """The next of what each has asked for."""
        for k, optimizer in enumerate(self.each):
            if not self.waiting[k]:
                self.asked[k], self.read[k] = optimizer.ask(), []
                self.waiting[k].extend(self.asked[k])
        return np.array([waiting.popleft() for waiting in self.waiting])

    def told(self, readings: Real) -> None:
        """Each is told once all that it asked for has been read."""
        for k, optimizer in enumerate(self.each):
            self.read[k].append(float(readings[k]))
            if not self.waiting[k]:
                optimizer.tell(self.asked[k], np.array(self.read[k]))


class Agent:
    """A policy that sees what the environment shows."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """What it does where it sees that."""
        return self.policy.act(observations)

    def told(self, readings: Real) -> None:
        """It will see them."""


class OneForAll:
    """The same waveform whatever the head, again and again."""

    def __init__(self, point: Real) -> None:
        self.point = point

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """That waveform."""
        return np.tile(self.point, (len(observations), 1))

    def told(self, readings: Real) -> None:
        """It does not listen."""


class Listed:
    """The waveforms of a list, one after the other; or a pulse first, and they are stretched to the period that rings.

    Parameters
    ----------
    points : ndarray, shape (tries, 7)
        In ``[-1, 1]``; of those that are stretched, for the middle of the heads.
    names : tuple of str, or None
        What each number of an observation is, where the period is read; None where nothing is.
    """

    def __init__(self, points: Real, names: tuple[str, ...] | None = None) -> None:
        self.points, self.done = points, 0
        self.times = [k for k, name in enumerate(names or ()) if name.endswith("_time")]
        self.heads: Real | None = None

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """The next of the list."""
        number, self.done = self.done, self.done + 1
        if not self.times:
            return np.tile(self.points[number], (len(observations), 1))
        if self.heads is None and number:
            self.heads = self._read(TIME_SCALE_S * np.asarray(observations, dtype=np.float64)[:, self.times])
        if self.heads is None:
            return np.tile(PULSE, (len(observations), 1))
        return stretched(np.tile(self.points[number - 1], (len(observations), 1)), MIDDLE, self.heads)

    def told(self, readings: Real) -> None:
        """It does not listen to costs."""

    def _read(self, times_s: Real) -> Real:
        """Heads in the middle but for their resonances, shape (n, 4), from times of peaks, shape (n, peaks)."""
        over_s = float(the_task().bounds.from_unit(PULSE[None, :])[0, 2:].sum())
        low_Hz, high_Hz = CONTEXT_LOWER[0], CONTEXT_UPPER[0]
        heads = np.tile(MIDDLE, (len(times_s), 1))
        for head, times in zip(heads, times_s, strict=True):
            free = times[times > over_s]
            if len(free) > 1:  # peaks of a free ringing are half a period apart
                resonance_Hz = 0.5 * (len(free) - 1) / (free[-1] - free[0])
                head[0] = (2 * resonance_Hz - low_Hz - high_Hz) / (high_Hz - low_Hz)
        return heads


def best_list(labelled: Real, points: Real, count: int, stretch: bool) -> tuple[Real, int]:
    """The list of waveforms, shape (count, 7), that leaves heads the least mean cost; and the evaluations it took.

    The next is always that which betters the list most, beginning with what is best alone.

    Parameters
    ----------
    labelled : ndarray, shape (n, 4)
        Heads.
    points : ndarray, shape (n, 7)
        The best waveform of each.
    count : int
    stretch : bool
        Whether waveforms will be stretched to the heads' resonances.
    """
    candidates = stretched(points, labelled, MIDDLE) if stretch else points
    heads = Heads(labelled.astype(np.float32))
    tried = [np.tile(candidate, (len(labelled), 1)) for candidate in candidates]
    costs = np.array([heads.evaluate(stretched(one, MIDDLE, labelled) if stretch else one) for one in tried])
    chosen: list[int] = []
    least = np.zeros(len(labelled))  # firing nothing
    for _ in range(count):
        chosen.append(int(np.minimum(costs, least).mean(axis=1).argmin()))
        least = np.minimum(least, costs[chosen[-1]])
    return candidates[chosen], costs.size
