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
_NAME_AND_UNIT = re.compile(r"^(?:CH?|Channel )\d\s*:\s*(.*)$", re.IGNORECASE)
_INTERVALS = re.compile(
    r"((time|sample|sampling|horizontal|x)[ _]?(interval|period|increment|step|resolution)|(sampling|sample)[ _]?time"
    r"|x?incr?(ement)?|delta([ _]?[tx])?|dt|t[ _]?sample|ts|interval|h?resolution)"
)
_RATES = re.compile(r"((sample|sampling|samples)[ _]?(rate|frequency|freq|/s|per second)|samplerate|fs|sps|rate)")
_STARTS = re.compile(r"(t0|x[ _]?(origin|org|zero|start|0)|hoffset|start([ _]time)?|first[ _]sample)")
_NAME_KEYS = (
    "source", "label", "channel", "channels", "trace name", "tracename", "channeltitle", "channel data", "name",
    "signal name",
)  # fmt: skip
"""Entries that name the channels."""
_CHANNEL_UNIT_KEYS = ("vertical units", "vunit", "yunits", "y_unit_label", "unitname", "unit", "units", "verticalunit")
_TIME_UNIT_KEYS = ("horizontal units", "hunit", "xunits", "horizontalunit")
_GENERIC = {"value", "values", "ampl", "amplitude", "data", "sequence", "level", "vol.", "voltage", "*", ""}
"""Names and units that tell nothing of a channel."""
_STAMP = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d\d(:\d\d)?")
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
    times : tuple of int
        Columns of times, where the header shows that each channel has its own.
    """

    names: tuple[str, ...]
    units: Mapping[int, Unit]
    unknown: Mapping[int, str]
    clock: tuple[float, float] | None
    style: str
    times: tuple[int, ...] = ()


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
    filled = [row for cells in rows if any(row := [cell.lstrip("#%; ").strip() for cell in cells])]
    about, titles = _sorted(filled, len(columns))
    paired = any(_is_paired(row) for row in filled)
    unit_row = titles.pop() if titles and _is_unit_row(titles[-1], below_names=len(titles) > 1) else []
    row = titles[-1] if titles else []
    clock, channels = _clock(row, unit_row)
    clock = clock or stated_clock(about)
    given = channels if len(channels) > max(columns) else []
    labels = [given[i] if i < len(given) and given[i] else f"column {i + 1}" for i in range(width)]
    times = list(columns[::2]) if paired and not given else list(columns[:1])
    if any(all(i < len(about.get(key, [])) and about[key][i] for i in columns) for key in _NAME_KEYS):
        times = []  # every column is a channel
    named = [i for i in columns if i not in times]
    units: dict[int, Unit] = {}
    unknown: dict[int, str] = {}
    for i in columns:
        text = unit_row[i] if i < len(unit_row) else ""
        if text.lower() in _GENERIC and known_unit(text) is None:
            text = _of_axis(
                about, i, columns, _TIME_UNIT_KEYS if i in times and len(columns) > 1 else _CHANNEL_UNIT_KEYS
            )
        unit = known_unit(text) or unit_in_name(labels[i])
        if isinstance(unit, Unit):
            units[i] = unit
        elif unit or text.lower() not in _GENERIC:
            unknown[i] = unit or text
    for i, name in _names_of(about, labels, columns, named).items():
        labels[i] = name
    several = tuple(times) if paired and not given else ()
    return Header(tuple(labels), units, unknown, clock, _style(about, row, unit_row), several)


def _sorted(rows: Sequence[Sequence[str]], count: int) -> tuple[dict[str, list[str]], list[list[str]]]:
    """Entries of a header by their keys in lower case, the value for each column at its place; and rows of titles.

    A row of titles fills nearly as many columns as there are; its cells are no numbers, dates or further keys.
    """
    about: dict[str, list[str]] = {}
    titles: list[list[str]] = []
    keys = {*_NAME_KEYS, *_CHANNEL_UNIT_KEYS, *_TIME_UNIT_KEYS}
    for k, row in enumerate(rows):
        cells = [cell for cell in row if cell]
        key = row[0].strip(" \t:=").lower()
        last = k + 1 == len(rows) and _are_titles(cells) and all(row[1 : count + 1 : 2])
        if len(cells) == 1 and (found := _KEY_AND_VALUE.match(cells[0])):
            about.setdefault(found.group(1).strip().lower(), ["", found.group(2) or ""])
        elif _is_paired(row) and not last:
            about[key] = list(row)
        elif row[0].endswith((":", "=")) or (key in keys and len(cells) > 1):
            about.setdefault(key, list(row))
        elif all("=" in cell or ": " in cell for cell in cells) and not any(_INCREMENT.match(cell) for cell in cells):
            found = _KEY_AND_VALUE.match(cells[0])
            if found:
                about.setdefault(found.group(1).strip().lower(), ["", found.group(2) or ""])
        elif len(cells) >= max(count - 1, 1) and _are_titles(cells):
            titles.append(list(row))
            about.setdefault(key, list(row))
        else:
            about.setdefault(key, list(row))
    return about, titles


def _is_paired(row: Sequence[str]) -> bool:
    """Whether a row repeats its key before the value of each channel."""
    return len(row) >= 4 and bool(row[0]) and row[0] == row[2]


def _are_titles(cells: Sequence[str]) -> bool:
    if any(_STAMP.fullmatch(cell) or (len(cell) > 7 and _STAMP.match(cell)) for cell in cells):
        return False
    numbers = [is_number(cell) for cell in cells]
    whole = all(cell.isdigit() for cell, number in zip(cells, numbers, strict=True) if number)
    started = any(cell.lower() in ("sequence", "x-axis") for cell in cells)
    return not any(numbers) or (started and (whole or cells[0].lower() == "sequence"))


def _of_axis(about: Mapping[str, list[str]], column: int, columns: Sequence[int], keys: Sequence[str]) -> str:
    """Unit of a column from an entry for the axes: at its place, or in the order of the channels."""
    for key in keys:
        cells = about.get(key, [])
        values = [_NAME_AND_UNIT.sub(r"\1", cell) for cell in cells[1:]]
        values = [value if known_unit(value) else value.partition(" (")[0] for value in values]
        told = [value for value in values if value and value != "*"]
        if not told:
            continue
        if keys is _TIME_UNIT_KEYS:
            return told[0]
        at_place = values[column - 1] if 0 < column <= len(values) else ""
        places = [k + 1 for k, value in enumerate(values) if value]
        if all(place in columns for place in places) and not (len(told) == 1 and column not in places):
            return at_place
        channels = list(columns[1:])
        return told[channels.index(column)] if column in channels and channels.index(column) < len(told) else ""
    return ""


def _names_of(
    about: Mapping[str, list[str]], labels: Sequence[str], columns: Sequence[int], channels: Sequence[int]
) -> dict[int, str]:
    """Better names of channels whose names repeat or tell nothing, from an entry that names them."""
    names = [re.sub(r"\s*[(\[].*$", "", labels[i]).lower() for i in channels]
    vague = {name for name in names if name in _GENERIC or name.startswith("column ") or names.count(name) > 1}
    if not channels or not vague:
        return {}
    for key in _NAME_KEYS:
        cells = about.get(key, [])
        at_place = {i: cells[i] for i in channels if i < len(cells) and cells[i]}
        told = [cell for cell in cells[1:] if cell]
        if len(told) == 1 and len(channels) > 1:
            told = [part.strip() for part in re.sub(r"^\(.*?\):?", "", told[0]).split(",")]
        found = at_place if len(at_place) == len(channels) else dict(zip(channels, told, strict=False))
        if len(found) == len(channels) and len(set(found.values())) == len(found):
            return found
    return {
        i: f"column {i + 1}" for i, name in zip(channels, names, strict=True) if name in _GENERIC and len(channels) > 1
    }


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
        name, _, unit = entry.replace("[", "(").partition("(")
        name, unit = name.strip(), unit.strip(" )]")
        values = [cell.replace(",", ".") for cell in cells[1:] if cell]
        if len(values) > 1 and is_number(values[-2]) and seconds(f"1 {values[-1]}") and not is_number(values[-1]):
            values = [f"{values[-2]} {values[-1]}"]  # the unit has a cell of its own
        if not all(seconds(cell) is not None or hertz(cell) for cell in values):
            values = values[:1]
        for cell in values:
            value = cell if not unit or not is_number(cell) else f"{cell} {unit}"
            if _INTERVALS.fullmatch(name) and (step := seconds(value)):
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
