"""The state that every tab shows, who watches it, and the file from which a server that starts again reads it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from inkjet_env.experiments.explore.drives import Corners
from inkjet_env.experiments.explore.heads import PUBLISHED, HeadShelf
from inkjet_env.experiments.explore.heads_state import HeadsState
from inkjet_env.experiments.explore.optimise_state import OptimiseState
from inkjet_env.experiments.explore.recordings_state import RecordingsState
from inkjet_env.experiments.explore.waveform_state import WaveformState
from inkjet_env.storage import stored_object, write_json

FORMAT = "exploration/1"
SAVE_AFTER_S = 0.5
"""Longest time in seconds for which a change is in memory alone."""


class Exploration:
    """Everything the application shows.

    Parameters
    ----------
    file : Path
        The session file; what it holds is read by `restored`, and changes are written to it.

    Attributes
    ----------
    waveform : WaveformState
        State of *Waveform*.
    optimise : OptimiseState
        State of *Optimise*.
    recordings : RecordingsState
        State of *Recordings*.
    heads : HeadsState
        State of *Heads*.
    shelf : HeadShelf
        The heads.
    trouble : list of str
        What could not be restored, in sentences.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self.waveform = WaveformState()
        self.shelf = HeadShelf()
        self.optimise = OptimiseState(file.with_name(f"{file.name}.search.npz"), lambda: self.changed("optimise"))
        self.recordings = RecordingsState(
            file.with_name(f"{file.stem}.files").absolute(), self.shelf, lambda: self.changed("recordings")
        )
        self.heads = HeadsState(self.shelf, self.waveform, self.recordings.files, lambda: self.changed("heads"))
        self.trouble: list[str] = []
        self._watchers: list[Callable[[str], object]] = []
        self._lock = threading.RLock()
        self._timer: threading.Timer | None = None

    @classmethod
    def restored(cls, file: Path) -> Exploration:
        """The exploration that a session file holds; a new one if there is no file.

        Raises
        ------
        ValueError
            The file is no session file. A head whose file is gone is left out, and `trouble` says so.
        """
        found = cls(file)
        if not file.exists():
            return found
        try:
            stored = stored_object(file)
            if stored.get("format") != FORMAT:
                raise ValueError(f"its format is not {FORMAT}")
            found.waveform = WaveformState.from_json(stored["waveform"])
            found._restore_heads(stored["heads"], str(stored["head"]))
            found.optimise.restore(stored["optimise"])
            if found.optimise.settings.head not in found.shelf.heads:  # its file is gone, which `trouble` tells
                found.optimise.change(head=PUBLISHED)
            found.heads.waveform = found.waveform
            found.heads.restore(stored["bests"])
            found.recordings.restore(stored["recordings"])
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            reason = str(error).rstrip(".") if isinstance(error, ValueError) else f"it lacks {error}"
            raise ValueError(
                f"{file}: is not a session of inkjet explore ({reason}). Delete it, or give another --session."
            ) from None
        return found

    def _restore_heads(self, stored: list[dict[str, Any]], chosen: str) -> None:
        for one in stored:
            try:
                self.shelf.add(Path(one["path"]), str(one["name"]))
            except (ValueError, OSError) as error:
                self.trouble.append(str(error))
        self.shelf.chosen = chosen if chosen in self.shelf.heads else self.shelf.chosen

    def as_json(self) -> dict[str, Any]:
        """The state as plain JSON values."""
        heads = [{"name": one.name, "path": str(one.path)} for one in list(self.shelf.heads.values()) if one.path]
        return {
            "format": FORMAT,
            "waveform": self.waveform.as_json(),
            "heads": heads,
            "head": self.shelf.chosen,
            "optimise": self.optimise.as_json(),
            "recordings": self.recordings.as_json(),
            "bests": self.heads.as_json(),
        }

    def open_drive(self, name: str, content: bytes) -> None:
        """Edit the drive of a dropped file; ``ValueError`` names the file and what is wrong with it."""
        with TemporaryDirectory() as folder:
            file = Path(folder) / ("drive" + Path(name).suffix.lower())
            file.write_bytes(content)
            try:
                found = Corners.from_file(file)
            except ValueError as error:
                raise ValueError(str(error).replace(str(file), name)) from None
        self.waveform.change(Corners(found.time_s, found.drive_V, name))

    def watch(self, watcher: Callable[[str], object]) -> Callable[[], None]:
        """Call ``watcher`` with the name of the view whose state has changed; returns what ends it."""
        self._watchers.append(watcher)

        def end() -> None:
            if watcher in self._watchers:
                self._watchers.remove(watcher)

        return end

    def changed(self, view: str) -> None:
        """Tell every watcher, and write the session file soon."""
        for watcher in list(self._watchers):
            watcher(view)
        with self._lock:
            if self._timer is None:
                self._timer = threading.Timer(SAVE_AFTER_S, self.save)
                self._timer.daemon = True
                self._timer.start()

    def close(self) -> None:
        """Keep everything, since the server ends: the session file, and the record of a search that has not ended."""
        self.recordings.close()
        self.heads.close()
        self.optimise.pause()
        if self.optimise.search is not None:
            self.optimise.search.save()
        self.save()

    def save(self) -> None:
        """Write the session file now."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            write_json(self.file, self.as_json())
