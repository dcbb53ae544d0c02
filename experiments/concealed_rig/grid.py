"""The times at which the plant computes: steps of the integrator between the samples, and their midpoints."""

from dataclasses import dataclass
from math import ceil

import numpy as np


@dataclass(frozen=True)
class Grid:
    """Steps of the integrator in one recording.

    A periodic recording is one period: after its last sample the drive goes in a straight line to the first one.

    Parameters
    ----------
    samples : int
    sample_s : float
        Sampling interval.
    substeps : int
        Steps of the integrator in a sampling interval.
    periodic : bool
    """

    samples: int
    sample_s: float
    substeps: int
    periodic: bool

    @property
    def step_s(self) -> float:
        """Step of the integrator."""
        return self.sample_s / self.substeps

    @property
    def half_s(self) -> float:
        """Distance of the points at which the drive is known: half a step."""
        return self.step_s / 2

    @property
    def steps(self) -> int:
        """Number of steps in the recording, or in its period."""
        return (self.samples if self.periodic else self.samples - 1) * self.substeps

    def halves(self, sampled: np.ndarray) -> np.ndarray:
        """A sampled drive, shape (n,), at every half step, shape (2·steps + 1,), linear between the samples."""
        per = 2 * self.substeps
        nodes = np.append(sampled, sampled[0]) if self.periodic else sampled
        rise = np.diff(nodes)[:, None] * (np.arange(per) / per)
        return np.append((nodes[:-1, None] + rise).ravel(), nodes[-1])

    def at_samples(self, stepped: np.ndarray) -> np.ndarray:
        """Of values at the steps, shape (steps + 1,), those at the samples, shape (n,)."""
        return stepped[:: self.substeps][: self.samples]

    @property
    def step_times_s(self) -> np.ndarray:
        """Times of the steps, shape (steps + 1,)."""
        return np.arange(self.steps + 1) * self.step_s


def grid_of(samples: int, sample_s: float, periodic: bool, fastest_Hz: float, per_period: int = 160) -> Grid:
    """Grid with at least `per_period` steps in a period of the fastest motion; `fastest_Hz` 0 is quasi-static."""
    if samples < 2 or not sample_s > 0:
        raise ValueError(f"A recording needs two samples and a positive interval; got {samples} and {sample_s} s.")
    substeps = max(1, ceil(sample_s * fastest_Hz * per_period - 1e-9))
    return Grid(samples, sample_s, substeps, periodic)
