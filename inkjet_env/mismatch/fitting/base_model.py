"""The base model fitted to a campaign, with the noise of its residuals: the starting point of every hypothesis."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from inkjet_env.identification import identify
from inkjet_env.identification.noise import NoiseModel
from inkjet_env.mismatch.fitting.base_parameters import Head, gains_and_offsets, in_convention
from inkjet_env.mismatch.fitting.dataset import ObservedRecording, finer, noise_seen
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign

DEGREE = 9
"""Least degree of the branch law: the base model explains all that it can before an effect is blamed."""
FAR_OFF = 0.7
"""Share of the fast recordings' variance. If the base model refitted from a given printhead leaves more unexplained,
that printhead was too far off to start from."""
MOST_SUBSTEPS = 16
"""Largest number of nodes per sampling step."""
NODES_A_PERIOD = 36
"""Least number of nodes per period of the resonance."""
MOST_ROUNDS = 10
"""Largest number of times that the base model is refitted from the end of its last fit."""


def base_model(
    campaign: Campaign,
    observed: Sequence[ObservedRecording],
    printhead: Printhead | None,
    held_out: Sequence[str] | None,
    progress: Callable[[str], None],
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

    Returns
    -------
    OutputErrorFit
        Its ``base`` is the fitted base model, its ``noise`` the noise of that model's residuals.

    Raises
    ------
    ValueError
        No base model can be identified from the recordings, or the printhead belongs to another head.
    """
    given = printhead is not None
    if printhead is None:
        # The gauge alone decides: where an effect is missing, the fast recordings would ask for ever higher degrees.
        rule = "strain_gauge" if any(o.channel == "strain_gauge" for o in observed) else "flattening"
        found = identify(campaign, degree_rule=rule, held_out=held_out, progress=progress)
        gains = {channel: gain.value for channel, gain in found.gains.items()}
        offsets, printhead, otherwise = dict(found.offsets), found.printhead, dict(found.noise)
    else:
        gains, offsets = gains_and_offsets(observed, printhead)
        otherwise = {}
    channels = {o.channel for o in observed}
    for channel in sorted(channels - set(offsets)):
        offsets[channel], gains[channel] = 0.0, 1.0
    coefficients = (0.0,) * max(0, DEGREE + 1 - len(printhead.coefficients)) + printhead.coefficients
    head = Head(replace(printhead, coefficients=coefficients), gains, offsets)
    coarsest_s = max((o.excitation.step_s for o in observed if o.excitation.fast), default=0.0)
    substeps = 2 * max(1, min(MOST_SUBSTEPS // 2, math.ceil(NODES_A_PERIOD * printhead.frequency_Hz * coarsest_s / 2)))
    joint = _settled(finer(observed, substeps), head, otherwise)
    if given and _unexplained(joint) > FAR_OFF:
        raise ValueError(
            f"the given printhead, with a resonance at {with_prefix(printhead.frequency_Hz, 'Hz', 3)}, explains almost "
            "nothing of these recordings, even after a refit. Give the printhead of these recordings, or none: it is "
            "then identified."
        )
    return joint


def _settled(
    observed: Sequence[ObservedRecording], head: Head, otherwise: Mapping[tuple[str, float], NoiseModel]
) -> OutputErrorFit:
    """A joint fit whose noise comes from its own base model's residuals, with the law's swing set by convention."""
    signals = {o.name: head.plant().signal(o.excitation) for o in observed}
    noise = noise_seen(observed, {o.name: o.measured - signals[o.name] for o in observed}, otherwise)
    joint = OutputErrorFit(observed, noise, head)
    for _ in range(MOST_ROUNDS):
        before = joint.base.nll
        joint = OutputErrorFit(observed, noise, in_convention(joint.base.head))
        if before - joint.base.nll < 0.5:
            break
    modelled = joint.modelled(joint.base)
    noise = noise_seen(observed, {o.name: o.measured - modelled[o.name] for o in observed}, otherwise)
    return OutputErrorFit(observed, noise, joint.base.head)


def _unexplained(joint: OutputErrorFit) -> float:
    """Share of the driven fast recordings' variance that the base model leaves unexplained, their mean."""
    moved = [o for o in joint.seen if o.excitation.fast and not o.still]
    modelled = joint.modelled(joint.base)
    residuals = sum(
        float(np.var(o.measured - modelled[o.name])) / max(float(np.var(o.measured)), 1e-300) for o in moved
    )
    return residuals / max(len(moved), 1)
