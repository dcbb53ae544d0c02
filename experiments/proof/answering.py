"""The concealed plant as a rig: it records whatever is asked for, beyond the plan of its campaign."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.experiments.concealed_plant import RIG, import_rig
from inkjet_env.experiments.proof.campaign_files import check_campaign_only, pack
from inkjet_env.printhead import DriverLimits
from inkjet_env.recordings import Recording
from inkjet_env.rig import Request
from inkjet_env.typing import Real

PROBE_BITS, PROBE_RANGE_V = 14, 200.0
"""Converter of the voltage at the head, where a campaign had no probe there and one is asked for."""


class ConcealedRig:
    """A concealed plant with the instruments of its campaign; its sensors' noise goes on, the head's effects too.

    Parameters
    ----------
    plant : object
        The concealed plant of `concealment.plant_of`.
    rig : str
        Module of the concealed plant.
    """

    def __init__(self, plant: Any, rig: str = RIG) -> None:
        self.plant = plant
        self._stages = import_rig(f"{rig}.plant")
        self._converters = import_rig(f"{rig}.converter")
        self._measurement = import_rig(f"{rig}.measurement").Measurement

    def limits(self) -> DriverLimits:
        """What the driver can do: the whole of the range of waveforms."""
        return DriverLimits()

    def record(self, request: Request, order: int) -> Recording:
        """Take one recording; see `inkjet_env.rig.Rig`."""
        sensor, monitor = self.sampled(self.row(request, order), request.drive_monitor)
        return request.answered(sensor, "nm" if request.channel == "displacement" else "V", order, monitor)

    def row(self, request: Request, order: int, repeat_of: int | None = None) -> Any:
        """A request as a line of the concealed plant's measuring plan."""
        return self._measurement(
            request.channel, "arbitrary", request.initial_state, request.step_s, request.drive_V, request.neighbour_V,
            order, repeat_of, self.plant.setup.rows[-1].condition,
        )  # fmt: skip

    def sampled(self, row: Any, monitored: bool) -> tuple[Real, Real | None]:
        """Samples of the sensor as its converter gives them, and of the voltage at the head, if there is a probe."""
        setup, plant = self.plant.setup, self.plant.plant
        base = self._stages.trace(self._stages.Plant(plant.head), row)
        # The noise of the row takes its place from its order, and its size from the plant without what is concealed.
        alone = replace(setup, rows=[row], base=[base] * row.order)
        now = self._stages.trace(plant, row)
        analogue = now.signal + alone.noise(row) + alone.by_chance(plant, row, now)
        converter = setup.instruments.converter[row.channel]
        largest = float(np.max(np.abs(analogue)))
        if largest > converter.range:  # whoever records turns the range up
            converter = replace(converter, range=self._converters.next_range(largest))
        instruments = setup.instruments
        if monitored and instruments.monitor is None:
            instruments = replace(instruments, monitor=self._converters.Converter(PROBE_RANGE_V, PROBE_BITS))
        rng = np.random.default_rng([self.plant.case.seed, self.plant.case.number, 101, row.order])
        monitor = instruments.monitored_V(row, now.applied_V, rng)
        return self._converters.converted(analogue, converter), monitor


def requests_of(asked: Sequence[Mapping[str, Any]], first_order: int) -> list[tuple[Request, int, int | None]]:
    """Requests, orders and what each repeats, of entries as a blind answer's ``requests`` holds them."""
    found: list[tuple[Request, int, int | None]] = []
    for one in asked:
        first = first_order + len(found)
        neighbour = one["neighbour_V"]
        request = Request(
            "request", one["channel"], one["initial_state"], one["step_s"],
            np.asarray(one["drive_V"], dtype=np.float64), bool(one["drive_monitor"]),
            neighbour_V=None if neighbour is None else np.asarray(neighbour, dtype=np.float64),
        )  # fmt: skip
        found += [(request, first + k, first if k else None) for k in range(one["repeats"])]
    return found


def continued_campaign(plant: Any, asked: Sequence[Mapping[str, Any]], name: str, rig: str = RIG) -> bytes:
    """Files of a concealed plant's campaign with the answers to requests after its last recording.

    The first recordings are those of the campaign, byte for byte; each answer has its own noise.

    Parameters
    ----------
    plant : object
        The concealed plant of `concealment.plant_of`.
    asked : sequence of dict
        In the order in which they were made: ``channel``, ``initial_state``, ``step_s``, ``drive_V``, ``neighbour_V``
        (None: at 0 V), ``repeats`` and ``drive_monitor``.
    name : str
        Opaque name of the campaign.
    rig : str
        Module of the concealed plant.
    """
    instruments = ConcealedRig(plant, rig)
    rows = list(plant.setup.rows)
    sensors, monitors = plant.recorded()
    for request, order, repeat_of in requests_of(asked, len(rows) + 1):
        row = instruments.row(request, order, repeat_of)
        sensor, monitor = instruments.sampled(row, request.drive_monitor)
        rows.append(row)
        sensors.append(sensor)
        monitors.append(monitor)
    with tempfile.TemporaryDirectory(prefix="inkjet-conceal-") as scratch:
        folder = Path(scratch) / name
        import_rig(f"{rig}.writing").write_campaign(folder, name, rows, sensors, monitors)
        check_campaign_only(folder)
        return pack(folder)
