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
from numpy.typing import NDArray

from inkjet_env.envs.task import WaveformTask, make_task
from inkjet_env.printhead.waveform import PARAMETER_NAMES
from inkjet_env.typing import Real

PEAK_SCALE_V, TIME_SCALE_S, COST_SCALE_V = 5.0, 100e-6, 20.0
"""Peak height in volts, time in seconds and cost in volts that are 1 in an observation."""
LARGEST = 10.0
"""Magnitude at which observations are clipped."""
MOST_TRIES, MOST_PEAKS = 10_000, 1000
"""Largest numbers of tries and peaks accepted."""


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
    **options
        Options of the task; see `inkjet_env.envs.task.make_task`. ``context`` is "random" and cannot be given.
    """

    def __init__(self, count: int, tries: int, peaks: int, **options: Any) -> None:
        if "context" in options:
            raise ValueError('context cannot be given: a head to be tuned is always drawn, as by context="random".')
        self.tries = _counted("tries", tries, MOST_TRIES)
        self.peaks = _counted("peaks", peaks, MOST_PEAKS)
        self.task: WaveformTask = make_task(context="random", **options)
        self.count = count
        self._clear()

    def _clear(self) -> None:
        n = self.count
        self.done = 0
        self.contexts = np.zeros((n, 4), dtype=np.float32)
        self.fired, self.kept = np.zeros((n, 7)), np.zeros((n, 7))
        self.heights_V, self.times_s = np.zeros((n, self.peaks)), np.zeros((n, self.peaks))
        self.kept_read_V, self.kept_cost_V = np.zeros(n), np.zeros(n)

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

    def begin(self, generators: Sequence[np.random.Generator]) -> None:
        """Replace the heads on the bench by unknown ones."""
        self._clear()
        self.contexts = self.task.contexts(generators)
        self._heads = self.task.heads(self.contexts)

    def fire(
        self, actions: NDArray[Any], shape: tuple[int, ...], generators: Sequence[np.random.Generator]
    ) -> tuple[Real, dict[str, Real]]:
        """One try on each head: rewards in volts, shape (n,), and the contents of ``info``, one row per head.

        Raises
        ------
        ValueError
            The actions have another shape than ``shape``, are NaN or outside the box; nothing is fired.
        """
        waveforms = self.task.waveforms(actions, shape)
        readings = self.task.read(waveforms, self._heads, generators if self.task.noise else ())
        self.done += 1
        self.fired = np.array(actions, dtype=np.float64).reshape(-1, 7)
        shown = np.arange(self.peaks) < readings.counts[:, None]
        width = min(self.peaks, readings.heights_V.shape[1])
        for table, found in ((self.heights_V, readings.heights_V), (self.times_s, readings.times_s)):
            table[:] = 0.0
            table[:, :width] = np.where(shown[:, :width], found[:, :width], 0.0)
        better = readings.read_V < self.kept_read_V
        rewards = np.where(better, self.kept_cost_V - readings.costs_V, 0.0)
        self.kept[better] = self.fired[better]
        self.kept_read_V = np.where(better, readings.read_V, self.kept_read_V)
        self.kept_cost_V = np.where(better, readings.costs_V, self.kept_cost_V)
        reported = {
            "waveform": waveforms,
            "cost": readings.costs_V.copy(),
            "reading": readings.read_V.copy(),
            "kept_cost": self.kept_cost_V.copy(),
        }
        return rewards, reported

    @property
    def over(self) -> bool:
        """Whether all tries have been made."""
        return self.done >= self.tries

    def observations(self) -> NDArray[np.float32]:
        """Observation of each head, shape (n, 16 + 2 peaks)."""
        share = np.full((self.count, 1), self.done / self.tries)
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
