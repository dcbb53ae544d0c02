"""Roles of the columns of an instrument's file, such as drive and sensor: given, by name, or guessed with a note."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from inkjet_env.printhead import nearest_name
from inkjet_env.recordings.clock import SAMPLE_NUMBERS
from inkjet_env.recordings.header import INDICES
from inkjet_env.recordings.instrument_file import Table
from inkjet_env.recordings.recording import CampaignError, brief
from inkjet_env.typing import Real

ROLES = ("time", "drive", "sensor", "monitor", "neighbour")
_NAMES = {
    "neighbour": (r"neighbou?r|adjacent",),
    "monitor": (r"monitor",),
    "drive": (
        r"drive|awg|generator|wavegen|command|excitation|stimulus",
        r"analog(ue)?[ _]*out|\bao[ _]?\d|\bdac\d?\b",
        r"(?<!analog )(?<!analogue )\binput\b|_in$|^in$|^u\d?(?=$|[\s_(\[])",
    ),
    "sensor": (
        r"sens|strain|displace|position|deflection|current|vibrom|interferom",
        r"analog(ue)?[ _]*in|\bai[ _]?\d|\badc\d?\b",
        r"response|(?<!analog )(?<!analogue )\boutput\b|_out$|^out$|^y\d?(?=$|[\s_(\[])",
    ),
}
"""Names of columns by role, those that tell most first. The roles' order matters: "drive monitor" is a monitor; and a
data acquisition card's output drives the head, whose answer is its input."""
_PAIR = re.compile(r"(^|[\s_(])(min|max|low|high)(imum|est)?(?=$|[\s_)(])", re.IGNORECASE)
_POSITION = re.compile(r"position|displace", re.IGNORECASE)
_VOLTAGE = re.compile(r"volt(age)?", re.IGNORECASE)
_TIME = re.compile(r"^(time|second|x-axis|x_value)|\btime\b|_time\b|^[tx]\b|^t_", re.IGNORECASE)
_FREQUENCY = re.compile(r"^f(req(uency)?)?\b|frequency|\bhz\b", re.IGNORECASE)
_NO_SECONDS = re.compile(
    r"(clock|timer|cpu)?[ _]?(ticks?|counts?|counter|cycles?|clocks?)"
    r"|min|h|hrs?|hours?|std|stunden?|heures?|d|days?|tage?|jours?",
    re.IGNORECASE,
)
"""First columns that are ticks, minutes, hours or days."""
_PEAK_DETECT = re.compile(r"peak[ _-]?detect", re.IGNORECASE)
CLEARLY_LARGER = 2.0
"""Ratio of ranges from which the column with the larger range is guessed to be the drive; below it, the first is."""
STATED = "interval_s= (--interval on the command line)"


@dataclass(frozen=True)
class Roles:
    """Columns of one file by their roles.

    Attributes
    ----------
    columns : dict of str to int
        Column of each role that is known, counted from 0.
    reasons : dict of str to str
        How it is known, in words.
    unsure : tuple of int
        Columns that must be the drive or the sensor, in an order to be guessed.
    times : tuple of int
        Further columns of times.
    """

    columns: dict[str, int]
    reasons: dict[str, str]
    unsure: tuple[int, ...]
    times: tuple[int, ...] = ()

    @property
    def missing(self) -> list[str]:
        """Roles that the unsure columns have."""
        return [role for role in ("drive", "sensor") if role not in self.columns]


