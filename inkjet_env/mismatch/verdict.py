"""The verdict on what the fits found, with its figures, location and next experiment."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from inkjet_env.estimate import Estimate
from inkjet_env.mismatch.design.next_experiment import NextExperiment, next_experiments
from inkjet_env.mismatch.diagnosis import Diagnosis, NamedEffect
from inkjet_env.mismatch.evidence import (
    closest,
    compared,
    modelled_recordings,
    named_effects,
    overlap,
    unexplained_share,
)
from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.fit_result import FitResult
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.headline import headline
from inkjet_env.mismatch.held_out import closure_of, confirmed, held_out_left_over
from inkjet_env.mismatch.localization.locate import locate
from inkjet_env.mismatch.localization.location import Location
from inkjet_env.mismatch.probabilities import NONE_OF_THESE, Explanation, calibration
from inkjet_env.mismatch.selection.base_intervals import dynamics
from inkjet_env.mismatch.selection.discrepancy_regression import DiscrepancyRegression
from inkjet_env.mismatch.selection.drawn_heads import drawn_heads
from inkjet_env.mismatch.selection.held_out_refit import explains_held_out_after_refit, held_out_misfits
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, base_hypothesis
from inkjet_env.mismatch.selection.minor_effects import with_minor_effects
from inkjet_env.mismatch.selection.random_effect_values import RandomEffect
from inkjet_env.mismatch.selection.remainder_fit import best_beside
from inkjet_env.mismatch.selection.score_test import Signatures
from inkjet_env.mismatch.selection.stepwise import Selection, weights
from inkjet_env.mismatch.stopwatch import Stopwatch
from inkjet_env.plant import Effect
from inkjet_env.plant.registry import own_class
from inkjet_env.plugins import provenance
from inkjet_env.printhead import Printhead, QuasiStaticPrinthead
from inkjet_env.printhead.printhead import UNKNOWN_INTERVALS


@dataclass(frozen=True, eq=False)
class Findings:
    """What the fits of a diagnosis found.

    Attributes
    ----------
    joint : OutputErrorFit
        Recordings, noise and base model, with the random effects that were found.
    chosen : Hypothesis
        The hypothesis that explains the recordings; the base model if no effect is supported.
    selection : Selection
        How it was selected.
    random_effects : sequence of RandomEffect
        Random effects that were found.
    indistinguishable : dict of str to tuple of str
        For each of them, by id: others that explain the recordings as well.
    discrepancy : DiscrepancyRegression
        Regression of what the chosen hypothesis leaves.
    effects : sequence of Effect
        Effects that were looked for.
    untestable : dict of str to str
        By id, the effects that the recordings cannot show, and why not.
    doubt : str or None
        Why the recordings may not be what they are said to be; then nothing is named.
    signatures : Signatures
        Signatures of the effects that have a law.
    dynamics_known : bool
        Whether the resonator of the heads is more than a placeholder: a recording shows it, or it was given.
    """

    joint: OutputErrorFit
    chosen: Hypothesis
    selection: Selection
    random_effects: Sequence[RandomEffect]
    indistinguishable: Mapping[str, tuple[str, ...]]
    discrepancy: DiscrepancyRegression
    effects: Sequence[Effect]
    untestable: Mapping[str, str]
    doubt: str | None
    signatures: Signatures
    dynamics_known: bool = True

    def known_part(self, printhead: Printhead) -> Printhead:
        """The head as a result may show it: without the placeholder for a resonator that is unknown."""
        return printhead if self.dynamics_known else QuasiStaticPrinthead.of(printhead)

    @property
    def groups(self) -> list[tuple[str, ...]]:
        """Groups of ids that the recordings cannot distinguish, the one that was chosen first."""
        replaced = self.selection.alternatives.items()
        groups = [(name, *others) for name, others in replaced if others and name in self.chosen.ids]
        drawn = [(s.effect.id, *self.indistinguishable.get(s.effect.id, ())) for s in self.random_effects]
        return groups + [group for group in drawn if len(group) > 1]


def judge(found: Findings, campaign: str, context: FitContext, stopwatch: Stopwatch, notes: Sequence[str]) -> Diagnosis:
    """The diagnosis from everything that was found.

    Parameters
    ----------
    found : Findings
        What the fits found.
    campaign : str
        Name of the campaign.
    context : FitContext
        Processes, random numbers, progress messages and checkpoint.
    stopwatch : Stopwatch
        Durations of the steps so far; its last steps are added.
    notes : sequence of str
        Sentences about the noise, the fits and what was not checked.
    """
    joint, chosen, settings = found.joint, found.chosen, found.joint.settings
    # the base model has no random effects either
    bare = joint.anew(head=joint.base.head, random_effects=()) if found.random_effects else joint
    recordings = modelled_recordings(bare, joint, chosen, found.discrepancy)
    closure = closure_of(recordings, settings.verdict)
    share = unexplained_share(base_hypothesis(bare), chosen, found.discrepancy)
    groups, anything = found.groups, bool(chosen.ids or found.random_effects)
    # No name without improvement on recordings that no fit saw; only what changes between them need not foretell them.
    ordered = any(effect.depends_on_order for effect in chosen.fit.active.effects)
    tested = held_out_left_over(base_hypothesis(bare), chosen)
    poor = bool(chosen.ids) and closure < settings.verdict.least_closure
    # there, the closure may show the noise's level
    faint = poor and math.isnan(tested) and confirmed(base_hypothesis(bare), chosen)
    poor = poor and not faint
    explained = poor and (closure > 0 or ordered) and explains_held_out_after_refit(joint, chosen, context)
    refuted = poor and not explained
    vague = max(map(len, groups), default=0) > settings.verdict.most_alike
    # the base model was checked on fitted recordings alone: does it hold where it predicted badly?
    unseen = () if anything or math.isnan(closure) else held_out_misfits(joint, chosen)
    unexplained = share if not refuted else max(share, min(1 - closure, 1.0))  # or what it leaves where it is tested
    if explained and ordered:  # it need not foretell them
        tested = math.nan
    stages = tuple(effect.stage for effect in chosen.fit.active.effects)
    explanation = Explanation(unexplained, tested, stages, overlap(found.selection))
    sure = calibration().explained(explanation) >= settings.verdict.least_probability
    p_value = max(found.selection.base_p_value, 0.0 if anything else found.selection.scatter_p_value)
    missed = not anything and (share > settings.verdict.left_over or p_value < settings.verdict.certain_p_value)
    if (anything and not sure) or missed or vague or unseen or found.doubt:
        verdict = "unknown"
    elif not anything:
        verdict = "none"
    else:
        verdict = "set" if groups else "named"
    context.progress("locating the mismatch")
    location = locate(bare.observed, bare.noise, bare.base, bare.basis[0], settings.localization)
    if verdict == "none":  # what the tests of the whole do not confirm is noise; its tables stay for whoever looks
        location = Location(tables=location.tables)
    stopwatch.took("location")
    corrected = _corrected(found, verdict, context)
    tried = [corrected] if corrected is chosen else [corrected, chosen]
    tried = [base_hypothesis(joint)] if verdict == "unknown" else tried  # never half of a model that is not named
    stands, remainder = tried[0], None
    if verdict != "none":
        context.progress("fitting the remainder")
        stands, remainder = best_beside(tried)
        stopwatch.took("remainder")
    corrected = chosen if verdict == "unknown" else stands
    if corrected is not chosen:
        recordings = modelled_recordings(bare, joint, corrected, found.discrepancy)
        closure = closure_of(recordings, settings.verdict)
    named, minor = _named(found, corrected)
    explains = math.nan if faint else closure
    said = found.doubt or headline(
        verdict, named, groups, explains, share, closest(base_hypothesis(joint), found.selection), location,
        settings.verdict, all(joint.noise.known(o) for o in joint.seen), unseen, minor,
    )  # fmt: skip
    probabilities = _probabilities(found, named, explanation, verdict)
    context.progress("designing the next experiment")
    following: tuple[NextExperiment, ...] = ()
    if verdict == "set" or vague:
        fits = _candidate_fits(found)
        none = probabilities.get(NONE_OF_THESE, 0.0)
        following = next_experiments(fits, joint.noise, joint.observed, found.effects, settings.design, none)
    stopwatch.took("next experiment")
    if remainder is not None:
        rounding = {o.name: o.told - o.measured for o in stands.joint.observed}
        recordings = tuple(
            replace(r, modelled={**r.modelled, "with_remainder": remainder.modelled[r.name] + rounding[r.name]})
            for r in recordings
        )
    if not stands.fit.converged:
        of = " with ".join(name.replace("_", " ") for name in stands.ids) or "the base model"
        last = f"The fit of {of} did not converge: its values are those at which it stopped, without known intervals."
        notes = [*notes, last]
    own = {f"effect {e.id}": provenance(type(e)) for e in found.effects if own_class(e) is not None}
    head, known = stands.fit.head, found.dynamics_known
    # A channel whose drive never moved has no gain; where a resonator is known, its gain is that of the given head.
    channels = {o.channel for o in joint.observed if known or not o.still} - {"drive_monitor"}
    ensemble = None
    if known:
        context.progress("drawing heads that the recordings leave possible")
        better = not closure <= 0  # a correction that predicts held-out recordings no better is not used
        ensemble = drawn_heads(
            _rivals(found, stands, probabilities)
            if better and verdict != "unknown"
            else [(base_hypothesis(joint), 1.0)],
            max(o.excitation.order for o in joint.observed),
            remainder.remainder if remainder is not None and better else None,
            settings.ensemble,
            np.random.default_rng(context.rng.integers(2**63)),
        )
        stopwatch.took("ensemble")
    gains, offsets = ({c: v for c, v in of.items() if c in channels} for of in (head.gains, head.offsets))
    nothing = {name: Estimate(math.nan, low, high) for name, (low, high) in UNKNOWN_INTERVALS.items()}
    return Diagnosis(
        campaign, verdict, said, tuple(named) if verdict != "unknown" else (), tuple(minor),
        tuple(groups) if verdict != "unknown" else (), location, recordings, closure, share, tested,
        explanation.overlap, p_value, compared(found.selection), found.untestable, following,
        remainder, found.known_part(head.printhead), gains, offsets, found.known_part(joint.base.head.printhead),
        dynamics(stands) if known else nothing, probabilities, tuple(notes), stopwatch.seconds, stopwatch.stages,
        settings, own, ensemble,
    )  # fmt: skip


def _rivals(found: Findings, stands: Hypothesis, probabilities: Mapping[str, float]) -> list[tuple[Hypothesis, float]]:
    """The model that stands, and those of effects that cannot be distinguished from its own, by their probabilities."""
    rivals = [(stands, 1.0)]
    ids = set(found.chosen.ids)
    for first, *others in found.groups:
        for other in others:
            wanted = (ids - {first}) | {other}
            same = next((h for h in found.selection.compared if set(h.ids) == wanted), None)
            odds = probabilities.get(other, 0.0) / max(probabilities.get(first, 0.0), 1e-12)
            if same is not None and odds > 0:
                rivals.append((same, min(odds, 1.0)))
    return rivals


def _probabilities(
    found: Findings, named: Sequence[NamedEffect], explanation: Explanation, verdict: str
) -> dict[str, float]:
    """Probability of each explanation, by the effect that explains most; see `Calibration.probabilities`."""
    ids = tuple(e.id for e in found.effects)
    if verdict == "none":
        return calibration().probabilities({}, None, ids)
    if named:
        most = max(named, key=lambda n: n.delta_nll).effect.id
        alike = dict.fromkeys((most, *found.indistinguishable.get(most, ())), 1.0)
        tried = alike if most not in found.chosen.ids else weights(found.selection, most)
        tried = {name: w for name, w in tried.items() if w >= found.joint.settings.verdict.least_weight}
        return calibration().probabilities(tried, explanation, ids)
    # Something is there, and nothing that was tried is supported: what came closest leaves the rest.
    come_closest = closest(base_hypothesis(found.joint), found.selection)
    name, share = (come_closest[0][0], come_closest[1]) if come_closest else (NONE_OF_THESE, 0.0)
    stage = {e.id: e.stage for e in found.effects}
    stages = tuple(stage[one] for one in come_closest[0]) if come_closest else ()
    left = max(explanation.left_over, 1 - share)
    return calibration().probabilities({name: 1.0}, replace(explanation, left_over=left, stages=stages), ids)


def _corrected(found: Findings, verdict: str, context: FitContext) -> Hypothesis:
    """The chosen hypothesis with minor effects, if it has a name and there are any."""
    if verdict not in ("named", "set") or not found.chosen.ids:
        return found.chosen
    context.progress("looking for minor effects")
    with_law = [e for e in found.effects if not e.random and e.id not in found.untestable]
    return with_minor_effects(found.chosen, with_law, found.signatures, context)


def _named(found: Findings, corrected: Hypothesis) -> tuple[list[NamedEffect], list[NamedEffect]]:
    """Random effects and then effects with a law, with their values and evidence; the same of minor effects."""
    joint = found.joint
    units = {o.channel: o.unit for o in joint.observed}
    drawn = [
        NamedEffect(
            s.effect, s.effect.description(s.values, units[s.channel]), s.gain,
            math.exp(-s.gain), s.estimates, s.values, units[s.channel],
        )
        for s in found.random_effects
    ]  # fmt: skip
    with_law = named_effects(joint, corrected, found.selection)
    named = [n for n in with_law if n.effect.id in found.chosen.ids]
    return [*drawn, *named], [n for n in with_law if n.effect.id not in found.chosen.ids]


def _candidate_fits(found: Findings) -> list[FitResult]:
    """The chosen fit, and those in which an effect that cannot be distinguished takes the place of a chosen one."""
    ids, fits = set(found.chosen.ids), [found.chosen.fit]
    for first, *others in found.groups:
        for other in others:
            wanted = (ids - {first}) | {other}
            fits.extend(h.fit for h in found.selection.compared if set(h.ids) == wanted)
    return fits
