"""The samples of one file, as the arrays of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.printhead import nearest_name
from inkjet_env.recordings.campaign import Source
from inkjet_env.recordings.header import Header
from inkjet_env.recordings.instrument_file import Table, TextTable
from inkjet_env.recordings.recording import SENSOR_COLUMNS, CampaignError, brief
from inkjet_env.recordings.sampling import single_precision_step, uniform_times
from inkjet_env.recordings.sheet import Sheet
from inkjet_env.recordings.table import Layout, split_cells
from inkjet_env.recordings.text_file import open_text
from inkjet_env.recordings.units import Unit
from inkjet_env.typing import Real

OPTIONAL_COLUMNS = ("drive_monitor_V", "neighbour_V")
_ROLES = {
    "time_s": "time", "drive_V": "drive", "sensor": "sensor", "drive_monitor_V": "monitor", "neighbour_V": "neighbour",
}  # fmt: skip
"""Roles of a recording's arrays."""


@dataclass(frozen=True)
class Samples:
    """Content of one file.

    Parameters
    ----------
    arrays : mapping
        `time_s`, `drive_V`, `sensor`, `unit` and the optional columns, by their names in `Recording`.
    names : tuple of str
        Names of all columns of the file.
    source : Source
        File and row of the first sample.
    notes : tuple of str
        Guesses made when the file was read, in sentences.
    channel : str or None
        Sensor, if the name or unit of its column shows it.
    """

    arrays: Mapping[str, Any]
    names: tuple[str, ...]
    source: Source
    notes: tuple[str, ...]
    channel: str | None = None


def read_standard_samples(file: Path) -> Samples:
    """Read a file of the campaign format: header in row 1, commas, decimal points, columns by their fixed names.

    Raises
    ------
    CampaignError
        A column is missing or duplicated, or anything that `read_columns` refuses.
    """
    text = open_text(file)
    names = tuple(split_cells(text.start[0], ",")) if text.start else ("",)
    for name in ("time_s", "drive_V", *OPTIONAL_COLUMNS, *SENSOR_COLUMNS.values()):
        if names.count(name) > 1:
            raise CampaignError(
                f"{file}, row 1: the header names {name} {names.count(name)} times. Remove all but one."
            )
    for name in ("time_s", "drive_V"):
        if name not in names:
            raise _missing(file, name, names)
    units = [unit for unit, column in SENSOR_COLUMNS.items() if column in names]
    if not units:
        raise _missing(file, "one of " + ", ".join(SENSOR_COLUMNS.values()), names)
    if len(units) > 1:
        raise CampaignError(
            f"{file}, row 1: must hold one sensor; the header names {' and '.join(SENSOR_COLUMNS[u] for u in units)}. "
            "Put each into a separate recording."
        )
    columns = {"time_s": "time_s", "drive_V": "drive_V", "sensor": SENSOR_COLUMNS[units[0]]}
    columns |= {name: name for name in OPTIONAL_COLUMNS if name in names}
    header = Header(names, {}, {}, None, "campaign")
    table = TextTable(Sheet(Layout(text, 1, names), tuple(range(len(names))), header))
    arrays: dict[str, Any] = dict(zip(columns, table.read([names.index(n) for n in columns.values()]), strict=True))
    arrays["time_s"], notes = uniform(table, names.index("time_s"), arrays["time_s"], None)
    unused = [name for name in names if name not in columns.values()]
    if unused:
        notes += (f"{file}: column {', '.join(unused)[:80]} was not read.",)
    roles = {_ROLES[label]: name for label, name in columns.items()}
    return Samples(arrays | {"unit": units[0]}, names, Source(str(file), 2, names, roles), notes)


def uniform(table: Table, column: int, time: Real, unit: Unit | None) -> tuple[Real, tuple[str, ...]]:
    """Uniform times in seconds from a file's time column, shape (n,), and notes if they were repaired.

    Raises
    ------
    CampaignError
        Times decrease, or their steps differ by more than their printed precision explains.
    """
    unit = unit or Unit("s")
    printed = table.print_step(column)
    time_s = unit.to_base(time)
    repaired = uniform_times(time_s, max(printed, single_precision_step(time, printed)) * unit.times / unit.over)
    if repaired is None:
        raise _not_uniform(table, time_s)
    uniform_s, jitter = repaired
    if uniform_s is time_s:
        return time_s, ()
    return uniform_s, (
        f"{table.file}: printed times are up to {jitter:.2g} steps off a uniform grid; "
        f"a step of {uniform_s[1] - uniform_s[0]:.9g} s was taken.",
    )


def _not_uniform(table: Table, time_s: Real) -> CampaignError:
    steps_s = np.diff(time_s)
    usual_s = float(np.median(steps_s))
    if usual_s < 0 and (steps_s < 0).all():
        return CampaignError(
            f"{table.file}, {table.place(0)}: time runs backwards, from {time_s[0]:.9g} s to {time_s[-1]:.9g} s. Sort "
            "the rows by time."
        )
    if usual_s <= 0:
        return CampaignError(
            f"{table.file}, {table.place(1)}: time must increase from row to row; most rows do not. "
            "Is this the time column, and is it printed with enough digits?"
        )
    backward = steps_s <= 0
    k = int(np.argmax(backward)) if backward.any() else int(np.argmax(np.abs(steps_s - usual_s)))
    place = table.place(k + 1)
    if backward.any():
        return CampaignError(
            f"{table.file}, {place}: time must increase from row to row; got {time_s[k + 1]:.9g} s after "
            f"{time_s[k]:.9g} s. Sort the rows or remove the repeated one."
        )
    return CampaignError(
        f"{table.file}, {place}: sampling must be uniform; a step of {steps_s[k]:.6g} s among steps of {usual_s:.6g} s "
        f"is {abs(steps_s[k] / usual_s - 1):.3g} steps off. Resample, or cut the recording there."
    )


def _missing(file: Path, wanted: str, names: tuple[str, ...]) -> CampaignError:
    return CampaignError(
        f"{file}, row 1: the header must name {wanted}; got {brief(','.join(names))}. Correct the header, or say which "
        f"column is which with columns=.{nearest_name(wanted, [name[:60] for name in names if name])}"
    )
