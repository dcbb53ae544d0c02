"""The cost of a waveform on a head whose signal is known within a margin, where a small error changes a lot.

The peak cost has steps. Where two peaks are equally high, a little decides which of them is the effective one. Where a
small wiggle delays the peak after it, that wiggle counts five times instead of the peak; and where the signal rises or
falls slowly for a moment, a shoulder, a little makes two more peaks of it. A search on a model ends at such steps, and
the head then falls off. The careful cost counts what such peaks may cost at worst.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.tuning.drop_signal import ERRORS, Shown, Signal, predicted_signals, without_wiggles
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import PeakCost, Printhead
from inkjet_env.typing import Real

FASTEST = 5.0
"""Highest frequency of what the prediction may lack, relative to the resonance: it tells slopes from heights."""
SEARCHED = 0.5
"""How much of what a waveform may cost beyond its peak cost counts in a search, which ends where a prediction errs in
its favour."""
NEARBY = 0.2
"""Distance in half widths of the box over which what a check has shown changes by as much as itself."""


@dataclass(frozen=True)
class CarefulCost(PeakCost):
    """The peak cost of a signal that is known within a margin, and what it may be beyond that at worst.

    The worst is the largest over which peak is effective, among those at most the margin below the highest; over
    whether wiggles smaller than the margin are there or not; and over whether there are wiggles where the slope is so
    small that what the prediction may lack can turn it.

    Parameters
    ----------
    margin_V : float
        The margin in volts, at least 0; with 0 it is the peak cost itself.
    share : float
        How much of the difference between worst and peak cost counts, from 0 to 1, the default.
    """

    margin_V: float = 0.0
    share: float = 1.0

    def __call__(self, peaks_V: ArrayLike, tail_V: float = 0.0) -> float:
        """Cost in volts of peaks in time order; ``tail_V`` is as in `PeakCost`."""
        peaks = np.asarray(peaks_V, dtype=np.float64)
        return self._counted(peaks, [peaks]) + tail_V

    def of_signal(self, signal: Signal, frequency_Hz: float, window_s: float) -> float:
        """Cost in volts of a densely sampled signal from the start of the waveform.

        Parameters
        ----------
        signal : Signal
            The signal.
        frequency_Hz : float
            Resonance frequency of the head, in hertz.
        window_s : float
            Time after the start within which peaks count, in seconds.
        """
        times_s, peaks_V = signal.peaks(window_s)
        possible = [peaks_V]
        slope = 2 * math.pi * FASTEST * frequency_Hz * self.margin_V
        at = shoulders(signal.signal_V, slope * signal.step_s)
        at = at[at * signal.step_s <= window_s]
        if at.size:
            where = np.searchsorted(times_s, np.repeat(at * signal.step_s, 2))
            possible.append(np.insert(peaks_V, where, np.repeat(signal.signal_V[at], 2)))
        return self._counted(peaks_V, possible)

    def _counted(self, peaks_V: Real, possible: Sequence[Real]) -> float:
        """Cost of peaks, and the share that counts of what these, with and without wiggles, may cost beyond it."""
        plain = super().__call__(peaks_V)
        smooth = peaks_V[without_wiggles(peaks_V, self.margin_V)]
        worst = max(self._worst(one) for one in (*possible, smooth))
        return plain + self.share * (worst - plain)

    def _worst(self, peaks_V: Real) -> float:
        """Largest cost over which of the highest peaks is effective."""
        if self.effective != "largest" or not peaks_V.size:
            return super().__call__(peaks_V)
        height = np.abs(peaks_V)
        after = np.append(height[1:], 0.0)
        effective = np.minimum(height, self.target_height_V)
        costs = height.sum() - height + self.A * effective + (self.B - 1.0) * after
        return float(costs[height >= height.max() - self.margin_V].max())


def shoulders(signal_V: Real, least_V: float) -> np.ndarray:
    """Samples at which a signal goes on rising, or falling, but by less than ``least_V`` a step and least nearby."""
    change_V = np.diff(signal_V)
    size_V = np.abs(change_V)
    goes_on = (change_V[:-2] * change_V[1:-1] > 0) & (change_V[1:-1] * change_V[2:] > 0)
    least = (size_V[1:-1] < size_V[:-2]) & (size_V[1:-1] <= size_V[2:]) & (size_V[1:-1] < least_V)
    return np.flatnonzero(goes_on & least) + 1


@dataclass(frozen=True, eq=False)
class Careful:
    """A problem of one drop whose signal is known within a margin, as an objective.

    Attributes
    ----------
    problem : Problem
        The problem: a head, or an ensemble of heads and the risk by which they are judged.
    margin_V : float
        Margin in volts; see `CarefulCost`.
    shown : Shown, optional
        What a check has shown beyond the prediction of the problem's head. It is added to the prediction; with the
        distance from the checked waveform the margin grows.
    """

    problem: Problem
    margin_V: float
    shown: Shown | None = None

    def evaluate(self, points: Real) -> Real:
        """Costs in volts, shape (n,), of points in ``[-1, 1]``, shape (n, 7)."""
        problem = self.problem
        points = np.atleast_2d(points)
        rows = problem.bounds.from_unit(points)
        margins_V = np.full(len(points), self.margin_V)
        if self.shown is not None:
            checked = problem.bounds.to_unit(self.shown.waveform.to_array())
            margins_V += ERRORS * self.shown.rms_V * np.abs(points - checked).max(axis=1) / NEARBY
        if problem.ensemble is None:
            return self._costs(problem.printhead, rows, margins_V)
        every = np.array([self._costs(head, rows, margins_V) for head in problem.ensemble.heads])
        return problem.ensemble.risk(every, problem.risk)

    def _costs(self, head: Printhead | AugmentedPrinthead, rows: Real, margins_V: Real) -> Real:
        problem, plain = self.problem, self.problem.cost
        found = np.empty(len(rows))
        period_s = math.inf if self.shown is None else self.shown.period_s  # as it was recorded
        signals = predicted_signals(rows, head, problem.initial_state, problem.window_s, period_s)
        for k, signal in enumerate(signals):
            if self.shown is not None:
                signal = self.shown.added_to(signal)
            cost = CarefulCost(plain.A, plain.B, plain.effective, plain.target_height_V, float(margins_V[k]), SEARCHED)
            found[k] = cost.of_signal(signal, head.frequency_Hz, problem.window_s)
        return found


def margin_of(fit: Mapping[str, Any], corrected: bool) -> float:
    """Margin in volts within which a head that was fitted predicts the signal.

    Parameters
    ----------
    fit : mapping
        Quality of its fit, as a ``printhead/1`` tells it.
    corrected : bool
        Whether the corrected head predicts, or the base model beside it.
    """
    noise_V = float(fit.get("noise_rms_V") or 0.0)
    held_out = fit.get("augmented_heldout_rms_V" if corrected else "base_heldout_rms_V") or fit.get("heldout_rms_V")
    held_out_V = float(held_out or noise_V)
    return ERRORS * math.sqrt(max(held_out_V**2 - noise_V**2, 0.0))
