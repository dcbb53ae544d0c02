"""Columns of numbers out of a text file: fast, and every bad cell named by its row."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from inkjet_env.recordings.recording import CampaignError, Real, brief

TAIL_BYTES = 1 << 16


@dataclass(frozen=True)
class Layout:
    """How the rows of a text file are to be read.

    Parameters
    ----------
    header_rows : int
        Rows before the first sample.
    names : tuple of str
        One a column.
    delimiter, decimal : str
        What separates columns, and the decimal sign.
    """

    header_rows: int
    names: tuple[str, ...]
    delimiter: str = ","
    decimal: str = "."


def read_columns(path: Path, layout: Layout, wanted: Sequence[int]) -> list[Real]:
    """Read some columns of a text file as float64, block by block, so that only they are held in memory.

    Parameters
    ----------
    path : Path
    layout : Layout
    wanted : sequence of int
        Which columns, counted from 0.

    Returns
    -------
    list of ndarray, shape (n,)
        In the order of ``wanted``.

    Raises
    ------
    CampaignError
        A cell that is not a finite number, a row that is too short or too long, fewer than two rows, a file that
        cannot be read. The message names the row; the file's first line is row 1.
    """
    import pyarrow
    from pyarrow import csv

    # Column names may repeat in a file; their numbers do not.
    labels = [f"{i}" for i in range(len(layout.names))]
    chosen = [labels[i] for i in wanted]
    blocks: list[list[Real]] = [[] for _ in wanted]
    try:
        reader = csv.open_csv(
            path,
            read_options=csv.ReadOptions(skip_rows=layout.header_rows, column_names=labels, block_size=1 << 22),
            parse_options=csv.ParseOptions(delimiter=layout.delimiter),
            convert_options=csv.ConvertOptions(
                column_types=dict.fromkeys(chosen, pyarrow.float64()),
                include_columns=chosen,
                null_values=[],
                decimal_point=layout.decimal,
                check_utf8=False,
            ),
        )
        for batch in reader:
            for block, label in zip(blocks, chosen, strict=True):
                block.append(batch.column(label).to_numpy())
    except pyarrow.ArrowInvalid as error:
        _explain(path, layout, wanted)
        raise CampaignError(f"{path}: is no table of numbers: {str(error)[:200]}. Export it as CSV again.") from None
    except OSError as error:
        raise CampaignError(f"{path}: cannot be read: {error.strerror or error}. Check the file.") from None
    columns = []
    for block in blocks:
        columns.append(np.concatenate(block) if block else np.empty(0))
        block.clear()
    if len(columns[0]) < 2:
        raise CampaignError(f"{path}: a recording must have at least 2 samples; got {len(columns[0])}. Add rows.")
    if not all(np.isfinite(column).all() for column in columns):
        _explain(path, layout, wanted)
    return columns


def row_of_sample(path: Path, layout: Layout, sample: int) -> int:
    """Row of the file, counted from 1, of a sample counted from 0; empty rows are passed over."""
    return next(itertools.islice(_samples(path, layout), sample, None), (layout.header_rows + sample + 1, []))[0]


def first_and_last_rows(path: Path, layout: Layout) -> tuple[list[list[str]], list[list[str]]]:
    """Cells of the first and of the last twenty rows of samples, as printed; the file must have been read before."""
    first = [cells for _, cells in itertools.islice(_samples(path, layout), 20)]
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - TAIL_BYTES))
        lines = file.read().decode("utf-8", errors="replace").splitlines()
    whole = lines[layout.header_rows :] if size <= TAIL_BYTES else lines[1:]
    return first, [_cells(line, layout) for line in whole if line][-20:]


def _samples(path: Path, layout: Layout) -> Iterator[tuple[int, list[str]]]:
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        for row, line in enumerate(file, start=1):
            if row > layout.header_rows and line.strip("\r\n"):
                yield row, _cells(line, layout)


def _cells(line: str, layout: Layout) -> list[str]:
    return [cell.strip().strip('"') for cell in line.rstrip("\r\n").split(layout.delimiter)]


def _explain(path: Path, layout: Layout, wanted: Sequence[int]) -> None:
    """Raise for the first row that breaks a rule; the slow twin of the fast reader, run only after it has failed."""
    for row, cells in _samples(path, layout):
        if len(cells) != len(layout.names):
            raise CampaignError(
                f"{path}, row {row}: must have {len(layout.names)} columns as the rows before; got {len(cells)}. "
                "Complete the row or remove it."
            )
        for i in wanted:
            try:
                finite = np.isfinite(float(cells[i].replace(layout.decimal, ".")))
            except ValueError:
                raise CampaignError(
                    f"{path}, row {row}: {layout.names[i]} must be a number; got {brief(cells[i])}. "
                    f"Use {layout.decimal!r} as decimal sign and {layout.delimiter!r} between columns."
                ) from None
            if not finite:
                raise CampaignError(
                    f"{path}, row {row}: {layout.names[i]} must be finite; got {brief(cells[i])}. "
                    "Trim the recording or mark the gap."
                )
