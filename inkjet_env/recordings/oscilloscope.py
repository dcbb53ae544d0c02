"""Recordings from the files of oscilloscopes and other instruments, which do not describe what was measured."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from inkjet_env.recordings.campaign import Campaign, Source
from inkjet_env.recordings.clock import SAMPLE_NUMBERS, agreed_times, counted_times, refuse_other_times
from inkjet_env.recordings.instrument_file import Table, open_table
from inkjet_env.recordings.instrument_folder import SAME_TIME, recording_tables
from inkjet_env.recordings.recording import CampaignError, Recording
from inkjet_env.recordings.roles import Roles, contradicted, guessed_roles, is_position, named_roles
from inkjet_env.recordings.samples import Samples, uniform
from inkjet_env.recordings.wiring import Wiring
from inkjet_env.typing import Real

_ARRAYS = {"drive": "drive_V", "sensor": "sensor", "monitor": "drive_monitor_V", "neighbour": "neighbour_V"}
_BASES = {"drive": ("V",), "sensor": ("V", "um", "nm"), "monitor": ("V",), "neighbour": ("V",)}
_CHANNEL_WORDS = (
    ("strain_gauge", re.compile(r"strain", re.IGNORECASE)),
    ("displacement", re.compile(r"displace|deflection|position|vibrom|interferom", re.IGNORECASE)),
    ("self_sensing", re.compile(r"self|current", re.IGNORECASE)),
)


def read_scope_folder(
    folder: Path,
    wiring: Wiring,
    initial_state: str = "free",
    interval_s: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Campaign:
    """Read each file of a folder as one recording, in the order of their names.

    See `read_campaign`, and `recording_tables` for recordings of several files.
    """
    tables, notes = recording_tables(folder)
    recordings: list[Recording] = []
    sources: dict[str, Source] = {}
    wiring.check_names(folder, tables)
    columns = [wiring.columns_for(name, table) for name, table in tables.items()]
    read = _samples_of(list(tables.values()), columns, interval_s, progress)
    for (name, table), samples in zip(tables.items(), read, strict=True):
        notes += samples.notes
        told = wiring.channel_for(name)
        guess = told or samples.channel
        if guess is None:
            raise CampaignError(
                f"{table.file}: the sensor is unknown. Give channel=, which is self_sensing, strain_gauge or "
                "displacement."
            )
        if told is None:
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
    return _samples_of([open_table(file)], [columns], interval_s)[0]


def _samples_of(
    tables: Sequence[Table],
    columns: Sequence[Mapping[str, str | int]],
    interval_s: float | None,
    progress: Callable[[str], None] | None = None,
) -> list[Samples]:
    """The samples of files with one wiring, except where the columns of a file were told."""
    known = [named_roles(table, told, interval_s) for table, told in zip(tables, columns, strict=True)]
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
    source = Source(
        str(table.file),
        table.first_row,
        tuple(names[i] for i in table.columns),
        {role: names[i] for role, i in roles.columns.items()},
    )
    channel = guessed_channel(names[roles.columns["sensor"]], str(arrays["unit"]))
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


def guessed_channel(name: str, unit: str) -> str | None:
    """The sensor that the name or the unit of its column shows; None if neither does."""
    for channel, words in _CHANNEL_WORDS:
        if words.search(name):
            return channel
    return "displacement" if unit in ("um", "nm") else None
