"""A recording beside what models make of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class ModelledRecording:
    """A recording beside what models make of it, in free run.

    Attributes
    ----------
    name, channel, unit : str
        Of the recording; ``unit`` is that of its signal.
    order : int
        When it was taken within the session: 1, 2, 3 …
    step_s : float
        Sampling step in seconds.
    drive_V : ndarray, shape (n,)
        Drive in volts.
    measured : ndarray, shape (n,)
        Signal in ``unit``.
    modelled : mapping of str to ndarray, shape (n,)
        Signal in ``unit`` by model: "base" is the model without effects, "augmented" the one of a diagnosis.
    fitted : int
        Samples from the start that were used for fitting; the others were held out.
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
        """Times in seconds from the first sample on, shape (n,)."""
        return np.arange(self.measured.size, dtype=np.float64) * np.float64(self.step_s)

    @property
    def held_out(self) -> bool:
        """Whether any of it was kept from every fit and choice."""
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
            Which of ``modelled``.
        held_out : bool, optional
            Over the samples that were held out, or over those that were fitted; NaN where there are none. Unless given:
            over what was held out, or over all of a recording that was fitted whole.
        """
        unseen = self.held_out if held_out is None else held_out
        part = self.residual(model)[self.fitted :] if unseen else self.residual(model)[: self.fitted]
        return float(np.sqrt(np.mean(part**2))) if part.size else math.nan
