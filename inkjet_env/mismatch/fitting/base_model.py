"""The base model fitted to a campaign, with the noise of its residuals: the starting point of every hypothesis."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from inkjet_env.identification import identify
from inkjet_env.identification.noise import NoiseModel
from inkjet_env.mismatch.fitting.base_parameters import Head, gains_and_offsets, in_convention
from inkjet_env.mismatch.fitting.campaign_noise import noise_seen
from inkjet_env.mismatch.fitting.dataset import ObservedRecording, finer
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.fitting.rounding import coarse_notes, without_rounding
from inkjet_env.mismatch.settings import DiagnosisSettings, FittingSettings
from inkjet_env.plant.recorded_motion import session_of
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead, QuasiStaticPrinthead
from inkjet_env.recordings import Campaign


def base_model(
    campaign: Campaign,
    observed: Sequence[ObservedRecording],
    printhead: Printhead | None,
    held_out: Sequence[str] | None,
    progress: Callable[[str], None],
    settings: DiagnosisSettings,
) -> OutputErrorFit:
    """The base model fitted to the recordings together with their noise.

    Parameters
    ----------
    campaign : Campaign
        Recordings from which the printhead is identified if none is given.
    observed : sequence of ObservedRecording
        The same recordings with conditions, held-out samples and excitations.
    printhead : Printhead, optional
        Where the fit starts; identified from the campaign unless given.
    held_out : sequence of str, optional
        Names of the held-out recordings, as in `identification.identify`.
    progress : callable
        Called with a short text that says what is being done.
    settings : DiagnosisSettings
        Settings of the diagnosis.

    Returns
    -------
    OutputErrorFit
        Its ``base`` is the fitted base model, its ``noise`` the noise of that model's residuals. If no recording shows
        the resonator and no printhead with dynamics is given, the base model is the hysteresis with gains and offsets:
        the resonator of its head is then a placeholder, which no result may contain.

    Raises
    ------
    ValueError
        No base model can be identified from the recordings, the printhead belongs to another head, or it has no
        dynamics and the recordings need them.
    """
    given = printhead is not None
    if printhead is None:
        # The gauge alone decides: where an effect is missing, the fast recordings would ask for ever higher degrees.
        rule = "strain_gauge" if any(o.channel == "strain_gauge" for o in observed) else "flattening"
        found = identify(campaign, degree_rule=rule, held_out=held_out, progress=progress)
        gains = {channel: gain.value for channel, gain in found.gains.items()}
        offsets, printhead, otherwise = dict(found.offsets), found.printhead, dict(found.noise)
        observed, printhead = _static_if_unknown(observed, printhead)
    else:
        observed, printhead = _static_if_unknown(observed, printhead)
        gains, offsets = gains_and_offsets(observed, printhead)
        otherwise = {}
    channels = {o.channel for o in observed}
    for channel in sorted(channels - set(offsets)):
        offsets[channel], gains[channel] = 0.0, 1.0
    coefficients = (0.0,) * max(
        0, settings.fitting.law_degree + 1 - len(printhead.coefficients)
    ) + printhead.coefficients
    head = Head(replace(printhead, coefficients=coefficients), gains, offsets)
    coarsest_s = max((o.excitation.step_s for o in observed if o.excitation.fast), default=0.0)
    substeps = substeps_for(printhead.frequency_Hz, coarsest_s, settings.fitting)
    session = session_of(head.printhead, [o.excitation for o in observed if o.channel != "drive_monitor"])
    observed = [replace(o, excitation=replace(o.excitation, session=session)) for o in observed]
    joint = _settled(finer(observed, substeps), head, otherwise, settings)
    if given and _unexplained(joint) > settings.fitting.poor_start_share:
        raise ValueError(
            f"the given printhead, with a resonance at {with_prefix(printhead.frequency_Hz, 'Hz', 3)}, explains almost "
            "nothing of these recordings, even after a refit. Give the printhead of these recordings, or none: it is "
            "then identified."
        )
    return joint


def _static_if_unknown(
    observed: Sequence[ObservedRecording], printhead: Printhead
) -> tuple[Sequence[ObservedRecording], Printhead]:
    """Recordings and head unchanged; if the head has no dynamics, static recordings and a placeholder resonator."""
    if not isinstance(printhead, QuasiStaticPrinthead):
        return observed, printhead
    if any(o.channel == "self_sensing" and not o.still for o in observed):
        return observed, printhead.with_dynamics()
    observed = [replace(o, excitation=replace(o.excitation, quasi_static=True, cache={})) for o in observed]
    return observed, printhead.with_placeholder(0.1 / min(o.excitation.step_s for o in observed))


def substeps_for(frequency_Hz: float, step_s: float, settings: FittingSettings) -> int:
    """Number of simulation nodes per sampling step of a recording of a head with this resonance."""
    wanted = math.ceil(settings.nodes_per_period * frequency_Hz * step_s / 2)
    return 2 * max(1, min(settings.most_substeps // 2, wanted))


def _settled(
    observed: Sequence[ObservedRecording],
    head: Head,
    otherwise: Mapping[tuple[str, float], NoiseModel],
    settings: DiagnosisSettings,
) -> OutputErrorFit:
    """A joint fit whose noise comes from its own base model's residuals, with the law's swing set by convention."""
    signals = {o.name: head.plant().signal(o.excitation) for o in observed}
    residuals = {o.name: o.measured - signals[o.name] for o in observed}
    noise = noise_seen(observed, residuals, otherwise, settings.fitting)
    joint = OutputErrorFit(observed, noise, head, settings, plain=in_convention(head))
    for _ in range(settings.fitting.most_base_fits):
        before = joint.base.nll
        joint = joint.anew(head=in_convention(joint.base.head))
        if before - joint.base.nll < settings.fitting.settled_gain:
            break
    joint = _with_own_noise(joint, otherwise)
    for _ in range(settings.fitting.rounding_rounds):
        modelled = joint.modelled(joint.base)
        observed = without_rounding(joint.observed, modelled, joint.noise, settings.fitting)
        if all(o.rounding is None for o in observed):
            return joint
        joint = _with_own_noise(joint.anew(observed=observed, head=joint.base.head), otherwise)
    notes = (*joint.noise.notes, *coarse_notes(joint.observed, joint.noise, settings.fitting))
    return joint.anew(noise=replace(joint.noise, notes=notes), base=joint.base, around=joint.around)


def _with_own_noise(joint: OutputErrorFit, otherwise: Mapping[tuple[str, float], NoiseModel]) -> OutputErrorFit:
    """The joint fit with the noise of its base model's residuals."""
    modelled = joint.modelled(joint.base)
    residuals = {o.name: o.measured - modelled[o.name] for o in joint.observed}
    return joint.anew(
        noise=noise_seen(joint.observed, residuals, otherwise, joint.settings.fitting), head=joint.base.head
    )


def _unexplained(joint: OutputErrorFit) -> float:
    """Share of the driven fast recordings' variance that the base model leaves unexplained, their mean."""
    moved = [o for o in joint.seen if o.excitation.fast and not o.still]
    modelled = joint.modelled(joint.base)
    residuals = sum(
        float(np.var(o.measured - modelled[o.name])) / max(float(np.var(o.measured)), 1e-300) for o in moved
    )
    return residuals / max(len(moved), 1)
