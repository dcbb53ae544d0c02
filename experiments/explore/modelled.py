"""A campaign beside its simulation by one head: residuals, noise, and whether it is the same head."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from inkjet_env.experiments.explore.heads import NamedHead
from inkjet_env.identification import Evaluation, evaluate
from inkjet_env.identification.agreement import agreement_sentence, agreements
from inkjet_env.recordings import Campaign


@dataclass(frozen=True, eq=False)
class Modelled:
    """A campaign beside its simulation by one head.

    Attributes
    ----------
    evaluations : dict of str to Evaluation
        By recording.
    noise_rms : dict of str to float
        Standard deviation of the noise by recording, in its unit; NaN where nothing shows it.
    differs : dict of str to bool
        Whether the residual is more than noise and tolerance.
    sentence : str
        Whether it is the same head.
    clearest : str
        Name of the recording that differs most, or shows the head best if none differs.
    """

    evaluations: Mapping[str, Evaluation]
    noise_rms: Mapping[str, float]
    differs: Mapping[str, bool]
    sentence: str
    clearest: str


def modelled_by(head: NamedHead, campaign: Campaign) -> Modelled:
    """Simulate the recordings of a campaign with a head."""
    found, _ = evaluate(campaign, head.head, gains_of(head))
    agreed = agreements(campaign, found, {})
    clearest = max(agreed, key=lambda one: (one.differs, one.share * (one.output_rms > 3 * one.noise_rms)))
    return Modelled(
        {one.recording.name: one for one in found},
        {one.name: one.noise_rms for one in agreed},
        {one.name: one.differs for one in agreed},
        agreement_sentence(agreed),
        clearest.name,
    )


def gains_of(head: NamedHead) -> dict[str, float]:
    """Gains of the channels from which a head was identified, in their units per hysteretic volt."""
    fit = head.data.get("fit")
    channels: Mapping[str, Any] = (fit.get("channels") or {}) if isinstance(fit, dict) else {}
    found = {}
    for channel, entry in channels.items():
        value = (entry.get("gain") or {}).get("value")
        if isinstance(value, (int, float)):
            found[channel] = float(value)
    return found
