"""The recordings of one head, and their relation to each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from inkjet_env.printhead import nearest_name
from inkjet_env.recordings.recording import Recording, brief


@dataclass(frozen=True)
class Source:
    """File, row and columns from which a recording was read.

    Parameters
    ----------
    file : str
        Path of the CSV file.
    first_row : int
        Row of the file, counted from 1, that holds the first sample.
    columns : tuple of str
        Names of the columns that hold samples.
    roles : mapping of str to str
        Name of the column that was read in each role: time, drive, sensor, monitor, neighbour.
    """

    file: str
    first_row: int = 2
    columns: tuple[str, ...] = ()
    roles: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Campaign:
    """Recordings of one head.

    Parameters
    ----------
    name : str
        Name of the campaign, as in its descriptor.
    recordings : tuple of Recording
        At least one recording; names are unique, and each ``repeat_of`` names another of them.
    title, description : str
        Texts for people.
    notes : tuple of str
        Guesses made when the files were read, in sentences.
    sources : mapping of str to Source
        File from which each recording was read, by the recording's name; empty for recordings without a file.

    Raises
    ------
    ValueError
        No recordings, a duplicate name, a ``repeat_of`` that names no other recording, or repeats in a circle.
    """

    name: str
    recordings: tuple[Recording, ...]
    title: str = ""
    description: str = ""
    notes: tuple[str, ...] = ()
    sources: Mapping[str, Source] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for label in ("name", "title", "description"):
            if not isinstance(getattr(self, label), str):
                raise ValueError(f"a campaign's {label} must be a string; got {brief(getattr(self, label))}.")
        if not self.name.isprintable():
            raise ValueError(f"a campaign's name must be printable; got {brief(self.name)}.")
        recordings = tuple(self.recordings)
        object.__setattr__(self, "recordings", recordings)
        object.__setattr__(self, "notes", tuple(self.notes))
        object.__setattr__(self, "sources", dict(self.sources))
        if not recordings:
            raise ValueError("a campaign must hold at least one recording; got none.")
        seen: set[str] = set()
        for recording in recordings:
            if recording.name in seen:
                raise ValueError(f"recording {brief(recording.name)} occurs twice. Give each recording a unique name.")
            seen.add(recording.name)
        for recording in recordings:
            if recording.repeat_of is not None and recording.repeat_of not in seen:
                raise ValueError(
                    f"repeat_of of recording {brief(recording.name)} must name a recording of this campaign or be "
                    f"null; got {brief(recording.repeat_of)}.{nearest_name(recording.repeat_of[:100], seen)}"
                )
        for recording in recordings:
            self._first_of(recording)

    @cached_property
    def _by_name(self) -> dict[str, Recording]:
        return {recording.name: recording for recording in self.recordings}

    def __getitem__(self, name: str) -> Recording:
        if name not in self._by_name:
            raise KeyError(f"campaign {self.name!r} has no recording {name!r}.{nearest_name(name, self._by_name)}")
        return self._by_name[name]

    def select(
        self, channel: str | None = None, excitation: str | None = None, initial_state: str | None = None
    ) -> tuple[Recording, ...]:
        """Recordings with these labels, in their order; None matches any."""
        return tuple(
            recording
            for recording in self.recordings
            if channel in (None, recording.channel)
            and excitation in (None, recording.excitation)
            and initial_state in (None, recording.initial_state)
        )

    def repeats(self) -> dict[str, tuple[Recording, ...]]:
        """Groups of two or more repeats, by the name of the recording that the others repeat."""
        groups: dict[str, list[Recording]] = {}
        for recording in self.recordings:
            groups.setdefault(self._first_of(recording), []).append(recording)
        return {name: tuple(group) for name, group in groups.items() if len(group) > 1}

    def _first_of(self, recording: Recording) -> str:
        """Name of the first recording in the chain that ``recording`` repeats; its own if it repeats none."""
        chain = {recording.name: None}
        while recording.repeat_of is not None:
            recording = self[recording.repeat_of]
            if recording.name in chain:
                raise ValueError(
                    f"repeat_of forms a cycle: {' → '.join([*chain, recording.name])[:120]}. "
                    "The first of the repeats must have null."
                )
            chain[recording.name] = None
        return recording.name
