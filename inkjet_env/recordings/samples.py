"""The samples of one file, as the arrays of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.printhead import nearest_name
from inkjet_env.recordings.campaign import Source
from inkjet_env.recordings.recording import SENSOR_COLUMNS, CampaignError, brief
from inkjet_env.recordings.sampling import last_digit, uniform_times
from inkjet_env.recordings.table import Layout, first_and_last_rows, read_columns, row_of_sample, split_cells
from inkjet_env.recordings.units import Unit
from inkjet_env.typing import Real

OPTIONAL_COLUMNS = ("drive_monitor_V", "neighbour_V")


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
    names = _header(file)
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
    layout = Layout(header_rows=1, names=names)
    arrays = dict(zip(columns, read_columns(file, layout, [names.index(n) for n in columns.values()]), strict=True))
    arrays["time_s"], notes = uniform(file, layout, names.index("time_s"), arrays["time_s"], None)
    unused = [name for name in names if name not in columns.values()]
    if unused:
        notes += (f"{file}: column {', '.join(unused)[:80]} was not read.",)
    return Samples(arrays | {"unit": units[0]}, names, Source(str(file), 2), notes)


def uniform(file: Path, layout: Layout, column: int, time: Real, unit: Unit | None) -> tuple[Real, tuple[str, ...]]:
    """Uniform times in seconds from a file's time column, shape (n,), and notes if they were repaired.

    Raises
    ------
    CampaignError
        Times decrease, or their steps differ by more than their printed precision explains.
    """
    unit = unit or Unit("s")
    printed = [
        last_digit([cells[column].replace(layout.decimal, ".") for cells in rows if len(cells) > column])
        for rows in first_and_last_rows(file, layout)
    ]
    print_step_s = max(printed) * unit.times / unit.over
    time_s = unit.to_base(time)
    repaired = uniform_times(time_s, print_step_s)
    if repaired is None:
        raise _not_uniform(file, layout, time_s)
    uniform_s, jitter = repaired
    if uniform_s is time_s:
        return time_s, ()
    return uniform_s, (
        f"{file}: printed times are up to {jitter:.2g} steps off a uniform grid; "
        f"a step of {uniform_s[1] - uniform_s[0]:.9g} s was taken.",
    )


def _not_uniform(file: Path, layout: Layout, time_s: Real) -> CampaignError:
    steps_s = np.diff(time_s)
    usual_s = float(np.median(steps_s))
    if usual_s <= 0:
        return CampaignError(
            f"{file}, row {layout.header_rows + 2}: time must increase from row to row; most rows do not. "
            "Is this the time column, and is it printed with enough digits?"
        )
    backward = steps_s <= 0
    k = int(np.argmax(backward)) if backward.any() else int(np.argmax(np.abs(steps_s - usual_s)))
    row = row_of_sample(file, layout, k + 1)
    if backward.any():
        return CampaignError(
            f"{file}, row {row}: time must increase from row to row; got {time_s[k + 1]:.9g} s after "
            f"{time_s[k]:.9g} s. Sort the rows or remove the repeated one."
        )
    return CampaignError(
        f"{file}, row {row}: sampling must be uniform; a step of {steps_s[k]:.6g} s among steps of {usual_s:.6g} s is "
        f"{abs(steps_s[k] / usual_s - 1):.3g} steps off. Resample, or cut the recording there."
    )


def _header(file: Path) -> tuple[str, ...]:
    try:
        with open(file, encoding="utf-8-sig") as lines:
            line = lines.readline(100_000)
    except OSError as error:
        raise CampaignError(f"{file}: cannot be read: {error.strerror or error}. Check the file.") from None
    except UnicodeDecodeError:
        raise CampaignError(f"{file}, row 1: the header must be UTF-8 text. Export the file as CSV.") from None
    return tuple(split_cells(line.rstrip("\r\n"), ","))


def _missing(file: Path, wanted: str, names: tuple[str, ...]) -> CampaignError:
    return CampaignError(
        f"{file}, row 1: the header must name {wanted}; got {brief(','.join(names))}. Correct the header, or say which "
        f"column is which with columns=.{nearest_name(wanted, [name[:60] for name in names if name])}"
    )