def named_roles(table: Table, columns: Mapping[str, str | int], interval_s: float | None = None) -> Roles:
    """Columns of the roles that are given or named in the header.

    If start and step of the times are stated, ``time`` is the column of sample numbers, or absent.

    Parameters
    ----------
    table : Table
        The file.
    columns : mapping
        Column of each role that is given, by name or by number from 1.
    interval_s : float, optional
        Sampling interval in seconds that the user states.

    Raises
    ------
    CampaignError
        A role or a column that does not exist, a column with two roles, two columns whose names claim one role, no
        times, or more or fewer remaining columns than roles to be filled.
    """
    roles: dict[str, int] = {}
    names = table.header.names
    for role, column in columns.items():
        if role not in ROLES:
            raise CampaignError(
                f"columns must name {', '.join(ROLES)}; got {brief(role)}.{nearest_name(str(role)[:60], ROLES)}"
            )
        number = column_number(table, role, column)
        if number in roles.values():
            raise CampaignError(f"columns gives column {brief(column)} two roles. Give each role its own column.")
        roles[role] = number
    reasons = dict.fromkeys(roles, "as told")
    free = [i for i in table.columns if i not in roles.values() and not _PEAK_DETECT.search(names[i])]
    if "time" not in roles:
        needed = sum(role not in roles for role in ("drive", "sensor"))
        time, reason = _time(table, free, interval_s, needed)
        if time is not None:
            roles["time"], reasons["time"] = time, reason
    numbering = [
        i for i in free if i in table.counting and (names[i].lower() in INDICES or names[i].startswith("column "))
    ]
    if "time" in roles and len(free) - len(numbering) >= 1 + sum(role not in roles for role in ("drive", "sensor")):
        free = [i for i in free if i not in numbering]
    _refuse_envelopes(table, free)
    seconds = [i for i in free if (unit := table.header.units.get(i)) is not None and unit.base == "s"]
    if "time" in roles:
        seconds += [i for i in free if names[i] == names[roles["time"]] and i not in seconds]
    seconds += [i for i in table.header.times if i in free and i not in seconds]
    free = [i for i in free if i not in roles.values()]
    for role in _NAMES:
        found = _named(role, names, free)
        if role in roles or not found:
            continue
        if len(found) > 1:
            claimed = " and ".join(names[i][:40] for i in found)
            raise CampaignError(
                f"{table.file}: {claimed} could each be the {role}. Specify one with columns={{{role!r}: …}}."
            )
        roles[role], reasons[role] = found[0], "by its name"
        free.remove(found[0])
    if "drive" not in roles and "sensor" in roles:
        volts = [i for i in free if _VOLTAGE.search(names[i])]
        if len(volts) == 1:
            roles["drive"], reasons["drive"] = volts[0], "by its name"
            free.remove(volts[0])
    missing = [role for role in ("drive", "sensor") if role not in roles]
    free = [i for i in free if i not in seconds]  # the times of each channel
    if len(missing) == 2 and len(free) == 1:
        raise CampaignError(
            f"{table.file}: holds one channel only, {names[free[0]][:40]}; a recording has a drive and a sensor. "
            "Export both channels, or call the files of one recording the same but for CH1 and CH2."
        )
    if missing and len(free) != len(missing):
        left = ", ".join(names[i] for i in free)[:120] or "none"
        raise CampaignError(
            f"{table.file}: the column of the {' and the '.join(missing)} is unknown; the remaining columns are: "
            f"{left}. Specify it with columns={{{', '.join(f'{role!r}: …' for role in missing)}}}."
        )
    drive = roles.get("drive")
    if drive is not None and drive not in table.header.units and is_position(names[drive]):
        raise CampaignError(
            f"{table.file}: {names[drive][:60]} is a position, not the voltage of a drive. Record the drive in volts."
        )
    further = tuple(i for i in seconds if i not in roles.values())
    return Roles(roles, reasons, tuple(free) if missing else (), further)


def _refuse_envelopes(table: Table, free: Sequence[int]) -> None:
    """Raise an error if two columns are the least and the largest values of one channel."""
    plain: dict[str, int] = {}
    for i in free:
        name = table.header.names[i]
        bare = _PAIR.sub(r"\1", name)
        if bare == name:
            continue
        if bare in plain:
            raise CampaignError(
                f"{table.file}: {table.header.names[plain[bare]][:40]} and {name[:40]} are the envelope of one "
                "channel, not its samples. Export the samples."
            )
        plain[bare] = i


def contradicted(table: Table, roles: Roles, values: Mapping[int, Real]) -> str:
    """Why names that only say input and output may be meant the other way round; empty if they are not.

    An amplifier's input is the small voltage of a generator, and its output drives the head.
    """
    pair = tuple(roles.columns.get(role, -1) for role in ("drive", "sensor"))
    names, units = table.header.names, table.header.units
    by_name = all(roles.reasons.get(role) == "by its name" for role in ("drive", "sensor"))
    volts = all(i in units and units[i].base == "V" for i in pair)
    stronger = any(
        re.search(p, names[i], re.IGNORECASE) for i in pair for r in ("drive", "sensor") for p in _NAMES[r][:2]
    )
    if not (by_name and volts) or stronger:
        return ""
    drive, sensor = pair
    first, second = (float(np.ptp(values[i])) for i in (drive, sensor))
    if second < CLEARLY_LARGER * first:
        return ""
    return (
        f"{names[drive][:40]} would be the drive by its name, yet {names[sensor][:40]} has the larger range, "
        f"{second:.3g} V against {first:.3g} V: an amplifier's input and output?"
    )


