"""Fitted quantities: drives with their weights, and the model of everything that they share."""

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
    """One drive with the mean of its repeats, its basis and its weight.

    Attributes
    ----------
    measurement : RepeatedMeasurement
        The drive and its repeats.
    basis : DriveBasis
        Powers of the branch law under the drive.
    noise : NoiseModel
        Noise of the channel, which whitens the signal.
    loudness : float
        Ratio of the channel's residual to its noise; the drive is weighted by its inverse.
    """

    measurement: RepeatedMeasurement
    basis: DriveBasis
    noise: NoiseModel
    loudness: float = 1.0

    @property
    def samples(self) -> int:
        """Number of samples that enter the fit, counting repeats."""
        return (self.measurement.fitted - self.noise.lost) * len(self.measurement.signals)

    def whitened(self, columns: Real) -> Real:
        """Whitened rows of the fitted samples, weighted by the number of repeats and the loudness."""
        weight = math.sqrt(len(self.measurement.signals)) / self.loudness
        return self.noise.whitened(columns[: self.measurement.fitted]) * weight


@dataclass(frozen=True, eq=False)
class Model:
    """Parameters that the fit determines.

    Attributes
    ----------
    a0, a1 : float
        Coefficients of the resonator, in 1/s² and 1/s.
    weights : ndarray, shape (d,)
        Coefficients of the branch law, lowest power (1) first, times the gain of the first channel.
    ratios : dict of str to float
        Gain of each channel over that of the first.
    offsets : dict of str to float
        Offset of each channel, in its unit.
    """

    a0: float
    a1: float
    weights: Real
    ratios: Mapping[str, float]
    offsets: Mapping[str, float]

    def predicted(self, measurement: RepeatedMeasurement, basis: DriveBasis, noise: NoiseModel | None = None) -> Real:
        """Free-run signal at every sample, in the channel's unit, shape (n,).

        A free initial state is estimated from the recording itself, whitened by ``noise`` if that is given.
        """
        psi = measurement.response(basis, self.a0, self.a1)
        signal = self.ratios[measurement.channel] * (psi @ self.weights) + self.offsets[measurement.channel]
        if has_free_state(measurement):
            states = basis.free_states(self.a0, self.a1)
            seen = measurement.fitted or measurement.drive_V.size  # a held-out end must not determine the state
            pair = np.column_stack([states, measurement.mean - signal])[:seen]
            pair = pair if noise is None else noise.whitened(pair)
            signal = signal + states @ np.linalg.lstsq(pair[:, :2], pair[:, 2], rcond=None)[0]
        return signal


def has_free_state(measurement: RepeatedMeasurement) -> bool:
    """Whether the resonator's initial state is a nuisance parameter of this recording."""
    return measurement.initial_state == "free" and measurement.fast


def channels_of(fitted: Sequence[Fitted]) -> tuple[str, ...]:
    """Channels in order; the gain of the first is a factor of the weights."""
    order = ("strain_gauge", "self_sensing", "displacement")
    present = {f.measurement.channel for f in fitted}
    return tuple(channel for channel in order if channel in present)
