"""Result of an identification: a printhead, intervals, and every recording beside its simulation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from inkjet_env.estimate import Estimate
from inkjet_env.identification.degree import DegreeChoice
from inkjet_env.identification.modelled_recording import ModelledRecording
from inkjet_env.identification.noise import NoiseModel
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

BADLY_PREDICTED = 2.0
"""Ratio of residual to noise on held-out recordings above which one that misses `MUCH` of the signal is bad."""
MUCH = 0.3
"""Share of the signal of held-out recordings that a head must not leave unexplained."""


@dataclass(frozen=True, eq=False)
class Identification:
    """A printhead identified from a campaign; made by `identify`.

    Attributes
    ----------
    printhead : Printhead
        The identified head.
    dynamics : dict of str to Estimate
        ``a0, a1, b1`` in 1/s², 1/s and 1/s, with 90 % confidence intervals. NaN with an infinite interval if no
        recording shows the resonator: ``printhead`` is then a `QuasiStaticPrinthead`.
    gains : dict of str to Estimate
        Gain of each channel: ``b1`` of self-sensing in 1/s; of strain gauge and displacement (``b0/a0``) in their unit
        per hysteretic volt.
    offsets : dict of str to float
        Offset of each channel, in its unit.
    coefficient_covariance : ndarray, shape (degree, degree)
        Covariance of the branch law's coefficients, lowest power first.
    degree : DegreeChoice
        Error against degree on the strain gauge alone, as in the paper; on all recordings if there is none.
    joint_degree : DegreeChoice
        Error against degree on all recordings together.
    noise : dict
        Noise models by channel and sampling step in seconds.
    recordings : tuple of ModelledRecording
        Every recording of the modelled channels, sorted by name.
    misfit : dict of str to float
        Root mean square of the whitened residual of the fit of each channel; 1 is the noise.
    notes : tuple of str
        Caveats for the reader, in sentences.
    """

    printhead: Printhead
    dynamics: Mapping[str, Estimate]
    gains: Mapping[str, Estimate]
    offsets: Mapping[str, float]
    coefficient_covariance: Real
    degree: DegreeChoice
    joint_degree: DegreeChoice
    noise: Mapping[tuple[str, float], NoiseModel]
    recordings: tuple[ModelledRecording, ...]
    misfit: Mapping[str, float]
    notes: tuple[str, ...]

    @property
    def hysteresis_channel(self) -> str:
        """Channel that shows the hysteresis most directly."""
        return next(c for c in ("strain_gauge", "displacement", "self_sensing") if c in self.gains)

    @property
    def heldout(self) -> tuple[ModelledRecording, ...]:
        """Recordings with held-out samples: whole recordings, or their ends, that no fit has used."""
        return tuple(r for r in self.recordings if r.held_out)

    def unit(self, channel: str) -> str:
        """Unit of the signal of a channel: V or um."""
        return next(r.unit for r in self.recordings if r.channel == channel)

    def rms(self, channel: str, held_out: bool) -> tuple[float, float]:
        """RMS of a channel's residual and of its noise, in its unit, over held-out or over fitted recordings."""
        mine = [r for r in self.recordings if r.channel == channel and not math.isnan(r.rms(held_out=held_out))]
        return _pooled(r.rms(held_out=held_out) for r in mine), _pooled(r.noise_rms for r in mine)

    @property
    def warning(self) -> str | None:
        """Why the head must not be used, in a sentence: it predicts held-out recordings badly; None if it does not."""
        for channel in self.gains:
            (rms, noise), mine = self.rms(channel, held_out=True), [r for r in self.heldout if r.channel == channel]
            signal = _pooled(float(np.std(r.measured[r.fitted :])) for r in mine)
            if rms > BADLY_PREDICTED * noise and rms > MUCH * signal:
                return (
                    f"Do not use this head: on held-out recordings of {channel} its residual is {rms / noise:.3g} "
                    f"times the noise and {100 * rms / signal:.0f} % of the signal."
                )
        return None

    def fit_json(self) -> dict[str, Any]:
        """The entry "fit" of ``printhead.json``.

        Residual and noise at the top level are those of self-sensing, in volts; if only displacement was recorded, they
        are divided by its gain and in volts of hysteretic drive; if only a strain gauge was, they are its own. The
        values of each channel follow in its own unit. None means that nothing was held out, or an unknown noise.
        """
        channels: dict[str, dict[str, Any]] = {}
        for channel, gain in self.gains.items():
            heldout, noise_heldout = self.rms(channel, held_out=True)
            train, noise_train = self.rms(channel, held_out=False)
            noise = noise_train if math.isnan(noise_heldout) else noise_heldout
            channels[channel] = {
                "unit": self.unit(channel),
                "gain": vars(gain),
                "offset": self.offsets[channel],
                "noise_rms": None if math.isnan(noise) else noise,
                "heldout_rms": None if math.isnan(heldout) else heldout,
                "train_rms": None if math.isnan(train) else train,
                "residual_over_noise": self.misfit[channel],
            }
        main = next(c for c in ("self_sensing", "displacement", "strain_gauge") if c in self.gains)
        per_volt = 1.0 if self.unit(main) == "V" else abs(self.gains[main].value)
        fit: dict[str, Any] = {
            f"{name}_V": None if (rms := channels[main][name]) is None else rms / per_volt
            for name in ("noise_rms", "heldout_rms", "train_rms")
        }
        return fit | {
            "heldout": [r.name for r in self.heldout],
            "degree_by_flattening": self.joint_degree.by_flattening,
            "degree_by_strain_gauge": self.degree.by_flattening if "strain_gauge" in self.gains else None,
            "degree_by_held_out": self.degree.by_held_out,
            "channels": channels,
            "notes": list(self.notes),
        }

    def as_json(self) -> dict[str, Any]:
        """Content of ``printhead.json``."""
        intervals = {name: (estimate.low, estimate.high) for name, estimate in self.dynamics.items()}
        return self.printhead.as_json(intervals, self.fit_json())


def _pooled(values: Iterable[float]) -> float:
    """Root mean square of values; NaN if there are none."""
    squares = [value**2 for value in values]
    return math.sqrt(sum(squares) / len(squares)) if squares else math.nan
