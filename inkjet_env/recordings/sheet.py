"""CSV styles of oscilloscopes, distinguished by their first lines.

========== =====================================================================================================
Tektronix  ``Model,MSO46`` … ``Vertical Units,V,V`` … ``TIME,CH1,CH2``; older: ``Record Length,2500,,-5e-3,0.04,``, the
           header in the first three columns beside the samples, one channel a file
Keysight   ``x-axis,1,2`` / ``second,Volt,Volt``
Rigol      ``X,CH1,CH2,Start,Increment,`` / ``Sequence,Volt,Volt,-6.0e-04,1.0e-06``; newer:
           ``CH1V,CH2V,t0 =-5e-04, tInc = 1e-09,`` with no column of times; or ``Time(s),CH1V,CH2V``
PicoScope  ``Time,Channel A,Channel B`` / ``(ms),(V),(mV)`` / empty line; ``;`` and decimal comma by locale
plain      a header line, or none
========== =====================================================================================================
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from inkjet_env.recordings.recording import CampaignError
from inkjet_env.recordings.table import Layout, split_cells, split_lines
from inkjet_env.recordings.units import Unit, known_unit, unit_in_name

SNIFFED_BYTES = 1 << 16
"""Bytes at the start of a file from which its layout is recognised."""
_START = re.compile(r"^t0\s*=\s*(\S+)$", re.IGNORECASE)
_INCREMENT = re.compile(r"^tInc\s*=\s*(\S+)$", re.IGNORECASE)
_BESIDE = 3


@dataclass(frozen=True)
class Sheet:
    """The columns of one oscilloscope file.

    Parameters
    ----------
    layout : Layout
        Rows, names, delimiter and decimal sign of the file.
    columns : tuple of int
        Numbers, from 0, of the columns that hold samples.
    units : mapping of int to Unit
        Units that are printed and known, by column.
    unknown : mapping of int to str
        Printed units that are not known, by column.
    clock : (float, float) or None
        Time of the first sample and sampling step in seconds, if the header states them in place of times.
    style : str
        Name of the style, for people.
    """

    layout: Layout
    columns: tuple[int, ...]
    units: dict[int, Unit]
    unknown: dict[int, str]
    clock: tuple[float, float] | None
    style: str


def read_sheet(file: Path) -> Sheet:
    """Find, from a file's first lines, where its samples are and in which units.

    Raises
    ------
    CampaignError
        The file has no rows of numbers, or binary content.
    """
    lines = _first_lines(file)
    for number, line in enumerate(lines):
        for delimiter in ("\t", ";", ","):
            cells = split_cells(line, delimiter)
            if not _all_numbers(cells, delimiter):
                continue
            comma = delimiter != "," and any("," in sample for sample in lines[number:])
            first = Layout(number, tuple(cells), delimiter, "," if comma else ".")
            return _sheet(first, [split_cells(above, delimiter) for above in lines[:number]])
        cells = split_cells(line, ",")
        if number == 0 and cells[0].lower() == "record length" and _all_numbers(cells[_BESIDE:], ","):
            return _sheet_beside(lines, cells)
    raise CampaignError(
        f"{file}: holds no row of at least two numbers in its first {len(lines)} rows. Export it as CSV, with "
        "comma, semicolon or tab between columns, or take it out of the folder."
    )


def _first_lines(file: Path) -> list[str]:
    try:
        with open(file, "rb") as opened:
            start = opened.read(SNIFFED_BYTES)
    except OSError as error:
        raise CampaignError(f"{file}: cannot be read: {error.strerror or error}. Check the file.") from None
    if b"\0" in start:
        raise CampaignError(f"{file}: is binary or UTF-16, not plain text. Export it as CSV, encoding UTF-8.")
    try:
        text = start.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = start.decode("latin-1")  # "µs" of older instruments, or a character cut at the end of the block
    lines = split_lines(text)
    return lines[:-1] if len(start) == SNIFFED_BYTES else lines


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _all_numbers(cells: list[str], delimiter: str) -> bool:
    """Whether all non-empty cells, at least two, are numbers; with a decimal comma if the delimiter allows it."""
    filled = [cell if delimiter == "," else cell.replace(",", ".") for cell in cells if cell]
    return len(filled) >= 2 and all(_is_number(cell) for cell in filled)


def _sheet(first: Layout, header: list[list[str]]) -> Sheet:
    """Sheet below a header; ``first.names`` are the cells of the first row of samples."""
    filled = [row for row in header if any(row)]
    about = {row[0].lower(): row[1:] for row in filled if len(row) > 1}
    unit_row = filled.pop() if filled and _is_unit_row(filled[-1], below_names=len(filled) > 1) else []
    names = filled[-1] if filled else []
    clock, channels = _clock(names, unit_row)
    columns = tuple(i for i, cell in enumerate(first.names) if cell)
    labelled = len(channels) > max(columns)
    labels = tuple(
        channels[i] if labelled and i < len(channels) and channels[i] else f"column {i + 1}"
        for i in range(len(first.names))
    )
    printed = unit_row or [*about.get("horizontal units", [""])[:1], *about.get("vertical units", [])]
    units, unknown = {}, {}
    for i in columns:
        text = printed[i] if i < len(printed) else ""
        unit = known_unit(text) or unit_in_name(labels[i])
        if unit is not None:
            units[i] = unit
        elif text and text.lower() != "sequence":
            unknown[i] = text
    layout = Layout(first.header_rows, labels, first.delimiter, first.decimal)
    return Sheet(layout, columns, units, unknown, clock, _style(about, names, unit_row))


def _sheet_beside(lines: list[str], first: list[str]) -> Sheet:
    """Sheet of an older Tektronix file, whose header stands beside the first samples."""
    about = {cells[0].lower(): cells[1] for line in lines[:30] if len(cells := split_cells(line, ",")) > 1 and cells[0]}
    time, *channels = (i for i in range(_BESIDE, len(first)) if first[i])
    names = [f"column {i + 1}" for i in range(len(first))]
    names[time], names[channels[0]] = "TIME", about.get("source") or "CH1"
    printed = {time: about.get("horizontal units", ""), channels[0]: about.get("vertical units", "")}
    units = {i: unit for i, text in printed.items() if (unit := known_unit(text))}
    unknown = {i: text for i, text in printed.items() if text and i not in units}
    return Sheet(Layout(0, tuple(names)), (time, *channels), units, unknown, None, "older Tektronix")


def _is_unit_row(row: list[str], below_names: bool) -> bool:
    """Whether the cells of a row are units; below names that start with a time, unknown short words count too."""
    words = [cell for cell in row if cell and not _is_number(cell)]
    if not words:
        return False
    first = known_unit(words[0])
    timed = below_names and first is not None and first.base == "s"
    return all(
        word.lower() == "sequence"
        or known_unit(word) is not None
        or (word[0] in "([" and word[-1] in ")]")
        or (timed and len(word) <= 4)
        for word in words
    )


def _clock(names: list[str], unit_row: list[str]) -> tuple[tuple[float, float] | None, list[str]]:
    """Start and step in seconds if a header states them, and the names of the columns without them."""
    lowered = [name.lower() for name in names]
    if "start" in lowered and "increment" in lowered:
        places = [lowered.index("start"), lowered.index("increment")]
        printed = [unit_row[i] if i < len(unit_row) else "" for i in places]
        channels = names[: min(places)]
    else:
        printed = [m.group(1) for pattern in (_START, _INCREMENT) for name in names if (m := pattern.match(name))]
        channels = [name for name in names if not (_START.match(name) or _INCREMENT.match(name))]
    if len(printed) == 2 and all(_is_number(cell) for cell in printed):
        return (float(printed[0]), float(printed[1])), channels
    return None, channels


def _style(about: dict[str, list[str]], names: list[str], unit_row: list[str]) -> str:
    first = names[0].lower() if names else ""
    if {"model", "sample interval", "record length"} & set(about):
        return "Tektronix"
    if first == "x-axis":
        return "Keysight"
    if first == "x" or any(re.fullmatch(r"X\(CH\d\)|CH\dV|tInc.*", name) for name in names):
        return "Rigol"
    if any(name.lower().startswith("channel ") for name in names) and unit_row:
        return "PicoScope"
    return "plain"
