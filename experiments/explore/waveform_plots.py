"""The four plots of *Waveform*: drive with corners to drag, response with its peaks, hysteresis loop, spectrum."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from bokeh.events import Pan, PanEnd, PanStart
from bokeh.models import ColumnDataSource, HoverTool, Range1d, Span

from inkjet_env.experiments.explore.curves import DROPS, Curves, Head
from inkjet_env.experiments.explore.drives import Drive
from inkjet_env.experiments.explore.figures import (
    AMBER,
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PIN_COLOURS,
    PINK,
    SKY,
    fit,
    legend_above,
    new_figure,
    put,
)
from inkjet_env.experiments.explore.waveform_state import WaveformState
from inkjet_env.typing import Real

REACH_PX = 26
"""Distance in pixels from which a corner is grasped."""
DROP_COLOURS = (SKY, GREEN, AMBER, PINK)


class WaveformPlots:
    """Figures and their data.

    Parameters
    ----------
    state : WaveformState
        What is drawn, and changed by dragging.
    dragged : callable
        Called after every change that dragging makes.
    """

    def __init__(self, state: WaveformState, dragged: Any) -> None:
        self.state, self.dragged = state, dragged
        self.grasped: int | None = None
        self.sources = {name: ColumnDataSource({"x": [], "y": []}, name=name) for name in (
            "drive", "corners", "sensor", "peaks", "effective", "next", "loop", "spectrum",
            *(f"drop {k + 1}" for k in range(DROPS)),
        )}  # fmt: skip
        for name in ("steep", "pinned drives", "pinned responses"):
            self.sources[name] = ColumnDataSource({key: [] for key in ("xs", "ys", "colour", "name")})
        self.drive, self.response = self._drive_figure(), self._response_figure()
        self.loop, self.spectrum = self._loop_figure(), self._spectrum_figure()

    def _drive_figure(self) -> Any:
        made = new_figure(
            "time (µs)", "drive (V)", "Drive: drag its corners", tools="xwheel_zoom,reset,save", height=270,
            x_range=Range1d(-3, 100), y_range=Range1d(-120, 120), name="drive",
        )  # fmt: skip
        self.limit_spans = [Span(dimension="width", line_color=ORANGE, line_dash="dashed", visible=False) for _ in "ab"]
        for span in self.limit_spans:
            made.add_layout(span)
        made.multi_line(
            "xs", "ys", line_color="colour", source=self.sources["pinned drives"], line_dash="dashed", line_width=1.5
        )
        made.line("x", "y", source=self.sources["drive"], color=BLUE, line_width=2)
        made.multi_line("xs", "ys", source=self.sources["steep"], line_color=ORANGE, line_width=4)
        made.scatter(
            "x", "y", source=self.sources["corners"], size=13, fill_color="white", line_color=BLUE, line_width=2
        )
        made.on_event(PanStart, self._grasp)
        made.on_event(Pan, self._drag)
        made.on_event(PanEnd, self._let_go)
        return made

    def _response_figure(self) -> Any:
        made = new_figure(
            "time since the drop's start (µs)", "response (V)", height=320, x_range=Range1d(0, 350),
            y_range=Range1d(-8, 8), name="response",
        )  # fmt: skip
        made.multi_line(
            "xs", "ys", line_color="colour", source=self.sources["pinned responses"], line_dash="dashed",
            line_width=1.3,
        )  # fmt: skip
        self.drop_lines = [
            made.line("x", "y", source=self.sources[f"drop {k + 1}"], color=colour, line_width=1.3,
                      legend_label=f"drop {k + 1}", visible=False)
            for k, colour in enumerate(DROP_COLOURS)
        ]  # fmt: skip
        made.line("x", "y", source=self.sources["sensor"], color=BLUE, line_width=1.8, legend_label="response")
        peaks = made.scatter("x", "y", source=self.sources["peaks"], size=5, color=BLUE, legend_label="peaks")
        made.scatter(
            "x", "y", source=self.sources["effective"], size=13, fill_color=None, line_color=BLACK, line_width=2,
            legend_label="effective",
        )  # fmt: skip
        made.scatter(
            "x", "y", source=self.sources["next"], size=13, marker="diamond", fill_color=None, line_color=ORANGE,
            line_width=2, legend_label="next",
        )  # fmt: skip
        made.add_tools(HoverTool(renderers=[peaks], tooltips=[("peak", "@y{0.000} V at @x{0.00} µs")]))
        legend_above(made)
        self.drop_items = made.legend[0].items[: len(self.drop_lines)]
        return made

    def _loop_figure(self) -> Any:
        made = new_figure(
            "drive (V)", "hysteretic drive (V)", "Hysteresis loop", x_range=Range1d(-120, 120),
            y_range=Range1d(-120, 120),
        )  # fmt: skip
        made.line("x", "y", source=self.sources["loop"], color=BLUE, line_width=1.8)
        return made

    def _spectrum_figure(self) -> Any:
        made = new_figure("frequency (kHz)", "|response| (V·µs)", x_range=Range1d(0, 200), y_range=Range1d(0, 100))
        made.line("x", "y", source=self.sources["spectrum"], color=BLUE, line_width=1.8)
        self.resonance = Span(dimension="height", line_color=GREY, line_dash="dashed")
        made.add_layout(self.resonance)
        return made

    def draw(self, found: Curves, head: Head, pinned: list[tuple[str, Drive, Curves]], settled: bool) -> None:
        """Put new data into every plot; axes shrink only once a gesture has ``settled``."""
        knots_s, knots_V = self.state.drive.knots()
        time_us, knots_us = found.time_s * 1e6, knots_s * 1e6
        end_us = max(float(knots_us[-1]), *(1e6 * one.duration_s for _, one, _ in pinned), 1.0)
        drive_us = np.concatenate([[-1e3], knots_us, [1e5]])
        self._put("drive", drive_us, np.concatenate([[knots_V[0]], knots_V, [knots_V[-1]]]))
        self._put("corners", knots_us, knots_V)
        self._put("sensor", time_us, found.sensor_V)
        self._put("peaks", found.peak_times_s * 1e6, found.peaks_V)
        e = found.effective
        one = slice(0, 0) if e is None else slice(e, e + 1)
        two = slice(0, 0) if e is None else slice(e + 1, e + 2)
        for name, part in (("effective", one), ("next", two)):
            self._put(name, found.peak_times_s[part] * 1e6, found.peaks_V[part])
        self._put("loop", found.loop_drive_V, found.loop_hysteretic_V)
        self._put("spectrum", found.frequency_Hz / 1e3, found.spectrum_Vs * 1e6)
        self._draw_train(found)
        self._draw_pinned(pinned)
        self._draw_limits(knots_us, knots_V)
        largest_V = max(
            1.0, *(float(np.abs(one.knots()[1]).max()) for one in (self.state.drive, *(p[1] for p in pinned)))
        )
        fit(self.drive.x_range, -0.03 * end_us, 1.12 * end_us, not settled)
        fit(self.drive.y_range, -1.15 * largest_V, 1.15 * largest_V, not settled)
        fit(self.response.x_range, 0.0, float(time_us[-1]), not settled)
        heights = [float(np.abs(one.sensor_V).max()) for one in (found, *(p[2] for p in pinned))]
        heights += [float(np.abs(one).max()) for one in found.drops]
        top_V = 1.1 * max(1e-3, *heights)
        fit(self.response.y_range, -top_V, top_V, not settled)
        for axis, values in ((self.loop.x_range, found.loop_drive_V), (self.loop.y_range, found.loop_hysteretic_V)):
            margin_V = max(1.0, 0.06 * float(np.ptp(values)))
            fit(axis, float(values.min()) - margin_V, float(values.max()) + margin_V, not settled)
        fit(self.spectrum.x_range, 0.0, float(found.frequency_Hz[-1]) / 1e3, not settled)
        fit(self.spectrum.y_range, 0.0, 1.08e6 * max(float(found.spectrum_Vs.max()), 1e-12), not settled)
        self.resonance.location = head.frequency_Hz / 1e3
        self.spectrum.title.text = f"Spectrum; dashed: resonance, {head.frequency_Hz / 1e3:.4g} kHz"

    def _put(self, name: str, x: Real, y: Real) -> None:
        put(self.sources[name], {"x": np.asarray(x), "y": np.asarray(y)})

    def _draw_train(self, found: Curves) -> None:
        for k, line in enumerate(self.drop_lines):
            there = k < len(found.drops)
            line.visible = self.drop_items[k].visible = there
            if there:
                self._put(f"drop {k + 1}", found.drop_times_s * 1e6, found.drops[k])
        frequency_Hz = self.state.conditions.drop_frequency_Hz
        self.response.title.text = (
            f"Response at {frequency_Hz / 1e3:.4g} kHz, once the train is steady"
            if frequency_Hz
            else "Response to one drop"
        )

    def _draw_pinned(self, pinned: list[tuple[str, Drive, Curves]]) -> None:
        colours = list(PIN_COLOURS[: len(pinned)])
        names = [name for name, _, _ in pinned]
        drives = [one.knots() for _, one, _ in pinned]
        told = {"colour": colours, "name": names}
        put(self.sources["pinned drives"], {"xs": [t * 1e6 for t, _ in drives], "ys": [v for _, v in drives]} | told)
        put(
            self.sources["pinned responses"],
            {"xs": [c.time_s * 1e6 for _, _, c in pinned], "ys": [c.sensor_V for _, _, c in pinned]} | told,
        )

    def _draw_limits(self, knots_us: Real, knots_V: Real) -> None:
        limits = self.state.limits
        for span, level_V in zip(self.limit_spans, (limits.lowest_V, limits.highest_V), strict=True):
            span.visible = math.isfinite(level_V)
            if span.visible:
                span.location = level_V
        with np.errstate(divide="ignore", invalid="ignore"):
            slews = np.diff(knots_V) / np.diff(knots_us)
        steep = np.flatnonzero(
            (slews > limits.rise_V_per_us * (1 + 1e-9)) | (-slews > limits.fall_V_per_us * (1 + 1e-9))
        )
        put(self.sources["steep"], {
            "xs": [knots_us[k : k + 2] for k in steep], "ys": [knots_V[k : k + 2] for k in steep],
            "colour": [ORANGE] * len(steep), "name": ["too steep"] * len(steep),
        })  # fmt: skip

    def _grasp(self, event: Any) -> None:
        """Take the corner under the pointer, if there is one."""
        times_s, volts = self.state.drive.knots()
        wide_px, high_px = self.drive.inner_width or 600, self.drive.inner_height or 200
        dx = (times_s * 1e6 - event.x) / (self.drive.x_range.end - self.drive.x_range.start) * wide_px
        dy = (volts - event.y) / (self.drive.y_range.end - self.drive.y_range.start) * high_px
        away_px = np.hypot(dx, dy)
        nearest = int(np.argmin(away_px))
        self.grasped = nearest if away_px[nearest] <= REACH_PX else None

    def _drag(self, event: Any) -> None:
        if self.grasped is not None:
            self.state.drag(self.grasped, event.x * 1e-6, event.y)
            self.dragged()

    def _let_go(self, event: Any) -> None:
        if self.grasped is not None:
            self._drag(event)
            self.grasped = None
            self.state.settle()
            self.dragged()
