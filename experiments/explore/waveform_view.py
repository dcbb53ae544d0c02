"""*Waveform*: sliders, corners to drag, drive, loop, response, cost's terms and spectrum; pin, undo, export."""

from __future__ import annotations

import html
import io
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import panel as pn

from inkjet_env.experiments.explore import exports
from inkjet_env.experiments.explore.curves import Conditions, Curves, Head, curves
from inkjet_env.experiments.explore.drives import Corners, Drive
from inkjet_env.experiments.explore.dwell_scan import DwellScan
from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.experiments.explore.figures import PIN_COLOURS
from inkjet_env.experiments.explore.quick_slider import QuickSlider
from inkjet_env.experiments.explore.style import column, row, set_differing, text_pane
from inkjet_env.experiments.explore.tables import cost_table, pinned_table
from inkjet_env.experiments.explore.view import Guarded, View
from inkjet_env.experiments.explore.waveform_plots import WaveformPlots
from inkjet_env.experiments.explore.waveform_state import MOST_PINNED
from inkjet_env.printhead import DriverLimits

PARAMETERS = (
    ("U1", "first plateau U1 (V)", 1.0, (0.0, 120.0, 0.5)),
    ("U2", "second plateau U2 (V)", 1.0, (-120.0, 0.0, 0.5)),
    ("t1", "rise t1 (µs)", 1e6, (0.1, 40.0, 0.05)),
    ("t2", "first dwell t2 (µs)", 1e6, (0.1, 40.0, 0.05)),
    ("t3", "fall t3 (µs)", 1e6, (0.1, 40.0, 0.05)),
    ("t4", "second dwell t4 (µs)", 1e6, (0.1, 40.0, 0.05)),
    ("t5", "return t5 (µs)", 1e6, (0.1, 40.0, 0.05)),
)
"""Name, label, displayed units in one SI unit, and slider of each parameter: start, end, step."""
SAME = 1e-9
"""Relative difference below which a slider shows the state already."""


