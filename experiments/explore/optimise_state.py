"""State of *Optimise*: the settings, the search that runs, and what it has found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from inkjet_env.experiments.explore.heads import HeadShelf
from inkjet_env.experiments.explore.search import PAUSED, RUNNING, STOPPED, Progress, Search
from inkjet_env.experiments.explore.search_plan import SearchSettings, command_text, planned
from inkjet_env.experiments.explore.waveform_state import WaveformState


class OptimiseState:
    """The search, started from the heads and the waveform's cost and limits.

    Parameters
    ----------
    record : Path
        File from which an interrupted search resumes.
    told : callable
        Called, from any thread, when there is something new.

    Attributes
    ----------
    settings : SearchSettings
        What is asked.
    search : Search or None
        The search that runs or ran since the server started.
    """

    def __init__(self, record: Path, told: Callable[[], object]) -> None:
        self.record, self.told = record, told
        self.settings = SearchSettings()
        self.search: Search | None = None
        self._earlier: Progress | None = None

    @property
    def progress(self) -> Progress | None:
        """The search as it stands; None before the first."""
        return self._earlier if self.search is None else self.search.progress

    @property
    def busy(self) -> bool:
        """Whether a search runs or is paused."""
        return self.progress is not None and self.progress.state in (RUNNING, PAUSED)

    def change(self, **settings: Any) -> None:
        """Change settings by name, for the next search."""
        self.settings = replace(self.settings, **settings)

    def start(self, shelf: HeadShelf, waveform: WaveformState) -> None:
        """Start a search; ``ValueError`` if one is under way, or the settings cannot be."""
        if self.busy:
            raise ValueError("a search is under way. Stop it first.")
        head, conditions = self._head(shelf), waveform.conditions
        plan = planned(self.settings, head, conditions.cost, waveform.limits)
        self.search = Search(plan, self.record, self.told)
        self.search.start()

    def resume(self) -> None:
        """Go on with a paused search."""
        if self.search is not None:
            self.search.start()

    def pause(self) -> None:
        """Pause the search."""
        if self.search is not None:
            self.search.pause()

    def stop(self) -> None:
        """End the search; what it has found stays."""
        if self.search is not None:
            self.search.stop()

    def take_over(self, shelf: HeadShelf, waveform: WaveformState) -> None:
        """Edit the best waveform in *Waveform*, on the head that was searched on."""
        if self.progress is None or self.progress.best is None:
            raise ValueError("there is no best waveform yet. Start a search.")
        waveform.change(self.progress.best)
        shelf.choose(self._head(shelf).name)

    def command_text(self, shelf: HeadShelf, waveform: WaveformState) -> str:
        """The command line that finds the same waveform."""
        return command_text(self.settings, self._head(shelf), waveform.conditions.cost, waveform.limits)

    def _head(self, shelf: HeadShelf) -> Any:
        return shelf.heads[self.settings.head]

    def as_json(self) -> dict[str, Any]:
        """The state as plain JSON values."""
        progress = self.progress
        return {
            "settings": self.settings.as_json(),
            "progress": None if progress is None else progress.as_json(),
        }

    def restore(self, stored: Mapping[str, Any]) -> None:
        """Take what `as_json` wrote; a search that had not ended is paused, where its record is there."""
        self.settings = SearchSettings.from_json(stored["settings"])
        self._earlier = None if stored["progress"] is None else Progress.from_json(stored["progress"])
        if self.record.exists():
            self.search = Search.from_record(self.record, self.told)
        elif self._earlier is not None and self.busy:
            self._earlier = replace(self._earlier, state=STOPPED)
