"""Figure of the regret against the number of evaluations."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from inkjet_env.reporting.plotting import COLOURS, new_figure
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Dash patterns with which the colours are used again.
DASHES = ("-", "--", ":")
LABEL_HEIGHT = 0.045
"""Height of a curve's name, as a fraction of the figure's height."""


def draw_regrets(curves: Mapping[str, Real]) -> Figure:
    """Regret against budget, both axes logarithmic, each curve labelled at its end.

    Parameters
    ----------
    curves : mapping of str to ndarray, shape (4, n)
        Optimiser → budgets in evaluations, lower end of the interval, regret and upper end, these three in the
        problems' scales.
    """
    figure, axes = new_figure(7.2, 4.6)
    colours = dict(zip(curves, itertools.cycle(COLOURS), strict=False))
    for number, (name, (budgets, low, regret, high)) in enumerate(curves.items()):
        colour, dash = colours[name], DASHES[number // len(COLOURS) % len(DASHES)]
        aside = budgets * 1.02 ** (number - len(curves) / 2)  # shifted so that the intervals do not overlap
        axes.vlines(aside, low, high, color=colour, lw=1.2)
        axes.plot(aside, regret, dash, marker="o", ms=3.5, color=colour, lw=1.4)
    every = np.unique(np.concatenate([curve[0] for curve in curves.values()]))
    axes.set(xscale="log", yscale="log", xlabel="evaluations", ylabel="regret (of the problem's scale)")
    axes.set_xticks(every, [f"{int(budget):,}" for budget in every])
    axes.minorticks_off()
    lowest, highest = (np.log(end) for end in axes.get_ylim())
    ends = sorted(curves, key=lambda name: curves[name][2, -1])
    heights = spread([(np.log(curves[name][2, -1]) - lowest) / (highest - lowest) for name in ends], LABEL_HEIGHT)
    for name, height in zip(ends, heights, strict=True):
        last = (curves[name][0, -1], curves[name][2, -1])
        axes.annotate(
            name, last, (1.03, height), textcoords="axes fraction", va="center", color=colours[name],
            arrowprops={"arrowstyle": "-", "color": colours[name], "lw": 0.5, "shrinkA": 0, "shrinkB": 4},
        )  # fmt: skip
    return figure


def spread(heights: Sequence[float], apart: float) -> Real:
    """Heights in ascending order, moved as little as possible to be at least ``apart`` from each other."""
    from scipy.optimize import isotonic_regression

    steps = apart * np.arange(len(heights))
    moved: Real = isotonic_regression(np.asarray(heights) - steps).x + steps
    return moved
