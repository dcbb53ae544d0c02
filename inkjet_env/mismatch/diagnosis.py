"""The result of a diagnosis: verdict, effects with intervals, location of the mismatch, fit before and after."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inkjet_env.estimate import Estimate
from inkjet_env.identification.modelled_recording import ModelledRecording
from inkjet_env.mismatch.design.next_experiment import NextExperiment
from inkjet_env.mismatch.localization.location import Location
from inkjet_env.mismatch.remainder_words import remainder_sentence
from inkjet_env.mismatch.selection.remainder_fit import FittedRemainder
from inkjet_env.mismatch.settings import DiagnosisSettings
from inkjet_env.plant import Effect
from inkjet_env.plant.head_ensemble import HeadEnsemble
from inkjet_env.plant.wording import SENSOR_UNIT
from inkjet_env.printhead import Printhead

VERDICTS = ("none", "named", "set", "unknown")
"""No effect is missing; the missing effects are named; several cannot be distinguished; the cause is unknown."""


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """An effect that was found.

    Attributes
    ----------
    effect : Effect
        The effect itself.
    sentence : str
        The effect with its values, in plain words.
    delta_nll : float
        Amount by which it lowers the negative log-likelihood of the fitted recordings beyond the rest of the model.
    p_value : float
        Probability that noise alone would give any effect of the catalogue as much evidence.
    parameters : dict of str to Estimate
        Identifiable parameters with 90 % intervals, in the units of `unit_of`.
    values : dict of str to float
        Values of all parameters, as a simulation needs them, including those without influence beside the others.
    unit : str
        Unit of the sensor's signal, in which some parameters are given.
    """

    effect: Effect
    sentence: str
    delta_nll: float
    p_value: float
    parameters: Mapping[str, Estimate]
    values: Mapping[str, float]
    unit: str = "V"

    def unit_of(self, parameter: str) -> str:
        """Unit of one of the effect's parameters."""
        unit = next(p.unit for p in self.effect.parameters if p.name == parameter)
        return self.unit if unit == SENSOR_UNIT else unit

    def as_json(self) -> dict[str, Any]:
        """The effect as in a ``diagnosis/1``."""
        return {
            "id": self.effect.id,
            "stage": self.effect.stage,
            "sentence": self.sentence,
            "evidence": {"delta_nll": self.delta_nll, "p_value": self.p_value},
            "parameters": {
                name: {
                    "value": _finite(v.value),
                    "low": _finite(v.low),
                    "high": _finite(v.high),
                    "unit": self.unit_of(name),
                }
                for name, v in self.parameters.items()
            },
        }