def is_position(name: str) -> bool:
    """Whether the name of a column says that it is a position."""
    return _POSITION.search(name) is not None


def _named(role: str, names: Sequence[str], free: Sequence[int]) -> list[int]:
    """Columns whose names claim a role, by the words that tell most."""
    for pattern in _NAMES[role]:
        if found := [i for i in free if re.search(pattern, names[i], re.IGNORECASE)]:
            return found
    return []


def named_drive(table: Table, interval_s: float | None = None) -> tuple[int | None, str, int]:
    """Columns of the times, None if they are stated, how they are known, and the drive's, which may be the only one.

    Raises
    ------
    CampaignError
        No times, or no column or several that could be the drive.
    """
    names = table.header.names
    free = [i for i in table.columns if not _PEAK_DETECT.search(names[i])]
    time, reason = _time(table, free, interval_s, 1)
    free = [i for i in free if i != time]
    others = {*_named("monitor", names, free), *_named("neighbour", names, free)}
    free = [i for i in free if i not in others]
    claimed = _named("drive", names, free)
    found = claimed or [i for i in free if _VOLTAGE.search(names[i])] or free
    if len(found) != 1:
        left = ", ".join(names[i][:40] for i in found) or "none"
        raise CampaignError(
            f"{table.file}: the column of the drive is unknown; it could be: {left}. Call one of them drive_V."
        )
    return time, reason, found[0]


def _time(table: Table, free: Sequence[int], interval_s: float | None, needed: int) -> tuple[int | None, str]:
    """The column of times, or of sample numbers, if there is one, and the reason.

    It is guessed only if ``needed`` further columns remain.
    """
    names, units = table.header.names, table.header.units
    stated = interval_s is not None or table.header.clock is not None
    found = [i for i in free if i in units and units[i].base == "s"]
    if found:
        return found[0], "by its unit"
    if table.header.times and table.header.times[0] in free:
        return table.header.times[0], "by its place"
    first = free[0] if free else None
    if first == table.columns[0] and (_FREQUENCY.search(names[first]) or "Hz" in table.header.unknown.get(first, "")):
        raise CampaignError(
            f"{table.file}: is a spectrum: its first column is {names[first][:40]}. Export the samples over time."
        )
    numbered = [i for i in free if names[i].lower() in INDICES]
    if stated and numbered:
        return numbered[0], SAMPLE_NUMBERS
    found = [i for i in free if _TIME.search(names[i]) and i not in units and i not in table.header.unknown]
    if found:
        return found[0], "by its name"
    if numbered:
        raise CampaignError(
            f"{table.file}: column {names[numbered[0]][:40]} numbers the samples, and "
            + (f"{table.header.unclear} is not understood" if table.header.unclear else "no sample interval is stated")
            + f". Give {STATED}, or export the times."
        )
    if stated:
        return None, ""
    named = first is None or first in units or any(_named(role, names, [first]) for role in _NAMES)
    if named or len(free) <= needed:
        unclear = table.header.unclear
        said = (
            f"what its header states, {unclear}, is not understood"
            if unclear
            else "its header states no sample interval"
        )
        raise CampaignError(f"{table.file}: has no column of times, and {said}. Add the column, or give {STATED}.")
    assert first is not None
    if _NO_SECONDS.fullmatch(names[first].strip("()[] ")):
        raise CampaignError(
            f"{table.file}: its first column, {names[first][:40]}, is no time in a unit that is read. Write "
            f"seconds, as time_s, or give {STATED}."
        )
    return first, "guessed: the first column"


