"""Whether held-out recordings that were predicted badly are explained once they are fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.fitting.spikes import without_spikes
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, attribute, base_hypothesis, settled
from inkjet_env.mismatch.selection.score_test import signatures
from inkjet_env.mismatch.settings import VerdictSettings
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.typing import Real


def held_out_misfits(joint: OutputErrorFit, chosen: Hypothesis) -> tuple[str, ...]:
    """Held-out recordings that a hypothesis does not explain to their noise, even when it is fitted to them too.

    An effect that no fitted recording shows is never looked for. If the hypothesis predicted a held-out recording badly
    only because the fitted recordings barely determine its parameters there, it explains it once it is fitted.

    Parameters
    ----------
    joint : OutputErrorFit
        Recordings with their held-out samples, noise and base model.
    chosen : Hypothesis
        The hypothesis, which explains the fitted recordings.

    Returns
    -------
    tuple of str
        Names of the recordings, largest excess first.
    """
    refitted, found, settings = _fitted_to_everything(joint, chosen), {}, joint.settings.verdict
    of_the_head = [o for o in joint.observed if o.channel != "drive_monitor"]
    for key in sorted({o.noise_key for o in of_the_head}):
        mine = [o for o in of_the_head if o.noise_key == key]
        heavy = joint.noise.tail(mine[0]) > joint.settings.localization.heavy_tails
        seen = [chosen.fit.residuals[o.name][: o.fitted] for o in mine if o.fitted]
        for o in (o for o in mine if o.fitted < o.excitation.samples):
            unseen = refitted.fit.residuals[o.name][o.fitted :]
            excess = _sure_excess(unseen, seen, settings)
            if heavy:  # a few spikes are none
                excess = min(excess, _sure_excess(without_spikes(unseen), [without_spikes(r) for r in seen], settings))
            if excess > 0:
                found[o.name] = excess * unseen.size
    return tuple(sorted(found, key=lambda name: -found[name]))


def _sure_excess(unseen: Real, seen: Sequence[Real], settings: VerdictSettings) -> float:
    """By how much the power of held-out residuals exceeds that of fitted ones, as a share; 0 if chance may do so.

    The power of a recording varies by the noise's tails, and as much as it varies more between fitted recordings.
    """
    if not seen:
        usual, tail, between, others = 1.0, 1.0, 0.0, 1
    else:
        power = np.concatenate(seen) ** 2
        usual, others = float(power.mean()) or 1.0, power.size
        tail = max(1.0, float(power.var()) / (2 * usual**2))
        each = np.array([float(np.mean(r**2)) for r in seen])
        between = max(0.0, float(each.var()) / usual**2 - tail * float(np.mean([2 / r.size for r in seen])))
    excess = float(unseen @ unseen) / unseen.size / usual - 1
    doubt = math.sqrt(tail * (2 / unseen.size + 2 / others) + between)
    return excess if excess > settings.least_excess + settings.excess_standard_deviations * doubt else 0.0


@dataclass(frozen=True)
class Division:
    """Which recordings are held out instead, and which of those held out before are fitted now; names of both."""

    held_out: tuple[str, ...]
    fitted: tuple[str, ...]


def held_out_otherwise(joint: OutputErrorFit, chosen: Hypothesis) -> Division | None:
    """The recordings held out such that the fitted ones show a mismatch of which so far only held-out ones know.

    It is what the chosen hypothesis leaves there, while it explains the fitted recordings.

    Every second of the conditions that show it is fitted, the one that shows most first; the others check what is found
    there. None if at most one condition shows it.
    """
    found = held_out_misfits(joint, chosen)
    condition = {o.name: o.condition for o in joint.observed}
    showing = list(dict.fromkeys(condition[name] for name in found))
    if len(showing) < 2:
        return None
    moved = set(showing[::2])
    before = [o for o in joint.observed if not o.fitted and o.channel != "drive_monitor"]
    fitted = tuple(o.name for o in before if o.condition in moved)
    return Division(tuple(o.name for o in before if o.name not in fitted), fitted)


def _of_everything(joint: OutputErrorFit) -> OutputErrorFit:
    """The same recordings and noise, with the held-out samples fitted too."""
    everything = [replace(o, fitted=o.excitation.samples) for o in joint.observed]
    return joint.anew(observed=everything, head=joint.base.head)


def _fitted_to_everything(joint: OutputErrorFit, chosen: Hypothesis) -> Hypothesis:
    """A hypothesis fitted to the held-out samples too; as it was where that fails."""
    whole = _of_everything(joint)
    if not chosen.ids:
        return base_hypothesis(whole)
    try:
        return settled(whole, whole.near(chosen.fit).fit(chosen.fit.active))
    except NUMERICAL:
        return chosen


def explains_held_out_after_refit(joint: OutputErrorFit, chosen: Hypothesis, context: FitContext) -> bool:
    """Whether effects that predicted held-out recordings badly explain them once these are fitted too.

    If a bubble appeared between two fitted recordings, nothing says whether it was there in the recordings between
    them. Effects that are not there explain the held-out recordings no better once these are fitted. A resonance that
    drifts with the order may differ from its course in each of them.

    Parameters
    ----------
    joint : OutputErrorFit
        Recordings with their held-out samples, noise and base model.
    chosen : Hypothesis
        The effects in question, fitted on the same recordings.
    context : FitContext
        Processes, random numbers, progress messages and checkpoint.
    """
    whole = _of_everything(joint)
    found, hypothesis = signatures(whole, chosen.fit.active.effects, context), base_hypothesis(whole)
    for effect in chosen.fit.active.effects:
        beside = found.beside(hypothesis.columns)
        hypothesis = next(iter(attribute(whole, hypothesis, [effect], beside, context)), hypothesis)
    drifts = all(e.depends_on_order and e.stage == "resonator" for e in chosen.fit.active.effects)  # and nothing else
    left = {o.name: hypothesis.fit.residuals[o.name][o.rows(held_out=True)] for o in joint.observed}
    if drifts:
        left |= {o.name: _at_its_own_resonance(hypothesis, o) for o in joint.observed if o.excitation.fast}
    before = after = noise = 0.0
    for key in sorted({o.noise_key for o in joint.observed}):
        mine = [o for o in joint.observed if o.noise_key == key]
        seen = np.concatenate([hypothesis.fit.residuals[o.name][o.rows(held_out=False)] for o in mine])
        unseen = np.concatenate([left[o.name] for o in mine])
        before += sum(float(np.sum(whole.base.residuals[o.name][o.rows(held_out=True)] ** 2)) for o in mine)
        after += float(unseen @ unseen)
        noise += unseen.size * (float(seen @ seen) / seen.size if seen.size else 1.0)
    return before - after >= (1 - joint.settings.verdict.left_over) * (before - noise)


def _at_its_own_resonance(hypothesis: Hypothesis, o: ObservedRecording) -> Real:
    """Whitened residuals of a recording's held-out rows with a frequency and a damping of its own, to first order."""
    joint, fit, rows = hypothesis.joint, hypothesis.fit, o.rows(held_out=True)
    residuals = fit.residuals[o.name][rows]
    if not residuals.size:
        return residuals
    try:
        columns = fit.head.sensitivities(o, fit.active.pairs)[:, fit.head.degree : fit.head.degree + 2]
    except NUMERICAL:
        return residuals
    white = joint.whitened(o, columns, fit.active.pairs)[rows]
    left: Real = residuals - white @ np.linalg.lstsq(white, residuals, rcond=1e-9)[0]
    return left
