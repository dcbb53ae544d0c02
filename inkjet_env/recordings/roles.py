"""Roles of the columns of an oscilloscope file, such as drive and sensor: given, by name, or guessed with a note."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from inkjet_env.printhead import nearest_name
from inkjet_env.recordings.recording import CampaignError, brief
from inkjet_env.recordings.sheet import Sheet
from inkjet_env.typing import Real

ROLES = ("time", "drive", "sensor", "monitor", "neighbour")
# The order matters: "drive monitor" is a monitor.
_NAMES = {
    "neighbour": re.compile(r"neighbou?r|adjacent", re.IGNORECASE),
    "monitor": re.compile(r"monitor", re.IGNORECASE),
    "drive": re.compile(r"drive|awg|generator|wavegen|command", re.IGNORECASE),
    "sensor": re.compile(r"sens|strain|displace|position|deflection|current|vibrom|interferom", re.IGNORECASE),
}
_TIME = re.compile(r"^(time|second|x-axis)|^[tx]\b|^t_", re.IGNORECASE)
CLEARLY_LARGER = 2.0
"""Ratio of ranges from which the column with the larger range is guessed to be the drive; below it, the first is."""


def named_roles(file: Path, sheet: Sheet, columns: Mapping[str, str | int]) -> tuple[dict[str, int], dict[str, str]]:
    """Columns, counted from 0, of the roles that are given or named in the header, and the reason for each role.

    If the header states start and step of the times, ``time`` is the column of sample numbers, or absent.

    Raises
    ------
    CampaignError
        A role or a column that does not exist, a column with two roles, or two columns whose names claim one role.
    """
    roles: dict[str, int] = {}
    for role, column in columns.items():
        if role not in ROLES:
            raise CampaignError(
                f"columns must name {', '.join(ROLES)}; got {brief(role)}.{nearest_name(str(role)[:60], ROLES)}"
            )
        number = _column_number(file, sheet, role, column)
        if number in roles.values():
            raise CampaignError(f"columns gives column {brief(column)} two roles. Give each role its own column.")
        roles[role] = number
    reasons = dict.fromkeys(roles, "as told")
    if "time" not in roles:
        roles, reasons = _with_time(sheet, roles, reasons)
    for role, pattern in _NAMES.items():
        if role in roles:
            continue
        found = [i for i in sheet.columns if i not in roles.values() and pattern.search(sheet.layout.names[i])]
        if len(found) > 1:
            names = " and ".join(sheet.layout.names[i][:40] for i in found)
            raise CampaignError(f"{file}: {names} could each be the {role}. Specify one with columns={{{role!r}: …}}.")
        if found:
            roles[role], reasons[role] = found[0], "by its name"
    return roles, reasons


def _with_time(sheet: Sheet, roles: dict[str, int], reasons: dict[str, str]) -> tuple[dict[str, int], dict[str, str]]:
    """Add the column of times, or of sample numbers."""
    free = [i for i in sheet.columns if i not in roles.values()]
    numbered = [i for i in free if sheet.layout.names[i].lower() in ("x", "sequence")]
    if sheet.clock is not None:
        found, reason = numbered[:1], "sample numbers; start and step from the header"
    elif found := [i for i in free if i in sheet.units and sheet.units[i].base == "s"]:
        reason = "by its unit"
    elif found := [i for i in free if _TIME.search(sheet.layout.names[i])]:
        reason = "by its name"
    else:
        found, reason = free, "guessed: the first column"
    if not found:
        return roles, reasons
    return roles | {"time": found[0]}, reasons | {"time": reason}


def _column_number(file: Path, sheet: Sheet, role: str, column: str | int) -> int:
    names = sheet.layout.names
    if isinstance(column, str) and column in names:
        return names.index(column)
    try:
        number = int(column) - 1
    except (TypeError, ValueError):
        number = -1
    if isinstance(column, bool) or number not in sheet.columns:
        known = [names[i] for i in sheet.columns]
        raise CampaignError(
            f"{file}: has no column {brief(column)} for the {role}; it has {', '.join(known)[:120]}, or numbers from 1."
            f"{nearest_name(str(column)[:60], known)}"
        )
    return number


def candidates(file: Path, sheet: Sheet, roles: dict[str, int]) -> list[int]:
    """Columns with uninformative names that must be the drive or the sensor, or both in an order to be guessed.

    Raises
    ------
    CampaignError
        There are more or fewer such columns than roles to be filled.
    """
    missing = [role for role in ("drive", "sensor") if role not in roles]
    free = [i for i in sheet.columns if i not in roles.values()]
    if not missing:
        return []
    if len(free) != len(missing):
        names = ", ".join(sheet.layout.names[i] for i in free)[:120] or "none"
        raise CampaignError(
            f"{file}: the column of the {' and the '.join(missing)} is unknown; the remaining columns are: {names}. "
            f"Specify it with columns={{{', '.join(f'{role!r}: …' for role in missing)}}}."
        )
    return free


def guessed_roles(sheet: Sheet, roles: dict[str, int], values: dict[int, Real]) -> tuple[dict[str, int], str]:
    """Assign the remaining roles to the `candidates`.

    Parameters
    ----------
    sheet : Sheet
        Columns of the file.
    roles : dict
        Columns by role, from `named_roles`.
    values : dict
        Samples of the candidates in base units, by column.

    Returns
    -------
    roles : dict
        Column of each role that was missing.
    reason : str
        Reason for the assignment, in words.
    """
    missing = [role for role in ("drive", "sensor") if role not in roles]
    if len(values) == 1:
        return {missing[0]: next(iter(values))}, "the only remaining column"
    first, second = values
    lengths = [i for i in values if i in sheet.units and sheet.units[i].base in ("um", "nm")]
    if len(lengths) == 1:
        return {"drive": second if lengths[0] == first else first, "sensor": lengths[0]}, "a length is the sensor"
    range_1, range_2 = (float(np.ptp(values[i])) for i in values)
    if range_2 >= CLEARLY_LARGER * range_1:
        return {"drive": second, "sensor": first}, f"guessed: the larger range, {range_2:.3g} against {range_1:.3g}"
    if range_1 >= CLEARLY_LARGER * range_2:
        return {"drive": first, "sensor": second}, f"guessed: the larger range, {range_1:.3g} against {range_2:.3g}"
    return {"drive": first, "sensor": second}, "guessed: the first of two columns of similar range"
