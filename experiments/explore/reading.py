"""How recordings are read: what is told of all files of a folder, and what is corrected of single recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from inkjet_env.cli.arguments import named_values
from inkjet_env.naming import check_name
from inkjet_env.recordings import Campaign, Recording, read_campaign
from inkjet_env.recordings.recording import CHANNELS, INITIAL_STATES, SENSOR_COLUMNS
from inkjet_env.recordings.roles import ROLES
from inkjet_env.recordings.survey import SurveyedFile, survey_folder
from inkjet_env.recordings.wiring import Wiring

LABELS = {"channel": CHANNELS, "unit": tuple(SENSOR_COLUMNS), "initial_state": INITIAL_STATES}
"""What can be corrected of a recording once it is read, and to what."""
CORRECTABLE = (*ROLES, *LABELS)
"""What can be corrected of a recording: the columns of its roles, and its labels."""
GUESS = "as guessed"
"""Takes a correction back."""


@dataclass(frozen=True)
class Corrections:
    """What is corrected of single recordings.

    Parameters
    ----------
    by_recording : mapping of str to mapping
        By recording: name of the column by role, and values of labels.
    """

    by_recording: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def corrected(self, name: str, what: str, value: str, columns: Sequence[str]) -> Corrections:
        """These corrections and one more, or one fewer if ``value`` is `GUESS`.

        Parameters
        ----------
        name : str
            The recording.
        what : str
            One of `CORRECTABLE`.
        value : str
            A column for a role, a value of a label, or `GUESS`. A column has one role: it loses another one that it was
            given.
        columns : sequence of str
            Names of the columns of the recording's file.

        Raises
        ------
        ValueError
            There is nothing to correct of that name, or no such column or value.
        """
        check_name("what is corrected", what, CORRECTABLE)
        own = {one: told for one, told in self.by_recording.get(name, {}).items() if one != what}
        if value != GUESS:
            if what in ROLES and value not in columns:
                raise ValueError(
                    f"{name[:60]} has no column {value[:40]!r} for the {what}; it has {', '.join(columns)[:120]}. "
                    "Choose one of them."
                )
            if what in LABELS:
                check_name(what, value, LABELS[what])
            own = {one: told for one, told in own.items() if what in LABELS or one in LABELS or told != value}
            own[what] = value
        others = {one: told for one, told in self.by_recording.items() if one != name}
        return Corrections({**others, name: own} if own else others)

    def applied(self, recording: Recording) -> Recording:
        """A recording with its labels corrected."""
        own = self.by_recording.get(recording.name, {})
        changes: dict[str, Any] = {what: value for what, value in own.items() if what in LABELS}
        return replace(recording, **changes) if changes else recording

    def columns_of(self) -> dict[str, dict[str, str | int]]:
        """Column of each role by recording."""
        found: dict[str, dict[str, str | int]] = {}
        for name, own in self.by_recording.items():
            if roles := {what: value for what, value in own.items() if what in ROLES}:
                found[name] = dict(roles)
        return found

    def channel_of(self) -> dict[str, str]:
        """Channel by recording."""
        return {name: own["channel"] for name, own in self.by_recording.items() if "channel" in own}

    def as_json(self) -> dict[str, dict[str, str]]:
        """The corrections as plain JSON values."""
        return {name: dict(own) for name, own in self.by_recording.items()}

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> Corrections:
        """The corrections that `as_json` wrote."""
        return cls({str(name): {str(k): str(v) for k, v in own.items()} for name, own in stored.items()})


@dataclass(frozen=True)
class Reading:
    """How files are read, where nothing in the folder says so.

    Parameters
    ----------
    columns : str
        Column of each role, as ``time=NAME,drive=NAME,sensor=NAME``; empty to guess.
    channel, initial_state : str
        Channel and initial state of all files; empty to guess.
    interval_s : float or None
        Sampling interval in seconds, for files without times.
    """

    columns: str = ""
    channel: str = ""
    initial_state: str = ""
    interval_s: float | None = None

    def campaign(self, folder: Path, corrections: Corrections) -> Campaign:
        """Read the campaign of a folder, each recording with its own columns and channel where they are corrected."""
        return read_campaign(
            folder, columns=self._columns(), channel=self.channel or None, initial_state=self.initial_state or None,
            interval_s=self.interval_s, columns_of=corrections.columns_of(), channel_of=corrections.channel_of(),
        )  # fmt: skip

    def survey(self, folder: Path, corrections: Corrections) -> tuple[SurveyedFile, ...]:
        """What the headers of a folder's files show, if they cannot be read as they are."""
        wiring = Wiring(self._columns() or {}, self.channel or None, corrections.columns_of(), corrections.channel_of())
        return survey_folder(folder, wiring, self.interval_s)

    def options(self) -> list[str]:
        """The same as options of a command."""
        pairs = (
            ("--columns", self.columns.strip()), ("--channel", self.channel), ("--initial-state", self.initial_state),
            ("--interval", "" if self.interval_s is None else f"{self.interval_s!r}"),
        )  # fmt: skip
        return [part for option, value in pairs if value for part in (option, value)]

    def as_json(self) -> dict[str, Any]:
        """The reading as plain JSON values."""
        return {
            "columns": self.columns, "channel": self.channel, "initial_state": self.initial_state,
            "interval_s": self.interval_s,
        }  # fmt: skip

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> Reading:
        """The reading that `as_json` wrote."""
        interval_s = None if stored["interval_s"] is None else float(stored["interval_s"])
        return cls(str(stored["columns"]), str(stored["channel"]), str(stored["initial_state"]), interval_s)

    def _columns(self) -> dict[str, str] | None:
        return dict(named_values("columns", self.columns)) if self.columns.strip() else None
