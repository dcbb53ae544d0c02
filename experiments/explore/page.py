"""One tab of the browser: four views over the one state that all tabs share."""

from __future__ import annotations

import html
import threading
from collections.abc import Callable
from typing import Any

import panel as pn
from tornado.ioloop import IOLoop

from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.experiments.explore.heads_view import HeadsView
from inkjet_env.experiments.explore.optimise_view import OptimiseView
from inkjet_env.experiments.explore.recordings_view import RecordingsView
from inkjet_env.experiments.explore.steady_styles import keep_styles
from inkjet_env.experiments.explore.style import column, text_pane
from inkjet_env.experiments.explore.waveform_view import WaveformView


class Page:
    """The views of one tab, redrawn when the state changes.

    Parameters
    ----------
    exploration : Exploration
        The state.
    """

    def __init__(self, exploration: Exploration) -> None:
        self.exploration = exploration
        self.message = text_pane()
        kinds = (WaveformView, OptimiseView, RecordingsView, HeadsView)
        self.views: dict[str, Any] = {kind.name: kind(exploration, self.guarded) for kind in kinds}
        self.tabs = pn.Tabs(
            *((name.capitalize(), view.layout) for name, view in self.views.items()), sizing_mode="stretch_width"
        )
        self.tabs.param.watch(lambda event: self._changed(list(self.views)[event.new]), "active")
        self.layout = column(self.message, self.tabs)
        self._due: set[str] = set()
        self._noting = threading.Lock()
        self._served_by = threading.get_ident()
        self._document = pn.state.curdoc
        self._loop = None if self._document is None else IOLoop.current()
        self._tell("".join(exploration.trouble))
        for view in self.views.values():
            view.draw()
        end = exploration.watch(self._changed)
        if self._document is not None:
            keep_styles(self._document)
            pn.state.on_session_destroyed(lambda _: end())

    def guarded(self, view: str, act: Callable[[], object]) -> None:
        """Make a change; a refusal is told in its sentence, what has changed is told to every tab."""
        try:
            act()
        except (ValueError, OSError) as error:
            self._tell(str(error))
            view = view or ""
        else:
            self._tell("")
        if view:
            self.exploration.changed(view)

    def _tell(self, sentence: str) -> None:
        told = f"<div class='trouble' id='trouble'>{html.escape(sentence)}</div>" if sentence else ""
        if self.message.object != told:
            self.message.object = told

    def _changed(self, view: str) -> None:
        """Redraw a view: at once if this tab made the change, so that one message tells all; else soon, and once."""
        with self._noting:
            waiting = bool(self._due)
            self._due.add(view)
        if self._loop is None or self._makes_the_change():
            self.redraw()
        elif not waiting:
            # Only the loop asks the document: what another thread asks of it while it is drawn can be lost.
            self._loop.add_callback(self._redraw_soon)

    def _redraw_soon(self) -> None:
        self._document.add_next_tick_callback(self.redraw)

    def _makes_the_change(self) -> bool:
        """Whether this tab is being served now: Bokeh's current document is that of all threads."""
        return threading.get_ident() == self._served_by and pn.state.curdoc is self._document

    def redraw(self) -> None:
        """Redraw what has changed, in one message to the browser."""
        with self._noting:
            due, self._due = self._due, set()
        with pn.io.hold(self._document):
            for name, view in self.views.items():
                if name in due or "all" in due:
                    try:
                        view.draw()
                    except ValueError as error:
                        self._tell(str(error))
