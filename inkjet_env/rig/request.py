"""What a lab's instruments must be able to do: take one recording that is asked for, and state their limits."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from inkjet_env.printhead import DriverLimits, check_name
from inkjet_env.printhead.hysteresis import INITIAL_STATES
from inkjet_env.printhead.sampled import check_samples
from inkjet_env.recordings import Recording
from inkjet_env.recordings.recording import CHANNELS
from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class Request:
    """A recording that is asked for.

    Parameters
    ----------
    name : str
        Name of the recording, valid as a file name.
    channel : {"self_sensing", "strain_gauge", "displacement"}
        Sensor to record.
    initial_state : {"periodic", "demagnetised"}
        ``periodic``: repeat the drive, the sample after the last being the first, until it has settled, and record one
        repetition. ``demagnetised``: demagnetise the ceramic, let the head come to rest, and apply the drive once.
    step_s : float
        Sampling step of drive and sensor, in seconds.
    drive_V : ndarray, shape (n,)
        Drive at the samples in volts, linear between them.
    drive_monitor : bool
        Whether to record the voltage at the head too.
    excitation : str
        Kind of drive, a label for people.
    repeat_of : str, optional
        Name of the recording of which this is a repeat.
    purpose : str
        What it is for, in words.
    neighbour_V : ndarray, shape (n,), optional
        Drive of the neighbouring channel in volts; None: it stays at 0 V.
    """

    name: str
    channel: str
    initial_state: str
    step_s: float
    drive_V: Real = field(repr=False)
    drive_monitor: bool = False
    excitation: str = "arbitrary"
    repeat_of: str | None = None
    purpose: str = ""
    neighbour_V: Real | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        check_name("channel", self.channel, CHANNELS)
        check_name("initial_state", self.initial_state, INITIAL_STATES)
        _, drive = check_samples(self.step_s * np.arange(np.size(self.drive_V)), self.drive_V)
        object.__setattr__(self, "drive_V", drive)
        if self.neighbour_V is not None:
            _, neighbour = check_samples(self.time_s, self.neighbour_V)
            object.__setattr__(self, "neighbour_V", neighbour)

    @property
    def time_s(self) -> Real:
        """Times of the samples in seconds from 0 s, shape (n,)."""
        return np.asarray(self.step_s * np.arange(self.drive_V.size), dtype=np.float64)

    def answered(self, sensor: Real, unit: str, order: int, drive_monitor_V: Real | None = None) -> Recording:
        """The recording, from its samples.

        Parameters
        ----------
        sensor : ndarray, shape (n,)
            Signal of the sensor at the samples, in ``unit``.
        unit : {"V", "um", "nm"}
            Its unit.
        order : int
            Position of the recording within the session: 1, 2, 3 …
        drive_monitor_V : ndarray, shape (n,), optional
            Voltage measured at the head, in volts.

        Raises
        ------
        ValueError
            The samples are not as many as those of the drive, or not finite.
        """
        return Recording(
            self.name, self.time_s, self.drive_V, sensor, unit, self.channel, self.excitation, self.initial_state,
            order, self.repeat_of, {}, drive_monitor_V, self.neighbour_V,
        )  # fmt: skip


class Rig(Protocol):
    """Instruments around a head: a generator or a controller that drives it, and what records its sensors."""

    def record(self, request: Request, order: int) -> Recording:
        """Take one recording.

        Parameters
        ----------
        request : Request
            What to record; `Request.answered` makes the recording from its samples.
        order : int
            Position of the recording within the session: 1, 2, 3 …
        """

    def limits(self) -> DriverLimits:
        """What the driver can do; no waveform that is proposed asks for more."""
