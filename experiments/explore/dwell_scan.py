"""The first dwell scanned at one click: which one gives the highest drop, and which one the quietest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import panel as pn
from bokeh.models import ColumnDataSource, Range1d, Span

from inkjet_env.experiments.explore.drives import Corners
from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.experiments.explore.figures import BLUE, GREY, ORANGE, fit, legend_above, new_figure, put
from inkjet_env.experiments.explore.style import column, row, set_differing, text_pane
from inkjet_env.jetting.scans import Curve, pulse_width_scan

STEP_S = 5e-8
"""Step of the slider, to which a dwell is rounded."""


class DwellScan:
    """The button, and below the plots what it finds; that disappears when the waveform becomes another one.

    Parameters
    ----------
    exploration : Exploration
        The state.
    guarded : callable
        Runs a change, tells a refusal in a sentence and the change to every tab.
    """

    def __init__(self, exploration: Exploration, guarded: Callable[[str, Callable[[], object]], None]) -> None:
        self.exploration, self.state = exploration, exploration.waveform
        self.button = pn.widgets.Button(label="Scan the dwell t2")
        self.button.on_click(lambda _: guarded("waveform", self.scan))
        self.highest = pn.widgets.Button(label="Take the highest drop")
        self.highest.on_click(lambda _: guarded("waveform", lambda: self.take(highest)))
        self.quietest = pn.widgets.Button(label="Take the least residual")
        self.quietest.on_click(lambda _: guarded("waveform", lambda: self.take(quietest)))
        self.said = text_pane()
        self.sources = {name: ColumnDataSource({"x": [], "y": []}, name=f"scanned {name}") for name in ("drop", "left")}
        self.figure = new_figure(
            "first dwell t2 (µs)", "peak (V)", "Scan of t2, single drops; dashed: now", height=250,
            x_range=Range1d(0, 40), y_range=Range1d(0, 10),
        )  # fmt: skip
        lines = (("drop", BLUE, "effective peak"), ("left", ORANGE, "residual: largest peak after it"))
        for name, colour, label in lines:
            self.figure.line("x", "y", source=self.sources[name], color=colour, line_width=1.8, legend_label=label)
        legend_above(self.figure)
        self.now = Span(dimension="height", line_color=GREY, line_dash="dashed")
        self.figure.add_layout(self.now)
        self.layout = column(self.said, self.figure, row(self.highest, self.quietest))
        self.layout.visible = False

    @property
    def _made_for(self) -> Any:
        """What a scan belongs to: everything but the dwell."""
        state = self.state
        conditions = replace(state.conditions, drop_frequency_Hz=0.0)
        drive = state.drive if isinstance(state.drive, Corners) else replace(state.drive, t2=0.0)
        return self.exploration.shelf.head, drive, conditions

    @property
    def curve(self) -> Curve | None:
        """The scan of this waveform; None if there is none."""
        scanned = self.state.scanned
        return scanned[1] if scanned is not None and scanned[0] == self._made_for else None

    def scan(self) -> None:
        """Scan the dwell of the waveform."""
        state = self.state
        if isinstance(state.drive, Corners):
            raise ValueError("a drive of segments has no dwell t2; drag its corners.")
        found = pulse_width_scan(
            self.exploration.shelf.head.head, state.drive, state.conditions.cost, window_s=state.conditions.window_s
        )
        if np.isnan(found.effective_V).all():
            raise ValueError("no dwell gives a peak that ejects a drop. Choose another effective peak, or more volts.")
        state.scanned = self._made_for, found

    def take(self, which: Callable[[Curve], int]) -> None:
        """Change the dwell to one that the scan found."""
        curve = self.curve
        if curve is None:
            raise ValueError("the waveform is another one than was scanned. Scan again.")
        dwell_s = max(float(curve.values[which(curve)]), STEP_S)
        self.state.change_parameter(3, round(dwell_s / STEP_S) * STEP_S)

    def draw(self) -> None:
        """Show the scan, if it is one of this waveform."""
        curve = self.curve
        set_differing(self.layout, visible=curve is not None)
        set_differing(self.button, disabled=isinstance(self.state.drive, Corners))
        if curve is None or isinstance(self.state.drive, Corners):
            return
        for name, heights_V in (("drop", curve.effective_V), ("left", curve.residual_V)):
            put(self.sources[name], {"x": curve.values * 1e6, "y": heights_V})
        fit(self.figure.x_range, 0.0, float(curve.values[-1]) * 1e6, False)
        fit(self.figure.y_range, 0.0, 1.1 * float(np.nanmax([curve.effective_V, curve.residual_V])), False)
        self.now.location = self.state.drive.t2 * 1e6
        self.said.object = scan_sentence(curve)


def highest(curve: Curve) -> int:
    """Index of the dwell with the highest effective peak."""
    return int(np.nanargmax(curve.effective_V))


def quietest(curve: Curve) -> int:
    """Index of the dwell with the least residual, as a share of the effective peak."""
    return int(np.nanargmin(curve.residual_V / curve.effective_V))


def scan_sentence(curve: Curve) -> str:
    """Which dwell gives the highest drop, and which one the quietest, as HTML."""
    k, q = highest(curve), quietest(curve)
    share = 100 * curve.residual_V[q] / curve.effective_V[q]
    return (
        f"<p>The head rings most at t2 = <b>{1e6 * curve.values[k]:.3g} µs</b>: effective peak "
        f"{curve.effective_V[k]:.3g} V. The residual is least, {share:.3g} %, at {1e6 * curve.values[q]:.3g} µs.</p>"
    )
