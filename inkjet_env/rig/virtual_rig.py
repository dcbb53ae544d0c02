"""A rig that answers requests by simulation, in place of a head on a bench."""

from __future__ import annotations

import numpy as np

from inkjet_env.plant import Plant
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import DriverLimits, Printhead
from inkjet_env.recordings import Recording
from inkjet_env.rig.answer import excitation_of
from inkjet_env.rig.battery import DriveLine, default_battery, displacement_battery
from inkjet_env.rig.record import Bench
from inkjet_env.rig.request import Request
from inkjet_env.typing import Real

MONITOR_NOISE = 5e-4
"""Standard deviation of the voltage measured at the head, as a share of the largest drive."""
ROOM = 2.5
"""Ranges of the instruments over what the default battery needs."""


class VirtualRig:
    """Virtual instruments around a head with known true parameters.

    Parameters
    ----------
    head : Printhead or AugmentedPrinthead
        The head that is recorded. Random effects of it contribute nothing.
    seed : int
        Seed of the noise; the same request at the same position in the session is answered with the same samples.
    snr_dB : float
        Signal-to-noise ratio of each channel's largest recording of the default battery, in dB.
    limits : DriverLimits, optional
        What the driver can do; by default everything.
    """

    def __init__(
        self,
        head: Printhead | AugmentedPrinthead,
        seed: int = 0,
        snr_dB: float = 45.0,
        limits: DriverLimits | None = None,
    ) -> None:
        self.head, self.seed, self.snr_dB = head, seed, snr_dB
        self._limits = limits or DriverLimits()
        self._benches: dict[str, Bench] = {}

    def limits(self) -> DriverLimits:
        """What the driver can do."""
        return self._limits

    def record(self, request: Request, order: int) -> Recording:
        """Take one recording; its noise is that of the channel's largest one of the default battery.

        Raises
        ------
        ValueError
            It asks for a drive of the neighbouring channel, which this rig has not.
        """
        if request.neighbour_V is not None:
            raise ValueError(
                f"{request.name} asks for a drive of the neighbouring channel, which the virtual rig has not. Have it "
                "recorded on the head, through the session's folders: leave out --rig."
            )
        bench = self._bench(request.channel)
        line = DriveLine(
            request.name, request.channel, request.excitation, request.initial_state, request.step_s, request.drive_V,
            request.purpose,
        )  # fmt: skip
        rng = np.random.default_rng([self.seed, order])
        sensor = bench.recorded(bench.signal(line, order), line, rng)
        monitor_V = None
        if request.drive_monitor:
            largest_V = float(np.abs(line.drive_V).max()) or 1.0
            monitor_V = self._at_head_V(line, order) + MONITOR_NOISE * largest_V * rng.standard_normal(sensor.size)
        return request.answered(sensor, bench.unit, order, monitor_V)

    def _bench(self, channel: str) -> Bench:
        if channel not in self._benches:
            frequency_Hz = self.head.frequency_Hz
            battery = (*default_battery(frequency_Hz), *displacement_battery(frequency_Hz))
            mine = [line for line in battery if line.channel == channel]
            self._benches[channel] = Bench.set_up(self.head, channel, mine, snr_dB=self.snr_dB, room=ROOM)[0]
        return self._benches[channel]

    def _at_head_V(self, line: DriveLine, order: int) -> Real:
        """Voltage at the head, at the samples."""
        if not isinstance(self.head, AugmentedPrinthead):
            return line.drive_V
        excitation = excitation_of(self.head, line, order)
        plant = Plant(self.head.printhead, effects=self.head.effects)
        return excitation.sampled(plant.at_ceramic_V(excitation))
