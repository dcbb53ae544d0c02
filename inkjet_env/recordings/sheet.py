"""Where the samples of an instrument's text file are, found in its first lines, and what its header says of them."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from inkjet_env.recordings.header import Header, read_header
from inkjet_env.recordings.header_entries import HeaderError, is_number
from inkjet_env.recordings.recording import CampaignError
from inkjet_env.recordings.table import Layout, split_cells, without_remark
from inkjet_env.recordings.text_file import TextFile
from inkjet_env.recordings.units import known_unit

DELIMITERS = ("\t", ";", ",", " ")
_NO_VALUE = {
    "", "nan", "inf", "+inf", "-inf", "∞", "+∞", "-∞", "-", "--", "---", "----", "-----", "n/a", "ovr", "over", "ol",
    "+ol", "-ol", "overrange", "+over", "-over",
}  # fmt: skip
"""Cells of a sample that an instrument did not take or that was out of its range, in lower case."""
_BESIDE_NUMBERS = re.compile(r"0x[0-9A-Fa-f]+$|\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[ T]\d|\d{1,2}:\d\d:\d\d")
"""Cells that may stand among the numbers of a sample: digital channels, dates and times of day."""
NAME_ROWS = 3
"""Number of rows above samples that blanks separate which may hold names and units."""
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
    counting : tuple of int
        Columns that count by one.
    """

    layout: Layout
    columns: tuple[int, ...]
    header: Header
    notes: tuple[str, ...] = ()
    counting: tuple[int, ...] = ()


@dataclass(frozen=True)
class _Run:
    """Consecutive rows of samples: their places among the lines, and their cells."""

    delimiter: str
    decimal: str
    rows: tuple[int, ...]
    cells: tuple[tuple[str, ...], ...]


def read_sheet(text: TextFile, settings: TextFile | None = None) -> Sheet:
    """Find where a file's samples are, and understand its header.

    Parameters
    ----------
    text : TextFile
        The file.
    settings : TextFile, optional
        A file beside it that holds its header, with colons between keys and values.

    Raises
    ------
    CampaignError
        The file has no rows of numbers.
    """
    runs = [run for delimiter in DELIMITERS if (run := _longest_run(text.start, delimiter)) is not None]
    if not runs:
        raise _no_samples(text)
    run = max(runs, key=lambda run: (len(run.rows), len(run.cells[0])))
    width = len(run.cells[0])
    filled = [sum(_value(row[i], run.decimal) is not None for row in run.cells) for i in range(width)]
    columns = tuple(i for i in range(width) if filled[i] >= len(run.rows) / 2)
    if not columns:
        raise _no_samples(text)
    delimiter = "\t" if run.delimiter == " " else run.delimiter  # words of a header are no cells
    above = [split_cells(line, delimiter) for line in text.start[: run.rows[0]]]
    if run.delimiter == " ":
        above = [*above[:-NAME_ROWS], *(_blank_aligned(row, width) for row in above[-NAME_ROWS:])]
    rows, cells = list(run.rows), list(run.cells)
    while above and (_is_beside(above[-1], columns, width, run.decimal) or _has_gaps(above[-1], columns, run)):
        rows.insert(0, rows[0] - 1)
        cells.insert(0, tuple(above.pop()))
    _check_thousands(text, run, columns)
    if columns[0] > 0:  # a header may stand beside the samples
        lines = [split_cells(line, delimiter) for line in text.start[rows[0] : rows[-1] + 1]]
        beside = [line[: columns[0]] for line in lines if _is_beside(line, columns, width, run.decimal)]
    else:
        beside = []
    if settings is not None:
        beside += [split_cells(line, ":") for line in settings.start]
    try:
        counting, whole_numbers, largest = _counts(run, columns)
        header = read_header(above, columns, width, beside, run.decimal, counting, whole_numbers, largest)
    except HeaderError as error:
        raise CampaignError(f"{text.path}: {error}") from None
    whole = [all(_value(row[i], run.decimal) is not None for i in columns) for row in cells]
    skipped = whole.index(True) if True in whole else 0
    layout = Layout(text, rows[skipped], header.names, run.delimiter, run.decimal)
    notes: tuple[str, ...] = ()
    if skipped:
        told = f"row {rows[0] + 1}" if skipped == 1 else f"rows {rows[0] + 1} to {rows[skipped - 1] + 1}"
        notes = (f"{text.path}: {told} at the start hold no value in some column and were passed over.",)
    return Sheet(layout, columns, header, notes, tuple(counting))


def _is_beside(row: Sequence[str], columns: Sequence[int], width: int, decimal: str) -> bool:
    """Whether a row holds numbers in the columns of samples, and an entry of the header before them."""
    return columns[0] > 0 and len(row) == width and all(_value(row[i], decimal) is not None for i in columns)


def _has_gaps(row: Sequence[str], columns: Sequence[int], run: _Run) -> bool:
    """Whether a row is a sample whose later cells hold no value, by whatever mark: only its time is a number."""
    first = columns[0]
    return (
        len(row) == len(run.cells[0])
        and _value(row[first], run.decimal) is not None
        and not any(known_unit(row[i]) for i in columns[1:])
        and len(columns) > 1
    )


def _blank_aligned(row: Sequence[str], width: int) -> list[str]:
    """Cells of a header's row above columns that blanks separate; unchanged if it is none."""
    text = row[0].lstrip("#% ")
    if len(row) > 1 or "=" in text or re.search(r":\s", text):
        return list(row)
    for cells in (
        text.split(),
        re.split(r"\s{2,}", text),
        re.split(r",\s*", text),
        re.findall(r"\S+(?:\s+[\[(][^\])]*[\])])?", text),
    ):
        if len(cells) == width:
            return cells
    return list(row)


