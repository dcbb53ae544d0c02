"""Drawings of a response: drive, hysteresis loop, ringing and peaks, on given matplotlib axes.

`picture` combines them into the environment's frame. The global state of pyplot is not touched; matplotlib is imported
on use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.extras import extra
from inkjet_env.plant.augmented import AugmentedResponse
from inkjet_env.printhead import PeakCost, Response
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PICTURE_SIZE = (960, 640)
"""Width and height of a picture, in pixels."""

# Colours of Okabe and Ito, which colour-blind readers can distinguish too.
DRIVE_COLOUR, HYSTERETIC_COLOUR, SENSOR_COLOUR = "#555555", "#D55E00", "#0072B2"
EFFECTIVE_COLOUR, NEXT_COLOUR = "#009E73", "#CC79A7"

AnyResponse = Response | AugmentedResponse

POINTS = 2000
"""Number of evenly spaced times in a curve."""
FAINTEST_SHOWN = 1e-3
"""Size of the faintest peak drawn if the window is infinite, as a share of the largest peak."""


def _ended_s(response: AnyResponse) -> float:
    """Time at which the drive ends, in seconds."""
    return float(response.knot_times_s[-1])


def _text(value: float, decimals: int) -> str:
    """A number as text, with a minus sign instead of a hyphen, and never −0."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}".replace("-", "−")


def _legend_above(axes: Axes) -> None:
    """Add a legend in one line beside the title, where it cannot overlap a curve."""
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=4,
        frameon=False,
        fontsize="small",
        borderaxespad=0.2,
        columnspacing=1.2,
        handletextpad=0.4,
    )


def _leave_room(axes: Axes, which: str) -> None:
    """Widen the limits of an axis to at least ±1 V, so that a constant curve is not magnified."""
    for axis in which:
        low, high = getattr(axes, f"get_{axis}lim")()
        if high - low < 2.0:
            getattr(axes, f"set_{axis}lim")(min(low, -1.0), max(high, 1.0))


def _shown_s(response: AnyResponse) -> float:
    """Time up to which the response is drawn, in seconds: the window, or as long as peaks are visible."""
    if np.isfinite(response.window_s):
        return response.window_s
    magnitude = np.abs(response.peaks_V)
    seen = response.peak_times_s[magnitude > FAINTEST_SHOWN * magnitude.max(initial=0.0)]
    return max(float(seen.max(initial=0.0)), 1.25 * _ended_s(response))


def _times_s(response: AnyResponse, end_s: float) -> Real:
    """Times of the points of a curve, in seconds: evenly spaced ones, the corners of the drive, and the peaks."""
    own = np.concatenate([response.knot_times_s, response.peak_times_s])
    return np.union1d(np.linspace(0.0, end_s, POINTS), own[own <= end_s])


def draw_drive(axes: Axes, response: AnyResponse | None) -> None:
    """Draw the drive and the hysteretic drive against time in µs."""
    if response is not None:
        time_s = _times_s(response, _ended_s(response) * 1.08)
        axes.plot(
            [t * 1e6 for t in (*response.knot_times_s, time_s[-1])],
            [*response.knot_drive_V, response.knot_drive_V[-1]],
            color=DRIVE_COLOUR,
            label="requested",
        )
        axes.plot(time_s * 1e6, response.hysteretic_V(time_s), color=HYSTERETIC_COLOUR, label="after hysteresis")
        axes.margins(x=0.0, y=0.08)
        _leave_room(axes, "y")
        _legend_above(axes)
    axes.set(title="Drive", xlabel="Time (µs)", ylabel="Drive (V)")


def draw_loop(axes: Axes, response: AnyResponse | None) -> None:
    """Draw the hysteretic drive against the drive, with a straight line for comparison."""
    if response is not None:
        time_s = _times_s(response, _ended_s(response))
        drive_V, hysteretic_V = response.drive_V(time_s), response.hysteretic_V(time_s)
        axes.axline((0.0, 0.0), slope=1.0, color="0.8", linewidth=1.0, zorder=0)
        axes.plot(drive_V, hysteretic_V, color=HYSTERETIC_COLOUR)
        _leave_room(axes, "xy")
    axes.set(title="Hysteresis", xlabel="Drive (V)", ylabel="Hysteretic drive (V)")


def draw_response(axes: Axes, response: AnyResponse | None, cost: PeakCost) -> None:
    """Draw the self-sensed signal and its peaks against time in µs; the effective peak and the next are highlighted."""
    axes.set(title="Self-sensed response", xlabel="Time (µs); grey: waveform", ylabel="Signal (V)")
    if response is None:
        return
    times_us, peaks_V = response.peak_times_s * 1e6, response.peaks_V
    end_s = _shown_s(response)
    time_s = _times_s(response, end_s)
    axes.axvspan(0.0, min(_ended_s(response), end_s) * 1e6, color="0.95", zorder=0)
    axes.axhline(0.0, color="0.8", linewidth=1.0, zorder=0)
    axes.plot(time_s * 1e6, response.sensor_V(time_s), color=SENSOR_COLOUR)
    effective = cost.effective_index(peaks_V)
    others = response.peak_times_s <= end_s
    if effective is not None:
        for index, colour, label, weight in (
            (effective, EFFECTIVE_COLOUR, "effective peak", cost.A),
            (effective + 1, NEXT_COLOUR, "next peak", cost.B),
        ):
            if index < peaks_V.size:
                others[index] = False
                label = f"{label} {_text(peaks_V[index], 2)} V, weight {weight:g}".replace("-", "−")
                axes.plot(times_us[index], peaks_V[index], "o", color=colour, markersize=9, label=label)
    if others.any():
        axes.plot(times_us[others], peaks_V[others], "o", color=SENSOR_COLOUR, markersize=4, label="others, weight 1")
    axes.margins(x=0.01, y=0.12)
    _leave_room(axes, "y")
    if peaks_V.size:
        _legend_above(axes)


def _heading(response: AnyResponse, cost: PeakCost) -> str:
    """Heading with the cost and the seven parameters of the waveform."""
    volts = " and ".join(_text(float(u), 1) for u in (response.knot_drive_V[1], response.knot_drive_V[3]))
    durations = ", ".join(_text(float(t), 2) for t in np.diff(response.knot_times_s) * 1e6)
    return f"Peak cost {_text(response.cost(cost), 2)} V\nU {volts} V,  t {durations} µs"


def picture(response: AnyResponse | None, cost: PeakCost) -> NDArray[np.uint8]:
    """Picture of a response, shape (640, 960, 3); empty axes if there is none yet."""
    with extra("a picture"):
        from matplotlib import rc_context
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    style: dict[Any, Any] = {
        "font.size": 11.0,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.titlelocation": "left",
        "axes.titleweight": "bold",
        "axes.titlesize": 11.5,
        "lines.linewidth": 1.8,
    }
    with rc_context(style):
        dpi = 100
        figure = Figure(figsize=(PICTURE_SIZE[0] / dpi, PICTURE_SIZE[1] / dpi), dpi=dpi)
        canvas = FigureCanvasAgg(figure)
        figure.set_layout_engine("constrained", w_pad=0.12, h_pad=0.10)
        axes = figure.subplot_mosaic([["drive", "loop"], ["response", "response"]], width_ratios=[3, 2])
        draw_drive(axes["drive"], response)
        draw_loop(axes["loop"], response)
        draw_response(axes["response"], response, cost)
        if response is None:
            figure.suptitle("No waveform fired yet", fontsize=15)
            for each in axes.values():
                each.set(xticks=[], yticks=[])
        else:
            figure.suptitle(_heading(response, cost), fontsize=13)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()
