"""One line of the measuring plan: a drive, on a channel, from an initial state."""

from dataclasses import dataclass, field

import numpy as np

CHANNELS = {"self_sensing": "sensor_V", "strain_gauge": "sensor_V", "displacement": "displacement_nm"}
INITIAL_STATES = ("demagnetised", "periodic")


@dataclass(frozen=True)
class Measurement:
    """What is asked of the rig in one recording.

    Parameters
    ----------
    channel, excitation, initial_state : str
        As section 4 of the contract names them.
    step_s : float
        Sampling interval.
    drive_V : ndarray, shape (n,)
        What the generator is asked for, linear between the samples; periodic recordings hold one period.
    neighbour_V : ndarray, shape (n,), optional
    order : int
        1, 2, 3 … within the campaign.
    repeat_of : int, optional
        Order of the measurement that it repeats.
    condition : dict
        Temperature and back pressure as they are written down.
    """

    channel: str
    excitation: str
    initial_state: str
    step_s: float
    drive_V: np.ndarray
    neighbour_V: np.ndarray | None = None
    order: int = 0
    repeat_of: int | None = None
    condition: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.channel not in CHANNELS:
            raise ValueError(f"channel must be one of {', '.join(CHANNELS)}; got {self.channel!r}.")
        if self.initial_state not in INITIAL_STATES:
            raise ValueError(f"initial_state must be one of {', '.join(INITIAL_STATES)}; got {self.initial_state!r}.")
        if self.drive_V.ndim != 1 or self.drive_V.size < 2 or not np.all(np.isfinite(self.drive_V)):
            raise ValueError("drive_V must be one finite row of two samples or more.")
        if not self.step_s > 0:
            raise ValueError(f"step_s must be a positive time; got {self.step_s}.")

    @property
    def periodic(self) -> bool:
        """Whether one period of the steady state is recorded."""
        return self.initial_state == "periodic"

    @property
    def name(self) -> str:
        """r001, r002 … in order of recording."""
        return f"r{self.order:03d}"
