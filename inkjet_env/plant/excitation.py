"""One recording as the plant sees it: the commanded drive, on nodes between the samples."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class Excitation:
    """A drive, how it was applied, and the nodes of the simulation: a recording without its measured signal.

    Parameters
    ----------
    channel : {"self_sensing", "strain_gauge", "displacement", "drive_monitor"}
        Sensor. The last is the voltage measured at the head, which shows the drive stage alone.
    initial_state : {"demagnetised", "periodic", "free"}
        State at the first sample: at rest on the virgin curve, in the steady state of the repeated drive, or unknown.
    step_s : float
        Sampling step, in seconds.
    drive_V : ndarray, shape (n,)
        Commanded drive in volts; linear between samples.
    order : int
        Position of the recording within the session: 1, 2, 3 …
    neighbour_V : ndarray, shape (n,), optional
        Drive of the neighbouring channel, in volts.
    substeps : int
        Nodes per sampling step; even, because the resonator advances by two nodes at a time.
    start : tuple of float
        Deflection relative to its rest position under the first drive, and scaled speed ``x' / ω0``, at the first
        sample, both in hysteretic volts; used if ``initial_state`` is ``"free"``.
    signal_range : tuple of float, optional
        Lowest and highest value measured, in the sensor's unit, if known: where the rails of a sensor that clips are.
    residual_lines_Hz : tuple of float
        Frequencies of the strongest lines in the base model's residuals of such recordings: where a hum may be.
    quasi_static : bool
        Whether a displacement is recorded too slowly to show the resonator, so that it is static as a strain gauge is.
    session : tuple of (int, float)
        Order of each recording of the session with a fast channel, and the mean square in V² of its speed ``x' / ω0``
        in hysteretic volts: what warms the head up to and including this recording. Empty outside a session.
    cache : dict
        Results that follow from the excitation alone, stored at their first use.
    """

    channel: str
    initial_state: str
    step_s: float
    drive_V: Real
    order: int = 1
    neighbour_V: Real | None = None
    substeps: int = 2
    start: tuple[float, float] = (0.0, 0.0)
    signal_range: tuple[float, float] | None = None
    residual_lines_Hz: tuple[float, ...] = ()
    quasi_static: bool = False
    session: tuple[tuple[int, float], ...] = ()
    cache: dict[Any, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if self.substeps < 2 or self.substeps % 2:
            raise ValueError(
                f"substeps must be an even number of nodes a sampling step, 2 or more; got {self.substeps}."
            )

    @property
    def samples(self) -> int:
        """Number of samples, n."""
        return self.drive_V.size

    @property
    def periodic(self) -> bool:
        """Whether the drive has been repeated: the sample after the last is the first."""
        return self.initial_state == "periodic"

    @property
    def fast(self) -> bool:
        """Whether the channel shows the resonator; a strain gauge is quasi-static."""
        return not self.quasi_static and self.channel in ("self_sensing", "displacement")

    @property
    def node_step_s(self) -> float:
        """Time between nodes, in seconds."""
        return self.step_s / self.substeps

    @property
    def nodes(self) -> int:
        """Number of nodes: one period without its end if periodic, otherwise up to the last sample."""
        return self.samples * self.substeps if self.periodic else (self.samples - 1) * self.substeps + 1

    @property
    def time_s(self) -> Real:
        """Times of the nodes from 0 s, shape (nodes,)."""
        return np.arange(self.nodes, dtype=np.float64) * np.float64(self.node_step_s)

    def refined(self, samples: Real) -> Real:
        """Values at the nodes, shape (nodes,), by linear interpolation of values at the samples, shape (n,)."""
        ends = np.append(samples, samples[0]) if self.periodic else samples
        fractions = np.arange(self.substeps) / self.substeps
        between = ends[:-1, None] + np.diff(ends)[:, None] * fractions
        return between.ravel() if self.periodic else np.append(between.ravel(), ends[-1])

    @property
    def drive_at_nodes_V(self) -> Real:
        """Commanded drive in volts at the nodes, shape (nodes,)."""
        if "drive" not in self.cache:
            self.cache["drive"] = self.refined(self.drive_V)
        drive: Real = self.cache["drive"]
        return drive

    def sampled(self, at_nodes: Real) -> Real:
        """Values at the samples, shape (n,), from values at the nodes, shape (nodes,)."""
        return at_nodes[:: self.substeps]