class WaveformView(View):
    """One tab's view of the waveform."""

    name = "waveform"

    def __init__(self, exploration: Exploration, guarded: Guarded) -> None:
        super().__init__(exploration, guarded)
        self.state = exploration.waveform
        self._kept: list[tuple[Head, Drive, Conditions, Curves]] = []
        self.plots = WaveformPlots(self.state, lambda: guarded("waveform", lambda: None))
        self.sliders = [self._slider(k) for k in range(len(PARAMETERS))]
        self.frequency = QuickSlider(
            label="drop frequency (kHz)", start=0.0, end=60.0, step=0.1, value=0.0,
            format="0.00[0]", sizing_mode="stretch_width",
        )  # fmt: skip
        self.frequency.param.watch(self._frequency_moved, "value")
        self.head = pn.widgets.Select(label="head", options=[], sizing_mode="stretch_width")
        self.head.param.watch(self._head_chosen, "value")
        self.terms = text_pane()
        self.compared = text_pane()
        self.excesses = text_pane()
        self.command = pn.widgets.TextAreaInput(
            label="the command line that gives the same", rows=6, sizing_mode="stretch_width"
        )
        self.undo = self.button("Undo", self.state.undo)
        self.dwell = DwellScan(exploration, guarded)
        self.layout = self._layout()

    def _slider(self, k: int) -> Any:
        _, label, _, (start, end, step) = PARAMETERS[k]
        slider = QuickSlider(
            label=label, start=start, end=end, step=step, value=start, format="0.00[0]", sizing_mode="stretch_width"
        )

        def moved(event: Any, settled: bool) -> None:
            scale = PARAMETERS[k][2]
            if isinstance(self.state.drive, Corners):
                return
            if abs(event.new / scale - self.state.drive.to_array()[k]) > SAME * abs(event.new / scale):
                self.change(lambda: self.state.change_parameter(k, event.new / scale, settled))
            elif settled:
                self.change(self.state.settle)

        slider.param.watch(lambda event: moved(event, False), "value")
        slider.param.watch(lambda event: moved(event, True), "value_throttled")
        return slider

    def _layout(self) -> Any:
        state = self.state
        self.pin_choice = pn.widgets.Select(options=[], width=84)
        take = self.button("Edit it", lambda: state.take(self.pin_choice.value))
        drop = self.button("Remove", lambda: state.unpin(self.pin_choice.value))
        self.pin_row = row(self.pin_choice, take, drop)
        self.limits = pn.widgets.TextInput(
            label="what the driver can do", placeholder="lowest_V=0,highest_V=48,rise_V_per_us=20",
            sizing_mode="stretch_width",
        )  # fmt: skip
        self.limits.param.watch(self._limits_given, "value")
        self.weights = [
            pn.widgets.FloatInput(label="A", value=-5.0, width=80),
            pn.widgets.FloatInput(label="B", value=5.0, width=80),
            pn.widgets.TextInput(label="effective peak", value="largest", width=110),
        ]
        for one in self.weights:
            one.param.watch(self._cost_given, "value")
        self.drive_file = pn.widgets.FileInput(accept=".csv,.ini,.txt", sizing_mode="stretch_width")
        self.drive_file.param.watch(self._drive_given, "value")
        files = row(
            self._download("CSV", "waveform.csv", lambda: exports.csv_text(state.drive)),
            self._download("Segments", "waveform.ini", lambda: exports.ini_text(state.drive)),
            self._download("JSON", "waveform.json", lambda: exports.simulation_text(*self._shown)),
            self._download("PNG", "waveform.png", lambda: exports.picture(*self._shown)),
        )
        settings = pn.Card(
            text_pane("<p>cost = A·|effective| + B·|next| + Σ|others|</p>"), row(*self.weights), self.limits,
            self.button("Make it legal", state.make_legal), text_pane("<p>a drive file of any segments</p>"),
            self.drive_file, title="Cost, driver, drive file", collapsed=True, sizing_mode="stretch_width",
        )  # fmt: skip
        controls = column(
            self.head, *self.sliders, self.frequency, row(self.undo, self.button("Pin", state.pin)),
            self.dwell.button, self.pin_row, settings, kind="controls",
        )  # fmt: skip
        plots = self.plots
        drawn = column(
            self.excesses, plots.drive, plots.response,
            row(column(plots.loop, kind="half"), column(plots.spectrum, kind="half")),
            self.dwell.layout, kind="drawn",
        )  # fmt: skip
        told = column(self.terms, self.compared, files, self.command, kind="told")
        return row(controls, drawn, told, kind="view")

    def _download(self, label: str, name: str, content: Callable[[], str | bytes]) -> Any:
        def made() -> io.BytesIO | None:
            found: list[str | bytes] = []
            self.guarded("", lambda: found.append(content()))
            if not found:
                return None
            return io.BytesIO(found[0].encode() if isinstance(found[0], str) else found[0])

        return pn.widgets.FileDownload(callback=made, filename=name, label=label, width=96)

    @property
    def _shown(self) -> tuple[Any, Any, Any]:
        """Head, drive and conditions as they are now."""
        return self.exploration.shelf.head.head, self.state.drive, self.state.conditions

    def _head_chosen(self, event: Any) -> None:
        if event.new is not None and event.new != self.exploration.shelf.chosen:
            self.change(lambda: self.exploration.shelf.choose(event.new))

    def _frequency_moved(self, event: Any) -> None:
        if abs(event.new * 1e3 - self.state.conditions.drop_frequency_Hz) > 1e-6:
            self.change(lambda: self.state.set_drop_frequency(event.new * 1e3))

    def _limits_given(self, event: Any) -> None:
        self.change(lambda: setattr(self.state, "limits", DriverLimits.from_text(event.new)))

    def _cost_given(self, _: Any) -> None:
        A, B, rule = (one.value for one in self.weights)

        def judged() -> None:
            try:
                effective: str | float = float(rule)
            except ValueError:
                effective = rule.strip()
            self.state.set_cost(replace(self.state.conditions.cost, A=A, B=B, effective=effective))

        self.change(judged)

    def _drive_given(self, event: Any) -> None:
        if event.new:
            self.change(lambda: self.exploration.open_drive(self.drive_file.filename, event.new))

    def _draw(self) -> None:
        state, head = self.state, self.exploration.shelf.head
        found = curves(head.head, state.drive, state.conditions)
        single = replace(state.conditions, drop_frequency_Hz=0.0)
        pinned = [(one.name, one.drive, self._of_pinned(head.head, one.drive, single)) for one in state.pinned]
        self.plots.draw(found, head.head, pinned, state.settled)
        self._show_controls()
        self.terms.object = cost_table(found.terms, state.conditions.cost, found.figures)
        rows = [("now", "#0072b2", found), *((n, c, d) for (n, _, d), c in zip(pinned, PIN_COLOURS, strict=False))]
        self.compared.object = pinned_table(rows) if pinned else ""
        told = [f"<li>The drive {html.escape(text)}</li>" for text in state.excesses()]
        self.excesses.object = f"<ul class='excess'>{''.join(told)}</ul>" if told else ""
        self.dwell.draw()
        self.command.value = exports.command_text(head, state.drive, state.conditions)

    def _of_pinned(self, head: Head, drive: Drive, conditions: Conditions) -> Curves:
        """Curves of a pinned drive, which are kept while it is pinned and nothing else changes."""
        kept = next((found for *key, found in self._kept if key == [head, drive, conditions]), None)
        if kept is None:
            kept = curves(head, drive, conditions)
            self._kept = [*self._kept, (head, drive, conditions, kept)][-MOST_PINNED:]
        return kept

    def _show_controls(self) -> None:
        state, shelf = self.state, self.exploration.shelf
        set_differing(self.head, options=list(shelf.heads), value=shelf.chosen)
        segments = isinstance(state.drive, Corners)
        for k, slider in enumerate(self.sliders):
            if slider.disabled != segments:
                slider.disabled = segments
            if not isinstance(state.drive, Corners):
                set_differing(slider, value=float(state.drive.to_array()[k]) * PARAMETERS[k][2])
        highest_kHz = 1e-3 / state.drive.duration_s if state.drive.duration_s else 1e3
        set_differing(self.frequency, end=round(highest_kHz, 3), value=state.conditions.drop_frequency_Hz / 1e3)
        names = [one.name for one in state.pinned]
        set_differing(self.pin_choice, options=names)
        if names and self.pin_choice.value not in names:
            self.pin_choice.value = names[-1]
        set_differing(self.pin_row, visible=bool(names))
        cost = state.conditions.cost
        for one, value in zip(self.weights, (cost.A, cost.B, f"{cost.effective}"), strict=True):
            set_differing(one, value=value)
        set_differing(self.limits, value=",".join(f"{k}={v:g}" for k, v in state.limits.as_json().items()))
        set_differing(self.undo, disabled=not state.can_undo)
