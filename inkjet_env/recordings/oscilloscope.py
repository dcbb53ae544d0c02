"""Recordings from an oscilloscope's CSV files, which do not describe what was measured."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from inkjet_env.recordings.campaign import Campaign, Source
from inkjet_env.recordings.recording import CampaignError, Recording
from inkjet_env.recordings.roles import candidates, guessed_roles, named_roles
from inkjet_env.recordings.samples import Samples, uniform
from inkjet_env.recordings.sheet import Sheet, read_sheet
from inkjet_env.recordings.table import Layout, read_columns
from inkjet_env.typing import Real

_ARRAYS = {"drive": "drive_V", "sensor": "sensor", "monitor": "drive_monitor_V", "neighbour": "neighbour_V"}
_BASES = {"drive": ("V",), "sensor": ("V", "um", "nm"), "monitor": ("V",), "neighbour": ("V",)}
_CHANNEL_WORDS = (
    ("strain_gauge", re.compile(r"strain", re.IGNORECASE)),
    ("displacement", re.compile(r"displace|deflection|position|vibrom|interferom", re.IGNORECASE)),
    ("self_sensing", re.compile(r"self|current", re.IGNORECASE)),
)
_ONE_CHANNEL = re.compile(r"^(.*?)[ _-]?(CH\d)$", re.IGNORECASE)

Reader = Callable[[Sequence[int]], list[Real]]


def read_scope_folder(
    folder: Path, columns: Mapping[str, str | int], channel: str | None, initial_state: str = "free"
) -> Campaign:
    """Read each ``*.csv`` and ``*.txt`` file of a folder as one recording, in the order of their names.

    Files whose names differ only in a final ``CH1``, ``CH2`` … and that hold one channel each form one recording. See
    `read_campaign`.
    """
    files = sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in (".csv", ".txt") and not path.name.startswith(".") and path.is_file()
    )
    notes: list[str] = []
    recordings: list[Recording] = []
    sources: dict[str, Source] = {}
    for name, group in _groups(files).items():
        samples = read_scope_samples(group, columns)
        notes += samples.notes
        guess = channel or samples.channel
        if guess is None:
            raise CampaignError(
                f"{group[0]}: the sensor is unknown. Give channel=, which is self_sensing, strain_gauge or "
                "displacement."
            )
        if channel is None:
            notes.append(f"{group[0]}: channel {guess}, guessed from the sensor's name or unit.")
        try:
            order = len(recordings) + 1
            recordings.append(
                Recording(name=name, channel=guess, initial_state=initial_state, order=order, **samples.arrays)
            )
        except ValueError as error:
            raise CampaignError(f"{group[0]}: {error}") from None
        sources[name] = samples.source
    if not recordings:
        raise CampaignError(
            f"{folder}: holds no campaign: neither datapackage.json nor a *.csv or *.txt file. Check the folder's name."
        )
    try:
        return Campaign(folder.resolve().name, tuple(recordings), notes=tuple(notes), sources=sources)
    except ValueError as error:
        raise CampaignError(f"{folder}: {error}") from None


def _groups(files: list[Path]) -> dict[str, tuple[Path, ...]]:
    """Files that form each recording, by its name."""
    groups: dict[str, tuple[Path, ...]] = {}
    for file in files:
        match = _ONE_CHANNEL.match(file.stem)
        name = match.group(1) if match and match.group(1) else file.stem
        groups[name] = (*groups.get(name, ()), file)
    return {(name if len(group) > 1 else group[0].stem): group for name, group in groups.items()}


def read_scope_samples(files: Sequence[Path], columns: Mapping[str, str | int]) -> Samples:
    """Read the samples of one recording from one file of an oscilloscope, or from several with one channel each.

    Parameters
    ----------
    files : sequence of Path
        One file, or one per channel.
    columns : mapping
        Column of each role that is known, by name or by number from 1.

    Returns
    -------
    Samples
        The samples, with notes on how the columns were understood.

    Raises
    ------
    CampaignError
        Undetermined roles, inconsistent units, times that are not uniform, or anything that `read_columns` refuses.
    """
    file = files[0]
    sheet, read = (_joined if len(files) > 1 else _single)(files)
    roles, reasons = named_roles(file, sheet, columns)
    unsure = candidates(file, sheet, roles)
    wanted = sorted({*roles.values(), *unsure})
    values = dict(zip(wanted, read(wanted), strict=True))
    scaled = {i: sheet.units[i].to_base(values[i]) if i in sheet.units else values[i] for i in wanted}
    if unsure:
        guessed, reason = guessed_roles(sheet, roles, {i: scaled[i] for i in unsure})
        roles, reasons = roles | guessed, reasons | dict.fromkeys(guessed, reason)
    for role, i in roles.items():
        _check_unit(file, sheet, role, i)
    arrays: dict[str, object] = {_ARRAYS[role]: scaled[i] for role, i in roles.items() if role != "time"}
    unit = sheet.units.get(roles["sensor"])
    arrays["unit"] = unit.base if unit else "V"
    count = len(next(iter(values.values())))
    repairs: tuple[str, ...] = ()
    if sheet.clock is not None:
        start_s, step_s = sheet.clock
        numbers = values[roles["time"]] if "time" in roles else np.arange(count, dtype=np.float64)
        arrays["time_s"] = _clock_times(file, start_s, step_s, numbers)
    else:
        time = roles["time"]
        arrays["time_s"], repairs = uniform(file, sheet.layout, time, values[time], sheet.units.get(time))
    names = sheet.layout.names
    understood = ", ".join(
        f"{role} = {names[i][:40]} ({reasons[role]}{_unit_note(sheet, role, i)})" for role, i in sorted(roles.items())
    )
    unread = [names[i] for i in sheet.columns if i not in roles.values()]
    notes = [f"{file}: {sheet.style} style; {understood}.", *repairs]
    if unread:
        notes.append(f"{file}: column {', '.join(unread)[:80]} was not read.")
    source = Source(str(file), sheet.layout.header_rows + 1)
    return Samples(arrays, names, source, tuple(notes), _guessed_channel(names[roles["sensor"]], str(arrays["unit"])))


def _single(files: Sequence[Path]) -> tuple[Sheet, Reader]:
    sheet = read_sheet(files[0])
    return sheet, lambda wanted: read_columns(files[0], sheet.layout, wanted)


def _joined(files: Sequence[Path]) -> tuple[Sheet, Reader]:
    """Several files, each with times and one channel, as one sheet: time, then one column per file: CH1, CH2 …"""
    sheets = [read_sheet(file) for file in files]
    for file, sheet in zip(files, sheets, strict=True):
        if len(sheet.columns) != 2 or sheet.clock is not None:
            raise CampaignError(
                f"{file}: must hold a time and one channel, since {files[0].name} and {files[-1].name} are read as "
                "one recording. Rename the files if they are separate recordings."
            )
    first = sheets[0]
    names = [*first.layout.names, *(f"column {i}" for i in range(len(files) - 1))]
    columns = (*first.columns, *range(len(first.layout.names), len(names)))
    units, unknown = {**first.units}, {**first.unknown}
    for column, file, sheet in zip(columns[1:], files, sheets, strict=True):
        names[column] = file.stem[-3:].upper()
        channel = sheet.columns[1]
        units |= {column: sheet.units[channel]} if channel in sheet.units else {}
        unknown |= {column: sheet.unknown[channel]} if channel in sheet.unknown else {}
    layout = Layout(first.layout.header_rows, tuple(names), first.layout.delimiter, first.layout.decimal)

    def read(wanted: Sequence[int]) -> list[Real]:
        tables = [read_columns(file, s.layout, s.columns) for file, s in zip(files, sheets, strict=True)]
        for file, table in zip(files, tables, strict=True):
            if not np.array_equal(table[0], tables[0][0]):
                raise CampaignError(
                    f"{file}: its times must be those of {files[0].name}; they differ. Export both again."
                )
        every = dict(zip(columns, [tables[0][0], *(table[1] for table in tables)], strict=True))
        return [every[i] for i in wanted]

    return Sheet(layout, columns, units, unknown, None, first.style), read


def _check_unit(file: Path, sheet: Sheet, role: str, column: int) -> None:
    name = sheet.layout.names[column]
    if column in sheet.unknown:
        raise CampaignError(
            f"{file}: the unit {sheet.unknown[column][:20]!r} of column {name[:40]} is not known; s, V, um and nm are, "
            "and ms, us, ns, mV, uV, kV, mm. Convert the column."
        )
    bases = ("s",) if role == "time" else _BASES[role]
    if column in sheet.units and sheet.units[column].base not in bases:
        raise CampaignError(
            f"{file}: the {role} must be in {' or '.join(bases)}; column {name[:40]} is in "
            f"{sheet.units[column].base}. Specify the column with columns={{{role!r}: …}}."
        )


def _unit_note(sheet: Sheet, role: str, column: int) -> str:
    if column in sheet.units or (role == "time" and sheet.clock is not None):
        return ""
    return f", no unit given: taken as {'s' if role == 'time' else 'V'}"


def _clock_times(file: Path, start_s: float, step_s: float, numbers: Real) -> Real:
    if not (np.isfinite([start_s, step_s]).all() and step_s > 0):
        raise CampaignError(f"{file}: the header's increment must be above 0 s; got {step_s:g} s. Export it again.")
    if not (np.diff(numbers) == 1).all():
        k = int(np.argmin(np.diff(numbers) == 1))
        raise CampaignError(
            f"{file}: sample numbers must count up by one; got {numbers[k + 1]:g} after {numbers[k]:g}. "
            "Samples are missing or doubled: export it again."
        )
    return start_s + step_s * numbers


def _guessed_channel(name: str, unit: str) -> str | None:
    for channel, words in _CHANNEL_WORDS:
        if words.search(name):
            return channel
    return "displacement" if unit in ("um", "nm") else None
