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

from inkjet_env.recordings.header_entries import (
    GENERIC,
    KEY_AND_VALUE,
    NAME_KEYS,
    HeaderError,
    better_names,
    entries_of,
    is_key,
    is_number,
    is_paired,
    refuse_counts,
    refuse_factors,
    stated_clock,
    unclear_clock,
    unit_of_column,
    unit_of_one,
)
from inkjet_env.recordings.units import NO_UNIT, Unit, known_unit, other_unit, seconds, unit_in_name, unit_like

_START = re.compile(r"^t0\s*=\s*(\S+)$", re.IGNORECASE)
_INCREMENT = re.compile(r"^tInc\s*=\s*(\S+)$", re.IGNORECASE)
_RULE = re.compile(r"[-=_.*~ ]{2,}")
_TIME_WORD = re.compile(r"time|^t\b|second", re.IGNORECASE)
_SETTINGS = re.compile(
    r"scale|div|offset|position|level|range|delay|trig|coupl|bandwidth|imped|probe|skew|interval|period|rate|resol|incr"
    r"|duration|length|\bt0\b|\bdt\b|start|origin|date|version|noise|cursor|measure",
    re.IGNORECASE,
)
"""Words of entries whose units are those of a setting."""
_LEFT = re.compile(r"(?:\bin |_|(?<!\d)[:=(\[,]\s*)([^\W\d_]{2,12})\s*(?=$|[)\],;:])")
"""A word that may be a unit, in brackets, after "in" or alone behind a mark."""
_UNIT_ROWS = 6
"""Number of rows that may stand between the names and the samples."""
_COUNTS = re.compile(r"(?<![^\W\d_])(raw|adc|dac|counts?|codes?)(?![^\W\d_])", re.IGNORECASE)
"""Words of names for a converter's counts."""
_STATISTICS = {"smp", "avg", "max", "min", "std", ""}
"""Cells of a row below the units that tells how a logger made its values."""
_STAMP = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d\d(:\d\d)?")
INDICES = {
    "x", "sequence", "index", "idx", "sample", "samples", "sample number", "no", "no.", "nr", "#", "n", "point",
    "record", "row", "xpos", "i",
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
    unclear : str
        What the header says of a sampling interval or rate that is not understood.
    """

    names: tuple[str, ...]
    units: Mapping[int, Unit]
    unknown: Mapping[int, str]
    clock: tuple[float, float] | None
    style: str
    times: tuple[int, ...] = ()
    unclear: str = ""


def read_header(
    rows: Sequence[Sequence[str]],
    columns: Sequence[int],
    width: int,
    beside: Sequence[Sequence[str]] = (),
    decimal: str = ".",
    counting: Sequence[int] = (),
    whole: Sequence[int] = (),
    largest: Mapping[int, float] | None = None,
) -> Header:
    """Understand the rows of cells above the samples.

    The units and above them the names stand last, but for rows of entries such as ``dt = 0.1 s``; all other rows are
    entries with a key in the first cell. Nothing that can only be a unit is passed over.

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
    decimal : str
        Decimal sign of the samples.
    counting, whole : sequence of int
        Columns that count by one, and columns of whole numbers.
    largest : mapping of int to float, optional
        Largest magnitude in each column.

    Raises
    ------
    HeaderError
        Channels with different sample intervals, units that contradict each other, names that do not stand over the
        samples, or samples that are no measured values.
    """
    left = [
        row
        for cells in rows
        if any(row := [(cell if k else cell.lstrip("#%; ")).strip() for k, cell in enumerate(cells)])
    ]
    left = [row for row in left if not all(_RULE.fullmatch(cell) or not cell for cell in row)]
    while left and all(cell.lower() in _STATISTICS for cell in left[-1]):
        left.pop()
    entries: list[list[str]] = []
    while left and _is_entry(left[-1], last=not entries):
        entries.append(left.pop())
    left, title, units_of, passed = _names_and_units(left, len(columns), width)
    about = entries_of([*left, *passed, *reversed(entries), *(row for row in beside if any(row))])
    refuse_counts(about, columns, counting, whole, largest or {})
    refuse_factors(about)
    clock, names = _clock(title, units_of)
    clock = clock or stated_clock(about, decimal)
    if (title and clock is None) or len(names) == len(title):
        names = _over_samples(names, columns, width, counting)
    labels = [names[i] if i < len(names) and names[i] else f"column {i + 1}" for i in range(width)]
    pairs = (title and is_paired(title)) or (not title and any(is_paired(row) for row in [*left, *entries]))
    times = tuple(columns[::2]) if pairs else ()
    timeless = all(f"name{k}" in about for k in range(len(columns)))
    timeless |= any(all(len(about.get(key, [])) > i and about[key][i] for i in columns) for key in NAME_KEYS)
    told = [[cell for cell in about.get(key, []) if cell] for key in NAME_KEYS]
    timeless |= clock is not None and any(1 < len(sources) == len(columns) for sources in told)
    channels = [i for i in columns if i not in (times or columns[: 0 if timeless else 1])]
    better = better_names(about, labels, channels, columns)
    units: dict[int, Unit] = {}
    unknown: dict[int, str] = {}
    for i in columns:
        text = units_of[i] if i < len(units_of) else ""
        if text.lower() in GENERIC and known_unit(text) is None:
            own = unit_of_one(about, (better.get(i, labels[i]), labels[i]))
            text = own or unit_of_column(about, i, channels, columns)
        unit = _unit_of(labels[i], text or next((row[i] for row in passed if i < len(row) and unit_like(row[i])), ""))
        if isinstance(unit, Unit):
            units[i] = unit
        elif unit is not None:
            unknown[i] = unit
    without = [i for i in columns if i not in units and i not in unknown]
    for text, base in _units_left([*left, *passed, *entries]) if without else ():
        unknown |= {i: text for i in without if i not in unknown and (i in channels) == (base != "s")}
    if units_of and any(i in units for i in channels):
        given = [i for i in channels if i < len(units_of) and units_of[i]]
        unknown |= {i: "" for i in without if i in channels and i not in given and i not in unknown}
    for i, name in better.items():
        labels[i] = name
    if raw := [
        labels[i] for i in channels if i in whole and i in without and i not in unknown and _COUNTS.search(labels[i])
    ]:
        raise HeaderError(
            f"holds whole numbers in column {raw[0][:40]}, by its name a converter's counts. Export volts; if they are "
            "volts, call it so, such as sensor_V."
        )
    return Header(
        tuple(labels),
        units,
        unknown,
        clock,
        _style(about, title, units_of),
        times,
        "" if clock else unclear_clock(about),
    )


def _unit_of(name: str, told: str) -> Unit | str | None:
    """Unit of a column from its name and from what is told of it elsewhere; as printed if it is not known."""
    elsewhere, named = known_unit(told), unit_in_name(name)
    if elsewhere is not None and isinstance(named, Unit) and elsewhere != named:
        raise HeaderError(
            f"gives column {name[:40]} two units, one in its name and {told[:20]} in a row of its own. Correct the "
            "header."
        )
    if elsewhere or named:
        return elsewhere or named
    return None if told.strip("()[] ").lower() in (*GENERIC, *NO_UNIT) else told


def _units_left(rows: Sequence[Sequence[str]]) -> list[tuple[str, str]]:
    """Units, with their base, in rows that are neither names nor their units, where they may be meant for columns."""
    found = []
    for row in rows:
        text = ", ".join(cell for cell in row if cell)
        if not _SETTINGS.search(text):
            for word in _LEFT.findall(text):
                unit = known_unit(word)
                if unit is not None and unit.times != unit.over:
                    found.append((word, unit.base))
    return found


def _names_and_units(
    left: list[list[str]], count: int, width: int
) -> tuple[list[list[str]], list[str], list[str], list[list[str]]]:
    """Rows above the names, the names, their units, and rows below that are neither; no names if there are none."""

    def tells(row: Sequence[str]) -> bool:
        """Whether a row surely holds names: one of a time, or one with a unit."""
        named = any(_TIME_WORD.search(cell) or isinstance(unit_in_name(cell), Unit) for cell in row)
        return named and len(row) == width and _is_title(row, count) and not _is_entry(row, last=False)

    above = list(left)
    units_of = above.pop() if above and _is_unit_row(above[-1], below_names=len(above) > 1) else []
    if (
        above
        and _is_title(above[-1], count)
        and (units_of or tells(above[-1]) or not any(map(tells, left[-_UNIT_ROWS:])))
    ):
        title = above.pop()
        if not units_of and above and len(above[-1]) == len(title) and _is_all_units(above[-1]):
            units_of = above.pop()
        return above, title, units_of, []
    for k in range(1, min(_UNIT_ROWS, len(left))):  # rows that are not understood may stand below
        title, passed = left[-1 - k], left[len(left) - k :]
        if tells(title):
            rows = [row for row in passed if _is_unit_row(row, below_names=True)]
            return left[: -1 - k], title, rows[0] if rows else [], [row for row in passed if row not in rows[:1]]
    return above, [], units_of, []


def _is_all_units(row: Sequence[str]) -> bool:
    return all(known_unit(cell) is not None or unit_like(cell) for cell in row if cell) and any(row)


def _over_samples(names: list[str], columns: Sequence[int], width: int, counting: Sequence[int]) -> list[str]:
    """The names at the places of the columns that hold samples.

    Raises
    ------
    HeaderError
        They stand elsewhere, and nothing tells which belongs to which.
    """
    filled = [name for name in names if name and name.lower() not in ("comment", "comments", "remark")]
    if len(filled) > width:
        raise HeaderError(
            f"names {len(filled)} columns, {', '.join(filled)[:80]}, above {width} columns. Put names that hold a "
            "delimiter into quotes, or name each column once."
        )
    if not filled or all(i < len(names) and names[i] for i in columns):
        return names
    if len(filled) == len(columns):
        placed = [""] * width
        for i, name in zip(columns, filled, strict=True):
            placed[i] = name
        return placed
    if len(filled) == len(columns) - 1 and filled == names[: len(filled)] and len(names) < width:
        if columns[0] in counting:  # the numbers of the rows have no name
            return ["row", *names]
        raise HeaderError(
            f"names {len(filled)} columns, {', '.join(filled)[:80]}, above {len(columns)} columns of numbers. Name "
            "every column."
        )
    return names


def _is_entry(row: Sequence[str], last: bool) -> bool:
    """Whether a row below the names can only be entries; the last row above the samples may name a time by channel."""
    cells = [cell for cell in row if cell]
    if any(_START.match(cell) or _INCREMENT.match(cell) for cell in cells) and not all("=" in cell for cell in cells):
        return False
    if _names_units(row) or (len(cells) == 1 and len(row) > 1 and known_unit(cells[0])):
        return False
    if len(cells) == 1 or row[0].endswith((":", "=")) or is_key(row[0]):
        return True
    if is_paired(row):
        return not (last and row[1] and row[3] and not any(map(is_number, cells)))
    found = [KEY_AND_VALUE.match(cell) for cell in cells]
    return all(found) and not all(known_unit(one.group(2) or "") for one in found if one)


def _names_units(row: Sequence[str]) -> bool:
    """Whether two cells or more are names with units, so that whatever the others are, the row holds names."""
    return (
        sum(known_unit(cell) is None and "=" not in cell and isinstance(unit_in_name(cell), Unit) for cell in row) > 1
    )


def _is_title(row: Sequence[str], count: int) -> bool:
    """Whether a row names nearly as many columns as there are: no numbers, dates or entries."""
    cells = [cell for cell in row if cell]
    if _names_units(row) and len(cells) >= count - 1:
        return True
    if len(cells) < max(count - 1, 1) or is_key(row[0]) or row[0].endswith((":", "=")):
        return False
    if any(_STAMP.match(cell) for cell in cells) or re.search(r":\s*[-+.\d]", cells[0]):
        return False
    numbers = [cell for cell in cells if is_number(cell)]
    timed = cells[0].lower() in ("x-axis", "x") or _TIME_WORD.search(cells[0]) is not None
    return not numbers or (timed and all(cell.isdigit() for cell in numbers))


def _is_unit_row(row: Sequence[str], below_names: bool) -> bool:
    """Whether the cells of a row are units; below names, units of any quantity and unknown short words count too."""
    words = [cell for cell in row if cell and not is_number(cell)]
    if not words:
        return False
    first = known_unit(words[0])
    timed = below_names and first is not None and first.base == "s"
    return all(
        word.lower() in GENERIC
        or known_unit(word) is not None
        or (below_names and unit_like(word))
        or ((below_names or first is not None) and other_unit(word))
        or (word[0] in "([" and word[-1] in ")]")
        or (timed and len(word) <= 4)
        for word in words
    ) and (
        first is not None
        or words[0].lower() in ("sequence", "ts")
        or words[0][0] in "(["
        or (below_names and (unit_like(words[0]) or other_unit(words[0])))
    )


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
