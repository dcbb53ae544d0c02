"""What a proof is of, how it is sought, and its parts: ranges of the largest extremum."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.bounds.cost_to_go import ring_down
from inkjet_env.experiments.bounds.head_numbers import GAIN, STEEPEST, head_numbers
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

MICRO = 1e-6


@dataclass(frozen=True)
class Settings:
    """How the search goes about it; what it proves does not depend on them.

    Attributes
    ----------
    width, growth : float
        Width of the first part in the largest extremum, relative to it, and by what factor each is wider than the one
        before: the higher the extremum, the fewer waveforms have it.
    voltages : tuple of floats
        Ends of the ranges of −U2 of the tables, from 0 to 1 within its bounds.
    angles, turn : int
        Cells of the tables; see `Grid`.
    table_levels, table_step : int, float
        Halvings of the last edge's duration in the tables, and largest distance of its nodes in µs.
    pieces : int
        Number of times that the box of all waveforms is halved before its pieces are distributed.
    thresholds, steps, finest
        As for `tree.prove`.
    deepest, most : int
        Largest number of halvings of a piece, and of its boxes.
    """

    width: float = 0.06
    growth: float = 1.2
    voltages: tuple[float, ...] = (
        *(k / 8 for k in range(2)),
        *(0.25 + k / 32 for k in range(16)),
        *(0.75 + k / 64 for k in range(16)),
        *(127 / 128, 255 / 256, 511 / 512, 1.0),
    )
    angles: int = 640
    turn: int = 60
    table_levels: int = 5
    table_step: float = 0.2
    pieces: int = 10
    thresholds: tuple[float, float] = (0.1, 1.0)
    steps: tuple[float, float] = (0.1, 0.5)
    finest: float = 20.0
    deepest: int = 100
    most: int = 200_000_000


TABLES = {
    "fine": Settings(),
    "coarse": Settings(angles=320, turn=30, table_step=0.35),
}
"""Settings by their name: fine tables take several times as long and let a bound come nearer to the least cost."""


@dataclass(frozen=True)
class Task:
    """What is to be proven, in µs and volts.

    Attributes
    ----------
    head : ndarray
        `head_numbers`.
    weights : tuple of two floats
        Weights of the effective extremum and of the next.
    lower, upper : ndarray, shape (7,)
        The waveforms: U1, −U2, then five durations.
    window : float
        Time within which extrema count.
    """

    head: Real
    weights: tuple[float, float]
    lower: Real
    upper: Real
    window: float

    @property
    def highest(self) -> float:
        """A bound of all extrema, in volts: what the edges push, if they all push the same way."""
        a, b = self.upper[:2]
        return float(self.head[GAIN] * self.head[STEEPEST] * (a + (a + b) + b))

    @property
    def ring(self) -> tuple[float, float, float, float]:
        """`ring_down`."""
        found: tuple[float, float, float, float] = ring_down(
            self.head, self.weights, float(self.upper[2:].sum()), self.window
        )
        return found


def task_of(one: Problem) -> Task:
    """The task of a problem.

    Raises
    ------
    ValueError
        Bounds of such problems cannot be proven; the message says why.
    """
    cost, head = one.cost, one.printhead
    obstacles = {
        "its head has effects beyond the base model": not isinstance(head, Printhead),
        "its costs are read with errors or late": bool(one.measurement_noise_V or one.instruments),
        "it is judged on several heads": one.spread is not None or one.ensemble is not None,
        "its waveforms follow one another": one.jetting_Hz != 0 or one.pulses != 0,
        "its drive does not begin in the periodic state": one.initial_state != "periodic",
        "its effective peak is not the largest one": cost.effective != "largest",
        "its cost has a target height": math.isfinite(cost.target_height_V),
        f"its weights are not A ≤ 0 and B ≥ 1: {cost.A:g} and {cost.B:g}": cost.A > 0 or cost.B < 1,
        "its voltages do not rise first and fall then": one.bounds.lower[0] < 0 or one.bounds.upper[1] > 0,
        "its window ends before its waveforms": one.window_s < sum(one.bounds.upper[2:]),
    }
    for why, stands in obstacles.items():
        if stands:
            raise ValueError(f"{one.name}: no bound can be proven, since {why}.")
    assert isinstance(head, Printhead)
    low, high = np.array(one.bounds.lower), np.array(one.bounds.upper)
    lower = np.concatenate([[low[0], -high[1]], low[2:] / MICRO])
    upper = np.concatenate([[high[0], -low[1]], high[2:] / MICRO])
    window = one.window_s / MICRO if math.isfinite(one.window_s) else 1e6
    return Task(head_numbers(head), (float(cost.A), float(cost.B)), lower, upper, window)


def parts_of(task: Task, bound_V: float, width: float, growth: float) -> list[tuple[float, float]]:
    """Ranges of the largest extremum in volts: from where nothing can cost less, to the highest of all.

    ``width`` and ``growth`` are as for `Settings`.
    """
    least = bound_V / task.weights[0]
    extent = math.log(task.highest / least)
    ends = [0.0]
    while ends[-1] < extent:
        ends.append(ends[-1] + width)
        width *= growth
    volts = [least * math.exp(end * extent / ends[-1]) for end in ends] if extent > 0 else []
    return list(itertools.pairwise([*volts[:-1], task.highest] if volts else []))