def _counts(run: _Run, columns: Sequence[int]) -> tuple[list[int], list[int], dict[int, float]]:
    """Columns that count by one, columns of whole numbers, and the largest magnitude in each."""
    counting, whole, largest = [], [], {}
    for i in columns:
        values = [value for row in run.cells if (value := _value(row[i], run.decimal)) is not None]
        largest[i] = max(map(abs, values), default=0.0)
        if all(value == int(value) for value in values):
            whole.append(i)
            if len(values) > 2 and all(b - a == 1 for a, b in itertools.pairwise(values)):
                counting.append(i)
    return counting, whole, largest


def _check_thousands(text: TextFile, run: _Run, columns: Sequence[int]) -> None:
    """Raise an error if a mark in some numbers may separate thousands."""
    for i in columns:
        cells = [row[i] for row in run.cells]
        marked = [k for k, cell in enumerate(cells) if re.search(r"[.,]", cell)]
        plain = [cell for cell in cells if re.fullmatch(r"[-+]?\d{1,3}", cell)]
        if (
            marked
            and len(marked) + len(plain) == len(cells)
            and any(len(cell.lstrip("+-")) == 3 for cell in plain)
            and all(re.fullmatch(r"[-+]?[1-9]\d{0,2}[.,]\d{3}", cells[k]) for k in marked)
        ):
            raise CampaignError(
                f"{text.path}, row {run.rows[marked[0]] + 1}: {cells[marked[0]]} among whole numbers may be "
                f"{cells[marked[0]].replace(',', '').replace('.', '')} with a mark for thousands. Export it without."
            )


def _longest_run(lines: Sequence[str], delimiter: str) -> _Run | None:
    """The longest run of rows of numbers of one width, the last one of equals; empty rows do not end it."""
    runs: list[list[tuple[int, list[str]]]] = []
    run: list[tuple[int, list[str]]] = []
    split = [split_cells(without_remark(line, delimiter), delimiter) for line in lines]
    tag = _tag_of_samples(split)
    for number, cells in enumerate(split):
        if not any(cells):
            continue
        if not _is_sample(cells[1:] if tag and cells[0] == tag else cells, delimiter):
            run = []
            continue
        if not run or len(run[-1][1]) != len(cells):
            run = []
            runs.append(run)
        run.append((number, cells))
    if not runs:
        return None
    longest = max(reversed(runs), key=len)
    # a damaged row may split the samples: it will be told of
    best = [row for run in runs if len(run) > 1 or run is longest for row in run if len(row[1]) == len(longest[0][1])]
    comma = delimiter != "," and any("," in cell for _, cells in best for cell in cells)
    return _Run(
        delimiter, "," if comma else ".", tuple(number for number, _ in best), tuple(tuple(cells) for _, cells in best)
    )


def _tag_of_samples(rows: Sequence[Sequence[str]]) -> str:
    """The word in the first cell of more than half of the rows, such as ``trace_values``; empty if there is none."""
    (word, count), *_ = Counter(row[0] for row in rows).most_common(1) or [("", 0)]
    return word if count > len(rows) / 2 and word[:1].isalpha() and word.lower() not in _NO_VALUE else ""


def _is_sample(cells: Sequence[str], delimiter: str) -> bool:
    """Whether the first filled cell and one more are numbers, and the others are too or stand for no value."""
    decimal = "." if delimiter == "," else ","
    filled = [cell for cell in cells if cell]
    numbers = [is_number(cell.replace(decimal, ".")) for cell in filled]
    if len(filled) < 2:  # a sample whose value is missing
        return len(cells) >= 2 and bool(cells[0]) and sum(numbers) == 1
    return sum(numbers) > 1 and all(
        number or cell.lower() in _NO_VALUE or _BESIDE_NUMBERS.match(cell)
        for number, cell in zip(numbers, filled, strict=True)
    )


def _value(cell: str, decimal: str) -> float | None:
    """Number in a cell; None if it holds none, or one that stands for no value."""
    text = cell.replace(",", ".") if decimal == "," else cell
    if cell.lower() in _NO_VALUE or not is_number(text) or not abs(float(text)) < _OUT_OF_RANGE:
        return None
    return float(text)


def _no_samples(text: TextFile) -> CampaignError:
    timed = any(cell.count(":") == 2 for line in text.start[-3:] for cell in split_cells(line, ",")[:1])
    single = sum(is_number(line.strip()) for line in text.start)
    worded = [re.split(r"[,;\t]", line) for line in text.start[-20:]]
    worded = [cells for cells in worded if sum(is_number(cell.strip()) for cell in cells) > 1]
    if timed:
        hint = "Write the times in seconds"
    elif single > len(text.start) / 2:
        hint = "Most rows hold one number: write time, drive and sensor beside each other, one column each"
    elif len(worded) > 10:
        words = next((cell.strip() for cell in worded[0] if not is_number(cell.strip())), "")
        hint = f"Its rows hold {words[:20]!r} beside numbers: remove that column"
    else:
        hint = "Export it as CSV, with comma, semicolon or tab between columns"
    return CampaignError(
        f"{text.path}: holds no row of numbers, at least two and nothing else, in its first {len(text.start)} rows. "
        f"{hint}, or take it out of the folder."
    )
