"""Answers of the concealed rig to requests: a campaign continued by recordings that its plan did not hold."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.experiments.concealed_plant import RIG, import_rig
from inkjet_env.experiments.proof.campaign_files import check_campaign_only, pack

PROBE_BITS, PROBE_RANGE_V = 14, 200.0
"""Converter of the voltage at the head, where a campaign had no probe there and one is asked for."""


def continued_campaign(plant: Any, requests: Sequence[Mapping[str, Any]], name: str, rig: str = RIG) -> bytes:
    """Files of a concealed plant's campaign with the answers to requests after its last recording.

    The first recordings are those of the campaign, byte for byte; each answer has its own noise.

    Parameters
    ----------
    plant : object
        The concealed plant of `concealment.plant_of`.
    requests : sequence of dict
        In the order in which they were made: ``channel``, ``initial_state``, ``step_s``, ``drive_V``, ``neighbour_V``
        (None: at 0 V), ``repeats`` and ``drive_monitor``.
    name : str
        Opaque name of the campaign.
    rig : str
        Module of the concealed plant.
    """
    measurement = import_rig(f"{rig}.measurement").Measurement
    rows = list(plant.setup.rows)
    with_neighbour = any(row.neighbour_V is not None for row in rows)
    monitored = set[int]()
    for request in requests:
        drive = np.asarray(request["drive_V"], dtype=np.float64)
        neighbour = request["neighbour_V"]
        if neighbour is None and with_neighbour:
            neighbour = np.zeros(drive.size)
        first = len(rows) + 1
        condition = next(row.condition for row in reversed(rows) if row.channel == request["channel"])
        for k in range(request["repeats"]):
            rows.append(
                measurement(
                    request["channel"], "arbitrary", request["initial_state"], request["step_s"], drive,
                    None if neighbour is None else np.asarray(neighbour, dtype=np.float64), len(rows) + 1,
                    first if k else None, condition,
                )
            )  # fmt: skip
            if request["drive_monitor"]:
                monitored.add(len(rows))
    sensors, monitors = _recorded(plant, rows, monitored, rig)
    with tempfile.TemporaryDirectory(prefix="inkjet-conceal-") as scratch:
        folder = Path(scratch) / name
        import_rig(f"{rig}.writing").write_campaign(folder, name, rows, sensors, monitors)
        check_campaign_only(folder)
        return pack(folder)


def _recorded(plant: Any, rows: list[Any], monitored: set[int], rig: str) -> tuple[list[Any], list[Any]]:
    """Samples of all rows, and of the probe at the head (None: not there)."""
    module = import_rig(f"{rig}.plant")
    converters = import_rig(f"{rig}.converter")
    known = len(plant.setup.rows)
    base = [*plant.setup.base, *(module.trace(module.Plant(plant.plant.head), row) for row in rows[known:])]
    setup = replace(plant.setup, rows=rows, base=base)
    instruments = setup.instruments
    probe = instruments.monitor or converters.Converter(PROBE_RANGE_V, PROBE_BITS)
    with_probe = replace(instruments, monitor=probe)
    sensors, monitors = plant.recorded()
    for row in rows[known:]:
        now = module.trace(plant.plant, row)
        analogue = now.signal + setup.noise(row) + setup.by_chance(plant.plant, row, now)
        converter = instruments.converter[row.channel]
        largest = float(np.max(np.abs(analogue)))
        if largest > converter.range:  # whoever records turns the range up
            converter = replace(converter, range=converters.next_range(largest))
        sensors.append(converters.converted(analogue, converter))
        rng = np.random.default_rng([plant.case.seed, plant.case.number, 101, row.order])
        there = with_probe if row.order in monitored else instruments
        monitors.append(there.monitored_V(row, now.applied_V, rng))
    return sensors, monitors
