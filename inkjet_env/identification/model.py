"""What is fitted: drives with how to weigh them, and the model of everything that they share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from inkjet_env.identification.basis import DriveBasis
from inkjet_env.identification.measurements import RepeatedMeasurement
from inkjet_env.identification.noise import NoiseModel
from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class Fitted:
    """One drive, its repeats' mean, and how to weigh it."""

    measurement: RepeatedMeasurement
    basis: DriveBasis
    noise: NoiseModel
    loudness: float = 1.0
    """How many times its noise the channel's residual is: it is weighed by that."""

    @property
    def samples(self) -> int:
        """Samples that enter the fit, repeats counted."""
        return (self.measurement.fitted - self.noise.lost) * len(self.measurement.signals)

    def whitened(self, columns: Real) -> Real:
        """The fitted rows, whitened, and weighed as so many repeats."""
        weight = math.sqrt(len(self.measurement.signals)) / self.loudness
        return self.noise.whitened(columns[: self.measurement.fitted]) * weight


@dataclass(frozen=True, eq=False)
class Model:
    """What the fit determines.

    Attributes
    ----------
    a0, a1 : float
    weights : ndarray, shape (d,)
        Coefficients of the branch law, lowest power (1) first, times the gain of the first channel.
    ratios : dict of str to float
        Gain of each channel over that of the first.
    offsets : dict of str to float
    """

    a0: float
    a1: float
    weights: Real
    ratios: Mapping[str, float]
    offsets: Mapping[str, float]

    def predicted(self, measurement: RepeatedMeasurement, basis: DriveBasis, noise: NoiseModel | None = None) -> Real:
        """Free-run signal at every sample, shape (n,).

        A free initial state is estimated from the recording itself, whitened by ``noise`` where given.
        """
        psi = basis.response(measurement.channel, self.a0, self.a1)
        signal = self.ratios[measurement.channel] * (psi @ self.weights) + self.offsets[measurement.channel]
        if has_free_state(measurement):
            states = basis.free_states(self.a0, self.a1)
            seen = measurement.fitted or measurement.drive_V.size  # what is held out of a recording tells nothing
            pair = np.column_stack([states, measurement.mean - signal])[:seen]
            pair = pair if noise is None else noise.whitened(pair)
            signal = signal + states @ np.linalg.lstsq(pair[:, :2], pair[:, 2], rcond=None)[0]
        return signal


def has_free_state(measurement: RepeatedMeasurement) -> bool:
    """Whether the resonator's initial state is a nuisance of this recording."""
    return measurement.initial_state == "free" and measurement.channel != "strain_gauge"


def channels_of(fitted: Sequence[Fitted]) -> tuple[str, ...]:
    """Channels in order: the first is the one whose gain the weights carry."""
    order = ("strain_gauge", "self_sensing", "displacement")
    present = {f.measurement.channel for f in fitted}
    return tuple(channel for channel in order if channel in present)
