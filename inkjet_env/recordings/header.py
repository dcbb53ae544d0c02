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
    "source", "multichannelsource", "label", "channel", "channels", "trace name", "tracename",
    "channeltitle", "channel data", "name", "signal name",
)  # fmt: skip
"""Entries that name the channels."""
_CHANNEL_UNIT_KEYS = ("vertical units", "vunit", "yunits", "y_unit_label", "unitname", "unit", "units", "verticalunit")
_TIME_UNIT_KEYS = ("horizontal units", "hunit", "xunits", "horizontalunit")
_KEYS = {*_NAME_KEYS, *_CHANNEL_UNIT_KEYS, *_TIME_UNIT_KEYS}
_GENERIC = {"value", "values", "ampl", "amplitude", "data", "sequence", "level", "vol.", "voltage", "*", "ts", "rn", ""}
"""Names and units that tell nothing of a channel."""
_STATISTICS = {"smp", "avg", "max", "min", "std", ""}
"""Cells of a row below the units that tells how a logger made its values."""
_STAMP = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d\d(:\d\d)?")
INDICES = {
    "x", "sequence", "index", "idx", "sample", "samples", "sample number", "no", "no.", "nr", "#", "n", "point",
    "record",
}  # fmt: skip
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


class HeaderError(ValueError):
    """A header that says the samples cannot be read; the message is a sentence without the file's name."""


def read_header(
    rows: Sequence[Sequence[str]], columns: Sequence[int], width: int, beside: Sequence[Sequence[str]] = ()
) -> Header:
    """Understand the rows of cells above the samples.

    The units and above them the names stand last, but for rows of entries such as ``dt = 0.1 s``; all other rows are
    entries with a key in the first cell.

    Parameters
    ----------
    rows : sequence of sequence of str
        Cells of each row.
    columns : sequence of int
        Columns that hold samples, counted from 0.
    width : int
        Number of columns.
    beside : sequence of sequence of str
        Cells of entries that stand to the left of the samples.

    Raises
    ------
    HeaderError
        Channels with different sample intervals, or samples that are no measured values.
    """
    left = [row for cells in rows if any(row := [cell.lstrip("#%; ").strip() for cell in cells])]
    while left and all(cell.lower() in _STATISTICS for cell in left[-1]):
        left.pop()
    entries: list[list[str]] = []
    while left and _is_entry(left[-1], last=not entries):
        entries.append(left.pop())
    units_of = left.pop() if left and _is_unit_row(left[-1], below_names=len(left) > 1) else []
    title = left.pop() if left and _is_title(left[-1], len(columns)) else []
    about = _entries([*left, *reversed(entries), *(row for row in beside if any(row))])
    if "fast" in map(str.lower, about.get("mode", [])) and "vertical scale" in about:
        raise HeaderError("holds the converter's counts, not volts. Export it in the detailed format.")
    clock, names = _clock(title, units_of)
    clock = clock or stated_clock(about)
    labels = [names[i] if i < len(names) and names[i] else f"column {i + 1}" for i in range(width)]
    pairs = (title and _is_paired(title)) or (not title and any(_is_paired(row) for row in [*left, *entries]))
    times = tuple(columns[::2]) if pairs else ()
    timeless = all(f"name{k}" in about for k in range(len(columns)))
    timeless |= any(all(len(about.get(key, [])) > i and about[key][i] for i in columns) for key in _NAME_KEYS)
    told = [[cell for cell in about.get(key, []) if cell] for key in _NAME_KEYS]
    timeless |= clock is not None and any(1 < len(sources) == len(columns) for sources in told)
    channels = [i for i in columns if i not in (times or columns[: 0 if timeless else 1])]
    units: dict[int, Unit] = {}
    unknown: dict[int, str] = {}
    for i in columns:
        text = units_of[i] if i < len(units_of) else ""
        if text.lower() in _GENERIC and known_unit(text) is None:
            text = _unit_of_channel(about, i, channels) if i in channels else _first(about, _TIME_UNIT_KEYS)
        unit = known_unit(text) or unit_in_name(labels[i])
        if isinstance(unit, Unit):
            units[i] = unit
        elif unit or text.lower() not in _GENERIC:
            unknown[i] = unit or text
    for i, name in _better_names(about, labels, channels).items():
        labels[i] = name
    return Header(tuple(labels), units, unknown, clock, _style(about, title, units_of), times)


def _is_paired(row: Sequence[str]) -> bool:
    """Whether a row repeats its key before the value of each channel."""
    return (
        len(row) >= 4 and bool(row[0]) and row[0] == row[2] and not (row[1] and row[3] and row[1] == row[3] == row[0])
    )


def _is_entry(row: Sequence[str], last: bool) -> bool:
    """Whether a row below the names can only be entries; the last row above the samples may name a time by channel."""
    cells = [cell for cell in row if cell]
    if any(_START.match(cell) or _INCREMENT.match(cell) for cell in cells) and not all("=" in cell for cell in cells):
        return False
    if len(cells) == 1 or row[0].endswith((":", "=")) or row[0].strip(" \t:=").lower() in _KEYS:
        return True
    if _is_paired(row):
        return not (last and row[1] and row[3] and not any(map(is_number, cells)))
    return all(_KEY_AND_VALUE.match(cell) for cell in cells)


