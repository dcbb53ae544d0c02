"""Figures of waveforms, responses and convergence; each function draws a new figure and returns it."""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.printhead import PeakCost, Response, SampledResponse
from inkjet_env.storage import write_atomically
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


BEFORE, AFTER, GREY = "#b3541e", "#1b5e8c", "#888888"
FIRST_S, LAST_S = -10e-6, 350e-6
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


def signed(value: float, digits: int) -> str:
    """The number with ``digits`` decimals and a true minus sign.

    Examples
    --------
    >>> signed(-1.25, 2)
    '−1.25'
    """
    return f"{value:.{digits}f}".replace("-", "−")


def draw_response(response: Response | SampledResponse, cost: PeakCost) -> Figure:
    """Drive (top) and self-sensing response with its peaks (bottom) against time."""
    figure, axes = new_figure(7.2, 4.6, nrows=2, sharex=True, height_ratios=[2, 3])
    _drive(axes[0], response, AFTER)
    _sensed(axes[1], response, cost, AFTER)
    legend = "dots: peaks; ring: the effective one"
    if isinstance(response, SampledResponse) and (later := int((response.peak_times_s > response.time_s[-1]).sum())):
        legend += f"; {later} more count after the last sample"
    axes[0].set_title(f"peak cost {signed(response.cost(cost), 3)} V ({legend})", fontsize=9)
    axes[0].set_ylabel("drive (V)")
    axes[1].set_ylabel("response (V)")
    axes[1].set_xlabel("time (µs)")
    return figure


def draw_before_after(before: Response, after: Response, cost: PeakCost, titles: Sequence[str]) -> Figure:
    """Drive and response of two waveforms, side by side on the same scales."""
    figure, axes = new_figure(8.6, 4.6, nrows=2, ncols=2, sharex=True, sharey="row", height_ratios=[2, 3])
    for column, (response, title, colour) in enumerate(zip((before, after), titles, (BEFORE, AFTER), strict=True)):
        _drive(axes[0, column], response, colour)
        _sensed(axes[1, column], response, cost, colour)
        axes[0, column].set_title(f"{title}\npeak cost {signed(response.cost(cost), 2)} V", fontsize=9)
        axes[1, column].set_xlabel("time (µs)")
    axes[0, 0].set_ylabel("drive (V)")
    axes[1, 0].set_ylabel("response (V)")
    return figure


def _drive(axes: Axes, response: Response | SampledResponse, colour: str) -> None:
    if isinstance(response, SampledResponse):
        axes.plot(response.time_s * 1e6, response.drive_V, color=colour, lw=1.4)
        return
    time_s = np.concatenate([[FIRST_S], response.knot_times_s, [_end_s(response)]])
    axes.plot(time_s * 1e6, response.drive_V(time_s), color=colour, lw=1.4)


def _end_s(response: Response) -> float:
    """End of the time axis in seconds: the end of the window, but never before the waveform's end."""
    window_s = response.window_s if np.isfinite(response.window_s) else LAST_S
    return max(window_s, 1.1 * float(response.knot_times_s[-1]))


def _sensed(axes: Axes, response: Response | SampledResponse, cost: PeakCost, colour: str) -> None:
    if isinstance(response, SampledResponse):
        time_s, sensor_V, last_s = response.time_s, response.sensor_V, response.time_s[-1]
    else:
        last_s = _end_s(response)
        time_s = np.linspace(FIRST_S, last_s, 4001)
        sensor_V = np.where(time_s < 0, 0.0, response.sensor_V(time_s))
    axes.plot(time_s * 1e6, sensor_V, color=colour, lw=1.2)
    shown = response.peak_times_s <= last_s
    axes.plot(response.peak_times_s[shown] * 1e6, response.peaks_V[shown], ".", color=colour, ms=5)
    e = cost.effective_index(response.peaks_V)
    if e is not None and shown[e]:
        axes.plot(
            response.peak_times_s[e] * 1e6,
            response.peaks_V[e],
            "o",
            ms=9,
            mfc="none",
            mec="black",
            mew=1.0,
            clip_on=False,
        )


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
