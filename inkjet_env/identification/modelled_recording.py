"""A recording beside its simulation by models."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class ModelledRecording:
    """A recording beside the free-run simulations of models.

    Attributes
    ----------
    name, channel, unit : str
        Name and channel of the recording, and the unit of its signal.
    order : int
        Position of the recording within the session: 1, 2, 3 …
    step_s : float
        Sampling step in seconds.
    drive_V : ndarray, shape (n,)
        Drive in volts.
    measured : ndarray, shape (n,)
        Measured signal in ``unit``.
    modelled : mapping of str to ndarray, shape (n,)
        Simulated signal in ``unit``, by model: "base" is the model without effects, "augmented" that of a diagnosis.
    fitted : int
        Number of samples from the start that were used for fitting; the others were held out.
    noise_rms : float
        Root mean square of the noise in ``unit``; NaN where it is unknown.
    """

    name: str
    channel: str
    unit: str
    order: int
    step_s: float
    drive_V: Real
    measured: Real
    modelled: Mapping[str, Real]
    fitted: int
    noise_rms: float

    @property
    def time_s(self) -> Real:
        """Times in seconds from the first sample, shape (n,)."""
        return np.arange(self.measured.size, dtype=np.float64) * np.float64(self.step_s)

    @property
    def held_out(self) -> bool:
        """Whether any samples were withheld from every fit and choice."""
        return self.fitted < self.measured.size

    def residual(self, model: str = "base") -> Real:
        """Measured minus modelled, shape (n,), in ``unit``."""
        residual: Real = self.measured - self.modelled[model]
        return residual

    def rms(self, model: str = "base", held_out: bool | None = None) -> float:
        """Root mean square of the residual, in ``unit``.

        Parameters
        ----------
        model : str
            Key of ``modelled``.
        held_out : bool, optional
            Whether to use the samples that were held out or those that were fitted; NaN if there are none. Default:
            those that were held out, or all samples of a recording that was fitted whole.
        """
        unseen = self.held_out if held_out is None else held_out
        part = self.residual(model)[self.fitted :] if unseen else self.residual(model)[: self.fitted]
        return float(np.sqrt(np.mean(part**2))) if part.size else math.nan
