"""*Optimise*: choose optimiser, problem, budget and seed; convergence and the best waveform while it runs."""

from __future__ import annotations

import html
from typing import Any

import numpy as np
import panel as pn
from bokeh.models import ColumnDataSource, Range1d

from inkjet_env import optimizers
from inkjet_env.experiments.benchmark.suite import suite
from inkjet_env.experiments.explore.curves import Conditions, curves
from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.experiments.explore.figures import BLUE, ORANGE, fit, legend_above, new_figure
from inkjet_env.experiments.explore.search import FAILED, PAUSED, RUNNING, Progress
from inkjet_env.experiments.explore.search_plan import NOT_ROBUST
from inkjet_env.experiments.explore.style import column, row, set_differing, text_pane
from inkjet_env.experiments.explore.view import Guarded, View
from inkjet_env.plant.head_ensemble import RISKS
from inkjet_env.reporting.waveform_figures import signed


class OptimiseView(View):
    """One tab's view of the search."""

    name = "optimise"

    def __init__(self, exploration: Exploration, guarded: Guarded) -> None:
        super().__init__(exploration, guarded)
        self.state = exploration.optimise
        self.widgets = {
            "optimizer": pn.widgets.Select(label="optimiser", options=list(optimizers.names())),
            "problem": pn.widgets.Select(label="problem", options=list(suite())),
            "budget": pn.widgets.IntInput(label="budget (evaluations)", start=1),
            "seed": pn.widgets.IntInput(label="seed", start=0),
            "head": pn.widgets.Select(label="head (published: the problem's own)", options=[]),
            "robust": pn.widgets.Select(label="robust over the possible heads", options=[NOT_ROBUST, *RISKS]),
        }
        for name, widget in self.widgets.items():
            widget.sizing_mode = "stretch_width"
            widget.param.watch(lambda event, name=name: self._chosen(name, event.new), "value")
        shelf, waveform = exploration.shelf, exploration.waveform
        self.start = self.button("Start", lambda: self.state.start(shelf, waveform), "primary")
        self.pause = self.button("Pause", self._pause_or_resume)
        self.stop = self.button("Stop", self.state.stop)
        self.take = self.button("Edit in Waveform", self._take_over)
        self.said = text_pane()
        self.command = pn.widgets.TextAreaInput(
            label="the command line that finds the same", rows=5, sizing_mode="stretch_width"
        )
        self.sources = {name: ColumnDataSource({"x": [], "y": []}) for name in ("best", "now", "drive", "sensor")}
        self.convergence = new_figure(
            "evaluations", "lowest cost so far (V)", "Convergence", x_range=Range1d(0, 1), y_range=Range1d(0, 1)
        )
        self.convergence.step("x", "y", source=self.sources["best"], color=BLUE, line_width=2, mode="after")
        self.convergence.scatter("x", "y", source=self.sources["now"], color=BLUE, size=8)
        self.waveform = new_figure(
            "time (µs)", "drive (V)", "Best waveform", x_range=Range1d(-3, 100), y_range=Range1d(-120, 120)
        )
        self.waveform.line("x", "y", source=self.sources["drive"], color=BLUE, line_width=2)
        self.response = new_figure(
            "time (µs)", "response (V)", "Its response", x_range=Range1d(0, 350), y_range=Range1d(-8, 8)
        )
        self.response.line("x", "y", source=self.sources["sensor"], color=BLUE, line_width=1.8, legend_label="best")
        self.edited = ColumnDataSource({"x": [], "y": []})
        self.response.line(
            "x", "y", source=self.edited, color=ORANGE, line_dash="dashed", legend_label="in Waveform now"
        )
        legend_above(self.response)
        note = text_pane("<p>Cost and driver's limits are those of <i>Waveform</i>, where they are not the usual.</p>")
        controls = column(
            *self.widgets.values(), note, row(self.start, self.pause, self.stop), self.take, self.command,
            kind="controls",
        )  # fmt: skip
        drawn = column(
            self.said, self.convergence, row(column(self.waveform, kind="half"), column(self.response, kind="half")),
            kind="drawn",
        )  # fmt: skip
        self.layout = row(controls, drawn, kind="view")

    def _chosen(self, name: str, value: Any) -> None:
        if value is not None and getattr(self.state.settings, name) != value:
            self.change(lambda: self.state.change(**{name: value}))

    def _pause_or_resume(self) -> None:
        progress = self.state.progress
        if progress is not None and progress.state == PAUSED:
            self.state.resume()
        else:
            self.state.pause()

    def _take_over(self) -> None:
        self.state.take_over(self.exploration.shelf, self.exploration.waveform)
        self.exploration.changed("waveform")

    def _draw(self) -> None:
        state, progress = self.state, self.state.progress
        set_differing(self.widgets["head"], options=list(self.exploration.shelf.heads))
        for name, widget in self.widgets.items():
            set_differing(widget, value=getattr(state.settings, name))
        set_differing(self.start, disabled=state.busy)
        set_differing(self.stop, disabled=not state.busy)
        paused = progress is not None and progress.state == PAUSED
        set_differing(self.pause, disabled=not state.busy, label="Resume" if paused else "Pause")
        set_differing(self.take, disabled=progress is None or progress.best is None)
        self.command.value = state.command_text(self.exploration.shelf, self.exploration.waveform)
        self.said.object = said(progress)
        if progress is not None and progress.best is not None:
            self._draw_progress(progress)

    def _draw_progress(self, progress: Progress) -> None:
        history = np.array(progress.history, dtype=np.float64).reshape(-1, 2)
        self.sources["best"].data = {"x": history[:, 0], "y": history[:, 1]}
        self.sources["now"].data = {"x": history[-1:, 0], "y": history[-1:, 1]}
        fit(self.convergence.x_range, 0.0, 1.02 * progress.budget, False)
        low, high = float(history[:, 1].min()), float(history[:, 1].max())
        margin = 0.08 * max(high - low, 0.1)
        fit(self.convergence.y_range, low - margin, high + margin, False)
        search, shelf = self.state.search, self.exploration.shelf
        head = shelf.heads[self.state.settings.head].head
        conditions = Conditions()
        if search is not None:
            problem = search.plan.problem
            head, conditions = problem.printhead, Conditions(problem.cost, drop_frequency_Hz=problem.jetting_Hz)
        assert progress.best is not None
        found = curves(head, progress.best, conditions)
        knots_s, knots_V = progress.best.knots()
        self.sources["drive"].data = {"x": knots_s * 1e6, "y": knots_V}
        self.sources["sensor"].data = {"x": found.time_s * 1e6, "y": found.sensor_V}
        edited = curves(head, self.exploration.waveform.drive, Conditions())
        self.edited.data = {"x": edited.time_s * 1e6, "y": edited.sensor_V}
        fit(self.waveform.x_range, -0.03e6 * knots_s[-1], 1.06e6 * knots_s[-1], False)
        top_V = 1.1 * max(float(np.abs(found.sensor_V).max()), float(np.abs(edited.sensor_V).max()), 1e-3)
        fit(self.response.x_range, 0.0, float(found.time_s[-1]) * 1e6, False)
        fit(self.response.y_range, -top_V, top_V, False)


def said(progress: Progress | None) -> str:
    """A search in a sentence, as HTML."""
    if progress is None:
        return "<p>Choose, and start.</p>"
    if progress.state == FAILED:
        return f"<div class='trouble'>The search failed: {html.escape(progress.failure)}</div>"
    words = {RUNNING: "Running", PAUSED: "Paused"}.get(progress.state, progress.state.capitalize())
    text = f"{words}: {progress.evaluations:,} of {progress.budget:,} evaluations"
    if progress.best is not None:
        text += f"; lowest cost <b id='best' data-cost='{progress.best_cost!r}'>{signed(progress.best_cost, 6)}</b> V"
    return f"<div class='verdict' id='search' data-state='{html.escape(progress.state)}'>{text}.</div>"
