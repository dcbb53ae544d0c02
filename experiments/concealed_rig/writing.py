"""A campaign's folder, as section 4 of the contract describes it: written beside, then renamed."""

import json
import os
import shutil
from pathlib import Path

import numpy as np

from experiments.concealed_rig.measurement import CHANNELS, Measurement


def _text_of(columns: dict[str, np.ndarray]) -> str:
    lines = [",".join(columns)]
    lines += [",".join(f"{value:.10g}" for value in row) for row in zip(*columns.values(), strict=True)]
    return "\n".join(lines) + "\n"


def _resource(row: Measurement, columns: dict[str, np.ndarray]) -> dict[str, object]:
    return {
        "name": row.name,
        "path": f"{row.name}.csv",
        "format": "csv",
        "schema": {"fields": [{"name": name, "type": "number"} for name in columns]},
        "inkjet": {
            "channel": row.channel,
            "excitation": row.excitation,
            "initial_state": row.initial_state,
            "order": row.order,
            "repeat_of": None if row.repeat_of is None else f"r{row.repeat_of:03d}",
            "condition": row.condition,
        },
    }


def write_campaign(
    folder: Path, name: str, rows: list[Measurement], sensors: list[np.ndarray], monitors: list[np.ndarray | None]
) -> None:
    """Write a campaign.

    Parameters
    ----------
    folder : Path
        The campaign's folder; it must not be there yet, or be empty.
    name : str
        Written into the descriptor.
    rows : list of Measurement
    sensors : list of ndarray
        What the converter gave, one row a measurement.
    monitors : list of ndarray or None
        Voltage at the head, where it was measured.

    Raises
    ------
    ValueError
        Where the folder holds something.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(f"{folder} must be new or empty: a campaign is never written over something else.")
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    shutil.rmtree(beside, ignore_errors=True)
    beside.mkdir()
    resources = []
    for row, sensor, monitor in zip(rows, sensors, monitors, strict=True):
        columns = {"time_s": np.arange(sensor.size) * row.step_s, "drive_V": row.drive_V, CHANNELS[row.channel]: sensor}
        if monitor is not None:
            columns["drive_monitor_V"] = monitor
        if row.neighbour_V is not None:
            columns["neighbour_V"] = row.neighbour_V
        (beside / f"{row.name}.csv").write_text(_text_of(columns), encoding="utf-8")
        resources.append(_resource(row, columns))
    descriptor = {"name": name, "inkjet": {"format": "campaign/1"}, "resources": resources}
    (beside / "datapackage.json").write_text(json.dumps(descriptor, indent=1) + "\n", encoding="utf-8")
    if folder.exists():
        folder.rmdir()
    beside.rename(folder)
