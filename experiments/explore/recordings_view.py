"""*Recordings*: drop or name files, correct what was guessed, see model and residual, identify and diagnose."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import panel as pn

from inkjet_env.cli.campaign_reading import notes_of
from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.experiments.explore.reading import CORRECTABLE, GUESS, Reading
from inkjet_env.experiments.explore.recording_plots import RecordingPlots
from inkjet_env.experiments.explore.recordings_state import DIAGNOSE, IDENTIFY
from inkjet_env.experiments.explore.recordings_table import COLUMNS, TITLES, choices, rows, unused
from inkjet_env.experiments.explore.style import column, row, set_differing, text_pane
from inkjet_env.experiments.explore.view import Guarded, View
from inkjet_env.recordings.recording import CHANNELS, INITIAL_STATES

TABLE = ":host { font-size: 12px; }"
MOST_NOTES = 6
"""Largest number of notes that are shown."""


class RecordingsView(View):
    """One tab's view of the recordings."""

    name = "recordings"

    def __init__(self, exploration: Exploration, guarded: Guarded) -> None:
        super().__init__(exploration, guarded)
        self.state = exploration.recordings
        self.told_folder: Path | None = None
        self.plots = RecordingPlots()
        self.verdict, self.notes = text_pane(), text_pane()
        wide = {"sizing_mode": "stretch_width"}
        self.folder = pn.widgets.TextInput(label="folder of a campaign", **wide)
        self.dropped = pn.widgets.FileInput(label="or drop its files", multiple=True, **wide)
        self.dropped.param.watch(self._files_dropped, ["value", "filename"])  # equal files may have other names
        self.columns = pn.widgets.TextInput(
            label="columns of the files", placeholder="time=T,drive=CH1,sensor=CH2", **wide
        )
        self.channel = pn.widgets.Select(label="channel of the files", options=[GUESS, *CHANNELS], **wide)
        self.initial = pn.widgets.Select(label="initial state of the files", options=[GUESS, *INITIAL_STATES], **wide)
        self.read = self.button("Read", self._open, "primary")
        self.identify = self.button("Identify", lambda: self.state.start(IDENTIFY))
        self.diagnose = self.button("Diagnose", lambda: self.state.start(DIAGNOSE))
        self.stop = self.button("Stop", self.state.stop)
        self.command = pn.widgets.TextAreaInput(label="the command that gives the same", rows=5, **wide)
        self.shown = pn.widgets.Select(label="recording", options=[], **wide)
        self.shown.param.watch(self._shown_chosen, "value")
        self.model = pn.widgets.RadioButtonGroup(label="head", options=["published"], variant="outline")
        self.model.param.watch(self._model_chosen, "value")
        self.shape: tuple[Any, ...] = ({}, [])
        self.table = self._new_table(*self.shape)
        self.table_place = column(self.table)
        controls = column(
            self.folder, self.dropped, self.columns, self.channel, self.initial, self.read,
            row(self.identify, self.diagnose, self.stop), self.command, self.shown,
            text_pane("<p>modelled by the head</p>"), self.model, kind="controls",
        )  # fmt: skip
        hint = text_pane(
            "<p>Which column is drive or sensor, channel, unit and initial state can be corrected in each row: click "
            "on them.</p>"
        )
        plots = self.plots
        drawn = column(
            self.verdict, self.notes, hint, self.table_place, plots.drive, plots.signal, plots.left, kind="drawn"
        )
        self.layout = row(controls, drawn, kind="view")

    def _new_table(self, offered: Mapping[str, Sequence[str]], hidden: Sequence[str]) -> Any:
        """An empty table, in which the cells of some columns can be set to what is offered.

        A table that is on the page does not take other editors or columns safely while it is drawn.
        """
        editors = {
            name: {"type": "list", "values": list(offered[name])} if name in offered else None for name in COLUMNS
        }
        table = pn.widgets.Tabulator(
            pd.DataFrame({name: [] for name in COLUMNS}), show_index=False, titles=TITLES, height=260,
            layout="fit_data_fill", sizing_mode="stretch_width", selectable=False, theme="simple", editors=editors,
            formatters={name: {"type": "plaintext"} for name in COLUMNS}, sortable=False,
            hidden_columns=list(hidden), stylesheets=[TABLE],
        )  # fmt: skip
        table.on_edit(self._edited)
        table.on_click(self._clicked)
        return table

    @property
    def _reading(self) -> Reading:
        """How files are read, as chosen."""
        channel, initial = ("" if one.value == GUESS else one.value for one in (self.channel, self.initial))
        return Reading(self.columns.value, channel, initial, self.state.reading.interval_s)

    def _open(self) -> None:
        self.state.open(Path(self.folder.value.strip()).expanduser(), self._reading)

    def _files_dropped(self, *_: Any) -> None:
        names, contents = self.dropped.filename, self.dropped.value
        names = names if isinstance(names, list) else [names]
        contents = contents if isinstance(contents, list) else [contents]
        if contents and contents[0] and len(names) == len(contents):
            files = dict(zip(names, contents, strict=True))
            self.change(lambda: self.state.drop(files, self._reading))

    def _edited(self, event: Any) -> None:
        if not self.drawing and event.column in CORRECTABLE and event.value != event.old:
            name = str(self.table.value["recording"].iloc[event.row])
            self.change(lambda: self.state.correct(name, event.column, str(event.value)))
            self.draw()

    def _clicked(self, event: Any) -> None:
        if event.column not in CORRECTABLE:
            name = str(self.table.value["recording"].iloc[event.row])
            self.change(lambda: self.state.show(name))

    def _shown_chosen(self, event: Any) -> None:
        if event.new and event.new != self.state.shown:
            self.change(lambda: self.state.show(event.new))

    def _model_chosen(self, event: Any) -> None:
        if event.new and event.new != self.state.model:
            self.change(lambda: self.state.choose_model(event.new))

    def _draw(self) -> None:
        state, job = self.state, self.state.job
        running = job is not None and job.running
        if state.folder is not None and state.folder != self.told_folder:
            self.told_folder, self.folder.value = state.folder, str(state.folder)
        idle = not running and not state.busy
        set_differing(self.read, disabled=not idle)
        set_differing(self.identify, disabled=not idle or state.campaign is None)
        set_differing(self.diagnose, disabled=not idle or state.campaign is None)
        set_differing(self.stop, disabled=not running)
        self.verdict.object = self._said()
        self._draw_commands()
        notes = [] if state.campaign is None else [*notes_of(state.campaign), *state.warnings]
        more = f"<li>… and {len(notes) - MOST_NOTES} more</li>" if len(notes) > MOST_NOTES else ""
        items = "".join(f"<li>{html.escape(one)}</li>" for one in notes[:MOST_NOTES]) + more
        self.notes.object = f"<ul class='notes'>{items}</ul>" if items else ""
        heads = list(self.exploration.shelf.heads)
        set_differing(self.model, options=heads)
        set_differing(self.model, value=state.model if state.model in heads else heads[0])
        self._draw_table()
        if state.campaign is not None and state.shown:
            modelled = state.modelled.get(state.model)
            recording = state.campaign[state.shown]
            self.plots.draw(
                recording,
                None if modelled is None else modelled.evaluations[state.shown],
                math.nan if modelled is None else modelled.noise_rms[state.shown],
                state.model,
            )

    def _draw_commands(self) -> None:
        """The command lines, in the order in which the verdicts stand."""
        state = self.state
        given = [text for one in (DIAGNOSE, IDENTIFY) if (text := state.command_text(one))]
        note = (
            ""
            if state.campaign is None
            else f"# Identify or Diagnose first writes what you corrected to {state.corrected}"
        )
        set_differing(self.command, value="\n\n".join(given) or (note if state.campaign else ""))

    def _draw_table(self) -> None:
        found, offered = rows(self.state), choices(self.state)
        names = self.state.columns_by_recording()
        values = pd.DataFrame(found, columns=list(COLUMNS))
        shape = (offered, unused(found, max(map(len, names.values()), default=0)))
        if shape != self.shape:
            self.shape, self.table = shape, self._new_table(*shape)
            self.table.value = values
            self.table_place[:] = [self.table]
        elif not values.equals(self.table.value):
            self.table.value = values
        read = [] if self.state.campaign is None else list(names)
        set_differing(self.shown, options=read)
        if self.state.shown in read:
            set_differing(self.shown, value=self.state.shown)

    def _said(self) -> str:
        """The verdict in one sentence, what is under way, and what went wrong, as HTML."""
        state, job = self.state, self.state.job
        said = []
        for command in (DIAGNOSE, IDENTIFY):
            if command in state.verdicts:
                text = html.escape(state.verdicts[command])
                said.append(f"<div class='verdict' id='{command}'>{text}</div>")
        modelled = state.modelled.get(state.model)
        if modelled is not None:
            said.append(f"<p><b>{html.escape(state.model)}</b>: {html.escape(modelled.sentence)}</p>")
        if job is not None and job.running:
            step = f": {html.escape(job.last_line)}" if job.last_line else ""
            said.append(f"<p id='job'>inkjet {job.name}, {job.seconds:.0f} s{step}</p>")
        elif state.busy:
            said.append(f"<p id='job'>{html.escape(state.busy)} the recordings …</p>")
        if state.trouble:
            said.append(f"<div class='trouble'>{html.escape(state.trouble)}</div>")
        return "".join(said) or "<p>Give the folder of a campaign, or drop its files.</p>"
