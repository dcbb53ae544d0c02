"""The canvas of every figure: a new one, its colours and lines, and how it is written."""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.storage import write_atomically
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER, GREY = "#b3541e", "#1b5e8c", "#888888"
STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "svg.hashsalt": "inkjet",
    "svg.fonttype": "path",
}
# Okabe and Ito's colours, which colour-blind readers can distinguish; reused with another dash pattern.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
DASHES = ("-", "--", ":")
MOST_POINTS = 3000
"""Largest number of points drawn for one line."""
LABEL_HEIGHT = 0.045
"""Height of a curve's name, as a fraction of the figure's height."""


def new_figure(width: float, height: float, **subplots: Any) -> tuple[Figure, Any]:
    """A new figure of ``width`` × ``height`` inches, not attached to a window, and its axes."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure((width, height), layout="constrained")
        return figure, figure.subplots(**subplots)


def svg_text(figure: Figure) -> str:
    """The figure as an ``<svg>`` element; the same figure always gives the same text."""
    import matplotlib as mpl

    buffer = io.StringIO()
    with mpl.rc_context(STYLE):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    return re.sub(r' xmlns(:xlink)?="[^"]*"', "", text)  # not needed within HTML


def check_picture_name(path: str | Path) -> None:
    """Raise ``ValueError`` unless the file name ends in .png, .svg or .pdf."""
    ending = Path(path).suffix.lower()
    if ending not in (".png", ".svg", ".pdf"):
        raise ValueError(f"{path}: a figure's name must end in .png, .svg or .pdf; got {ending or 'no ending'!r}.")


def write_picture(path: str | Path, figure: Figure) -> None:
    """Write a figure atomically as PNG, SVG or PDF, by the name's ending."""
    check_picture_name(path)
    buffer = io.BytesIO()
    figure.savefig(buffer, format=Path(path).suffix.lower()[1:], dpi=160)
    write_atomically(path, buffer.getvalue())


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
    """Heights in ascending order, moved as little as possible to be at least ``apart`` from each other.

    Examples
    --------
    >>> spread([0.0, 0.0, 1.0], 0.5).tolist()
    [-0.25, 0.25, 1.0]
    """
    from scipy.optimize import isotonic_regression

    steps = apart * np.arange(len(heights))
    moved: Real = isotonic_regression(np.asarray(heights) - steps).x + steps
    return moved


def time_scale(span_s: float) -> tuple[float, str]:
    """The unit that suits a span of time: its length in seconds, and its symbol."""
    for seconds, unit in ((1.0, "s"), (1e-3, "ms")):
        if span_s >= 2 * seconds:
            return seconds, unit
    return 1e-6, "µs"


def draw_line(axes: Axes, x: Real, y: Real, **style: Any) -> None:
    """Draw a line of many points through the smallest and the largest value of each run of neighbours."""
    run = -(-2 * x.size // MOST_POINTS)
    if run > 2:
        rows = y[: y.size // run * run].reshape(-1, run)
        first = np.arange(len(rows)) * run
        kept = np.unique(np.concatenate([first + rows.argmin(axis=1), first + rows.argmax(axis=1), [y.size - 1]]))
        x, y = x[kept], y[kept]
    axes.plot(x, y, **style)