@dataclass(frozen=True, eq=False)
class HypothesisScore:
    """How well one hypothesis explains the base model's residuals.

    Attributes
    ----------
    ids : tuple of str
        Ids of the effects that are on together.
    gain : float
        Gain in log-likelihood of the fitted recordings over the base model.
    predicted, predicted_error : float
        Gain in log-likelihood of left-out conditions (cross-validation), and its standard error.
    share : float
        Gain relative to that of the best hypothesis, 0 … 1.
    cosine : float
        Cosine of its signature with the winner's, base parameters projected out; NaN if there is no winner.
    description : str
        The effects with their values, in words.
    """

    ids: tuple[str, ...]
    gain: float
    predicted: float
    predicted_error: float
    share: float
    cosine: float
    description: str


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Where a campaign and the base model differ, and why; made by `diagnose`.

    Attributes
    ----------
    campaign : str
        Name of the campaign.
    verdict : {"none", "named", "set", "unknown"}
        Whether effects are missing and which; see `VERDICTS`.
    headline : str
        The verdict in plain words.
    effects : tuple of NamedEffect
        Missing effects that were found; empty if the verdict is "none" or "unknown".
    minor : tuple of NamedEffect
        Effects beside them of overwhelming evidence, which explain little; the augmented model has them too.
    candidates : tuple of tuple of str
        Groups of effects that these recordings cannot distinguish.
    location : Location
        Where the recordings differ from the base model.
    recordings : tuple of ModelledRecording
        All recordings with the signals of the "base" and of the "augmented" model.
    closure : float
        Share of the base model's held-out mean square beyond noise that the augmented model removes; NaN if there is
        nothing to remove.
    left_over : float
        Share of the mismatch in the fitted recordings that remains significantly beyond noise; 0 if none does.
    held_out_left_over : float
        The same of the held-out recordings, by which the verdict is judged; NaN if they show no mismatch, or if an
        effect that changes between recordings explains them only once they are fitted.
    overlap : float
        What several effects explain each alone, in sum, over what they explain together, less 1; 0 of one.
    p_value : float
        Probability that noise alone would look as much like an effect as these recordings do: score test over all
        effects that have a law. Where nothing is found and the largest score is not beyond any doubt about the noise,
        the probability by its scatter between conditions if that is larger.
    attributions : tuple of HypothesisScore
        Best hypotheses that were compared, best first.
    untestable : dict of str to str
        By id, the effects that these recordings cannot show: why not, and which recordings would.
    next_experiments : tuple of NextExperiment
        Recordings that would separate the candidates, the most informative first; empty unless there are several.
    remainder : FittedRemainder or None
        Discrepancy model of what the named effects leave, or the base model if the verdict is "unknown"; None unless it
        predicts held-out recordings better. It corrects without explaining.
    printhead : Printhead
        The base part of the augmented model; the base model if the verdict is unknown. A `QuasiStaticPrinthead` if no
        recording shows the resonator and no head with dynamics was given.
    gains, offsets : dict of str to float
        By channel: signal for a `Plant.motion` of 1, and signal at rest, in the channel's unit.
    base_printhead : Printhead
        The base model, fitted without any effect.
    dynamics : dict of str to Estimate
        ``a0`` in 1/s², ``a1`` and ``b1`` in 1/s, of the same model as ``printhead``, with 90 % intervals.
    probabilities : dict of str to float
        By id of the effect that explains most of the mismatch, "nothing" and "none of these" among them; they sum to 1.
        Calibrated over heads like those of the proof's version 1; see `mismatch.probabilities`.
    notes : tuple of str
        Sentences about the noise, the fits and what was not checked.
    seconds : float
        Duration of the diagnosis.
    stages : dict of str to float
        Duration of each step, in seconds.
    settings : DiagnosisSettings
        Settings that it was made with.
    ensemble : HeadEnsemble or None
        Heads that the recordings leave possible: parameters drawn within their covariance, candidates that cannot be
        distinguished by their probabilities, the remainder on and off; heads of the base model if the corrected one
        predicts held-out recordings no better. None if the dynamics are unknown or no such head can be simulated.
    plugins : dict of str to dict of str to str
        Place, code (SHA-256) and package of each ``effect ID`` that was tried and is not of the catalogue.
    """

    campaign: str
    verdict: str
    headline: str
    effects: tuple[NamedEffect, ...]
    minor: tuple[NamedEffect, ...]
    candidates: tuple[tuple[str, ...], ...]
    location: Location
    recordings: tuple[ModelledRecording, ...]
    closure: float
    left_over: float
    held_out_left_over: float
    overlap: float
    p_value: float
    attributions: tuple[HypothesisScore, ...]
    untestable: Mapping[str, str]
    next_experiments: tuple[NextExperiment, ...]
    remainder: FittedRemainder | None
    printhead: Printhead
    gains: Mapping[str, float]
    offsets: Mapping[str, float]
    base_printhead: Printhead
    dynamics: Mapping[str, Estimate]
    probabilities: Mapping[str, float]
    notes: tuple[str, ...]
    seconds: float
    stages: Mapping[str, float]
    settings: DiagnosisSettings = field(default_factory=DiagnosisSettings)
    plugins: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    ensemble: HeadEnsemble | None = None

    def heldout_rms(self, which: str) -> float:
        """RMS over the main channel's held-out samples, in volts; NaN if nothing is held out.

        A displacement is given in hysteretic volts, a strain gauge in its own.

        Parameters
        ----------
        which : {"base", "augmented", "with_remainder", "noise"}
            Residuals of the base model, of the augmented model or of the model with the remainder, or the noise.
        """
        mine = [r for r in self.recordings if r.held_out and r.channel == self.main_channel]
        if not mine:
            return math.nan
        rows = [r.measured.size - r.fitted for r in mine]
        sizes = [r.noise_rms if which == "noise" else r.rms(which, held_out=True) for r in mine]
        per_volt = 1.0 if mine[0].unit == "V" else abs(self.gains[self.main_channel])
        return float(np.sqrt(np.average(np.square(sizes), weights=rows))) / per_volt

    @property
    def main_channel(self) -> str:
        """The channel that the figures refer to: self-sensing, else displacement, else the strain gauge."""
        present = {r.channel for r in self.recordings}
        return next(c for c in ("self_sensing", "displacement", "strain_gauge") if c in present)

    @property
    def next_experiment(self) -> NextExperiment | None:
        """The most informative of the next experiments; None without any."""
        return self.next_experiments[0] if self.next_experiments else None

    def as_json(self, drives: Sequence[str | None] = ()) -> dict[str, Any]:
        """The verdict as ``diagnosis/1``; ``drives`` names the files with the drives of the next experiments."""
        asked = [
            one.as_json(name)
            for one, name in itertools.zip_longest(self.next_experiments, drives[: len(self.next_experiments)])
        ]
        return {
            "format": "diagnosis/1",
            "verdict": self.verdict,
            "headline": self.headline,
            "effects": [e.as_json() for e in self.effects],
            "minor": [e.as_json() for e in self.minor],
            "candidates": [list(group) for group in self.candidates],
            "probabilities": dict(self.probabilities),
            "location": {
                "recordings": list(self.location.recordings),
                "time_s": [list(pair) for pair in self.location.time_s],
                "frequency_Hz": [list(pair) for pair in self.location.frequency_Hz],
                "drive_V": [list(pair) for pair in self.location.drive_V],
                "sentence": self.location.sentence,
                "by_recording": {
                    name: {"time_s": [list(pair) for pair in times], "frequency_Hz": [list(pair) for pair in bands]}
                    for name, (times, bands) in self.location.by_recording.items()
                },
            },
            "fit": {
                "noise_rms_V": _finite(self.heldout_rms("noise")),
                "base_heldout_rms_V": _finite(self.heldout_rms("base")),
                "augmented_heldout_rms_V": _finite(self.heldout_rms("augmented")),
                "closure": _finite(self.closure),
                "left_over": self.left_over,
                "heldout_left_over": _finite(self.held_out_left_over),
                "overlap": self.overlap,
                "p_value": self.p_value,
                "heldout": [r.name for r in self.recordings if r.held_out],
            },
            "next_experiment": asked[0] if asked else None,
            "further_experiments": asked[1:],
            "remainder": self._remainder_json(),
            "attributions": [
                {
                    "ids": list(a.ids),
                    "delta_nll": a.gain,
                    "predicted": _finite(a.predicted),
                    "predicted_error": _finite(a.predicted_error),
                    "share": _finite(a.share),
                    "cosine": _finite(a.cosine),
                }
                for a in self.attributions
            ],
            "untestable": dict(self.untestable),
            "notes": list(self.notes),
            "seconds": self.seconds,
            **({"plugins": self.plugins} if self.plugins else {}),
        }

    @property
    def carrier(self) -> str:
        """The model that carries the remainder: "base" if the verdict is "unknown", else "augmented"."""
        return "base" if self.verdict == "unknown" else "augmented"

    @property
    def remainder_sentence(self) -> str | None:
        """What the remainder does, in plain words; None if there is none."""
        if self.remainder is None:
            return None
        channels = tuple(self.remainder.remainder.channels)
        return remainder_sentence(self.recordings, channels, self.carrier, self.remainder.share)

    def _remainder_json(self) -> dict[str, Any] | None:
        if self.remainder is None:
            return None
        return {
            "sentence": self.remainder_sentence,
            "channels": list(self.remainder.remainder.channels),
            "heldout_rms_V": _finite(self.heldout_rms("with_remainder")),
            "augmented_heldout_rms_V": _finite(self.heldout_rms(self.carrier)),
            "share": self.remainder.share,
            "delta_nll": self.remainder.gain,
            "delta_nll_error": self.remainder.gain_error,
            "features": self.remainder.remainder.size,
        }

    def augmented_json(self) -> dict[str, Any]:
        """The corrected model as ``printhead/1``: effects with their intervals, the remainder and the ensemble, if any.

        It is the base model, with the remainder if there is one, if no effect was found.
        """
        ensemble = {} if self.ensemble is None else {"ensemble": self.ensemble.as_json()}
        return self._corrected_json() | ensemble

    def _corrected_json(self) -> dict[str, Any]:
        from inkjet_env.plant.augmented import AugmentedPrinthead

        units = {r.channel: r.unit for r in self.recordings}
        channels = {
            channel: {"unit": units[channel], "gain": {"value": gain}, "offset": self.offsets.get(channel, 0.0)}
            for channel, gain in self.gains.items()
            if channel in units
        }
        fit = self.as_json()["fit"] | {"channels": channels}
        dynamics = {name: (estimate.low, estimate.high) for name, estimate in self.dynamics.items()}
        if not self.effects:
            # the model that came closest has no name, so no file
            of_another = ("augmented_heldout_rms_V", "closure", "heldout_left_over")
            base = self.base_printhead.as_json(dynamics, {k: v for k, v in fit.items() if k not in of_another})
            return base if self.remainder is None else base | {"remainder": self.remainder.remainder.as_json()}
        all_effects = (*self.effects, *self.minor)
        values = tuple((e.effect, dict(e.values)) for e in all_effects)
        intervals = {e.effect.id: {name: (p.low, p.high) for name, p in e.parameters.items()} for e in all_effects}
        last = max(r.order for r in self.recordings)
        augmented = AugmentedPrinthead(
            self.printhead, values, self.gains, last, None if self.remainder is None else self.remainder.remainder
        )
        return augmented.as_json(dynamics, fit, effect_intervals=intervals)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
