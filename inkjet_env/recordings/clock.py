"""Times of samples: a column of times, sample numbers with a stated interval, or the interval alone."""

from __future__ import annotations

import numpy as np

from inkjet_env.recordings.instrument_file import Table
from inkjet_env.recordings.recording import CampaignError
from inkjet_env.typing import Real

SAMPLE_NUMBERS = "sample numbers"
"""Reason for which a column of sample numbers stands for the times."""
SAME_STEP = 0.01
"""Largest relative difference between the step of a file's times and the interval that its header states."""
FAR_ORIGIN = 1e5
"""Ratio of the first time to the recording's length above which times are stamps of a calendar, not seconds."""


def counted_times(
    table: Table, time: int | None, reason: str, values: Real, interval_s: float | None
) -> tuple[Real, str] | None:
    """Times from an interval that the header or the user states, shape (n,), and a note; None if a column holds them.

    Parameters
    ----------
    table : Table
        The file.
    time : int, optional
        Column of the times or of the sample numbers.
    reason : str
        How that column is known.
    values : ndarray, shape (n,)
        That column, or any other if there is none.
    interval_s : float, optional
        Sampling interval in seconds that the user states.

    Raises
    ------
    CampaignError
        The interval is not above zero, sample numbers do not count up, a column of times only counts, or an unnamed
        column rises by another step than the one that is stated.
    """
    clock, origin = table.header.clock if interval_s is None else (0.0, interval_s), _origin(interval_s)
    if time is not None and reason != SAMPLE_NUMBERS:
        if reason.startswith("guessed") and time in table.counting:
            raise CampaignError(
                f"{table.file}: column {table.header.names[time][:40]} counts the samples; it is no time. Give "
                "interval_s= (--interval on the command line), or call it time if a sample is taken every second."
            )
        return None
    assert clock is not None  # otherwise there is a time
    start_s, step_s = clock
    if not (np.isfinite([start_s, step_s]).all() and step_s > 0):
        raise CampaignError(f"{table.file}: the sample interval must be above 0 s; got {step_s:g} s. Check it.")
    numbers = np.arange(values.size, dtype=np.float64) if time is None else values
    steps = np.diff(numbers)
    if time is not None and abs(float(np.median(steps)) / step_s - 1) < SAME_STEP:
        return None  # they are times after all
    if not (steps == 1).all():
        k = int(np.argmin(steps == 1))
        raise CampaignError(
            f"{table.file}: sample numbers must count up by one; got {numbers[k + 1]:g} after {numbers[k]:g}. "
            "Samples are missing or doubled: export it again."
        )
    return start_s + step_s * numbers, f"{table.file}: a sample every {step_s:.6g} s, as the {origin} states."


def refuse_other_times(table: Table, used: set[int], interval_s: float | None) -> None:
    """Raise an error if an unnamed first column rises evenly, by another step than the one that is stated."""
    first, clock = table.columns[0], table.header.clock if interval_s is None else (0.0, interval_s)
    if clock is None or first in used or first in table.counting or not table.header.names[first].startswith("column "):
        return
    (values,) = table.read([first])
    steps = np.diff(values)
    usual = float(np.median(steps))
    even = usual > 0 and bool((np.abs(steps - usual) < 0.01 * usual).all())
    if even and abs(usual / clock[1] - 1) > SAME_STEP:
        raise CampaignError(
            f"{table.file}: its first column rises by {usual:.4g} from row to row, yet the {_origin(interval_s)} "
            f"states a sample every {clock[1]:.4g} s. If they are times, name the column, as time_s or time_ms."
        )


def agreed_times(
    table: Table, time: int, time_s: Real, step_s: float, interval_s: float | None
) -> tuple[Real, tuple[str, ...]]:
    """Times of a column, compared with an interval that the header or the user states; and notes.

    Raises
    ------
    CampaignError
        They contradict each other, or the times are stamps of a calendar without a unit.
    """
    clock, origin = table.header.clock if interval_s is None else (0.0, interval_s), _origin(interval_s)
    name, known = table.header.names[time][:40], time in table.header.units
    if not known and abs(float(time_s[0])) > FAR_ORIGIN * abs(float(time_s[-1] - time_s[0])):
        raise CampaignError(
            f"{table.file}: column {name} starts at {time_s[0]:.9g} and rises by {time_s[-1] - time_s[0]:.4g} in all, "
            "without a unit: stamps of a calendar? Write the unit behind the name, such as time (ms), or export times "
            "from the start."
        )
    if clock is None or abs(step_s / clock[1] - 1) <= SAME_STEP:
        return time_s, ()
    told = f"the times are {step_s:.4g} s apart, the {origin} states a sample every {clock[1]:.4g} s"
    power = float(np.log10(step_s / clock[1]) / 3)
    in_another_unit = abs(power - round(power)) < 1e-3 and round(power) != 0
    if in_another_unit and not known and power > 0:
        told = f"{told}; the times have no unit, so the interval that the {origin} states was taken"
        return time_s * (clock[1] / step_s), (f"{table.file}: {told}.",)
    if interval_s is not None or in_another_unit:
        raise CampaignError(f"{table.file}: {told}. Check the unit of the times.")
    return time_s, (f"{table.file}: {told}; the times were taken.",)


def _origin(interval_s: float | None) -> str:
    return "header" if interval_s is None else "user"
