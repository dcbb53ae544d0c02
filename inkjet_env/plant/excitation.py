"""One recording as the plant sees it: what was asked of the head, on nodes between the samples."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class Excitation:
    """A drive, how it was applied, and the nodes it is followed on: everything of a recording but what was measured.

    Parameters
    ----------
    channel : {"self_sensing", "strain_gauge", "displacement", "drive_monitor"}
        The last is the voltage measured at the head, which shows the drive stage alone.
    initial_state : {"demagnetised", "periodic", "free"}
    step_s : float
        Sampling step.
    drive_V : ndarray, shape (n,)
        What the generator was asked for; linear between samples.
    order : int
        When it was taken within the session.
    neighbour_V : ndarray, shape (n,), optional
        Drive of the neighbouring channel.
    substeps : int
        Nodes a sampling step: even, because the resonator goes over two nodes at a time.
    start : tuple of float
        Deflection, from where the first drive would hold it, and scaled speed ``x' / ω0``, in hysteretic volts, at the
        first sample; used where ``free``.
    largest_signal : float, optional
        Largest magnitude that was measured, in the sensor's unit, where that is known: a sensor that clips is scaled
        by it.
    residual_lines_Hz : tuple of float
        Frequencies of the strongest lines in what the base model leaves of recordings like this one: where a hum may
        be looked for.
    """

    channel: str
    initial_state: str
    step_s: float
    drive_V: Real
    order: int = 1
    neighbour_V: Real | None = None
    substeps: int = 2
    start: tuple[float, float] = (0.0, 0.0)
    largest_signal: float | None = None
    residual_lines_Hz: tuple[float, ...] = ()
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
        """Whether the drive had been repeating: the sample after the last is the first."""
        return self.initial_state == "periodic"

    @property
    def fast(self) -> bool:
        """Whether the resonator shows; a strain gauge is quasi-static."""
        return self.channel in ("self_sensing", "displacement")

    @property
    def node_step_s(self) -> float:
        """Time between nodes."""
        return self.step_s / self.substeps

    @property
    def nodes(self) -> int:
        """Number of nodes: one period without its end where periodic, else up to the last sample."""
        return self.samples * self.substeps if self.periodic else (self.samples - 1) * self.substeps + 1

    @property
    def time_s(self) -> Real:
        """Times of the nodes from 0 s, shape (nodes,)."""
        return np.arange(self.nodes, dtype=np.float64) * np.float64(self.node_step_s)

    def refined(self, samples: Real) -> Real:
        """Values at the samples, made linear between them: shape (n,) to (nodes,)."""
        ends = np.append(samples, samples[0]) if self.periodic else samples
        fractions = np.arange(self.substeps) / self.substeps
        between = ends[:-1, None] + np.diff(ends)[:, None] * fractions
        return between.ravel() if self.periodic else np.append(between.ravel(), ends[-1])

    @property
    def drive_at_nodes_V(self) -> Real:
        """The drive that was asked for at the nodes, shape (nodes,)."""
        if "drive" not in self.cache:
            self.cache["drive"] = self.refined(self.drive_V)
        drive: Real = self.cache["drive"]
        return drive

    def sampled(self, at_nodes: Real) -> Real:
        """Values at the samples from values at the nodes."""
        return at_nodes[:: self.substeps]