def column_number(table: Table, role: str, column: str | int) -> int:
    """A column of a file, counted from 0, by its name or its number from 1; `CampaignError` if there is none."""
    names = table.header.names
    if isinstance(column, str) and column in names:
        return names.index(column)
    try:
        number = int(column) - 1
    except (TypeError, ValueError):
        number = -1
    if isinstance(column, bool) or number not in table.columns:
        known = [names[i] for i in table.columns]
        raise CampaignError(
            f"{table.file}: has no column {brief(column)} for the {role}; it has {', '.join(known)[:120]}, or numbers "
            f"from 1.{nearest_name(str(column)[:60], known)}"
        )
    return number


def guessed_roles(
    files: Sequence[tuple[Table, Roles, Mapping[int, Real]]],
) -> list[tuple[dict[str, int], str]]:
    """Roles of the unsure columns of the files of one folder, which have one wiring.

    Parameters
    ----------
    files : sequence of (Table, Roles, mapping of int to ndarray)
        Each file, its roles by name, and the samples of its unsure columns in base units.

    Returns
    -------
    list of (dict of str to int, str)
        For each file: column of each role that was missing, and the reason in words.

    Raises
    ------
    CampaignError
        Guesses from different files contradict each other, or no file allows one.
    """
    answers: list[tuple[dict[str, int], str]] = []
    guesses: dict[int, tuple[int, int, str]] = {}
    for k, (table, roles, values) in enumerate(files):
        if len(roles.unsure) == 2:
            first, second = roles.unsure
            units = table.header.units
            lengths = [i for i in roles.unsure if i in units and units[i].base in ("um", "nm")]
            if len(lengths) == 1:
                answers.append(
                    (
                        {"drive": second if lengths[0] == first else first, "sensor": lengths[0]},
                        "a length is the sensor",
                    )
                )
                continue
            guesses[k] = _larger(first, second, values)
            answers.append(({}, ""))
        elif roles.unsure:
            answers.append(({roles.missing[0]: roles.unsure[0]}, "the only remaining column"))
        else:
            answers.append(({}, ""))
    named = {k: tuple(files[k][0].header.names[i] for i in files[k][1].unsure) for k in guesses}
    for names in dict.fromkeys(named.values()):
        mine = [k for k in guesses if named[k] == names]
        for k, answer in _one_wiring([(files[n], guesses[n]) for n in mine], names).items():
            answers[mine[k]] = answer
    return answers


def _larger(first: int, second: int, values: Mapping[int, Real]) -> tuple[int, int, str]:
    """1 if the first column clearly has the larger range, 2 if the second has, 0 if neither; and the reason.

    A column that never moves tells nothing: -1.
    """
    ranges = [float(np.ptp(values[i])) for i in (first, second)]
    told = f"guessed: the larger range, {max(ranges):.3g} against {min(ranges):.3g}"
    if min(ranges) == 0:
        return -1, 0, ""
    if ranges[1] >= CLEARLY_LARGER * ranges[0]:
        return 2, 0, told
    if ranges[0] >= CLEARLY_LARGER * ranges[1]:
        return 1, 0, told
    return 0, 0, "guessed: the first of two columns of similar range"


def _one_wiring(
    files: Sequence[tuple[tuple[Table, Roles, Mapping[int, Real]], tuple[int, int, str]]], names: Sequence[str]
) -> dict[int, tuple[dict[str, int], str]]:
    """One guess for files with the same columns, by their places."""
    tells = Counter(guess for _, (guess, _, _) in files if guess > 0)
    first_file = files[0][0][0].file
    ask = "Say which it is with columns={'drive': …, 'sensor': …} (--columns)."
    if len(tells) > 1:
        raise CampaignError(
            f"{first_file.parent}: {names[0][:40]} has the larger range in {tells[1]} recordings, {names[1][:40]} in "
            f"{tells[2]}; which of them is the drive cannot be guessed. {ask}"
        )
    if not tells and all(guess < 0 for _, (guess, _, _) in files):
        raise CampaignError(
            f"{first_file}: {names[0][:40]} or {names[1][:40]} never moves, so which of them is the drive cannot be "
            f"guessed. {ask}"
        )
    chosen = next(iter(tells), 1)
    answers = {}
    for k, ((_, roles, _), (guess, _, told)) in enumerate(files):
        first, second = roles.unsure
        drive, sensor = (first, second) if chosen == 1 else (second, first)
        reason = told if guess == chosen or not tells else "guessed: as in the other recordings"
        answers[k] = ({"drive": drive, "sensor": sensor}, reason)
    return answers
