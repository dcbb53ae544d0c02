"""Where the samples of an instrument's text file are, found in its first lines, and what its header says of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from inkjet_env.recordings.header import Header, is_number, read_header
from inkjet_env.recordings.recording import CampaignError
from inkjet_env.recordings.table import BLANKS, Layout, split_cells
from inkjet_env.recordings.text_file import TextFile
from inkjet_env.recordings.units import known_unit

DELIMITERS = ("\t", ";", ",", " ")
_BESIDE = 3
"""Columns of an older Tektronix file that hold its header, beside the samples."""
_NO_VALUE = {
    "", "nan", "inf", "+inf", "-inf", "∞", "+∞", "-∞", "-", "--", "---", "----", "-----", "n/a", "ovr", "over", "ol",
    "+ol", "-ol", "overrange", "+over", "-over",
}  # fmt: skip
"""Cells of a sample that an instrument did not take or that was out of its range, in lower case."""
_OUT_OF_RANGE = 9.8e37
"""Least magnitude of the numbers that stand for no value in instruments' replies."""


@dataclass(frozen=True)
class Sheet:
    """The samples of one file and what its header says.

    Attributes
    ----------
    layout : Layout
        Rows, names, delimiter and decimal sign of the file.
    columns : tuple of int
        Columns that hold samples, counted from 0.
    header : Header
        Names, units and clock.
    notes : tuple of str
        What was passed over, in sentences.
    """

    layout: Layout
    columns: tuple[int, ...]
    header: Header
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Run:
    """Consecutive rows of samples: their places among the lines, and their cells."""

    delimiter: str
    decimal: str
    rows: tuple[int, ...]
    cells: tuple[tuple[str, ...], ...]


def read_sheet(text: TextFile) -> Sheet:
    """Find where a file's samples are, and understand its header.

    Raises
    ------
    CampaignError
        The file has no rows of numbers.
    """
    first = split_cells(text.start[0], ",") if text.start else [""]
    if first[0].lower() == "record length" and len(first) > _BESIDE + 1 and all(map(is_number, first[_BESIDE:5])):
        return _sheet_beside(text, first)
    runs = [run for delimiter in DELIMITERS if (run := _longest_run(text.start, delimiter)) is not None]
    if not runs:
        raise _no_samples(text)
    run = max(runs, key=lambda run: (len(run.rows), len(run.cells[0])))
    width = len(run.cells[0])
    filled = [sum(_value(row[i], run.decimal) is not None for row in run.cells) for i in range(width)]
    columns = tuple(i for i in range(width) if filled[i] >= len(run.rows) / 2)
    header = read_header([split_cells(line, run.delimiter) for line in text.start[: run.rows[0]]], columns, width)
    whole = [all(_value(row[i], run.decimal) is not None for i in columns) for row in run.cells]
    skipped = whole.index(True) if True in whole else 0
    layout = Layout(text, run.rows[skipped], header.names, run.delimiter, run.decimal)
    notes: tuple[str, ...] = ()
    if skipped:
        rows = f"row {run.rows[0] + 1}" if skipped == 1 else f"rows {run.rows[0] + 1} to {run.rows[skipped - 1] + 1}"
        notes = (f"{text.path}: {rows} at the start hold no value in some column and were passed over.",)
    return Sheet(layout, columns, header, notes)


def _longest_run(lines: Sequence[str], delimiter: str) -> _Run | None:
    """The longest run of rows of numbers of one width, the last one of equals; empty rows do not end it."""
    best: list[tuple[int, list[str]]] = []
    run: list[tuple[int, list[str]]] = []
    for number, line in enumerate(lines):
        if not line.strip(BLANKS):
            continue
        cells = split_cells(line, delimiter)
        if not _is_sample(cells, delimiter):
            run = []
            continue
        if run and len(run[-1][1]) != len(cells):
            run = []
        run.append((number, cells))
        if len(run) >= len(best):
            best = run
    if not best:
        return None
    comma = delimiter != "," and any("," in cell for _, cells in best for cell in cells)
    return _Run(
        delimiter, "," if comma else ".", tuple(number for number, _ in best), tuple(tuple(cells) for _, cells in best)
    )


def _is_sample(cells: Sequence[str], delimiter: str) -> bool:
    """Whether the first filled cell and one more are numbers, and the others are too or stand for no value."""
    decimal = "." if delimiter == "," else ","
    filled = [cell for cell in cells if cell]
    numbers = [is_number(cell.replace(decimal, ".")) for cell in filled]
    if len(filled) < 2:  # a sample whose value is missing
        return len(cells) >= 2 and bool(cells[0]) and sum(numbers) == 1
    return numbers[0] and all(number or cell.lower() in _NO_VALUE for number, cell in zip(numbers, filled, strict=True))


def _value(cell: str, decimal: str) -> float | None:
    """Number in a cell; None if it holds none, or one that stands for no value."""
    text = cell.replace(",", ".") if decimal == "," else cell
    if cell.lower() in _NO_VALUE or not is_number(text) or not abs(float(text)) < _OUT_OF_RANGE:
        return None
    return float(text)


def _no_samples(text: TextFile) -> CampaignError:
    timed = any(cell.count(":") == 2 for line in text.start[-3:] for cell in split_cells(line, ",")[:1])
    hint = "Write the times in seconds" if timed else "Export it as CSV, with comma, semicolon or tab between columns"
    return CampaignError(
        f"{text.path}: holds no row of at least two numbers in its first {len(text.start)} rows. {hint}, or take it "
        "out of the folder."
    )


def _sheet_beside(text: TextFile, first: Sequence[str]) -> Sheet:
    """Sheet of an older Tektronix file, whose header stands beside the first samples."""
    rows = [cells for line in text.start[:30] if len(cells := split_cells(line, ",")) > 1 and cells[0]]
    about = {cells[0].lower(): cells[1] for cells in rows}
    time, *channels = (i for i in range(_BESIDE, len(first)) if first[i])
    names = [f"column {i + 1}" for i in range(len(first))]
    names[time], names[channels[0]] = "TIME", about.get("source") or "CH1"
    printed = {time: about.get("horizontal units", ""), channels[0]: about.get("vertical units", "")}
    units = {i: unit for i, cell in printed.items() if (unit := known_unit(cell))}
    unknown = {i: cell for i, cell in printed.items() if cell and i not in units}
    header = Header(tuple(names), units, unknown, None, "older Tektronix")
    return Sheet(Layout(text, 0, tuple(names)), (time, *channels), header)


def renamed(sheet: Sheet, names: Sequence[str]) -> Sheet:
    """The sheet with other names of its columns."""
    return replace(
        sheet, layout=replace(sheet.layout, names=tuple(names)), header=replace(sheet.header, names=tuple(names))
    )
