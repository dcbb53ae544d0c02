"""A drive to be simulated, from a file of any style that recordings may have, or from a controller's segments."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from inkjet_env.recordings.checks import LARGEST_DRIVE_V, UNREAL_DRIVE_V
from inkjet_env.recordings.clock import SAME_STEP, agreed_times, counted_times, refuse_other_times
from inkjet_env.recordings.instrument_file import ARRAY_SUFFIXES, Table, TextTable, open_table
from inkjet_env.recordings.recording import CampaignError
from inkjet_env.recordings.roles import named_drive
from inkjet_env.recordings.segment_file import is_segment_file, read_segments
from inkjet_env.recordings.sheet import read_sheet
from inkjet_env.recordings.text_file import open_text
from inkjet_env.typing import Real


@dataclass(frozen=True)
class Drive:
    """A drive over time, linear between its samples.

    Attributes
    ----------
    time_s, drive_V : ndarray, shape (n,)
        Times in seconds, increasing, and drive in volts.
    notes : tuple of str
        What is doubtful, in sentences.
    """

    time_s: Real
    drive_V: Real
    notes: tuple[str, ...]


def read_drive(path: str | os.PathLike[str], interval_s: float | None = None, implausible: bool = False) -> Drive:
    """Read a drive: its times need not be uniform.

    Parameters
    ----------
    path : str or Path
        A file of any style that `read_campaign` reads, or the segment file of a print controller.
    interval_s : float, optional
        Sampling interval in seconds, for a file that holds neither times nor an interval.
    implausible : bool
        Whether a drive beyond 1 kV is meant.

    Raises
    ------
    CampaignError
        The file cannot be read, the columns of times and drive are unknown, a time does not increase, or a voltage is
        beyond 1 kV. The message names the file, the row, the rule and a fix.
    """
    file = Path(path)
    if not file.is_file():
        raise CampaignError(
            f"{file}: must be a file; there is {'a folder' if file.is_dir() else 'none'}. Check its name."
        )
    if file.suffix.lower() in ARRAY_SUFFIXES:
        table = open_table(file)
    else:
        text = open_text(file)
        if is_segment_file(text):
            time_s, drive_V = read_segments(text)
            return _checked(file, time_s, drive_V, (), implausible)
        table = TextTable(read_sheet(text))
    return _checked(file, *_columns(table, interval_s), implausible)


def _columns(table: Table, interval_s: float | None) -> tuple[Real, Real, tuple[str, ...]]:
    """Times in seconds, drive in volts and notes."""
    time, reason, drive = named_drive(table, interval_s)
    wanted = [drive] if time is None else [time, drive]
    values = dict(zip(wanted, table.read(wanted), strict=True))
    header, names = table.header, table.header.names
    for role, i, bases in (("time", time, ("s",)), ("drive", drive, ("V",))):
        if i is not None and (i in header.unknown or (i in header.units and header.units[i].base not in bases)):
            unit = header.unknown[i] or "no unit" if i in header.unknown else header.units[i].base
            raise CampaignError(
                f"{table.file}: the {role} must be in {bases[0]}; column {names[i][:40]} is in {unit[:20]}. Convert it."
            )
    drive_V = header.units[drive].to_base(values[drive]) if drive in header.units else values[drive]
    notes = list(table.notes)
    if drive not in header.units:
        notes.append(f"{table.file}: column {names[drive][:40]} has no unit: taken as V.")
    some = drive_V if time is None else values[time]
    if time is None:
        refuse_other_times(table, {drive}, interval_s)
    if (counted := counted_times(table, time, reason, some, interval_s)) is not None:
        return counted[0], drive_V, (*notes, counted[1])
    assert time is not None
    if time not in header.units:
        notes.append(f"{table.file}: column {names[time][:40]} ({reason}) has no unit: taken as s.")
    time_s = header.units[time].to_base(some) if time in header.units else some
    steps = np.diff(time_s)
    if not (steps > 0).all():
        k = int(np.argmin(steps > 0))
        place = f"{table.file}, {table.place(k + 1)}"
        if steps[k] == 0:
            raise CampaignError(
                f"{place}: time must increase from row to row; got {time_s[k + 1]:.9g} s twice. For a vertical edge, "
                f"put the second row one step of the generator later, such as {time_s[k + 1] + 1e-8:.9g} s."
            )
        raise CampaignError(
            f"{place}: time must increase from row to row; got {time_s[k + 1]:.9g} s after {time_s[k]:.9g} s. Sort the "
            "rows."
        )
    if (np.abs(steps / np.median(steps) - 1) < SAME_STEP).all():
        time_s, more = agreed_times(table, time, time_s, float(np.median(steps)), interval_s)
        notes.extend(more)
    return time_s, drive_V, tuple(notes)


def _checked(file: Path, time_s: Real, drive_V: Real, notes: tuple[str, ...], implausible: bool) -> Drive:
    largest_V = float(np.abs(drive_V).max())
    if largest_V > UNREAL_DRIVE_V and not implausible:
        raise CampaignError(
            f"{file}: the drive goes to {largest_V:g} V. Check the unit: millivolts? If it is meant, give "
            "implausible=True (--implausible)."
        )
    if largest_V > LARGEST_DRIVE_V:
        notes = (
            *notes,
            f"{file}: the drive goes to {largest_V:g} V, beyond ±{LARGEST_DRIVE_V:g} V: check the head's limit.",
        )
    return Drive(time_s, drive_V, notes)
