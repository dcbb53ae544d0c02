"""Columns of numbers from a text file: fast, and every bad cell is named by its row."""

from __future__ import annotations

import csv
import itertools
import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from inkjet_env.recordings.recording import CampaignError, brief
from inkjet_env.typing import Real

TAIL_BYTES = 1 << 16
"""Bytes at the end of a file in which its last rows are looked for."""
ROWS_A_BLOCK = 1 << 16
"""Number of rows that are held in memory as text."""
_POINTS_AND_COMMAS = str.maketrans(".,", ",.")


@dataclass(frozen=True)
class Layout:
    """Layout of the rows of a text file.

    Parameters
    ----------
    header_rows : int
        Number of rows before the first sample.
    names : tuple of str
        Name of each column.
    delimiter, decimal : str
        Separator of the columns, and decimal sign.
    """

    header_rows: int
    names: tuple[str, ...]
    delimiter: str = ","
    decimal: str = "."


def read_columns(path: Path, layout: Layout, wanted: Sequence[int]) -> list[Real]:
    """Read some columns of a text file as float64, block by block, so that only these are held in memory.

    A million rows of three columns take about 2 s.

    Parameters
    ----------
    path : Path
        The text file.
    layout : Layout
        Layout of its rows.
    wanted : sequence of int
        Columns to read, counted from 0.

    Returns
    -------
    list of ndarray, shape (n,)
        The columns in the order of ``wanted``; read-only.

    Raises
    ------
    CampaignError
        A cell that is not a finite number, a row that is too short or too long, fewer than two rows, a file that
        cannot be read. The message names the row; the file's first line is row 1.
    """
    columns = [np.empty(0) for _ in wanted]
    count = 0
    try:
        with open(path, encoding="utf-8-sig", errors="replace") as file:
            rows = itertools.islice(file, layout.header_rows, None)
            while block := list(itertools.islice(rows, ROWS_A_BLOCK)):
                values = _numbers(block, layout, wanted)
                end = count + len(values)
                for column, read in zip(columns, values.T, strict=True):
                    if end > len(column):
                        column.resize(max(end, len(column) * 5 // 4), refcheck=False)
                    column[count:end] = read
                count = end
    except ValueError as error:
        raise _first_fault(path, layout, wanted, str(error)) from None
    except OSError as error:
        raise CampaignError(f"{path}: cannot be read: {error.strerror or error}. Check the file.") from None
    for column in columns:
        column.resize(count, refcheck=False)
        column.flags.writeable = False
    if count < 2 or not all(np.isfinite(column).all() for column in columns):
        raise _first_fault(path, layout, wanted, "a value is not finite")
    return columns


def _numbers(lines: list[str], layout: Layout, wanted: Sequence[int]) -> Real:
    """Numbers in the wanted columns of some lines, shape (rows, wanted); ``ValueError`` if a line is no such row."""
    lines = [line for line in lines if line != "\n"]
    if not lines:
        return np.empty((0, len(wanted)))
    width = len(layout.names)
    text = "".join(lines)
    if '"' in text:
        if any(line.count('"') % 2 for line in lines):
            raise ValueError("a quotation mark is not closed")
        widths = {len(split_cells(line, layout.delimiter)) for line in lines}
    else:
        widths = {line.count(layout.delimiter) + 1 for line in lines}
    if widths != {width}:
        raise ValueError("the rows differ in their number of columns")
    if layout.decimal == ",":
        lines = [_with_points(line) for line in lines]
    return np.loadtxt(lines, delimiter=layout.delimiter, comments=None, quotechar='"', usecols=tuple(wanted), ndmin=2)


def _with_points(text: str) -> str:
    """Text with decimal points for decimal commas; what was a point is then no part of a number."""
    return text.translate(_POINTS_AND_COMMAS)


def row_of_sample(path: Path, layout: Layout, sample: int) -> int:
    """Row of the file, counted from 1, of a sample counted from 0; empty rows are not samples."""
    return next(itertools.islice(_samples(path, layout), sample, None), (layout.header_rows + sample + 1, []))[0]


def first_and_last_rows(path: Path, layout: Layout) -> tuple[list[list[str]], list[list[str]]]:
    """Cells of the first and the last twenty rows of samples, as printed; the file must have been read before."""
    first = [cells for _, cells in itertools.islice(_samples(path, layout), 20)]
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - TAIL_BYTES))
        lines = split_lines(file.read().decode("utf-8", errors="replace"))
    whole = lines[layout.header_rows :] if size <= TAIL_BYTES else lines[1:]
    return first, [split_cells(line, layout.delimiter) for line in whole if line][-20:]


def split_cells(line: str, delimiter: str) -> list[str]:
    """Cells of one line, without the blanks and quotes around them."""
    try:
        cells = next(csv.reader([line], delimiter=delimiter), []) or [""]
    except csv.Error:
        cells = line.split(delimiter)
    return [cell.strip() for cell in cells]


def split_lines(text: str) -> list[str]:
    """Lines of a CSV file; `str.splitlines` would split at many more characters."""
    return re.split(r"\r\n|\n|\r", text)


def _samples(path: Path, layout: Layout) -> Iterator[tuple[int, list[str]]]:
    for row, line in _sample_lines(path, layout):
        yield row, split_cells(line, layout.delimiter)


def _sample_lines(path: Path, layout: Layout) -> Iterator[tuple[int, str]]:
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        for row, line in enumerate(file, start=1):
            if row > layout.header_rows and line != "\n":
                yield row, line.rstrip("\n")


def _first_fault(path: Path, layout: Layout, wanted: Sequence[int], reason: str) -> CampaignError:
    """Error for the first row that breaks a rule, or for too few rows: a slow reader, run after the fast one failed."""
    count = 0
    for row, line in _sample_lines(path, layout):
        count += 1
        if line.count('"') % 2:
            return CampaignError(f"{path}, row {row}: a quotation mark is not closed. Remove it.")
        cells = split_cells(line, layout.delimiter)
        if len(cells) != len(layout.names):
            return CampaignError(
                f"{path}, row {row}: must have {len(layout.names)} columns as the rows before; got {len(cells)}. "
                "Complete the row or remove it."
            )
        for i in wanted:
            try:
                finite = math.isfinite(float(_with_points(cells[i]) if layout.decimal == "," else cells[i]))
            except ValueError:
                return CampaignError(
                    f"{path}, row {row}: {layout.names[i][:40]} must be a number; got {brief(cells[i])}. "
                    f"Use {layout.decimal!r} as decimal sign and {layout.delimiter!r} between columns."
                )
            if not finite:
                return CampaignError(
                    f"{path}, row {row}: {layout.names[i][:40]} must be finite; got {brief(cells[i])}. "
                    "Trim the recording or mark the gap."
                )
    if count < 2:
        return CampaignError(f"{path}: a recording must have at least 2 samples; got {count}. Add rows.")
    return CampaignError(
        f"{path}: is not a table of numbers: {' '.join(reason.split())[:200]}. Export it as CSV again."
    )
