"""Hypotheses, i.e. combinations of effects, fitted from several starts and compared."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.fit_result import FitResult
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.selection.cross_validation import LeaveOutResiduals, predicted, spanned
from inkjet_env.mismatch.selection.rugged_strengths import rugged_starts, scanned, tried_from, widely_scanned
from inkjet_env.mismatch.selection.score_test import ScoreTest, superposed
from inkjet_env.plant import Effect
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import rest
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A fit compared with the base model on the same recordings and noise.

    Parameters
    ----------
    fit : FitResult
        Base model and effects at the minimum.
    joint : OutputErrorFit
        Recordings, noise and base model, with the base sensitivities that belong to the fit.
    """

    fit: FitResult
    joint: OutputErrorFit

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of the effects that are on."""
        return self.fit.ids

    @property
    def gain(self) -> float:
        """Gain in log-likelihood of the fitted recordings over the base model."""
        return self.joint.base.nll - self.fit.nll

    @property
    def score(self) -> float:
        """Gain less the penalty of Schwarz's criterion for the free parameters."""
        return self.gain - 0.5 * self.free * math.log(self.residuals.size)

    @property
    def free(self) -> int:
        """Number of the effects' parameters that took part in the fit."""
        return int(np.count_nonzero(~self.fit.idle))

    @cached_property
    def residuals(self) -> Real:
        """Whitened residuals of the fitted rows, shape (rows,)."""
        return np.concatenate([self.fit.residuals[o.name][: o.fitted] for o in self.joint.seen])

    @cached_property
    def columns(self) -> Real:
        """Orthonormal basis of the sensitivities to all fitted parameters, shape (rows, q)."""
        return spanned(self.joint.basis[0], self.fit.jacobian)

    @cached_property
    def predicted(self) -> LeaveOutResiduals:
        """Residuals with each condition left out."""
        most = self.joint.settings.selection.single_condition
        return predicted(self.residuals, self.columns, conditions(self.joint), most)

    @property
    def degenerate(self) -> bool:
        """Whether an effect has degenerated into something else."""
        return bool(self.degenerated)

    @property
    def degenerated(self) -> frozenset[str]:
        """Ids of effects that have become something else.

        That is so if a shape with any influence has run into its bound, or a strength into a bound beyond which these
        recordings would show something else, or if the parameters that make the effect what it is are not needed.
        """
        found = {e.id for e in self.fit.active.effects if e.characteristic and self.net_gain(e, e.characteristic) <= 0}
        low, high = self.joint.limits(self.fit.active.effects)
        named = [(e, p) for e in self.fit.active.effects for p in e.parameters]
        widest = np.array([p.bounds for _, p in named]).reshape(-1, 2)
        at_bound = self.joint.settings.selection.at_bound
        room = at_bound * (high - low)
        shape_at = (self.fit.active.theta <= low + room) | (self.fit.active.theta >= high - room)
        ends = ((low, low > widest[:, 0]), (high, high < widest[:, 1]))
        strength_at = np.zeros(low.size, dtype=bool)
        for end, narrower in ends:
            near = np.abs(self.fit.active.theta - end) <= at_bound * np.where(end == 0, high - low, np.abs(end))
            strength_at |= near & narrower & (low < high)
        return frozenset(found) | {
            e.id
            for (e, p), strength, shape in zip(named, strength_at, shape_at & ~self.fit.idle, strict=True)
            if (strength if p.name in e.strengths else shape and not p.open_ended)
        }

    @property
    def excess(self) -> float:
        """Sum of squared residuals beyond the noise's expectation."""
        moved = int(np.count_nonzero(np.any(self.fit.jacobian, axis=0)))
        return 2 * self.fit.nll - (self.residuals.size - self.joint.base_rank - moved)

    @property
    def sure_excess(self) -> float:
        """What of the `excess` is beyond the doubt of the noise's own level; 0 where the noise is not known."""
        if not self.noise_known:
            return 0.0
        doubt = self.joint.noise.doubt(self.joint.seen)
        return max(self.excess - self.joint.settings.verdict.excess_standard_deviations * doubt, 0.0)

    @property
    def leaves_much(self) -> bool:
        """Whether the residuals exceed the noise by enough for another effect to be worth adding."""
        return not self.noise_known or self.excess > self.joint.settings.selection.equation_error * 2 * self.gain

    @property
    def surely_leaves_much(self) -> bool:
        """The same beyond the doubt of the noise's own level."""
        return self.sure_excess > self.joint.settings.selection.equation_error * 2 * self.gain

    @property
    def lacks_terms(self) -> bool:
        """Whether the residuals are so large that terms of the last effect's law which are off may be missing."""
        plain = self.fit.active.last.plain_leaves
        short = not self.noise_known or self.excess > plain * (2 * self.gain + self.excess)
        return self.leaves_much and short and self.has_other_terms

    @property
    def has_other_terms(self) -> bool:
        """Whether terms of the last effect's law are off."""
        return bool(self.fit.active.terms(self.fit.active.last)[1])

    @property
    def noise_known(self) -> bool:
        """Whether every recording's noise is known from more than residuals; otherwise these may be mismatch."""
        return all(self.joint.noise.known(o) for o in self.joint.seen)

    def idle_term(self) -> tuple[str, ...] | None:
        """The term of the last effect's law that Wald's test finds least needed; None if each is worth its parameters.

        A term is worth its parameters if half its Wald statistic exceeds the penalty of Schwarz's criterion.
        """
        active, effect = self.fit.active, self.fit.active.last
        on, _ = active.terms(effect)
        strong = [term for term in on if term[0] in effect.strengths]
        terms = [term for term in on if term not in strong or len(strong) > 1]
        net_gain = {term: self.net_gain(effect, term) for term in terms}
        least = min(net_gain, key=lambda term: net_gain[term], default=None)
        return least if least is not None and net_gain[least] < 0 else None

    def net_gain(self, effect: Effect, names: Sequence[str]) -> float:
        """Half Wald's statistic of some of an effect's parameters, less Schwarz's penalty for those that are fitted."""
        active = self.fit.active
        first = active.slices[effect.id].start
        place = {p.name: first + k for k, p in enumerate(effect.parameters)}
        mine = [place[name] for name in names if not self.fit.idle[place[name]]]
        at_rest = {place[p.name]: rest(effect, p) for p in effect.parameters}
        value = np.array([active.theta[k] - at_rest[k] for k in mine])
        covariance = self._root[np.searchsorted(np.flatnonzero(~self.fit.idle), mine)]
        spread = covariance @ covariance.T
        half_wald = 0.5 * float(value @ np.linalg.lstsq(spread, value, rcond=1e-12)[0]) if mine else 0.0
        return half_wald - 0.5 * len(mine) * math.log(self.residuals.size)

    @cached_property
    def _root(self) -> Real:
        """Root of the covariance of the coordinates that are not idle, shape (k, k)."""
        q = self.joint.basis[0]
        jacobian = self.fit.jacobian[:, np.flatnonzero(~self.fit.idle)]
        root: Real = np.linalg.pinv(np.linalg.qr(jacobian - q @ (q.T @ jacobian), mode="r"), rcond=1e-9)
        return root


