"""Which files of an instrument's folder form one recording: one file each, or one file for each channel."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from inkjet_env.recordings.header import Header
from inkjet_env.recordings.instrument_file import ARRAY_SUFFIXES, TEXT_SUFFIXES, Table, open_table
from inkjet_env.recordings.recording import CampaignError
from inkjet_env.recordings.text_file import open_text
from inkjet_env.typing import Real

_CHANNEL_TAG = re.compile(
    r"(?:^|(?<=[ _-]))(?P<tag>(CH?|Chan|Channel[ _]?|F|M|Math|Ref)\d|Vib)(?=$|[ _-])|(?<=\w)CH\d$|^C\d(?=[A-Z])",
    re.IGNORECASE,
)
SAME_TIME = 1e-3
"""Largest difference, in sampling steps, between the times of two files of one recording."""


def recording_tables(folder: Path) -> tuple[dict[str, Table], list[str]]:
    """The tables of a folder's recordings, by name and in the order of their files, and notes on other files.

    Files whose names differ only in a channel's tag, such as ``CH1`` or ``C2``, and that hold one channel each form one
    recording.

    Raises
    ------
    CampaignError
        There is no file of an instrument, one of them cannot be opened, or files cannot be told apart.
    """
    files = sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in TEXT_SUFFIXES + ARRAY_SUFFIXES and not path.name.startswith(".") and path.is_file()
    )
    tables, notes = _grouped(files)
    unread = sorted(p.name for p in folder.iterdir() if p.is_file() and p not in files and not p.name.startswith("."))
    if unread:
        more = f" and {len(unread) - 3} more" if len(unread) > 3 else ""
        notes.append(f"{folder}: {', '.join(name[:40] for name in unread[:3])}{more} of another kind, not read.")
    if not tables:
        raise CampaignError(
            f"{folder}: holds no campaign: neither datapackage.json nor a *.csv or *.txt file. Check the folder's name."
        )
    return tables, notes


def _grouped(files: Sequence[Path]) -> tuple[dict[str, Table], list[str]]:
    """The table of each recording by its name, and notes on files that were passed over."""
    notes: list[str] = []
    opened: dict[Path, Table] = {}
    headers = {other: file for file in files for other in files if other.name == f"{_stem(file)}.Wfm{file.suffix}"}
    for file in files:
        if file in headers.values():
            continue
        try:
            opened[file] = open_table(file, headers.get(file))
        except CampaignError:
            beside = next((other for other in files if other != file and _stem(other) in file.name), None)
            if file.suffix.lower() != ".txt" or beside is None or _has_numbers(file):
                raise
            notes.append(f"{file}: holds no samples and was passed over, as settings of {beside.name}.")
    groups: dict[str, list[tuple[str, Table]]] = {}
    for file, table in opened.items():
        tag = _CHANNEL_TAG.search(_stem(file))
        one_channel = len(table.columns) == 2 or (len(table.columns) == 1 and table.header.clock is not None)
        name = _stem(file)
        if tag is not None and one_channel:
            name = " ".join(part.strip(" _-") for part in (name[: tag.start()], name[tag.end() :]) if part.strip(" _-"))
        groups.setdefault(name or _stem(file), []).append((tag.group().upper() if tag else "", table))
    found: dict[str, Table] = {}
    for name, group in groups.items():
        if len(group) > 1 and len({tag for tag, _ in group}) == len(group):
            found[name] = JoinedTable(tuple(group))
        else:
            for _, table in group:
                if (same := found.get(_stem(table.file))) is not None:
                    raise CampaignError(
                        f"{table.file}: it and {same.file.name} would be one recording, {_stem(table.file)}. Rename "
                        "one, or take it out of the folder."
                    )
                found[_stem(table.file)] = table
    return dict(sorted(found.items(), key=lambda pair: pair[1].file)), notes


def _stem(file: Path) -> str:
    """Name of a file without its suffixes."""
    return file.name.removesuffix(".gz").rpartition(".")[0] or file.stem


def _has_numbers(file: Path) -> bool:
    """Whether a text file has rows that look like samples."""
    return sum(bool(re.fullmatch(r"[-+0-9.eE,;\t ]*\d[-+0-9.eE,;\t ]*", line)) for line in open_text(file).start) > 2


@dataclass
class JoinedTable(Table):
    """Several files of one channel each, with their tags, as one table: time, then one column for each file."""

    parts: tuple[tuple[str, Table], ...]

    def __post_init__(self) -> None:
        (_, first), *_ = self.parts
        self.file, self.first_row, self.counting = first.file, first.first_row, ()
        self.notes = tuple(note for _, table in self.parts for note in table.notes)
        own = [table.columns[-1] for _, table in self.parts]
        clocks = {table.header.clock for _, table in self.parts}
        if len(clocks) > 1:
            stated = ", ".join(
                f"{table.file.name} from {clock[0]:.9g} s every {clock[1]:.6g} s"
                if (clock := table.header.clock)
                else f"{table.file.name} none"
                for _, table in self.parts
            )
            raise CampaignError(
                f"{self.file}: the files state different times ({stated}), so they are no one recording. "
                "Rename them, or put drive and sensor of one recording into one file."
            )
        timed = len(first.columns) > 1
        names = [first.header.names[first.columns[0]]] if timed else []
        sources = [(table.header, column) for (_, table), column in zip(self.parts, own, strict=True)]
        if timed:
            sources.insert(0, (first.header, first.columns[0]))
        told = [table.header.names[column] for (_, table), column in zip(self.parts, own, strict=True)]
        vague = len(set(told)) < len(told) or any(name.startswith("column ") for name in told)
        names += [tag for tag, _ in self.parts] if vague else told
        units = {k: header.units[i] for k, (header, i) in enumerate(sources) if i in header.units}
        unknown = {k: header.unknown[i] for k, (header, i) in enumerate(sources) if i in header.unknown}
        self.columns = tuple(range(len(names)))
        self.header = Header(tuple(names), units, unknown, first.header.clock, first.header.style)

    def read(self, wanted: Sequence[int]) -> list[Real]:
        read = [table.read(table.columns) for _, table in self.parts]
        if len({len(columns[-1]) for columns in read}) > 1 or len(read[0]) > 1:
            self._check_times([columns[0] for columns in read])
        every = [*([read[0][0]] if len(read[0]) > 1 else []), *(columns[-1] for columns in read)]
        return [every[i] for i in wanted]

    def _check_times(self, times: Sequence[Real]) -> None:
        step = abs(times[0][-1] - times[0][0]) / max(times[0].size - 1, 1)
        for (_, table), time in zip(self.parts, times, strict=True):
            if time.size != times[0].size or np.abs(time - times[0]).max() > SAME_TIME * step:
                raise CampaignError(
                    f"{table.file}: its times must be those of {self.file.name}; they differ. Export both again, or "
                    "rename the files if they are separate recordings."
                )

    def print_step(self, column: int) -> float:
        (_, first), *_ = self.parts
        return first.print_step(first.columns[0])

    def place(self, sample: int) -> str:
        return self.parts[0][1].place(sample)
