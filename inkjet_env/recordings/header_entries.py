"""Entries of a header, such as ``Sample Interval,2e-6``: names, units and the clock that they state."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from inkjet_env.recordings.units import hertz, known_unit, seconds

KEY_AND_VALUE = re.compile(r"^([^:=]{2,40}?)\s*[:=]\s*(\S.*)?$")
_NAME_AND_UNIT = re.compile(r"^(?:CH?|Channel )\d\s*:\s*(.*)$", re.IGNORECASE)
_INTERVALS = re.compile(
    r"((time|sample|sampling|horizontal|x)[ _]?(interval|period|increment|step|resolution)|(sampling|sample)[ _]?time"
    r"|t?interval|x?incr?(ement)?|delta([ _]?[tx])?|dt|t[ _]?sample|ts|h?resolution)"
)
_RATES = re.compile(
    r"((samples?|sampling|scan)[ _]?(rate|frequency|freq|/s|per second)|samplerate|fs|sps|rate)([ _](in[ _])?k?hz)?"
)
_STARTS = re.compile(r"(t0|t_?start|x[ _]?(origin|org|zero|start|0)|hoffset|start([ _]time)?|first[ _]sample)")
NAME_KEYS = (
    "source", "multichannelsource", "label", "channel", "channels", "trace name", "tracename",
    "channeltitle", "channel data", "name", "signal name",
)  # fmt: skip
"""Entries that name the channels."""
_CHANNEL_UNIT_KEY = re.compile(
    r"((v(ertical)?|y|channels?|ch|data)[ _]?)?(axis[ _]?)?units?([ _]?(label|name))?|unitname"
)
_TIME_UNIT_KEY = re.compile(r"(h(orizontal)?|x|t(ime)?)[ _]?(axis[ _]?)?units?([ _]?(label|name))?")
_ONE_UNIT_KEY = re.compile(r"(.+?)[ _.]*(vertical[ _]?)?units?", re.IGNORECASE)
"""An entry with the unit of one channel."""
_FACTORS = re.compile(
    r"y?mult(iplier)?|y[ _]?(mult\w*|incr?(ement)?)|(scale|conversion)([ _]?factors?)?|lsb"
    r"|volts?[ _/]*(per[ _]*)?(bit|count|lsb)"
)
"""Entries with the factor from a converter's counts to volts."""
_COLUMN_FACTORS = re.compile(r"(scale|scaling|conversion)([ _]?factors?)?|multipliers?|factors?")
_SCALE = re.compile(r"vertical[ _]?scale|v(olts?)?[ _]?(/|per)[ _]?div(ision)?", re.IGNORECASE)
MOST_DIVISIONS = 12
"""Number of divisions beyond which samples are no volts."""
LONGEST_BARE_S = 1.0
"""Sample interval from which a number without a unit is not taken: it may be seconds, or microseconds."""
GENERIC = {"value", "values", "ampl", "amplitude", "data", "sequence", "level", "vol.", "voltage", "*", "ts", "rn", ""}
"""Names and units that tell nothing of a channel."""
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}([.,])\d{3}(?![\d.,eE])")


class HeaderError(ValueError):
    """A header that says the samples cannot be read; the message is a sentence without the file's name."""


def is_key(cell: str) -> bool:
    """Whether a cell is the key of an entry, on names, units or the mode."""
    key = cell.strip(" \t:=").lower()
    unit = _CHANNEL_UNIT_KEY.fullmatch(key) or _TIME_UNIT_KEY.fullmatch(key)
    return key in (*NAME_KEYS, "mode") or unit is not None


def is_paired(row: Sequence[str]) -> bool:
    """Whether a row repeats its key before the value of each channel."""
    return (
        len(row) >= 4 and bool(row[0]) and row[0] == row[2] and not (row[1] and row[3] and row[1] == row[3] == row[0])
    )


