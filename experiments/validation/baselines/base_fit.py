"""The common basis of the diagnosis's baselines: a base model, recordings put aside, and the error measure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from inkjet_env.mismatch import Diagnosis
from inkjet_env.mismatch.fitting.base_model import substeps_for
from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.mismatch.fitting.campaign_noise import Noise, noise_seen
from inkjet_env.mismatch.fitting.dataset import ObservedRecording, finer, observe
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.settings import DiagnosisSettings
from inkjet_env.plant import Plant
from inkjet_env.recordings import Campaign
from inkjet_env.typing import Real

DEGREE = 8
"""Degree of the branch law of all baselines, that of the published head."""
ASIDE_EVERY = 4
"""One in this many of a channel's fitted conditions is put aside for model selection."""


def base_fit(campaign: Campaign, head: Head) -> OutputErrorFit:
    """The base model of degree `DEGREE`, fitted to a campaign from a nearby head; noise as in the diagnosis."""
    law = head.printhead.branch_law
    x = np.linspace(0, 1, 1001)
    powers = x[:, None] ** np.arange(1, DEGREE + 1)
    coefficients = np.linalg.lstsq(powers, law.Q(x), rcond=None)[0]
    printhead = replace(head.printhead, coefficients=(*(float(c) for c in coefficients[::-1]), 0.0))
    head = replace(head, printhead=printhead)
    observed = tuple(o for o in observe(campaign) if o.channel != "drive_monitor")  # which is not a sensor of the head
    coarsest_s = max(o.excitation.step_s for o in observed if o.excitation.fast)
    settings = DiagnosisSettings()
    observed = finer(observed, substeps_for(head.printhead.frequency_Hz, coarsest_s, settings.fitting))

    def noise(signals: Mapping[str, Real]) -> Noise:
        residuals = {o.name: o.measured - signals[o.name] for o in observed}
        return noise_seen(observed, residuals, {}, settings.fitting)

    first = OutputErrorFit(
        observed, noise({o.name: head.plant().signal(o.excitation) for o in observed}), head, settings
    )
    return first.anew(noise=noise(first.modelled(first.base)), head=first.base.head)


def base_of(found: Diagnosis, campaign: Campaign) -> Head:
    """The base model of a diagnosis, with gains and offsets recovered from its signals."""
    plant = Plant(found.base_printhead, {"self_sensing": found.base_printhead.b1})
    excitations = {o.name: o.excitation for o in observe(campaign)}
    gains, offsets = {}, {}
    for channel in sorted({recording.channel for recording in found.recordings}):
        mine = [recording for recording in found.recordings if recording.channel == channel]
        shown = np.concatenate([plant.motion(excitations[r.name].drive_at_nodes_V, excitations[r.name]) for r in mine])
        size = float(np.abs(shown).max())
        table = np.column_stack([shown / size, np.ones(shown.size)])
        gain, offset = np.linalg.lstsq(table, np.concatenate([r.modelled["base"] for r in mine]), rcond=None)[0]
        gains[channel], offsets[channel] = float(gain) / size, float(offset)
    return Head(found.base_printhead, gains, offsets)


def over_noise(
    joint: OutputErrorFit, modelled: Mapping[str, Real], chosen: Sequence[ObservedRecording] | None = None
) -> float:
    """RMS of a model's whitened residuals over the held-out samples, or over the fitted samples of chosen recordings.

    NaN if the model has no signal.
    """
    parts = []
    for o in joint.observed if chosen is None else chosen:
        parts.append(joint.whitened(o, o.measured - modelled[o.name])[o.rows(held_out=chosen is None)])
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def put_aside(
    joint: OutputErrorFit, channel: str, fold: int = 1
) -> tuple[list[ObservedRecording], list[ObservedRecording]]:
    """The fitted recordings of a channel, split by whole conditions into those to fit and those for model selection."""
    mine = [o for o in joint.seen if o.channel == channel and not o.still]
    conditions = sorted({o.condition for o in mine})
    aside = set(conditions[fold::ASIDE_EVERY])
    return [o for o in mine if o.condition not in aside], [o for o in mine if o.condition in aside]
