"""Columns of numbers from a text file: fast, and every bad cell is named by its row."""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from inkjet_env.recordings.recording import CampaignError, brief
from inkjet_env.recordings.text_file import TextFile
from inkjet_env.typing import Real

ROWS_A_BLOCK = 1 << 16
"""Number of rows that are held in memory as text."""
EDGE = 20
"""Number of rows at either end of a file whose printed digits are kept."""
BLANKS = ' \t\n\r,;"'
"""Characters of a row without any filled cell."""
_POINTS_AND_COMMAS = str.maketrans(".,", ",.")


@dataclass(frozen=True)
class Layout:
    """Layout of the rows of a text file.

    Parameters
    ----------
    file : TextFile
        The file.
    header_rows : int
        Number of rows before the first sample.
    names : tuple of str
        Name of each column.
    delimiter, decimal : str
        Separator of the columns, a blank for any number of blanks; and decimal sign.
    """

    file: TextFile
    header_rows: int
    names: tuple[str, ...]
    delimiter: str = ","
    decimal: str = "."


@dataclass(frozen=True)
class Columns:
    """Columns of a text file.

    Attributes
    ----------
    values : list of ndarray, shape (n,)
        The columns that were wanted; read-only.
    first, last : list of list of str
        Cells of the first and the last rows, as printed.
    """

    values: list[Real]
    first: list[list[str]]
    last: list[list[str]]


def read_columns(layout: Layout, wanted: Sequence[int]) -> Columns:
    """Read some columns of a text file as float64, block by block, so that only these are held in memory.

    A million rows of three columns take about 1 s.

    Parameters
    ----------
    layout : Layout
        The file and the layout of its rows.
    wanted : sequence of int
        Columns to read, counted from 0.

    Raises
    ------
    CampaignError
        A cell that is not a finite number, a row that is too short or too long, fewer than two rows, a file that
        cannot be read. The message names the row; the file's first line is row 1.
    """
    columns = [np.empty(0) for _ in wanted]
    count = 0
    first: list[str] = []
    last: list[str] = []
    try:
        with layout.file.lines() as lines:
            rows = itertools.islice(lines, layout.header_rows, None)
            while block := list(itertools.islice(rows, ROWS_A_BLOCK)):
                filled = [line for line in block if _is_row(line)]
                values = _numbers(filled, layout, wanted)
                first, last = first or filled[:EDGE], [*last, *filled[-EDGE:]][-EDGE:]
                end = count + len(values)
                for column, read in zip(columns, values.T, strict=True):
                    if end > len(column):
                        column.resize(max(end, len(column) * 5 // 4), refcheck=False)
                    column[count:end] = read
                count = end
    except CampaignError:
        raise
    except ValueError as error:
        raise _first_fault(layout, wanted, str(error)) from None
    for column in columns:
        column.resize(count, refcheck=False)
        column.flags.writeable = False
    if count < 2 or not all(np.isfinite(column).all() for column in columns):
        raise _first_fault(layout, wanted, "a value is not finite")
    edges = (
        [split_cells(without_remark(line, layout.delimiter), layout.delimiter) for line in lines]
        for lines in (first, last)
    )
    return Columns(columns, *edges)


def _numbers(lines: list[str], layout: Layout, wanted: Sequence[int]) -> Real:
    """Numbers in the wanted columns of some lines, shape (rows, wanted); ``ValueError`` if a line is no such row."""
    if not lines:
        return np.empty((0, len(wanted)))
    width = len(layout.names)
    text = "".join(lines)
    if "#" in text:
        lines = [without_remark(line, layout.delimiter) for line in lines]
    if '"' in text:
        if any(line.count('"') % 2 for line in lines):
            raise ValueError("a quotation mark is not closed")
        widths = {len(split_cells(line, layout.delimiter)) for line in lines}
    elif layout.delimiter == " ":
        widths = {len(line.split()) for line in lines}
    else:
        widths = {line.count(layout.delimiter) + 1 for line in lines}
    if widths != {width}:
        raise ValueError("the rows differ in their number of columns")
    if layout.decimal == ",":
        lines = [_with_points(line) for line in lines]
    delimiter = None if layout.delimiter == " " else layout.delimiter
    return np.loadtxt(lines, delimiter=delimiter, comments=None, quotechar='"', usecols=tuple(wanted), ndmin=2)


def _is_row(line: str) -> bool:
    """Whether a line is a row of samples: neither empty nor a comment."""
    return bool(line.strip(BLANKS)) and line.lstrip()[0] not in "#%"


def _with_points(text: str) -> str:
    """Text with decimal points for decimal commas; what was a point is then no part of a number."""
    return text.translate(_POINTS_AND_COMMAS)


def row_of_sample(layout: Layout, sample: int) -> int:
    """Row of the file, counted from 1, of a sample counted from 0; empty rows are not samples."""
    with layout.file.lines() as lines:
        rows = itertools.islice(_sample_lines(layout, lines), sample, None)
        return next(rows, (layout.header_rows + sample + 1, ""))[0]


def without_remark(line: str, delimiter: str) -> str:
    """A row of samples without the remark that some programs write behind it, after a number sign."""
    place = line.find(f"{delimiter}#")
    return line[:place] + "\n" if place > 0 and line[:place].strip(BLANKS) else line


def split_cells(line: str, delimiter: str) -> list[str]:
    """Cells of one line, without the blanks and quotes around them."""
    if delimiter == " ":
        return line.replace('"', "").split() or [""]
    try:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), []) or [""]
    except csv.Error:
        cells = line.split(delimiter)
    return [cell.strip() for cell in cells]


def _sample_lines(layout: Layout, lines: Iterator[str]) -> Iterator[tuple[int, str]]:
    for row, line in enumerate(lines, start=1):
        if row > layout.header_rows and _is_row(line):
            yield row, without_remark(line, layout.delimiter).rstrip("\n")


def _first_fault(layout: Layout, wanted: Sequence[int], reason: str) -> CampaignError:
    """Error for the first row that breaks a rule, or for too few rows: a slow reader, run after the fast one failed."""
    count, path = 0, layout.file.path
    with layout.file.lines() as lines:
        for row, line in _sample_lines(layout, lines):
            count += 1
            if (fault := _fault(line, layout, wanted)) is not None:
                return CampaignError(f"{path}, row {row}: {fault}")
    if count < 2:
        return CampaignError(f"{path}: a recording must have at least 2 samples; got {count}. Add rows.")
    return CampaignError(
        f"{path}: is not a table of numbers: {' '.join(reason.split())[:200]}. Export it as CSV again."
    )


def _fault(line: str, layout: Layout, wanted: Sequence[int]) -> str | None:
    """What is wrong with a row, and the likely fix; None if it is right."""
    if line.count('"') % 2:
        return "a quotation mark is not closed. Remove it."
    cells = split_cells(line, layout.delimiter)
    if len(cells) != len(layout.names):
        return (
            f"must have {len(layout.names)} columns as the rows before; got {len(cells)}. Complete the row or remove "
            "it."
        )
    for i in wanted:
        name = layout.names[i][:40]
        if not cells[i]:
            return f"{name} is empty. Trim the recording or mark the gap."
        try:
            finite = math.isfinite(float(_with_points(cells[i]) if layout.decimal == "," else cells[i]))
        except ValueError:
            return (
                f"{name} must be a number; got {brief(cells[i])}. Use {layout.decimal!r} as decimal sign and "
                f"{layout.delimiter!r} between columns."
            )
        if not finite:
            return f"{name} must be finite; got {brief(cells[i])}. Trim the recording or mark the gap."
    return None
