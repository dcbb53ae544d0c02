"""Sampled drives and responses as CSV: every row is checked on reading; files are written atomically."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.printhead import Waveform
from inkjet_env.storage import write_atomically
from inkjet_env.typing import Real

DRIVE_COLUMNS = ("time_s", "drive_V")
DEFAULT_SAMPLE_RATE_Hz = 100e6
MAX_SAMPLES = 10_000_000


def read_drive(path: str | Path) -> tuple[Real, Real]:
    """Read a sampled drive.

    Parameters
    ----------
    path : str or Path
        CSV with a header line that names ``time_s`` and ``drive_V``; other columns are ignored.

    Returns
    -------
    time_s, drive_V : ndarray, shape (n,)
        Times in seconds, increasing, and drive in volts.

    Raises
    ------
    ValueError
        The file does not exist or is not CSV, a column is missing, there are fewer than two samples, a value is not a
        finite number, or a time does not increase. The message names the file, the row (the header is row 1), the
        rule and a fix.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise ValueError(f"{path}: cannot be read: {reason}. Check the file's name.") from None
    rows = csv.reader(text.splitlines())
    header = [name.strip() for name in next(_parsed(path, rows), [])]
    for column in DRIVE_COLUMNS:
        if header.count(column) != 1:
            raise ValueError(
                f"{path}, row 1: the header must name {column} once; got {','.join(header)[:80]!r}. "
                "The first line of the file must read time_s,drive_V."
            )
    places = [header.index(column) for column in DRIVE_COLUMNS]
    samples: list[tuple[float, float]] = []
    for row in _parsed(path, rows):
        if not row:
            continue
        sample = _sample(f"{path}, row {rows.line_num}", row, places)
        if samples and sample[0] <= samples[-1][0]:
            raise ValueError(
                f"{path}, row {rows.line_num}: time_s must increase from row to row; got {sample[0]:g} s after "
                f"{samples[-1][0]:g} s. Sort the rows or remove the repeated one."
            )
        samples.append(sample)
    if len(samples) < 2:
        raise ValueError(f"{path}: a drive must have at least 2 samples; got {len(samples)}. Add rows.")
    time_s, drive_V = np.array(samples).T
    return np.ascontiguousarray(time_s), np.ascontiguousarray(drive_V)


def _parsed(path: str | Path, rows: Any) -> Iterator[list[str]]:
    try:
        yield from rows
    except csv.Error as error:
        raise ValueError(
            f"{path}, row {rows.line_num}: is not CSV: {error}. Give a text file with columns separated by commas."
        ) from None


def _sample(place: str, row: list[str], places: list[int]) -> tuple[float, float]:
    values = []
    for column, index in zip(DRIVE_COLUMNS, places, strict=True):
        if index >= len(row):
            raise ValueError(f"{place}: {column} is missing. Complete the row or remove it.")
        try:
            value = float(row[index])
        except ValueError:
            raise ValueError(
                f"{place}: {column} must be a number; got {row[index]!r}. "
                "Use a decimal point, and commas between columns."
            ) from None
        if not math.isfinite(value):
            raise ValueError(f"{place}: {column} must be finite; got {row[index]!r}. Trim the recording.")
        values.append(value)
    return values[0], values[1]


def write_columns(path: str | Path, columns: Mapping[str, Real]) -> None:
    """Write columns of equal length as CSV with a header line; all numbers but times are read back exactly.

    Times (names ending in ``_s``) have 12 significant digits, so that ``k / rate`` is written without rounding noise.
    """
    formats = ["%.12g" if name.endswith("_s") else "%.17g" for name in columns]
    lines = [",".join(columns)]
    lines += [
        ",".join(f % value for f, value in zip(formats, row, strict=True))
        for row in zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    ]
    write_atomically(path, "\n".join(lines) + "\n")


def sampled_waveform(waveform: Waveform, sample_rate_Hz: float) -> tuple[Real, Real]:
    """Times in seconds and drive in volts of a waveform at a uniform rate, for an arbitrary waveform generator.

    The first sample is at time 0 and the last at or just after the waveform's end; both are 0 V. A generator that
    interpolates linearly between samples cuts each corner by less than one sampling step.

    Raises
    ------
    ValueError
        The rate is not positive, or gives fewer than 11 or more than ten million samples.
    """
    if not (math.isfinite(sample_rate_Hz) and sample_rate_Hz > 0):
        raise ValueError(f"the sample rate must be a positive number of Hz; got {sample_rate_Hz:g}.")
    steps = math.ceil(waveform.duration_s * sample_rate_Hz * (1 - 1e-12))
    if not 10 <= steps < MAX_SAMPLES:
        raise ValueError(
            f"a sample rate of {sample_rate_Hz:g} Hz gives {steps + 1} samples of a waveform of "
            f"{waveform.duration_s * 1e6:.3g} µs; 11 to {MAX_SAMPLES} are allowed. Give another --sample-rate."
        )
    time_s = np.arange(steps + 1) / sample_rate_Hz
    drive_V = waveform.drive_V(time_s)
    drive_V[[0, -1]] = 0.0
    return time_s, drive_V
