"""*Heads*: published, identified and corrected side by side: parameters, loop, frequency response, best waveform."""

from __future__ import annotations

import html
from typing import Any

import panel as pn
from bokeh.models import ColumnDataSource, Range1d

from inkjet_env.experiments.explore.curves import Conditions, curves
from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.experiments.explore.figures import fit, legend_above, new_figure
from inkjet_env.experiments.explore.heads import MOST_HEADS
from inkjet_env.experiments.explore.heads_state import SEARCH, frequency_response
from inkjet_env.experiments.explore.style import column, row, set_differing, text_pane
from inkjet_env.experiments.explore.view import Guarded, View
from inkjet_env.reporting.plotting import COLOURS
from inkjet_env.reporting.waveform_figures import signed


class HeadsView(View):
    """One tab's view of the heads."""

    name = "heads"

    def __init__(self, exploration: Exploration, guarded: Guarded) -> None:
        super().__init__(exploration, guarded)
        self.state = exploration.heads
        self.file = pn.widgets.FileInput(accept=".json", sizing_mode="stretch_width")
        self.file.param.watch(self._dropped, "value")
        self.find = self.button("Find the best waveforms", self.state.find, "primary")
        self.choice = pn.widgets.Select(label="whose best waveform", options=[], sizing_mode="stretch_width")
        self.take = self.button("Edit it in Waveform", lambda: self.state.take(self.choice.value), view="all")
        self.said, self.table = text_pane(), text_pane()
        self.loop = new_figure(
            "drive (V)", "hysteretic drive (V)", "Loop under the drive in Waveform", x_range=Range1d(-1, 1),
            y_range=Range1d(-1, 1),
        )  # fmt: skip
        self.response = new_figure(
            "frequency (kHz)", "|response| (V/V)", "Frequency response, small signals", x_range=Range1d(0, 1),
            y_range=Range1d(0, 1),
        )  # fmt: skip
        self.best = new_figure(
            "time (µs)", "drive (V)", "Best waveform of each", x_range=Range1d(0, 60), y_range=Range1d(-120, 120)
        )
        self.answer = new_figure(
            "time (µs)", "response (V)", "Response of each to its best", x_range=Range1d(0, 350),
            y_range=Range1d(-8, 8),
        )  # fmt: skip
        self.sources: list[dict[str, ColumnDataSource]] = []
        self.figures = {"loop": self.loop, "response": self.response, "best": self.best, "answer": self.answer}
        self.items: list[list[Any]] = []
        for k in range(MOST_HEADS):
            sources = {name: ColumnDataSource({"x": [], "y": []}) for name in self.figures}
            style = {"color": COLOURS[k % len(COLOURS)], "line_width": 1.8}
            for name, figure in self.figures.items():
                figure.line("x", "y", source=sources[name], legend_label=f"{k}", **style)
            self.sources.append(sources)
        for figure in self.figures.values():
            legend_above(figure)
        note = text_pane(
            f"<p>Best: of {SEARCH.budget:,} evaluations of {SEARCH.optimizer}, seed {SEARCH.seed}, with the cost and "
            "the driver's limits of <i>Waveform</i>.</p>"
        )
        add = text_pane("<p>add a printhead file</p>")
        controls = column(add, self.file, self.find, note, self.choice, self.take, kind="controls")
        half = [column(figure, kind="half") for figure in self.figures.values()]
        drawn = column(self.said, self.table, row(*half[:2]), row(*half[2:]), kind="drawn")
        self.layout = row(controls, drawn, kind="view")

    def _dropped(self, event: Any) -> None:
        if event.new:
            self.guarded("all", lambda: self.state.drop(self.file.filename, event.new))

    def _draw(self) -> None:
        state, heads = self.state, list(self.exploration.shelf.heads.values())
        set_differing(self.find, disabled=bool(state.busy))
        names = [one.name for one in heads]
        set_differing(self.choice, options=names)
        set_differing(self.choice, value=self.choice.value if self.choice.value in names else names[0])
        self.said.object = (
            f"<p id='finding'>searching for {html.escape(state.busy)} …</p>"
            if state.busy
            else f"<div class='trouble'>{html.escape(state.trouble)}</div>"
            if state.trouble
            else ""
        )
        self.table.object = heads_table(self.exploration)
        conditions = self.exploration.waveform.conditions
        single = Conditions(conditions.cost, conditions.window_s)
        for k, sources in enumerate(self.sources):
            there = k < len(heads)
            for figure in self.figures.values():
                item = figure.legend[0].items[k]
                item.update(visible=there, label={"value": heads[k].name if there else ""})
            if not there:
                for source in sources.values():
                    source.data = {"x": [], "y": []}
                continue
            head = heads[k]
            found = curves(head.head, self.exploration.waveform.drive, single)
            frequency_Hz, magnitude = frequency_response(head.head)
            sources["loop"].data = {"x": found.loop_drive_V, "y": found.loop_hysteretic_V}
            sources["response"].data = {"x": frequency_Hz / 1e3, "y": magnitude}
            best: dict[str, Any] = {"x": [], "y": []}
            answer: dict[str, Any] = {"x": [], "y": []}
            if head.name in state.best:
                waveform = state.best[head.name][0]
                knots_s, knots_V = waveform.knots()
                best = {"x": knots_s * 1e6, "y": knots_V}
                its_own = curves(head.head, waveform, single)
                answer = {"x": its_own.time_s * 1e6, "y": its_own.sensor_V}
            sources["best"].data, sources["answer"].data = best, answer
        for name, figure in self.figures.items():
            self._fit(name, figure)

    def _fit(self, name: str, figure: Any) -> None:
        """Show all of every line."""
        data = [sources[name].data for sources in self.sources if len(sources[name].data["x"])]
        if not data:
            return
        for range_, key in ((figure.x_range, "x"), (figure.y_range, "y")):
            low, high = min(float(min(one[key])) for one in data), max(float(max(one[key])) for one in data)
            margin = 0.06 * max(high - low, 1e-9)
            at_zero = low >= 0
            fit(range_, 0.0 if at_zero else low - margin, high + margin, False)


