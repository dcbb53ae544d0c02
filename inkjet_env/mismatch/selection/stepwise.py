"""Stepwise selection: which effects the recordings support, and which of them they cannot distinguish."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, attribute, base_hypothesis, leftover, settled
from inkjet_env.mismatch.selection.score_test import ScoreTest
from inkjet_env.mismatch.selection.significance import largest_by_scatter, stands_out
from inkjet_env.plant import Effect
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.errors import NUMERICAL


@dataclass(frozen=True, eq=False)
class Selection:
    """Result of a stepwise selection.

    Attributes
    ----------
    chosen : Hypothesis
        The selected hypothesis; the base model if no effect is supported.
    alternatives : dict of str to tuple of str
        For each effect of the chosen hypothesis, by id: effects that could replace it without loss.
    compared : tuple of Hypothesis
        All hypotheses with effects that were fitted, best first.
    p_values : dict of str to float
        For each chosen effect, by id: p-value of the score test that led to its being added.
    base_p_value : float
        Probability that noise alone gives any effect a score as large as the largest beside the base model.
    scatter_p_value : float
        Probability of that score by its scatter between conditions, which need not be independent noise within one; 0
        if it is beyond any doubt about the noise.
    """

    chosen: Hypothesis
    alternatives: dict[str, tuple[str, ...]]
    compared: tuple[Hypothesis, ...]
    p_values: dict[str, float]
    base_p_value: float
    scatter_p_value: float


def select(
    joint: OutputErrorFit,
    effects: Sequence[Effect],
    found: ScoreTest,
    context: FitContext,
) -> Selection:
    """Select effects forward from the base model in a beam, then by deletions and swaps.

    Every addition must predict left-out conditions better.

    Parameters
    ----------
    joint : OutputErrorFit
        Recordings, noise and base model.
    effects : sequence of Effect
        Effects to choose from.
    found : Signatures
        Their signatures, the base parameters projected out.
    context : FitContext
        Processes, random numbers, progress messages and checkpoint.
    """
    base, settings = base_hypothesis(joint), joint.settings.selection
    beam, chosen = [base], base
    compared: dict[frozenset[str], Hypothesis] = {frozenset(): base}
    p_values: dict[frozenset[str], dict[str, float]] = {frozenset(): {}}
    base_p_value = scatter = 1.0
    for _ in range(settings.most_effects):
        added: list[Hypothesis] = []
        for parent in beam:
            beside = found.beside(parent.columns)
            scores = beside.best(parent.residuals)
            p_value = beside.p_value(max(scores.values(), default=0.0), context.rng, settings.score_draws)
            if parent is base:
                base_p_value, scatter = p_value, largest_by_scatter(base, beside)
            if p_value > settings.significance_level:
                continue
            promising = sorted(scores, key=lambda name: -scores[name])
            tried = [e for e in effects if e.id in promising and frozenset((*parent.ids, e.id)) not in compared]
            if parent is not base:  # all have been tried on the base model; later only those with a high score are
                least = settings.further_score * scores[promising[0]]
                tried = [e for e in tried if scores[e.id] > least]
            found_good = 0
            # a third effect stands out, or is none
            hopeless = settings.alternative_gain if len(parent.ids) > 1 else None
            for hypothesis in attribute(joint, parent, tried, beside, context, hopeless):
                ids = frozenset(hypothesis.ids)
                compared[ids] = hypothesis
                p_values[ids] = p_values[frozenset(parent.ids)] | {hypothesis.ids[-1]: p_value}
                if found_good < settings.beam_width and supported(parent, hypothesis):
                    found_good += 1
                    added.append(hypothesis)
            if any(worth_adding(chosen, h) and not h.leaves_much for h in added):
                break  # everything is explained; the other parents cannot do better
        added.sort(key=lambda h: -h.score)
        if not added or not worth_adding(chosen, added[0]):
            break
        before, chosen = chosen, added[0]
        if chosen.noise_known and chosen.excess < settings.named_share * 2 * chosen.gain:
            break  # too little is left for another name
        if not (chosen.leaves_much and leftover(chosen, found, context.rng)):
            break
        if before.ids and explained(before, chosen) < settings.further_effect * unexplained(before):
            break  # a third effect does not mend what such a pair leaves
        width = 1 if before.ids else settings.beam_width
        beam = [h for h in added[:width] if h.gain >= settings.beam_gain * added[0].gain]
    grown, chosen = chosen, without_idle(joint, chosen, compared)
    tests = p_values.get(frozenset(chosen.ids), p_values[frozenset(grown.ids)])
    compared_with_others = () if leaves_too_much(chosen) else chosen.ids
    alternatives = {
        name: _as_good(joint, chosen, name, effects, found, compared, context) for name in compared_with_others
    }
    ranked = sorted(compared.values(), key=lambda h: -h.score)
    needed = {name: tests[name] for name in chosen.ids}
    return Selection(chosen, alternatives, tuple(h for h in ranked if h.ids), needed, base_p_value, scatter)


def supported(without: Hypothesis, with_it: Hypothesis) -> bool:
    """Whether left-out conditions are predicted significantly better in sum, and most of those affected better."""
    if with_it.degenerate:
        return False
    gains, errors = without.predicted.log_likelihood_gain(with_it.predicted)
    settings = with_it.joint.settings.selection
    least = settings.predicted_standard_errors * math.sqrt(float(np.sum(errors**2)))
    if gains.sum() <= least or with_it.score <= without.score:
        return False
    affected = errors > settings.affected_condition
    return not affected.any() or float(np.mean(gains[affected] > 0)) >= settings.better_conditions


def worth_adding(without: Hypothesis, with_it: Hypothesis) -> bool:
    """Whether a further effect explains a good part of the misfit beyond noise; a first effect always may be added."""
    if not without.ids:
        return True
    settings = with_it.joint.settings.selection
    more, residuals, mismatch = explained(without, with_it), unexplained(without), 2 * with_it.gain
    if more >= settings.large_share * mismatch and more >= settings.further_effect_if_large * residuals:
        return True
    return more >= max(settings.further_effect * residuals, settings.named_share * mismatch)


def explained(without: Hypothesis, with_it: Hypothesis) -> float:
    """Sum of squares that a further effect explains."""
    return 2 * (without.fit.nll - with_it.fit.nll)


def unexplained(hypothesis: Hypothesis) -> float:
    """Sum of squared residuals, beyond noise if the noise is known."""
    return hypothesis.excess if hypothesis.noise_known else 2 * hypothesis.fit.nll


def leaves_too_much(hypothesis: Hypothesis) -> bool:
    """Whether so large a share of the mismatch is left that the verdict is unknown whatever else explains as much."""
    mismatch = max(hypothesis.excess, 0.0) + 2 * hypothesis.gain  # what is left may be less than the noise by chance
    return hypothesis.sure_excess > hypothesis.joint.settings.selection.lost * mismatch


def without_idle(joint: OutputErrorFit, chosen: Hypothesis, compared: dict[frozenset[str], Hypothesis]) -> Hypothesis:
    """The hypothesis without the effects that it does not need: backward deletion.

    Parameters
    ----------
    joint : OutputErrorFit
        Recordings, noise and base model.
    chosen : Hypothesis
        A fit of these with effects.
    compared : dict of frozenset of str to Hypothesis
        Fits of these with other effects, by their ids; those that are made are added.
    """
    while len(chosen.ids) > 1:
        for effect in chosen.fit.active.effects:
            rest = chosen.fit.active.minus(effect)
            key = frozenset(rest.ids)
            smaller = compared.get(key) or _only(joint, chosen, rest)
            if smaller is None:
                continue
            compared[key] = smaller
            if not (supported(smaller, chosen) and worth_adding(smaller, chosen) and stands_out(smaller, chosen, 1)):
                chosen = smaller
                break
        else:
            return chosen
    return chosen


def _only(joint: OutputErrorFit, chosen: Hypothesis, rest: ActiveEffects) -> Hypothesis | None:
    """The chosen hypothesis with only some of its effects; None if it cannot be simulated from there."""
    try:
        return settled(joint, joint.fit(rest, chosen.fit.head))
    except NUMERICAL:
        return None


def _as_good(
    joint: OutputErrorFit,
    chosen: Hypothesis,
    name: str,
    effects: Sequence[Effect],
    found: ScoreTest,
    compared: dict[frozenset[str], Hypothesis],
    context: FitContext,
) -> tuple[str, ...]:
    """Ids of effects that could replace one of the chosen: swaps, judged by likelihood and by signature."""
    settings = joint.settings.selection
    rest = chosen.fit.active.minus(next(e for e in chosen.fit.active.effects if e.id == name))
    ids = frozenset(rest.ids)
    without = compared.get(ids) or _only(joint, chosen, rest)
    if without is None:
        return ()
    compared[ids] = without
    missing = [e for e in effects if e.id not in chosen.ids and ids | {e.id} not in compared]
    if missing and rest.ids:
        beside = found.beside(without.columns)
        scores = beside.best(without.residuals)
        least = settings.further_score * max(scores.values(), default=0.0)
        missing = [e for e in missing if scores.get(e.id, 0.0) > least]
        for hypothesis in attribute(joint, without, missing, beside, context, settings.alternative_gain):
            compared[frozenset(hypothesis.ids)] = hypothesis
    same = []
    for effect in effects:
        other = compared.get(ids | {effect.id})
        if other is None or other.degenerate or effect.id == name or effect.id in chosen.ids:
            continue
        behind = chosen.score - other.score  # one that needs more parameters for it is no equal
        apart = float(np.linalg.norm(other.residuals - chosen.residuals))
        alike = leans(chosen, other, joint.settings.verdict.excess_standard_deviations) and 2 * behind < chosen.excess
        alike = alike and abs(cosine(without, chosen, other)) > settings.same_signature
        weighty = behind <= -math.log(settings.alike_weight) * temperature(chosen)
        if behind <= settings.predicted_standard_errors * apart or alike or weighty:
            same.append((behind, effect.id))
    return tuple(name for _, name in sorted(same))


def leans(chosen: Hypothesis, other: Hypothesis, standard_deviations: float) -> bool:
    """Whether what a hypothesis leaves leans to another's signals by more than noise; of the truth it does not."""
    difference = chosen.residuals - other.residuals
    return float(chosen.residuals @ difference) > standard_deviations * float(np.linalg.norm(difference))


def temperature(chosen: Hypothesis) -> float:
    """Difference of scores that counts as little beside a hypothesis, Eq. (2) of docs/explanation/diagnosis.md."""
    settings = chosen.joint.settings.selection
    approximate = settings.alike_explained * chosen.gain
    return settings.alike_gain + settings.alike_excess * chosen.sure_excess + approximate


def weights(selection: Selection, name: str) -> dict[str, float]:
    """Relative weights of one chosen effect and of all that were tried in its place, by id; the chosen one has 1."""
    chosen = selection.chosen
    rest = set(chosen.ids) - {name}
    tried = {frozenset(h.ids): h for h in selection.compared}
    found = {name: 1.0}
    for ids, other in tried.items():
        if rest < ids and len(ids) == len(rest) + 1 and name not in ids and not other.degenerate:
            behind = max(chosen.score - other.score, 0.0)
            found[min(ids - rest)] = math.exp(-behind / temperature(chosen))
    return found


def cosine(without: Hypothesis, one: Hypothesis, other: Hypothesis) -> float:
    """Cosine between what two hypotheses add to a third, whitened, base parameters adapted."""
    a, b = without.residuals - one.residuals, without.residuals - other.residuals
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size else 0.0