def _is_title(row: Sequence[str], count: int) -> bool:
    """Whether a row names nearly as many columns as there are: no numbers, dates or entries."""
    cells = [cell for cell in row if cell]
    if len(cells) < max(count - 1, 1) or row[0].strip(" \t:=").lower() in _KEYS or row[0].endswith((":", "=")):
        return False
    if any(_STAMP.match(cell) or re.search(r":\s*[-+.\d]", cell) for cell in cells):
        return False
    numbers = [cell for cell in cells if is_number(cell)]
    return not numbers or (cells[0].lower() in ("x-axis", "x") and all(cell.isdigit() for cell in numbers))


def _entries(rows: Sequence[Sequence[str]]) -> dict[str, list[str]]:
    """Entries by their keys in lower case: cells at the places of the columns, the key's empty."""
    about: dict[str, list[str]] = {}
    for row in rows:
        cells = [cell for cell in row if cell]
        key = row[0].strip(" \t:=").lower()
        if found := _KEY_AND_VALUE.match(cells[0]) if len(cells) == 1 or all("=" in cell for cell in cells) else None:
            about.setdefault(found.group(1).strip().lower(), ["", found.group(2) or ""])
        elif _is_paired(row):
            about[key] = ["" if k % 2 == 0 else cell for k, cell in enumerate(row)]
        else:
            about.setdefault(key, ["", *row[1:]])
    return about


def _first(about: Mapping[str, list[str]], keys: Sequence[str]) -> str:
    return next((cell for key in keys for cell in about.get(key, []) if cell), "")


def _unit_of_channel(about: Mapping[str, list[str]], column: int, channels: Sequence[int]) -> str:
    """Unit of a channel from an entry for all of them: at its place, or in their order."""
    for key in _CHANNEL_UNIT_KEYS:
        cells = [_NAME_AND_UNIT.sub(r"\1", cell) for cell in about.get(key, [])]
        cells = [cell if known_unit(cell) else cell.partition(" (")[0] for cell in cells]
        told = [cell for cell in cells if cell]
        if not told:
            continue
        if all(len(cells) > i and cells[i] for i in channels):
            return cells[column]
        place = list(channels).index(column)
        return told[place] if place < len(told) else ""
    return ""


def _better_names(about: Mapping[str, list[str]], labels: Sequence[str], channels: Sequence[int]) -> dict[int, str]:
    """Names of channels from an entry for all of them, where their titles repeat or tell nothing."""
    titles = [re.sub(r"\s*[(\[].*$", "", labels[i]).lower() for i in channels]
    if not any(title in _GENERIC or title.startswith("column ") or titles.count(title) > 1 for title in titles):
        return {}
    numbered = {i: _first(about, [f"name{k}"]) for k, i in enumerate(channels)}
    if all(numbered.values()):
        return numbered
    for key in _NAME_KEYS:
        cells = about.get(key, [])
        told = [cell for cell in cells if cell]
        if len(told) == 1 and len(channels) > 1:
            told = [part.strip() for part in re.sub(r"^\(.*?\):?", "", told[0]).split(",")]
        placed = all(len(cells) > i and cells[i] for i in channels)
        found = {i: cells[i] for i in channels} if placed else dict(zip(channels, told, strict=False))
        if len(found) == len(channels) and len(set(found.values())) == len(found):
            return found
    return {i: f"column {i + 1}" for i, title in zip(channels, titles, strict=True) if titles.count(title) > 1}


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
    ) and (first is not None or words[0].lower() in ("sequence", "ts") or words[0][0] in "([")


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
    """Start and step in seconds if entries of a header state them.

    Raises
    ------
    HeaderError
        Channels have different intervals.
    """
    steps: set[float] = set()
    start = 0.0
    for entry, cells in about.items():
        name, _, unit = entry.replace("[", "(").partition("(")
        name, unit = name.strip(), unit.strip(" )]")
        values = [cell.replace(",", ".") for cell in cells if cell]
        if len(values) == 2 and is_number(values[0]) and not is_number(values[1]):
            values = [" ".join(values)]  # the unit has a cell of its own
        values = [f"{value} {unit}" if unit and is_number(value) else value for value in values]
        read = hertz if _RATES.fullmatch(name) else seconds
        if not all(read(value) is not None for value in values):
            values = values[:1]
        found = [value for one in values if (value := read(one)) is not None]
        if _INTERVALS.fullmatch(name):
            mine = {value for value in found if value > 0}
        elif _RATES.fullmatch(name):
            mine = {1 / value for value in found if value > 0}
        else:
            mine = set()
            if _STARTS.fullmatch(name) and found:
                start = found[0]
        if len(mine) > 1 and max(mine) > 1.001 * min(mine):
            raise HeaderError(
                f"has channels with different sample intervals, {min(mine):.4g} s and {max(mine):.4g} s. Export drive "
                "and sensor with the same."
            )
        steps |= mine
    if not steps or max(steps) > 1.001 * min(steps):
        return None
    address = _first(about, ["trigger address"])
    return start or (-float(address) * min(steps) if is_number(address) else 0.0), min(steps)


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
