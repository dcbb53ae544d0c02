"""What a diagnosis says: verdict, effects with intervals, where the mismatch is, the fit before and after."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from inkjet_env.estimate import Estimate
from inkjet_env.identification.modelled_recording import ModelledRecording
from inkjet_env.mismatch.design.next_experiment import NextExperiment
from inkjet_env.mismatch.localization.location import Location
from inkjet_env.plant import Effect
from inkjet_env.plant.wording import SENSOR_UNIT
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

VERDICTS = ("none", "named", "set", "unknown")


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """An effect that was found.

    Attributes
    ----------
    effect : Effect
    sentence : str
        With its values, in plain words.
    delta_nll : float
        By how much it lowers the negative log-likelihood of the fitted recordings beyond the rest of the model.
    p_value : float
        That chance alone would give any effect of the catalogue so much.
    parameters : dict of str to Estimate
        Those that the recordings tell, with 90 % intervals.
    values : dict of str to float
        Of all parameters, those too that do nothing beside the others: what a simulation needs.
    unit : str
        Of the sensor's signal, in which some parameters are.
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


@dataclass(frozen=True, eq=False)
class HypothesisScore:
    """How well one hypothesis explains what the base model leaves.

    Attributes
    ----------
    ids : tuple of str
        Of the effects that are on together.
    gain : float
        Of the log-likelihood of the fitted recordings over the base model's.
    predicted, predicted_error : float
        The same for recordings left out, condition by condition, and its standard error.
    share : float
        Of the mismatch that the best hypothesis of all explains, how much this one does: 0 … 1.
    cosine : float
        Of its signature with the winner's, base parameters projected out; NaN where there is no single winner.
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
class Correction:
    """A flexible model of what no effect explains: it corrects, it does not explain.

    Attributes
    ----------
    share : float
        Of the mean square that the verdict's model leaves on held-out recordings beyond noise, how much it removes.
    gain, gain_error : float
        Of the log-likelihood of held-out recordings.
    modelled : dict of str to ndarray
        What it adds to the augmented model's signal, by recording.
    """

    share: float
    gain: float
    gain_error: float
    modelled: Mapping[str, Real]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Where a campaign and the base model differ, and why; made by `diagnose`.

    Attributes
    ----------
    campaign : str
    verdict : {"none", "named", "set", "unknown"}
    headline : str
        The verdict in plain words.
    effects : tuple of Named
    candidates : tuple of tuple of str
        Groups of effects that these recordings cannot tell apart.
    location : Location
    recordings : tuple of ModelledRecording
        With the signals of the "base" and of the "augmented" model.
    closure : float
        Share of the base model's held-out mean square beyond noise that the augmented model removes; NaN where there
        is none to remove.
    left_over : float
        Share of the mismatch in the fitted recordings that is surely left beyond noise; 0 where none surely is.
    attributions : tuple of Attribution
        Best first.
    untestable : dict of str to str
        Effects that these recordings cannot show: why not, and which would.
    next_experiment : NextExperiment or None
    correction : Correction or None
    printhead : Printhead
        The base part of the augmented model; the base model where the verdict is unknown.
    gains, offsets : dict of str to float
    base_printhead : Printhead
        Without any effect.
    dynamics : dict of str to Estimate
        ``a0, a1, b1`` of the model that the verdict stands by: the base model where it is unknown.
    notes : tuple of str
    seconds : float
    stages : dict of str to float
        Where the time went, in seconds.
    """

    campaign: str
    verdict: str
    headline: str
    effects: tuple[NamedEffect, ...]
    candidates: tuple[tuple[str, ...], ...]
    location: Location
    recordings: tuple[ModelledRecording, ...]
    closure: float
    left_over: float
    attributions: tuple[HypothesisScore, ...]
    untestable: Mapping[str, str]
    next_experiment: NextExperiment | None
    correction: Correction | None
    printhead: Printhead
    gains: Mapping[str, float]
    offsets: Mapping[str, float]
    base_printhead: Printhead
    dynamics: Mapping[str, Estimate]
    notes: tuple[str, ...]
    seconds: float
    stages: Mapping[str, float]

    def heldout_rms(self, which: str) -> float:
        """Pooled over the main channel's held-out samples, in volts (hysteretic ones of a displacement); NaN of none.

        ``which``: "base", "augmented" or "noise".
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
        """The fast channel that the figures are of."""
        present = {r.channel for r in self.recordings}
        return next(c for c in ("self_sensing", "displacement", "strain_gauge") if c in present)

    def as_json(self, drive_csv: str | None = None) -> dict[str, Any]:
        """The verdict as ``diagnosis/1``; ``drive_csv`` names the file of the next experiment's drive."""
        return {
            "format": "diagnosis/1",
            "verdict": self.verdict,
            "headline": self.headline,
            "effects": [
                {
                    "id": e.effect.id,
                    "stage": e.effect.stage,
                    "sentence": e.sentence,
                    "evidence": {"delta_nll": e.delta_nll, "p_value": e.p_value},
                    "parameters": {
                        name: {
                            "value": _finite(v.value),
                            "low": _finite(v.low),
                            "high": _finite(v.high),
                            "unit": e.unit_of(name),
                        }
                        for name, v in e.parameters.items()
                    },
                }
                for e in self.effects
            ],
            "candidates": [list(group) for group in self.candidates],
            "location": {
                "recordings": list(self.location.recordings),
                "time_s": [list(pair) for pair in self.location.time_s],
                "frequency_Hz": [list(pair) for pair in self.location.frequency_Hz],
                "drive_V": [list(pair) for pair in self.location.drive_V],
                "sentence": self.location.sentence,
            },
            "fit": {
                "noise_rms_V": _finite(self.heldout_rms("noise")),
                "base_heldout_rms_V": _finite(self.heldout_rms("base")),
                "augmented_heldout_rms_V": _finite(self.heldout_rms("augmented")),
                "closure": _finite(self.closure),
                "left_over": self.left_over,
                "heldout": [r.name for r in self.recordings if r.held_out],
            },
            "next_experiment": None
            if self.next_experiment is None
            else {"sentence": self.next_experiment.sentence, "drive_csv": drive_csv},
            "attributions": [
                {
                    "ids": list(a.ids),
                    "delta_nll": a.gain,
                    "foretold": _finite(a.predicted),
                    "foretold_error": _finite(a.predicted_error),
                    "share": _finite(a.share),
                    "cosine": _finite(a.cosine),
                }
                for a in self.attributions
            ],
            "untestable": dict(self.untestable),
            "notes": list(self.notes),
            "seconds": self.seconds,
        }

    def augmented_json(self) -> dict[str, Any]:
        """The augmented model as ``printhead/1``, effects with their intervals; the base model where none was found."""
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
            of_another = ("augmented_heldout_rms_V", "closure")  # the model that came closest has no name, so no file
            return self.base_printhead.as_json(dynamics, {k: v for k, v in fit.items() if k not in of_another})
        values = tuple((e.effect, dict(e.values)) for e in self.effects)
        intervals = {e.effect.id: {name: (p.low, p.high) for name, p in e.parameters.items()} for e in self.effects}
        last = max(r.order for r in self.recordings)
        augmented = AugmentedPrinthead(self.printhead, values, self.gains, last)
        return augmented.as_json(dynamics, fit, effect_intervals=intervals)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