def entries_of(rows: Sequence[Sequence[str]]) -> dict[str, list[str]]:
    """Entries by their keys in lower case: cells at the places of the columns, the key's empty."""
    about: dict[str, list[str]] = {}
    for row in rows:
        cells = [cell for cell in row if cell]
        key = row[0].strip(" \t:=").lower()
        if found := KEY_AND_VALUE.match(cells[0]) if len(cells) == 1 or all("=" in cell for cell in cells) else None:
            _keep(about, found.group(1).strip().lower(), ["", found.group(2) or ""])
        elif (found := KEY_AND_VALUE.match(cells[0])) and is_key(found.group(1)):
            about.setdefault(found.group(1).strip().lower(), ["", found.group(2) or "", *row[1:]])
        elif is_paired(row):
            about[key] = ["" if k % 2 == 0 else cell for k, cell in enumerate(row)]
        else:
            _keep(about, key, ["", *row[1:]])
    return about


def _keep(about: dict[str, list[str]], key: str, cells: list[str]) -> None:
    """Keep an entry; the first of those with one key, but a clock must not be stated twice with different numbers."""
    clock = _INTERVALS.fullmatch(key) or _RATES.fullmatch(key)
    if clock and about.get(key, cells) != cells:
        told = " and ".join(next(filter(None, one), "") for one in (about[key], cells))
        raise HeaderError(f"states {key} twice, {told}. Remove one.")
    about.setdefault(key, cells)


def _first(about: Mapping[str, list[str]], keys: re.Pattern[str]) -> str:
    return next((cell for key in about if keys.fullmatch(key) for cell in about[key] if cell), "")


def unit_of_one(about: Mapping[str, list[str]], names: Sequence[str]) -> str:
    """Unit of a column from an entry of its own."""
    for key, cells in about.items():
        found = _ONE_UNIT_KEY.fullmatch(key)
        if found and found.group(1).strip().lower() in map(str.lower, names):
            return next((cell for cell in cells if cell), "")
    return ""


def unit_of_column(about: Mapping[str, list[str]], column: int, channels: Sequence[int], columns: Sequence[int]) -> str:
    """Unit of a column from an entry for all of them: at its place, or in their order."""
    for key in about:
        if not _CHANNEL_UNIT_KEY.fullmatch(key):
            continue
        cells = [_NAME_AND_UNIT.sub(r"\1", cell) for cell in about[key]]
        cells = [cell if known_unit(cell) else cell.partition(" (")[0] for cell in cells]
        told = [cell for cell in cells if cell]
        if not told:
            continue
        if len(told) == len(columns) > len(channels):  # of the times too
            return told[list(columns).index(column)]
        if column not in channels:
            break
        if all(len(cells) > i and cells[i] for i in channels):
            return cells[column]
        place = list(channels).index(column)
        return told[0] if len(told) == 1 else told[place] if place < len(told) else ""
    return "" if column in channels else _first(about, _TIME_UNIT_KEY)


def better_names(
    about: Mapping[str, list[str]], labels: Sequence[str], channels: Sequence[int], columns: Sequence[int]
) -> dict[int, str]:
    """Names of channels from an entry for all of them, where their titles repeat or tell nothing."""
    titles = [labels[i].lower() for i in channels]
    bare = [re.sub(r"\s*[(\[].*$", "", title) for title in titles]
    if not any(t in GENERIC or t.startswith("column ") for t in bare) and len(set(titles)) == len(titles):
        return {}
    numbered = {i: next(filter(None, about.get(f"name{k}", [])), "") for k, i in enumerate(channels)}
    if all(numbered.values()):
        return numbered
    for key in NAME_KEYS:
        cells = about.get(key, [])
        told = [cell for cell in cells if cell]
        if len(told) == 1 and len(channels) > 1:
            told = [part.strip() for part in re.sub(r"^\(.*?\):?", "", told[0]).split(",")]
        placed = all(len(cells) > i and cells[i] for i in channels)
        if len(told) == len(columns) > len(channels):  # the times' too
            placed, told = False, told[len(columns) - len(channels) :]
        found = {i: cells[i] for i in channels} if placed else dict(zip(channels, told, strict=False))
        if len(found) == len(channels) and len(set(found.values())) == len(found):
            return found
    return {i: f"column {i + 1}" for i, title in zip(channels, titles, strict=True) if titles.count(title) > 1}