def heads_table(exploration: Exploration) -> str:
    """Parameters of each head with their 90 % intervals, as an HTML table; every name is escaped."""
    heads = list(exploration.shelf.heads.values())
    columns: list[dict[str, str]] = []
    for head in heads:
        told = {"what it is": head.kind}
        told["resonance (kHz)"] = f"{head.head.frequency_Hz / 1e3:.5g}"
        told["damping ratio"] = f"{head.head.damping_ratio:.4g}"
        for name, value, low, high, unit in head.rows():
            interval = "" if low is None or high is None else f" ({low:.6g} … {high:.6g})"
            told[f"{name} ({unit})" if unit else name] = f"{value:.6g}{interval}"
        if head.name in exploration.heads.best:
            told["cost of its best waveform (V)"] = signed(exploration.heads.best[head.name][1], 3)
        columns.append(told)
    names = list(dict.fromkeys(name for told in columns for name in told))
    names.sort(key=lambda name: name.startswith("cost of"))
    top = "".join(
        f"<th><span class='dot' style='background:{COLOURS[k % len(COLOURS)]}'></span>{html.escape(head.name)}</th>"
        for k, head in enumerate(heads)
    )
    rows = []
    for name in names:
        cells = "".join(f"<td>{html.escape(told.get(name, '–'))}</td>" for told in columns)
        rows.append(f"<tr><td>{html.escape(name)}</td>{cells}</tr>")
    table = f"<thead><tr><th></th>{top}</tr></thead><tbody>{''.join(rows)}</tbody>"
    return f"<div class='scroll'><table class='told text'>{table}</table></div>"
