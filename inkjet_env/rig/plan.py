"""A battery as files for an arbitrary waveform generator, so that a real rig can record the same campaign."""

from __future__ import annotations

import csv
import io
import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from inkjet_env.rig.battery import DriveLine, default_battery
from inkjet_env.storage import write_atomically

PLAN = "plan.csv"
"""Name of the file that lists the drives."""

PLAN_COLUMNS = (
    "file",
    "channel",
    "excitation",
    "initial_state",
    "repeats",
    "samples",
    "sample_step_s",
    "repetition_period_s",
    "purpose",
)


def plan_csvs(folder: str | os.PathLike[str], battery: Sequence[DriveLine] | None = None) -> None:
    """Write the drive of each line as ``<channel>-<label>.csv`` (time_s, drive_V), and a list of them as ``plan.csv``.

    In ``plan.csv`` the ``repetition_period_s`` is the period at which a periodic drive is fired; it is empty if the
    drive is applied once, to the demagnetised head. Take the recordings of a channel in random order.

    Parameters
    ----------
    folder : str or Path
        Destination; created if it is missing. Files of the same names are replaced.
    battery : sequence of DriveLine, optional
        Lines to write; by default `default_battery` for a head expected at 50 kHz.

    Raises
    ------
    ValueError
        There are no lines, or two lines of a channel have the same label.
    OSError
        The folder is not writable.
    """
    lines = default_battery() if battery is None else tuple(battery)
    if not lines:
        raise ValueError("battery must hold at least one line; got none.")
    names = [f"{line.channel}-{line.label}.csv" for line in lines]
    name, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise ValueError(f"each line of a channel must have its own label; {count} would be written to {name}.")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    plan = io.StringIO()
    writer = csv.DictWriter(plan, PLAN_COLUMNS, lineterminator="\n")
    writer.writeheader()
    for name, line in zip(names, lines, strict=True):
        rows = zip(line.time_s.tolist(), line.drive_V.tolist(), strict=True)
        write_atomically(folder / name, "time_s,drive_V\n" + "".join(f"{t:.12g},{u:.9g}\n" for t, u in rows))
        period_s = line.repetition_period_s
        writer.writerow(
            {
                "file": name,
                "channel": line.channel,
                "excitation": line.excitation,
                "initial_state": line.initial_state,
                "repeats": line.repeats,
                "samples": line.drive_V.size,
                "sample_step_s": f"{line.step_s:.12g}",
                "repetition_period_s": "" if period_s is None else f"{period_s:.12g}",
                "purpose": line.purpose,
            }
        )
    write_atomically(folder / PLAN, plan.getvalue())
