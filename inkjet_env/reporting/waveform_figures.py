"""Figures of waveforms with their responses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from inkjet_env.printhead import PeakCost, Response, SampledResponse
from inkjet_env.reporting.plotting import AFTER, BEFORE, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIRST_S = -10e-6
LAST_S = 350e-6


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
