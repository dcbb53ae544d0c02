"""What the rows above the samples of an instrument's file say: names, units, sampling interval, maker.

========== =====================================================================================================
Tektronix  ``Model,MSO46`` … ``Vertical Units,V,V`` … ``TIME,CH1,CH2``
Keysight   ``x-axis,1,2`` / ``second,Volt,Volt``
Rigol      ``X,CH1,CH2,Start,Increment,`` / ``Sequence,Volt,Volt,-6.0e-04,1.0e-06``; newer:
           ``CH1V,CH2V,t0 =-5e-04, tInc = 1e-09,`` with no column of times; or ``Time(s),CH1V,CH2V``
Siglent    ``Vertical Units,CH1:V, CH2:V`` … ``Source,CH1,CH2`` / ``Second,Value,Value``
PicoScope  ``Time,Channel A,Channel B`` / ``(ms),(V),(mV)`` / empty line; ``;`` and decimal comma by locale
OWON       ``Time interval :,0.50uS`` … ``index,CH1_Voltage(mV)``
LeCroy     ``LECROYWR64Xi,1234,Waveform`` … ``Time,Ampl``
plain      a header line, or none
========== =====================================================================================================
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from inkjet_env.recordings.units import Unit, hertz, known_unit, seconds, unit_in_name

_START = re.compile(r"^t0\s*=\s*(\S+)$", re.IGNORECASE)
_INCREMENT = re.compile(r"^tInc\s*=\s*(\S+)$", re.IGNORECASE)
_KEY_AND_VALUE = re.compile(r"^([^:=]{2,40}?)\s*[:=]\s*(\S.*)?$")
_CHANNEL_AND_UNIT = re.compile(r"^(?:CH?|Channel )\d\s*:\s*(.*)$", re.IGNORECASE)
_INTERVALS = re.compile(
    r"((time|sample|sampling|horizontal|x)[ _]?(interval|period|increment|step|resolution)|(sampling|sample)[ _]time"
    r"|x?incr?(ement)?|delta([ _]?[tx])?|dt|t[ _]?sample|ts|interval|hresolution)"
)
_RATES = re.compile(r"((sample|sampling|samples)[ _]?(rate|frequency|freq|/s|per second)|samplerate|fs|sps)")
_STARTS = re.compile(r"(t0|x[ _]?(origin|org|zero|start|0)|hoffset|start([ _]time)?|first[ _]sample)")
_GENERIC = {"value", "values", "ampl", "amplitude", "volt", "volts", "data", "sequence", "level", ""}
"""Names and units that tell nothing of a channel."""
_ROW_LABELS = {"source", "label", "channel", "trace name"}
"""First cells of a row that names the channels."""
INDICES = {"x", "sequence", "index", "idx", "sample", "samples", "sample number", "no", "no.", "nr", "#", "n", "point"}
"""Names of a column that numbers the samples."""


@dataclass(frozen=True)
class Header:
    """What a header says.

    Attributes
    ----------
    names : tuple of str
        Name of each column; ``column 2`` where it says none.
    units : mapping of int to Unit
        Units that are printed and known, by column.
    unknown : mapping of int to str
        Printed units that are not known, by column.
    clock : (float, float) or None
        Time of the first sample and sampling step in seconds, if they are stated.
    style : str
        Name of the style, for people.
    """

    names: tuple[str, ...]
    units: Mapping[int, Unit]
    unknown: Mapping[int, str]
    clock: tuple[float, float] | None
    style: str


def read_header(rows: Sequence[Sequence[str]], columns: Sequence[int], width: int) -> Header:
    """Understand the rows of cells above the samples.

    Parameters
    ----------
    rows : sequence of sequence of str
        Cells of each row.
    columns : sequence of int
        Columns that hold samples, counted from 0.
    width : int
        Number of columns.
    """
    filled = [[cell.lstrip("#%; ").strip() for cell in row] for row in rows if any(row)]
    about = _about(filled)
    unit_row = filled.pop() if filled and _is_unit_row(filled[-1], below_names=len(filled) > 1) else []
    row = filled[-1] if filled else []
    clock, channels = _clock(row, unit_row)
    if clock is None:
        clock = stated_clock(about)
    if len(channels) > max(columns) and not _KEY_AND_VALUE.match(row[0]):
        labels = [channels[i] or f"column {i + 1}" for i in range(min(width, len(channels)))]
    else:
        labels = []
    if labels and labels[0].lower() in _ROW_LABELS:
        labels[0] = "Time"
    labels += [f"column {i + 1}" for i in range(len(labels), width)]
    labels = _told_apart(labels, columns, about)
    of_axes = _units_of_axes(about, columns, width)
    units, unknown = {}, {}
    for i in columns:
        text = unit_row[i] if i < len(unit_row) else ""
        if text.lower() in _GENERIC and known_unit(text) is None:
            text = of_axes[i]
        unit = known_unit(text) or unit_in_name(labels[i])
        if isinstance(unit, Unit):
            units[i] = unit
        elif unit or text.lower() not in _GENERIC:
            unknown[i] = unit or text
    return Header(tuple(labels), units, unknown, clock, _style(about, row, unit_row))


def _about(rows: Sequence[Sequence[str]]) -> dict[str, list[str]]:
    """Entries of a header's rows, by their names in lower case."""
    about: dict[str, list[str]] = {}
    for row in rows:
        cells = [cell for cell in row if cell]
        if len(cells) == 1 and (found := _KEY_AND_VALUE.match(cells[0])):
            about.setdefault(found.group(1).strip().lower(), [found.group(2) or ""])
        elif len(row) > 1:
            about.setdefault(row[0].strip(" \t:=").lower(), list(row[1:]))
    return about


