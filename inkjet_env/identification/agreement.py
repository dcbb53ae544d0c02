"""Whether recordings are still those of a given printhead: residuals beyond noise, as shares of the signals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from inkjet_env.identification.evaluate import Evaluation
from inkjet_env.identification.measurements import measurements, noise_of
from inkjet_env.recordings import Campaign

TOLERANCE = 0.02
"""Share of a recording's signal below which a residual beyond noise does not count: a head is known no better."""
STANDARD_DEVIATIONS = 4.0
"""Of the noise's power in a recording, by which a residual must exceed that power before it counts."""
MOST_LAGS = 65_536
"""Largest number of lags, in samples, over which noise is taken to be correlated: long recordings fit into memory."""
ITS_OWN = 3.0
"""Multiple of the residual that the head left in recordings held out from its own identification, which counts neither:
that of one recording may be so much larger than their root mean square."""


@dataclass(frozen=True)
class Agreement:
    """How well a given printhead predicts one recording.

    Attributes
    ----------
    name, unit : str
        Name of the recording and unit of its sensor.
    rms, output_rms : float
        Root mean square of the residual, and of the signal about its offset, in that unit.
    noise_rms : float
        Standard deviation of the noise in that unit, from repeats and recordings at rest; NaN if none show it.
    differs : bool
        Whether the residual is significantly larger than the noise, than `TOLERANCE` of the signal and than what the
        head left when it was identified.
    """

    name: str
    unit: str
    rms: float
    output_rms: float
    noise_rms: float
    differs: bool

    @property
    def beyond(self) -> float:
        """Residual beyond noise, root mean square, in the unit of the sensor."""
        return math.sqrt(max(self.rms**2 - (0.0 if math.isnan(self.noise_rms) else self.noise_rms) ** 2, 0.0))

    @property
    def share(self) -> float:
        """`beyond` as a share of the signal; infinite if there is no signal."""
        return self.beyond / self.output_rms if self.output_rms else math.inf * bool(self.beyond)


def agreements(
    campaign: Campaign, evaluations: Sequence[Evaluation], its_own: Mapping[str, float] | None = None
) -> tuple[Agreement, ...]:
    """The agreement of every recording, in the campaign's order.

    Parameters
    ----------
    campaign : Campaign
        The recordings.
    evaluations : sequence of Evaluation
        Their simulation, from `evaluate`.
    its_own : mapping of str to float, optional
        By channel, the residual beyond noise that the head left in its own recordings, in volts or micrometres.
    """
    gathered = measurements(campaign, held_out=[])
    models, keys = noise_of(gathered), {name: m.noise_key for m in gathered for name in m.names}
    found = []
    for one in evaluations:
        recording = one.recording
        scale = 1e3 if recording.unit == "nm" else 1.0  # noise and residuals of a displacement are in micrometres
        noise, doubt = math.nan, 0.0
        if (model := models.get(keys[recording.name])) is not None:
            noise = scale * model.rms
            samples = recording.sensor.size
            covariance = model.autocovariance(min(samples, MOST_LAGS))
            correlated = covariance[0] ** 2 + 2 * float(np.sum(covariance[1:] ** 2))
            doubt = STANDARD_DEVIATIONS * noise**2 * math.sqrt(2 * correlated / covariance[0] ** 2 / samples)
        power = one.rms**2 - (0.0 if math.isnan(noise) else noise**2) - doubt
        allowed = max(TOLERANCE * one.output_rms, ITS_OWN * scale * (its_own or {}).get(recording.channel, 0.0))
        differs = power > allowed**2
        found.append(Agreement(recording.name, recording.unit, one.rms, one.output_rms, noise, differs))
    return tuple(found)


def agreement_sentence(found: Sequence[Agreement]) -> str:
    """Whether it is still the same head, and which recordings differ, in words."""
    differing = sorted((one for one in found if one.differs), key=lambda one: -one.share)
    of = f"{len(found)} recording{'s' if len(found) > 1 else ''}"
    unknown = all(math.isnan(one.noise_rms) for one in found)
    beyond = "(no repeats show the noise, so all of it counts)" if unknown else "beyond noise"
    if not differing:
        return (
            f"Yes, this is still the same head: it predicts {'all ' if len(found) > 1 else ''}{of} to within "
            f"{100 * TOLERANCE:g} % of the signal {beyond}, or as well as those that it was identified from."
        )
    named = ", ".join(f"{one.name} ({_percent(one.share)})" for one in differing[:3])
    more = f" and {len(differing) - 3} more" if len(differing) > 3 else ""
    return (
        f"No, this is not the same head, or it has changed: {len(differing)} of {of} differ by more than "
        f"{100 * TOLERANCE:g} % of the signal {beyond}: {named}{more}."
    )


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 1 else f"{100 * share:.0f} %"
