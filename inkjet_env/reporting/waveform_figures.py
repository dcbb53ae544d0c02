"""Figures of waveforms with their responses.

``python -m inkjet_env.reporting.waveform_figures FILE`` draws the one that explains parameters and cost.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from inkjet_env.printhead import PeakCost, Printhead, Response, SampledResponse, Waveform
from inkjet_env.reporting.plotting import AFTER, BEFORE, GREY, new_figure, write_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIRST_S = -10e-6
LAST_S = 350e-6
EXPLAINED = Waveform(80, -60, 5e-6, 8e-6, 9e-6, 12e-6, 8e-6)
"""A waveform whose edges are long enough to be labelled and whose response rings."""


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


def draw_explained(response: Response, cost: PeakCost) -> Figure:
    """A bipolar waveform with its seven parameters (left), and the response's peaks with their weights (right).

    Parameters
    ----------
    response : Response
        Response to a bipolar waveform, whose six corners are `Response.knot_times_s`; times in seconds, drive and
        response in volts.
    cost : PeakCost
        Determines which peak is effective, and the weights.

    Raises
    ------
    ValueError
        There is no effective peak, or none after it.
    """
    e = cost.effective_index(response.peaks_V)
    if e is None or e + 1 >= response.peaks_V.size:
        raise ValueError("the response must have an effective peak and one after it to be explained.")
    figure, (left, right) = new_figure(8.6, 3.5, ncols=2, width_ratios=[4, 5])
    _explained_waveform(left, response)
    _explained_peaks(right, response, cost, e)
    return figure


def _explained_waveform(axes: Axes, response: Response) -> None:
    """Draw the drive with a dimension line for each voltage and each duration."""
    time_us = response.knot_times_s * 1e6
    drive_V = response.drive_V(response.knot_times_s)
    high_V, low_V = float(drive_V.max()), float(drive_V.min())
    end_us = float(time_us[-1])
    span_V = high_V - low_V
    edge = 0.15 * end_us
    axes.plot([-edge, *time_us, end_us + edge], [0, *drive_V, 0], color=AFTER, lw=2)
    axes.axhline(0, color=GREY, lw=0.8)
    below_V = low_V - 0.13 * span_V
    for number, (start, stop) in enumerate(itertools.pairwise(time_us), start=1):
        _dimension(axes, (start, below_V), (stop, below_V))
        axes.text((start + stop) / 2, below_V - 0.03 * span_V, f"$t_{number}$", ha="center", va="top", fontsize=11)
    for time, volts in zip(time_us, drive_V, strict=True):
        axes.plot([time, time], [volts, below_V], color=GREY, lw=0.6, ls=":")
    for number, place, volts in ((1, 1, high_V), (2, 3, low_V)):
        middle = (time_us[place] + time_us[place + 1]) / 2
        _dimension(axes, (middle, 0.0), (middle, volts))
        axes.text(middle + 0.02 * end_us, volts / 2, f"$U_{number}$", ha="left", va="center", fontsize=11)
    axes.set_ylim(below_V - 0.17 * span_V, high_V + 0.08 * span_V)
    axes.set(xlabel="time (µs)", ylabel="drive (V)")
    axes.set_title("the waveform: two voltages, five durations", fontsize=9)


def _dimension(axes: Axes, start: tuple[float, float], stop: tuple[float, float]) -> None:
    """A line with an arrow at both ends, as in a technical drawing."""
    axes.annotate("", stop, start, arrowprops={"arrowstyle": "<->", "lw": 0.8, "shrinkA": 0, "shrinkB": 0})


def _explained_peaks(axes: Axes, response: Response, cost: PeakCost, e: int) -> None:
    """Draw the response with the name and the weight of the effective peak, of the next one and of the others."""
    last = min(e + 9, response.peaks_V.size - 1)
    end_s = float(response.peak_times_s[last])
    time_s = np.linspace(0.0, end_s, 2001)
    times_us, peaks_V = response.peak_times_s[: last + 1] * 1e6, response.peaks_V[: last + 1]
    axes.axvspan(times_us[e], end_s * 1e6, color="#f3ead9", lw=0)
    axes.axhline(0, color=GREY, lw=0.8)
    axes.plot(time_s * 1e6, response.sensor_V(time_s), color=AFTER, lw=1.4)
    axes.plot(times_us, peaks_V, ".", color=AFTER, ms=6)
    axes.plot(times_us[e], peaks_V[e], "o", ms=9, mfc="none", mec="black", mew=1.0)
    size_V = float(np.abs(peaks_V).max())
    axes.set_ylim(-1.25 * size_V, 1.45 * size_V)
    right_us = end_s * 1e6
    axes.annotate(
        f"effective peak $y_e$, weight $A$ = {signed(cost.A, 0)}",
        (times_us[e], peaks_V[e]),
        (10, 0),
        textcoords="offset points",
        va="center",
    )
    axes.annotate(
        f"the peak after it, $y_{{e+1}}$, weight $B$ = {signed(cost.B, 0)}",
        (times_us[e + 1], peaks_V[e + 1]),
        (right_us, 0.72 * size_V),
        ha="right",
        va="center",
        arrowprops={"arrowstyle": "-", "lw": 0.6, "shrinkA": 2, "shrinkB": 3},
    )
    axes.text(right_us, -0.62 * size_V, "every other peak: weight 1", ha="right", va="center")
    axes.text(right_us, 1.36 * size_V, "residual vibration: all after the effective peak", ha="right", va="top")
    axes.set(xlabel="time (µs)", ylabel="response (V)", xlim=(0, right_us * 1.02))
    axes.set_title(f"its response: peak cost $J$ = {signed(response.cost(cost), 2)} V", fontsize=9)


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


def main() -> None:
    """Draw the figure that explains the seven parameters and the cost, into the file that is named."""
    parser = argparse.ArgumentParser(prog="python -m inkjet_env.reporting.waveform_figures", description=main.__doc__)
    parser.add_argument("file", help="picture to be written: .png, .svg or .pdf")
    file = parser.parse_args().file
    write_picture(file, draw_explained(Printhead.published().respond(EXPLAINED), PeakCost()))
    print(file)


if __name__ == "__main__":
    main()
