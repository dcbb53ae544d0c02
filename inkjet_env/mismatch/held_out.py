"""What recordings that no fit has seen say of the base model and of the effects found."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.identification.modelled_recording import ModelledRecording
from inkjet_env.mismatch.evidence import unexplained_share
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.selection.discrepancy_regression import DiscrepancyRegression
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, base_hypothesis
from inkjet_env.mismatch.settings import VerdictSettings


def closure_of(recordings: Sequence[ModelledRecording], settings: VerdictSettings) -> float:
    """Closure over the held-out recordings of all channels, each in units of its noise.

    It is the share of the base model's mean square beyond noise that the augmented model removes; NaN if there is
    nothing significant to remove.
    """
    before = after = samples = 0.0
    for r in recordings:
        rows = r.measured.size - r.fitted
        if rows and r.noise_rms > 0:
            before += rows * (r.rms("base", held_out=True) / r.noise_rms) ** 2
            after += rows * (r.rms("augmented", held_out=True) / r.noise_rms) ** 2
            samples += rows
    least = settings.least_excess * samples + settings.excess_standard_deviations * math.sqrt(2 * samples)
    if not samples or before - samples < least:
        return math.nan
    return (before - after) / (before - samples)


def held_out_left_over(base: Hypothesis, chosen: Hypothesis) -> float:
    """Share of the mismatch in held-out recordings that the chosen hypothesis surely leaves; NaN if they show none.

    Both are sums of squares of whitened residuals beyond those of fitted recordings of the same noise, so that the
    doubt about the noise's level cancels. What chance may leave is taken off.

    Parameters
    ----------
    base, chosen : Hypothesis
        Base model without random effects, and the chosen hypothesis.
    """
    joint, standard_deviations = chosen.joint, chosen.joint.settings.verdict.held_out_standard_deviations
    left = mismatch = doubt = 0.0
    of_the_head = [o for o in joint.observed if o.channel != "drive_monitor"]
    for key in sorted({o.noise_key for o in of_the_head}):
        mine = [o for o in of_the_head if o.noise_key == key]
        seen, after, before = (
            np.concatenate([h.fit.residuals[o.name][o.rows(held_out=held_out)] for o in mine])
            for h, held_out in ((chosen, False), (chosen, True), (base, True))
        )
        if not seen.any() or not after.size:  # fitted to the last digit, they tell nothing of the noise
            continue
        usual = float(seen @ seen) / seen.size
        left += float(after @ after) / usual - after.size
        mismatch += float(before @ before) / usual - after.size
        tail = max(joint.noise.tail(o) for o in mine)
        doubt += tail * 2 * after.size * (1 + after.size / seen.size)
    sure = standard_deviations * math.sqrt(doubt)
    if mismatch <= sure:
        return math.nan
    return min(max(left - sure, 0.0) / mismatch, 1.0)


def confirmed(base: Hypothesis, chosen: Hypothesis) -> bool:
    """Whether the held-out recordings move from the base model as the effects foretell, by more than half.

    The share ``Σ r d / Σ d²`` of the foretold changes ``d`` that the base model's residuals ``r`` show is 1 if the
    effects are right and 0 if there are none, whatever the noise's level, which the closure needs. It counts less two
    standard deviations.
    """
    joint, settings = chosen.joint, chosen.joint.settings.verdict
    shown = foretold = doubt = 0.0
    for o in joint.observed:
        if o.fitted or o.channel == "drive_monitor":
            continue
        before, after = base.fit.residuals[o.name], chosen.fit.residuals[o.name]
        change = before - after
        shown += float(before @ change)
        foretold += float(change @ change)
        doubt += float(change @ change) * float(after @ after) / after.size
    return shown - settings.held_out_standard_deviations * math.sqrt(doubt) >= settings.least_closure * foretold > 0


def only_held_out_differ(joint: OutputErrorFit, chosen: Hypothesis, discrepancy: DiscrepancyRegression) -> bool:
    """Whether a hypothesis may explain the fitted recordings alone, and leaves a mismatch in those held out.

    Effects that change between recordings may leave one, since nothing fitted says what they are there.
    """
    base, settings = base_hypothesis(joint), joint.settings.verdict
    if not chosen.ids:
        return True
    if any(effect.depends_on_order for effect in chosen.fit.active.effects):
        return False
    explained = unexplained_share(base, chosen, discrepancy) <= settings.left_over
    return explained and held_out_left_over(base, chosen) > settings.left_over
