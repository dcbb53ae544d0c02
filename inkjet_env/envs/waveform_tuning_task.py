"""Tuning the waveform of an unknown head in a few tries: actions, readings and observations.

The single environment and the vector one share this file, which works on rows; the numbers of a row do not depend on
the number of rows.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from inkjet_env.envs.given_heads import GivenHeads, HeadsOption
from inkjet_env.envs.task import Readings, WaveformTask, make_task
from inkjet_env.plant.augmented import AugmentedPrinthead, AugmentedResponse
from inkjet_env.printhead import Printhead, Response
from inkjet_env.printhead.waveform import PARAMETER_NAMES
from inkjet_env.typing import Real

PEAK_SCALE_V, TIME_SCALE_S, COST_SCALE_V = 5.0, 100e-6, 20.0
"""Peak height in volts, time in seconds and cost in volts that are 1 in an observation."""
LARGEST = 10.0
"""Magnitude at which observations are clipped."""
MOST_TRIES, MOST_PEAKS = 10_000, 1000
"""Largest numbers of tries and peaks accepted."""
EVERY = slice(None)
"""The rows of every head."""


class WaveformTuningTask:
    """N heads on the bench, with the tries and readings of each.

    Parameters
    ----------
    count : int
        Number of heads, N.
    tries : int
        Number of waveforms that may be fired on each head.
    peaks : int
        Number of peaks of the last response in an observation, counted from the first.
    threads : int, optional
        Largest number of threads that simulate; None is the number of cores. No number depends on it.
    heads : HeadEnsemble, head, path or sequence of heads and paths, optional
        What each head is drawn from, by weight; see `inkjet_env.envs.given_heads.ensemble_of_heads`. By default heads
        are drawn as with ``context="random"``.
    **options
        Options of the task; see `inkjet_env.envs.task.make_task`. ``context`` and ``reference`` cannot be given,
        nor can ``printhead`` beside ``heads``.
    """

    def __init__(
        self,
        count: int,
        tries: int,
        peaks: int,
        threads: int | None = 1,
        heads: HeadsOption | None = None,
        **options: Any,
    ) -> None:
        if "context" in options:
            raise ValueError('context cannot be given: a head to be tuned is always drawn, as by context="random".')
        if "reference" in options:
            raise ValueError("reference cannot be given: the reward of a try is by how much it lowers the cost.")
        self.tries = _counted("tries", tries, MOST_TRIES)
        self.peaks = _counted("peaks", peaks, MOST_PEAKS)
        self.given = None if heads is None else GivenHeads(heads, **options)
        self.task: WaveformTask = make_task(context="random", **options) if self.given is None else self.given.tasks[0]
        self.count = count
        self.threads = threads
        self.contexts = np.zeros((count, 4), dtype=np.float32)
        self._heads = self.task.heads(self.contexts)
        self.numbers = np.zeros(count, dtype=np.int64)
        self.done = np.zeros(count, dtype=np.int64)
        self.fired, self.kept = np.zeros((2, count, 7))
        self.heights_V, self.times_s = np.zeros((2, count, self.peaks))
        self.kept_read_V, self.kept_cost_V = np.zeros((2, count))

    def action_space(self) -> spaces.Box:
        """Space of the seven waveform parameters, scaled to [-1, 1]."""
        return self.task.action_space()

    def observation_space(self) -> spaces.Box:
        """Observation space of one head."""
        return spaces.Box(-LARGEST, LARGEST, (len(self.observation_names()),), np.float32)

    def observation_names(self) -> tuple[str, ...]:
        """Name of each entry of an observation."""
        numbered = range(1, self.peaks + 1)
        return (
            "tries_made", "kept_reading", *(f"fired_{name}" for name in PARAMETER_NAMES),
            *(f"kept_{name}" for name in PARAMETER_NAMES), *(f"peak_{k}_height" for k in numbered),
            *(f"peak_{k}_time" for k in numbered),
        )  # fmt: skip

    def begin(self, generators: Sequence[np.random.Generator], rows: NDArray[np.bool_] | slice = EVERY) -> None:
        """Replace heads on the bench by unknown ones: those of ``rows``, with one generator each."""
        for table in (
            self.done, self.fired, self.kept, self.heights_V, self.times_s, self.kept_read_V, self.kept_cost_V
        ):  # fmt: skip
            table[rows] = 0
        if self.given is not None:
            self.numbers[rows] = self.given.drawn(generators)
            return
        contexts = self.contexts.copy()
        contexts[rows] = self.task.contexts(generators)
        self.put_on_the_bench(contexts)

    def put_on_the_bench(self, contexts: ArrayLike) -> None:
        """Have these heads on the bench from now on, instead of those that were drawn.

        Parameters
        ----------
        contexts : array_like, shape (N, 4)
            The heads as ``context="random"`` shows them; beyond ±1 they are outside the ranges of drawn heads.

        Raises
        ------
        ValueError
            The heads on the bench are given ones, or the shape is another.
        """
        if self.given is not None:
            raise ValueError("the heads on the bench are those of the option heads; give others there.")
        placed = np.array(contexts, dtype=np.float32)
        if placed.shape != (self.count, 4):
            raise ValueError(f"contexts must have shape ({self.count}, 4); got {placed.shape}.")
        self.contexts, self._heads = placed, self.task.heads(placed)

    def fire(
        self,
        actions: NDArray[Any],
        shape: tuple[int, ...],
        generators: Sequence[np.random.Generator],
        rows: NDArray[np.bool_] | slice = EVERY,
    ) -> tuple[Real, dict[str, Real]]:
        """One try on the heads of ``rows``: rewards in volts, shape (n,), and the contents of ``info``, one row each.

        There is one generator per row. The actions have an entry for every head; those of the others are ignored.

        Raises
        ------
        ValueError
            The actions have another shape than ``shape``, are NaN or outside the box; nothing is fired.
        """
        waveforms = self.task.waveforms(actions, shape, rows if isinstance(rows, np.ndarray) else None)[rows]
        readings = self._read(waveforms, generators if self.task.noise else (), rows)
        fired = np.clip(np.array(actions, dtype=np.float64).reshape(-1, 7)[rows], -1.0, 1.0)
        self.done[rows] += 1
        self.fired[rows] = fired
        self.heights_V[rows], self.times_s[rows] = readings.first(self.peaks)
        kept_V = self.kept_cost_V[rows]
        better = readings.read_V < self.kept_read_V[rows]
        rewards = np.where(better, kept_V - readings.costs_V, 0.0)
        self.kept[rows] = np.where(better[:, None], fired, self.kept[rows])
        self.kept_read_V[rows] = np.where(better, readings.read_V, self.kept_read_V[rows])
        self.kept_cost_V[rows] = np.where(better, readings.costs_V, kept_V)
        reported = {
            "waveform": waveforms,
            "cost": readings.costs_V.copy(),
            "reading": readings.read_V.copy(),
            "kept_cost": self.kept_cost_V[rows].copy(),
        }
        return rewards, reported

    def _read(
        self, waveforms: Real, generators: Sequence[np.random.Generator], rows: NDArray[np.bool_] | slice
    ) -> Readings:
        if self.given is not None:
            return self.given.read(self.numbers[rows], waveforms, generators, self.threads)
        return self.task.read(waveforms, self._heads[rows], generators, self.threads)

    def head(self, row: int) -> Printhead | AugmentedPrinthead:
        """The head on the bench of one row: what a strategy that tunes it must not know."""
        return self._task_of(row).head(self.contexts[row])

    def respond(self, row: int) -> Response | AugmentedResponse | None:
        """Response of the head of one row to the waveform fired last; None before the first try."""
        waveform = self.task.bounds.from_unit(self.fired[row]) if self.done[row] else None
        return self._task_of(row).respond(waveform, self.contexts[row])

    def _task_of(self, row: int) -> WaveformTask:
        return self.task if self.given is None else self.given.tasks[self.numbers[row]]

    @property
    def over(self) -> NDArray[np.bool_]:
        """Whether all tries on each head have been made, shape (N,)."""
        return self.done >= self.tries

    def observations(self) -> NDArray[np.float32]:
        """Observation of each head, shape (n, 16 + 2 peaks)."""
        share = self.done[:, None] / self.tries
        parts = (
            share, self.kept_read_V[:, None] / COST_SCALE_V, self.fired, self.kept,
            self.heights_V / PEAK_SCALE_V, self.times_s / TIME_SCALE_S,
        )  # fmt: skip
        return np.clip(np.concatenate(parts, axis=1), -LARGEST, LARGEST).astype(np.float32)


def _counted(name: str, value: Any, most: int) -> int:
    try:
        count = operator.index(value)
    except TypeError:
        raise ValueError(f"{name} must be a whole number; got {value!r}.") from None
    if isinstance(value, bool) or not 1 <= count <= most:
        raise ValueError(f"{name} must be 1 to {most}; got {value!r}.")
    return count