def conditions(joint: OutputErrorFit) -> list[NDArray[np.intp]]:
    """Indices of the fitted rows of each condition."""
    numbers = np.concatenate([np.full(o.fitted, o.condition) for o in joint.seen])
    return [np.flatnonzero(numbers == number) for number in np.unique(numbers)]


def base_hypothesis(joint: OutputErrorFit) -> Hypothesis:
    """The base model as a hypothesis: no effect on."""
    return Hypothesis(joint.base, joint)


def leftover(hypothesis: Hypothesis, found: ScoreTest, rng: np.random.Generator) -> bool:
    """Whether any effect's signature is still significant in a hypothesis's residuals."""
    settings = hypothesis.joint.settings.selection
    beside = found.beside(hypothesis.columns)
    largest = max(beside.best(hypothesis.residuals).values(), default=0.0)
    return beside.p_value(largest, rng, settings.score_draws) <= settings.significance_level


def attribute(
    joint: OutputErrorFit,
    beside: Hypothesis,
    effects: Sequence[Effect],
    found: ScoreTest,
    context: FitContext,
    hopeless: float | None = None,
) -> list[Hypothesis]:
    """The hypotheses that have one more effect on than ``beside``, best first.

    Each is fitted with a few steps from its best starts; those that gain a fair share of the best one's gain are
    continued until they settle. If an effect's law has several terms, only those that are on at the start take part at
    first. If residuals remain that are too large, the other terms are fitted too; so are those of effects that come
    close to one that leaves little.

    Parameters
    ----------
    joint : OutputErrorFit
        Recordings, noise and base model.
    beside : Hypothesis
        The hypothesis to which one effect is added.
    effects : sequence of Effect
        Effects that may be switched on.
    found : Signatures
        Their signatures with the columns of ``beside`` projected out; they rank the starts.
    context : FitContext
        Processes, random numbers, progress messages and checkpoint.
    hopeless : float, optional
        Share of the best gain, after the first steps, below which an effect is not fitted to the end; that of the
        settings unless given.
    """
    given, settings = beside.fit, joint.settings.selection
    hopeless = settings.hopeless_gain if hopeless is None else hopeless
    by_effect: dict[str, list[FitResult]] = {}
    for begun in sorted(_begun(joint, beside, effects, found, context), key=lambda fit: fit.nll):
        by_effect.setdefault(begun.active.last.id, []).append(begun)
    most = max((given.nll - fits[0].nll for fits in by_effect.values()), default=0.0)

    def refined(begun: Sequence[FitResult]) -> list[Hypothesis]:
        questions = [(fit.active, fit, None) for fit in begun]
        fits, ended = context.fits(joint, lambda fit: simplest(joint, fit).fit, begun, questions), []
        for k, fit in enumerate(fits):
            if fit is not None:
                context.progress(f"refining {' + '.join(fit.ids)} ({k + 1} of {len(begun)})")
                ended.append(Hypothesis(fit, joint.near(fit)))
        return ended

    promising = [fits for fits in by_effect.values() if given.nll - fits[0].nll >= hopeless * most]
    hypotheses = [Hypothesis(fits[0], joint) for fits in by_effect.values() if fits not in promising]
    close = [fits for fits in promising if given.nll - fits[0].nll >= settings.alternative_gain * most]
    ended = sorted(refined([fits[0] for fits in close]), key=lambda h: -h.score)
    much = not ended or ended[0].leaves_much
    if ended and much and not ended[0].surely_leaves_much:  # it may be noise
        much = leftover(ended[0], found, context.rng)
    if much:
        far = [fits[0] for fits in promising if fits not in close]
        ended = sorted([*ended, *refined(far)], key=lambda h: -h.score)
    else:
        hypotheses += [Hypothesis(fits[0], joint) for fits in promising if fits not in close]
    if ended and much and not given.active.effects:  # the best start may have led to another minimum
        seconds = [fit for fits in promising for fit in fits[1:] if given.nll - fit.nll >= hopeless * most]
        seconds += [fit for effect in effects if (fit := widely_scanned(joint, effect, ended[0].fit)) is not None]
        best: dict[tuple[str, ...], Hypothesis] = {}
        for one in sorted([*ended, *refined(seconds)], key=lambda h: -h.score):
            best.setdefault(one.ids, one)
        ended = list(best.values())
    if ended:
        largest = max(given.nll - h.fit.nll for h in ended)
        if much or ended[0].degenerate:
            partial = [
                h.fit for h in ended if h.lacks_terms and given.nll - h.fit.nll >= settings.whole_law_gain * largest
            ]
        else:  # what comes so close that it may be its simple law that fails, not its physics
            close_gain = settings.close_gain * largest
            partial = [h.fit for h in ended[1:] if h.has_other_terms and given.nll - h.fit.nll >= close_gain]
        partial = partial[: settings.most_whole_laws // len(given.ids) if given.ids else None]
        wholes = [(fit.active, fit, "whole") for fit in partial]
        for k, fit in enumerate(context.fits(joint, lambda fit: shaped(joint, fit, beside).fit, partial, wholes)):
            if fit is not None:
                context.progress(f"refining {' + '.join(fit.ids)} with all parameters ({k + 1} of {len(partial)})")
                ended = [h for h in ended if h.ids != fit.ids] + [Hypothesis(fit, joint.near(fit))]
    return sorted([*hypotheses, *ended], key=lambda h: -h.score)


def _begun(
    joint: OutputErrorFit, beside: Hypothesis, effects: Sequence[Effect], found: ScoreTest, context: FitContext
) -> list[FitResult]:
    """A few steps from the starts of each effect; those that screening shows to be alike or hopeless get no more."""
    given, settings = beside.fit, joint.settings.selection
    known = given.jacobian if given.active.effects else None
    if not given.active.effects:  # the first effect
        joint = joint.from_plain
    best_score = found.best(beside.residuals)
    largest = max(best_score.values(), default=0.0)

    def stepped(name: str, tasks: Sequence[tuple[ActiveEffects, FitResult]], steps: int) -> Iterator[FitResult | None]:
        questions = [(active, begin, steps) for active, begin in tasks]
        fits = context.fits(joint, lambda task: tried_from(joint, *task, steps, known=known), tasks, questions)
        for k, ((active, _), fit) in enumerate(zip(tasks, fits, strict=True)):
            context.progress(f"{name} {' + '.join(active.ids)} (start {k + 1} of {len(tasks)})")
            yield fit

    starts = [
        (given.active.plus(effect, start), given.moved(head=joint.start) if known is None else given)
        for effect in effects
        if effect.id not in given.ids and best_score.get(effect.id, 0.0) >= settings.least_score * largest
        for _, start in found.ranked(effect, beside.residuals, settings.same_start)[
            : settings.starts if best_score[effect.id] >= settings.fair_score * largest else 1
        ]
    ]
    screened = [fit for fit in stepped("screening", starts, settings.screening_steps) if fit is not None]
    most = max((given.nll - fit.nll for fit in screened), default=0.0)
    following, ended = [], []
    for effect in effects:
        least, continued = settings.screened_gain * most, settings.screened_starts
        if best_score.get(effect.id, 0.0) >= settings.further_score * largest:
            least, continued = -math.inf, settings.starts  # the score promises more than screening may show
        apart: list[FitResult] = []
        for fit in sorted((fit for fit in screened if fit.active.last.id == effect.id), key=lambda fit: fit.nll):
            alike = settings.same_start_gain
            if not any(fit.nll - other.nll <= alike * abs(given.nll - other.nll) for other in apart):
                apart.append(fit)
        good = [fit for fit in apart if given.nll - fit.nll >= least]
        following += [fit for fit in good[:continued] if not fit.converged]
        ended += [fit for fit in apart if fit not in following]
    more = [(fit.active, fit) for fit in following]
    steps = settings.first_steps - settings.screening_steps
    return ended + [fit for fit in stepped("fitting", more, steps) if fit is not None]


def shaped(joint: OutputErrorFit, fit: FitResult, beside: Hypothesis) -> Hypothesis:
    """A settled fit, continued with those terms of its last effect's law that are worth their parameters."""
    near, steps = joint.near(fit), joint.settings.selection.first_steps
    plain = Hypothesis(fit, near)
    effect = fit.active.last
    others = superposed(joint, effect, beside.residuals, beside.columns)
    known = beside.fit.jacobian if beside.ids else None
    tried = [tried_from(near, fit.active, fit, steps, True, known)]
    for values in others:
        begin = fit.active.with_values(effect, values)
        tried.append(tried_from(joint, begin, beside.fit, steps, True, known))
    for values in rugged_starts(joint, fit.active):
        tried.append(tried_from(near, fit.active.with_values(effect, values), fit, steps, True, known))
    begun = min((one for one in tried if one is not None), key=lambda one: one.nll, default=None)
    if begun is None or Hypothesis(begun, near).score <= plain.score:
        return plain
    whole = simplest(joint, begun, whole=True)
    return whole if whole.score > plain.score else plain


def completed(joint: OutputErrorFit, chosen: Hypothesis) -> Hypothesis:
    """A single effect with those terms of its law, off so far, that are worth their parameters.

    A simple law may explain all with values that are not those of the law with its other terms on.
    """
    if len(chosen.ids) != 1 or not chosen.fit.active.terms(chosen.fit.active.last)[1]:
        return chosen
    try:
        whole = shaped(joint, chosen.fit, base_hypothesis(joint))
    except NUMERICAL:
        return chosen
    return whole if whole.score > chosen.score and not whole.degenerate else chosen


def simplest(joint: OutputErrorFit, fit: FitResult, whole: bool = False) -> Hypothesis:
    """A fit continued until it settles, without the terms of its last effect's law that are not worth it."""
    best, tried = settled(joint, scanned(joint, fit), whole), set()
    while True:
        effect = best.fit.active.last
        on, _ = best.fit.active.terms(effect)
        shapes = [term for term in on if term[0] not in effect.strengths]  # a plain shape may be another minimum
        idle = best.idle_term()
        terms = [term for term in ([idle] if idle else []) + shapes if term not in tried]
        if not terms:
            return best
        tried.add(terms[0])
        without = replace(best.fit.moved(active=best.fit.active.without_term(effect, terms[0])), nll=math.inf)
        near = best.joint  # its base sensitivities tell whether it is worth taking them anew
        begun = tried_from(near, without.active, without)
        if begun is None or Hypothesis(begun, near).score < best.score - joint.settings.selection.worse_law:
            continue
        fewer = settled(joint, begun)
        if fewer.score >= best.score:
            best, tried = fewer, set()


def settled(joint: OutputErrorFit, fit: FitResult, whole: bool = False) -> Hypothesis:
    """A fit continued until it settles, with the base sensitivities taken anew in each round."""
    settings = joint.settings
    for _ in range(settings.selection.most_rounds):
        near = joint.near(fit)
        following = tried_from(near, fit.active, fit, whole=whole) or fit
        gained = fit.nll - following.nll
        fit, joint = following, near
        misfit = fit.nll - 0.5 * sum(o.fitted for o in joint.seen)
        if gained < max(settings.fitting.settled_gain, settings.fitting.step_gain_share * misfit):
            break
    return Hypothesis(fit, joint)
