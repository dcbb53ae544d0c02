"""Recordings from the files of oscilloscopes and other instruments, which do not describe what was measured."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from inkjet_env.recordings.campaign import Campaign, Source
from inkjet_env.recordings.clock import SAMPLE_NUMBERS, agreed_times, counted_times, refuse_other_times
from inkjet_env.recordings.header import Header
from inkjet_env.recordings.instrument_file import ARRAY_SUFFIXES, TEXT_SUFFIXES, Table, open_table
from inkjet_env.recordings.recording import CampaignError, Recording
from inkjet_env.recordings.roles import Roles, contradicted, guessed_roles, is_position, named_roles
from inkjet_env.recordings.samples import Samples, uniform
from inkjet_env.recordings.text_file import open_text
from inkjet_env.typing import Real

_ARRAYS = {"drive": "drive_V", "sensor": "sensor", "monitor": "drive_monitor_V", "neighbour": "neighbour_V"}
_BASES = {"drive": ("V",), "sensor": ("V", "um", "nm"), "monitor": ("V",), "neighbour": ("V",)}
_CHANNEL_WORDS = (
    ("strain_gauge", re.compile(r"strain", re.IGNORECASE)),
    ("displacement", re.compile(r"displace|deflection|position|vibrom|interferom", re.IGNORECASE)),
    ("self_sensing", re.compile(r"self|current", re.IGNORECASE)),
)
_CHANNEL_TAG = re.compile(
    r"(?:^|(?<=[ _-]))(?P<tag>(CH?|Chan|Channel[ _]?|F|M|Math|Ref)\d|Vib)(?=$|[ _-])|(?<=\w)CH\d$|^C\d(?=[A-Z])",
    re.IGNORECASE,
)
SAME_TIME = 1e-3
"""Largest difference, in sampling steps, between the times of two files of one recording."""


def read_scope_folder(
    folder: Path,
    columns: Mapping[str, str | int],
    channel: str | None,
    initial_state: str = "free",
    interval_s: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Campaign:
    """Read each file of a folder as one recording, in the order of their names.

    Files whose names differ only in a channel's tag, such as ``CH1`` or ``C2``, and that hold one channel each form one
    recording. See `read_campaign`.
    """
    files = sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in TEXT_SUFFIXES + ARRAY_SUFFIXES and not path.name.startswith(".") and path.is_file()
    )
    tables, notes = _tables(files)
    unread = sorted(p.name for p in folder.iterdir() if p.is_file() and p not in files and not p.name.startswith("."))
    if unread:
        more = f" and {len(unread) - 3} more" if len(unread) > 3 else ""
        notes.append(f"{folder}: {', '.join(name[:40] for name in unread[:3])}{more} of another kind, not read.")
    if not tables:
        raise CampaignError(
            f"{folder}: holds no campaign: neither datapackage.json nor a *.csv or *.txt file. Check the folder's name."
        )
    recordings: list[Recording] = []
    sources: dict[str, Source] = {}
    for (name, table), samples in zip(
        tables.items(), _samples_of(list(tables.values()), columns, interval_s, progress), strict=True
    ):
        notes += samples.notes
        guess = channel or samples.channel
        if guess is None:
            raise CampaignError(
                f"{table.file}: the sensor is unknown. Give channel=, which is self_sensing, strain_gauge or "
                "displacement."
            )
        if channel is None:
            notes.append(f"{table.file}: channel {guess}, guessed from the sensor's name or unit.")
        try:
            order = len(recordings) + 1
            recordings.append(
                Recording(name=name, channel=guess, initial_state=initial_state, order=order, **samples.arrays)
            )
        except ValueError as error:
            raise CampaignError(f"{table.file}: {error}") from None
        sources[name] = samples.source
    try:
        return Campaign(folder.resolve().name, tuple(recordings), notes=tuple(notes), sources=sources)
    except ValueError as error:
        raise CampaignError(f"{folder}: {error}") from None


def read_scope_samples(file: Path, columns: Mapping[str, str | int], interval_s: float | None = None) -> Samples:
    """Read the samples of one recording from one file of an instrument.

    Parameters
    ----------
    file : Path
        The file.
    columns : mapping
        Column of each role that is known, by name or by number from 1.
    interval_s : float, optional
        Sampling interval in seconds, where the file has no times.

    Returns
    -------
    Samples
        The samples, with notes on how the columns were understood.

    Raises
    ------
    CampaignError
        Undetermined roles, inconsistent units, times that are not uniform, or anything that cannot be read.
    """
    return _samples_of([open_table(file)], columns, interval_s)[0]


def _tables(files: Sequence[Path]) -> tuple[dict[str, Table], list[str]]:
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


def _samples_of(
    tables: Sequence[Table],
    columns: Mapping[str, str | int],
    interval_s: float | None,
    progress: Callable[[str], None] | None = None,
) -> list[Samples]:
    """The samples of files with one wiring."""
    known = [named_roles(table, columns, interval_s) for table in tables]
    read: list[dict[int, Real]] = []
    for number, (table, roles) in enumerate(zip(tables, known, strict=True), start=1):
        if progress is not None:
            progress(f"reading ({number} of {len(tables)})")
        wanted = sorted({*roles.columns.values(), *roles.unsure, *roles.times})
        values = dict(zip(wanted, table.read(wanted), strict=True))
        units = table.header.units
        time = roles.columns.get("time")
        _check_further_times(table, time, {i: values[i] for i in roles.times})
        # one column after the other, so that no other is held twice
        for i in [i for i in wanted if i in units and i != time]:
            values[i] = units[i].to_base(values[i])
        read.append(values)
    guessed = guessed_roles(
        [
            (table, roles, {i: values[i] for i in roles.unsure})
            for table, roles, values in zip(tables, known, read, strict=True)
        ]
    )
    return [
        _samples(
            table,
            replace(roles, columns=roles.columns | more, reasons=roles.reasons | dict.fromkeys(more, why)),
            values,
            interval_s,
        )
        for table, roles, values, (more, why) in zip(tables, known, read, guessed, strict=True)
    ]


def _check_further_times(table: Table, time: int | None, further: Mapping[int, Real]) -> None:
    """Raise an error if the channels of one file have different times."""
    names, units = table.header.names, table.header.units
    if time is None or not further:
        return
    first = table.read([time])[0]
    step = abs(first[-1] - first[0]) / max(first.size - 1, 1)
    for i, values in further.items():
        if units.get(i) == units.get(time) and np.abs(values - first).max() > SAME_TIME * step:
            k = int(np.argmax(np.abs(values - first) > SAME_TIME * step))
            raise CampaignError(
                f"{table.file}, {table.place(k)}: the times {names[time][:40]} and {names[i][:40]} differ, "
                f"{first[k]:.9g} and {values[k]:.9g}. Export drive and sensor at the same times."
            )


def _samples(table: Table, roles: Roles, values: Mapping[int, Real], interval_s: float | None) -> Samples:
    """The samples of one file whose roles are all known, its values in base units except times."""
    header, names = table.header, table.header.names
    for role, i in roles.columns.items():
        _check_unit(table, role, i)
    if why := contradicted(table, roles, values):
        raise CampaignError(f"{table.file}: {why} Specify them with columns={{'drive': …, 'sensor': …}} (--columns).")
    arrays: dict[str, object] = {_ARRAYS[role]: values[i] for role, i in roles.columns.items() if role != "time"}
    unit = header.units.get(roles.columns["sensor"])
    sensor = names[roles.columns["sensor"]]
    if unit is None and is_position(sensor):
        raise CampaignError(
            f"{table.file}: {sensor[:60]} has no unit. Write it behind the name, such as position (um), or choose "
            "another column."
        )
    arrays["unit"] = unit.base if unit else "V"
    arrays["time_s"], repairs = _times(table, roles, values, interval_s)
    understood = ", ".join(
        f"{role} = {names[i][:40]} ({roles.reasons[role]}{_unit_note(table, roles, role)})"
        for role, i in sorted(roles.columns.items())
    )
    notes = [*table.notes, f"{table.file}: {header.style} style; {understood}.", *repairs]
    unread = [names[i] for i in table.columns if i not in roles.columns.values()]
    if unread:
        notes.append(f"{table.file}: column {', '.join(unread)[:80]} was not read.")
    source = Source(str(table.file), table.first_row)
    channel = _guessed_channel(names[roles.columns["sensor"]], str(arrays["unit"]))
    return Samples(arrays, names, source, tuple(notes), channel)


def _times(
    table: Table, roles: Roles, values: Mapping[int, Real], interval_s: float | None
) -> tuple[Real, tuple[str, ...]]:
    """Uniform times in seconds, and notes on how they were found."""
    time, reason = roles.columns.get("time"), roles.reasons.get("time", "")
    if time is None:
        refuse_other_times(table, set(roles.columns.values()), interval_s)
    some = next(iter(values.values())) if time is None else values[time]
    if (counted := counted_times(table, time, reason, some, interval_s)) is not None:
        return counted[0], (counted[1],)
    assert time is not None
    time_s, notes = uniform(table, time, some, table.header.units.get(time))
    step_s = float(time_s[-1] - time_s[0]) / (some.size - 1)
    time_s, more = agreed_times(table, time, time_s, step_s, interval_s)
    return time_s, (*notes, *more)


def _check_unit(table: Table, role: str, column: int) -> None:
    name, header = table.header.names[column], table.header
    if header.unknown.get(column) == "":
        raise CampaignError(
            f"{table.file}: column {name[:40]} has no unit, though others have one. Write it in the header, or choose "
            "another column."
        )
    if column in header.unknown:
        raise CampaignError(
            f"{table.file}: the unit {header.unknown[column][:20]!r} of column {name[:40]} is not known; s, V, um and "
            "nm are, and ms, us, ns, mV, uV, kV, mm. Write it so, or convert the column."
        )
    bases = ("s",) if role == "time" else _BASES[role]
    if column in header.units and header.units[column].base not in bases:
        raise CampaignError(
            f"{table.file}: the {role} must be in {' or '.join(bases)}; column {name[:40]} is in "
            f"{header.units[column].base}. Specify the column with columns={{{role!r}: …}}."
        )


def _unit_note(table: Table, roles: Roles, role: str) -> str:
    if roles.columns[role] in table.header.units or roles.reasons[role] == SAMPLE_NUMBERS:
        return ""
    return f", no unit given: taken as {'s' if role == 'time' else 'V'}"


def _guessed_channel(name: str, unit: str) -> str | None:
    for channel, words in _CHANNEL_WORDS:
        if words.search(name):
            return channel
    return "displacement" if unit in ("um", "nm") else None