def _told_apart(labels: list[str], columns: Sequence[int], about: Mapping[str, list[str]]) -> list[str]:
    """Names of the columns; those of a row of sources or labels where names repeat and tell nothing."""
    channels = columns[1:]
    named = [labels[i].lower() for i in channels]
    if not channels or not (set(named) <= _GENERIC or all(name.startswith("column ") for name in named)):
        return labels
    for key in sorted(_ROW_LABELS):
        told = [cell for cell in about.get(key, []) if cell]
        if len(told) == len(channels) and len(set(told)) == len(told):
            told_by_column = dict(zip(channels, told, strict=True))
            return [told_by_column.get(i, label) for i, label in enumerate(labels)]
    if len(channels) > 1 and len(set(named)) < len(named):
        return [f"column {i + 1}" if i in channels else label for i, label in enumerate(labels)]
    return labels


def _units_of_axes(about: Mapping[str, list[str]], columns: Sequence[int], width: int) -> list[str]:
    """Units by column from rows that state them for the axes."""
    of_axes = [*about.get("horizontal units", [""])[:1], *about.get("vertical units", [])]
    printed = [found.group(1) if (found := _CHANNEL_AND_UNIT.match(cell)) else cell for cell in of_axes]
    placed = [""] * width
    for i, text in zip(columns, [printed[0], *(cell for cell in printed[1:] if cell)], strict=False):
        placed[i] = text
    return placed


def _is_unit_row(row: Sequence[str], below_names: bool) -> bool:
    """Whether the cells of a row are units; below names that start with a time, unknown short words count too."""
    words = [cell for cell in row if cell and not is_number(cell)]
    if not words:
        return False
    first = known_unit(words[0])
    timed = below_names and first is not None and first.base == "s"
    return all(
        word.lower() in _GENERIC
        or known_unit(word) is not None
        or (word[0] in "([" and word[-1] in ")]")
        or (timed and len(word) <= 4)
        for word in words
    ) and (first is not None or words[0].lower() == "sequence" or words[0][0] in "([")


def _clock(names: Sequence[str], unit_row: Sequence[str]) -> tuple[tuple[float, float] | None, list[str]]:
    """Start and step in seconds if they stand among the names, and the names of the columns without them."""
    lowered = [name.lower() for name in names]
    if "start" in lowered and "increment" in lowered:
        places = [lowered.index("start"), lowered.index("increment")]
        printed = [unit_row[i] if i < len(unit_row) else "" for i in places]
        channels = list(names[: min(places)])
    else:
        printed = [m.group(1) for pattern in (_START, _INCREMENT) for name in names if (m := pattern.match(name))]
        channels = [name for name in names if not (_START.match(name) or _INCREMENT.match(name))]
    if len(printed) == 2 and all(seconds(cell) is not None for cell in printed):
        return (seconds(printed[0]) or 0.0, seconds(printed[1]) or 0.0), channels
    return None, channels


def stated_clock(about: Mapping[str, list[str]]) -> tuple[float, float] | None:
    """Start and step in seconds if entries of a header state them, and all that do agree."""
    steps, start = set(), 0.0
    for entry, cells in about.items():
        name, _, unit = entry.partition("(")
        name, unit = name.strip(), unit.strip(" )")
        for cell in cells:
            value = cell if not unit or not is_number(cell) else f"{cell} {unit}"
            if _INTERVALS.fullmatch(name) and (step := seconds(value)) is not None:
                steps.add(step)
            elif _RATES.fullmatch(name) and (rate := hertz(value)):
                steps.add(1 / rate)
            elif _STARTS.fullmatch(name) and (first := seconds(value)) is not None:
                start = first
    if not steps or max(steps) > 1.001 * min(steps) or not min(steps) > 0:
        return None
    return start, min(steps)


def is_number(cell: str) -> bool:
    """Whether a cell is a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _style(about: Mapping[str, list[str]], names: Sequence[str], unit_row: Sequence[str]) -> str:
    first = names[0].lower() if names else ""
    if any(entry.startswith("lecroy") for entry in about):
        return "LeCroy"
    if "time interval" in about and any("_voltage" in name.lower() for name in names):
        return "OWON"
    if "model number" in about or (
        unit_row and unit_row[0].lower() == "second" and "value" in map(str.lower, unit_row)
    ):
        return "Siglent"
    if {"model", "sample interval", "record length"} & set(about):
        return "Tektronix"
    if first == "x-axis":
        return "Keysight"
    if first == "x" or any(re.fullmatch(r"X\(CH\d\)|CH\dV|tInc.*", name) for name in names):
        return "Rigol"
    if any(name.lower().startswith("channel ") for name in names) and unit_row:
        return "PicoScope"
    return "plain"