def stated_clock(about: Mapping[str, list[str]], decimal: str = ".") -> tuple[float, float] | None:
    """Start and step in seconds if entries of a header state them.

    Raises
    ------
    HeaderError
        Channels have different intervals, or a mark may stand for thousands.
    """
    steps: set[float] = set()
    start = 0.0
    for entry, cells in about.items():
        name, _, unit = entry.replace("[", "(").partition("(")
        name, unit = name.strip(), unit.strip(" )]")
        if _INTERVALS.fullmatch(name) or _RATES.fullmatch(name):
            for cell in cells:
                if (mark := _THOUSANDS.match(cell)) and mark.group(1) != decimal:
                    raise HeaderError(
                        f"states {name} {cell}; {mark.group(1)!r} may stand for thousands or be the decimal sign. "
                        "Write it without."
                    )
        values = [cell.replace(",", ".") for cell in cells if cell]
        if len(values) % 2 == 0 and all(is_number(a) and not is_number(b) for a, b in _pairs(values)):
            values = [" ".join(pair) for pair in _pairs(values)]  # the units have cells of their own
        if _RATES.fullmatch(name) and (key_unit := re.search(r"([kM]?)hz$", name, re.IGNORECASE)):
            values = [f"{value} {key_unit.group()}" if is_number(value) else value for value in values]
        values = [f"{value} {unit}" if unit and is_number(value) else value for value in values]
        read = hertz if _RATES.fullmatch(name) else seconds
        if not all(read(value) is not None for value in values):
            values = values[:1]
        found = [value for one in values if (value := read(one)) is not None]
        if _INTERVALS.fullmatch(name):
            bare = all(is_number(value) for value in values)
            bits = "resolution" in name and bare  # or samples of a division
            mine = {value for value in found if value > 0 and not (bits and value >= 1)}
            mine = {value for value in mine if not (bare and value >= LONGEST_BARE_S)}
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
    address = next(filter(None, about.get("trigger address", [])), "")
    return start or (-float(address) * min(steps) if is_number(address) else 0.0), min(steps)


def _pairs(values: Sequence[str]) -> list[tuple[str, str]]:
    return list(zip(values[::2], values[1::2], strict=True))


def refuse_counts(
    about: Mapping[str, list[str]],
    columns: Sequence[int],
    counting: Sequence[int],
    whole: Sequence[int],
    largest: Mapping[int, float],
) -> None:
    """Raise an error if the samples are a converter's counts, of which the header tells in one way or another."""
    if "fast" in map(str.lower, about.get("mode", [])) and "vertical scale" in about:
        raise HeaderError("holds the converter's counts, not volts. Export it in the detailed format.")
    if not set(columns) <= {*whole, *columns[:1]}:
        return
    factors = [key for key in about if _FACTORS.fullmatch(key) and any(cell not in ("", "1") for cell in about[key])]
    if factors and set(columns) - set(counting):
        raise HeaderError(
            f"holds whole numbers and, in its header, {factors[0]!r}, a factor to volts. Multiply, or export volts."
        )
    scales = [float(cell) for key, cells in about.items() if _SCALE.fullmatch(key) for cell in cells if is_number(cell)]
    count = max((largest[i] for i in whole if i in largest), default=0.0)
    if scales and count > MOST_DIVISIONS * max(scales):
        raise HeaderError(
            f"holds whole numbers up to {count:g}, though a division is {max(scales):g} V: the converter's counts, not "
            "volts. Export volts."
        )


def refuse_factors(about: Mapping[str, list[str]]) -> None:
    """Raise an error if an entry gives each column a factor."""
    for key, cells in about.items():
        numbers = [cell for cell in cells if is_number(cell)]
        if _COLUMN_FACTORS.fullmatch(key) and len(numbers) > 1 and any(float(cell) != 1 for cell in numbers):
            raise HeaderError(
                f"has a factor for each column in its header, {key} {', '.join(numbers)[:60]}. Multiply the columns by "
                "it, and leave it out."
            )


def unclear_clock(about: Mapping[str, list[str]]) -> str:
    """What entries say of a sampling interval or rate, where `stated_clock` finds none; empty if they say nothing."""
    told = [
        f"{key} {next(filter(None, cells), '')}"[:60]
        for key, cells in about.items()
        if _INTERVALS.fullmatch(key) or _RATES.fullmatch(key)
    ]
    return " and ".join(told[:2])


def is_number(cell: str) -> bool:
    """Whether a cell is a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True
