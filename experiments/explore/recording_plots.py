"""Plots of one recording: drive, measured beside modelled, residual in its noise band; their time axes are one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import panel as pn
from bokeh.models import BoxAnnotation, ColumnDataSource, Range1d

from inkjet_env.experiments.explore.figures import BLUE, GREY, ORANGE, SKY, fit, legend_above, new_figure, put
from inkjet_env.experiments.explore.traces import decimated
from inkjet_env.identification import Evaluation
from inkjet_env.recordings import Recording
from inkjet_env.reporting.plotting import time_scale
from inkjet_env.typing import Real

BOTH_ENDS_MS = 5
"""Time in milliseconds within which both ends of the time axis are told, one after the other."""
BAND = 2.0
"""Half width of the noise band, in standard deviations of the noise."""


class RecordingPlots:
    """Figures and their data; zooming fetches the samples that can be seen."""

    def __init__(self) -> None:
        self.second = 1e-6
        self.recording: Recording | None = None
        self.evaluation: Evaluation | None = None
        self.residual: Real | None = None
        self.sources = {
            name: ColumnDataSource({"x": [], "y": []}, name=f"recorded {name}")
            for name in ("drive", "measured", "modelled", "left")
        }
        self.time = Range1d(0, 1)
        self.drive = new_figure("", "drive (V)", height=150, x_range=self.time, y_range=Range1d(-1, 1))
        self.drive.line("x", "y", source=self.sources["drive"], color=GREY, line_width=1.5)
        self.signal = new_figure(
            "", "signal", height=300, x_range=self.time, y_range=Range1d(-1, 1), name="recorded signal"
        )
        self.signal.line("x", "y", source=self.sources["measured"], color=SKY, line_width=3, legend_label="measured")
        self.signal.line("x", "y", source=self.sources["modelled"], color=BLUE, line_width=1.4, legend_label="modelled")
        self.left = new_figure(
            "time (µs)", "measured − modelled", height=220, x_range=self.time, y_range=Range1d(-1, 1)
        )
        self.left.line("x", "y", source=self.sources["left"], color=ORANGE, line_width=1.2, legend_label="residual")
        self.band = BoxAnnotation(fill_color=GREY, fill_alpha=0.22, line_color=None, visible=False)
        self.left.add_layout(self.band)
        legend_above(self.signal)
        legend_above(self.left)
        self.time.on_change("start", self._zoomed)
        self.time.on_change("end", self._zoomed)
        self._waiting = False

    def draw(self, recording: Recording, evaluation: Evaluation | None, noise: float, model: str) -> None:
        """Show a recording, and its simulation if there is one."""
        other = self.recording is None or recording.name != self.recording.name
        self.recording, self.evaluation = recording, evaluation
        self.residual = None if evaluation is None else recording.sensor - evaluation.modelled
        unit = {"um": "µm"}.get(recording.unit, recording.unit)
        self.signal.yaxis.axis_label = f"signal ({unit})"
        self.signal.legend.items[1].label = {"value": f"modelled: {model}"}
        known = not math.isnan(noise)
        text = f"residual ({unit})" + (f"; grey: ±{BAND:g} noise, {noise:.3g} {unit}" if known else "; noise unknown")
        self.left.legend.items[0].label = {"value": text}
        self.left.yaxis.axis_label = f"residual ({unit})"
        self.band.visible = known
        if known:
            self.band.update(bottom=-BAND * noise, top=BAND * noise)
        if other:
            self.second, symbol = time_scale(recording.duration_s)
            self.left.xaxis.axis_label = f"time ({symbol})"
            begin_s = float(recording.time_s[0])
            fit(self.time, begin_s / self.second, (begin_s + recording.duration_s) / self.second, False)
        signals = [recording.sensor] if evaluation is None else [recording.sensor, evaluation.modelled]
        _fit_all(self.drive.y_range, [recording.drive_V], 1.0)
        _fit_all(self.signal.y_range, signals)
        if self.residual is not None:
            largest = max(float(np.abs(self.residual).max()), 3 * noise if known else 0.0, 1e-12)
            fit(self.left.y_range, -1.1 * largest, 1.1 * largest, False)
        self._fill()

    def _zoomed(self, attr: str, old: Any, new: Any) -> None:
        """Fill the plots soon, and once for both ends of the axis."""
        document = self.time.document
        if document is None or document.session_context is None:
            self._refill()
        elif not self._waiting:
            self._waiting = True
            document.add_timeout_callback(self._refill, BOTH_ENDS_MS)

    def _refill(self) -> None:
        self._waiting = False
        if self.recording is not None:
            with pn.io.hold(self.time.document):
                self._fill()

    def _fill(self) -> None:
        """Send what can be seen."""
        recording, evaluation = self.recording, self.evaluation
        assert recording is not None
        self._put("drive", recording.drive_V)
        self._put("measured", recording.sensor)
        self._put("modelled", None if evaluation is None else evaluation.modelled)
        self._put("left", self.residual)

    def _put(self, name: str, signal: Real | None) -> None:
        assert self.recording is not None
        if signal is None:
            self.sources[name].data = {"x": [], "y": []}
            return
        begin_s, step_s = float(self.recording.time_s[0]), self.recording.step_s
        time_s, values = decimated(begin_s, step_s, signal, self.time.start * self.second, self.time.end * self.second)
        put(self.sources[name], {"x": time_s / self.second, "y": values})


def _fit_all(range_: Range1d, signals: list[Real], least: float = 1e-12) -> None:
    """Show all of some signals, and at least ``least`` beyond them."""
    low, high = min(float(one.min()) for one in signals), max(float(one.max()) for one in signals)
    margin = max(0.08 * (high - low), least)
    fit(range_, low - margin, high + margin, False)
