"""Hypotheses — effects that are on together — fitted from several starts and compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.fitting.checkpoint import Kept
from inkjet_env.mismatch.fitting.fit_result import Fit
from inkjet_env.mismatch.fitting.joint_fit import FAR_FROM_RIGHT, MOST_STEPS, JointFit
from inkjet_env.mismatch.fitting.process_pool import Crew
from inkjet_env.mismatch.selection.cross_validation import Foretold, foretold, orthonormal
from inkjet_env.mismatch.selection.score_test import Signatures, point_of, superposed
from inkjet_env.plant import Effect
from inkjet_env.plant.effect import coordinates, parts_of, rest
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.typing import Real

STARTS = 3
"""Of each effect whose score is fair, fitted with a few steps each; the best goes on. Of the others one."""
WORTH_STARTS = 0.2
"""Share of the best effect's score that is fair."""
FIRST_STEPS = 6
AT_BOUND = 1e-3
"""Share of a coordinate's range."""
MOST_ROUNDS = 4
"""Times that the base parameters' sensitivities are taken anew."""
SETTLED = 0.5
"""Of the log-likelihood: a round that gains less is the last."""
LEAST_SHARE = 1e-3
"""Share of the whole mismatch that a further effect must explain; so little an equation may be wrong by."""
WORTH_WHOLE = 0.5
"""The other parts of an effect's law are let in if it has gained this share of what the best one has."""
MOST_WHOLE = 2
"""Of the effects beside another one, so many."""
HOPELESS = 0.3
"""After the first steps, an effect goes on if it has gained this share of what the best one has."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A fit, and what it says beside the base model's on the same recordings and noise."""

    fit: Fit
    joint: JointFit

    @property
    def ids(self) -> tuple[str, ...]:
        """Of the effects that are on."""
        return self.fit.ids

    @property
    def gain(self) -> float:
        """Of the log-likelihood of the fitted recordings over the base model's."""
        return self.joint.base.nll - self.fit.nll

    @property
    def score(self) -> float:
        """Gain less what so many parameters gain by chance (Schwarz's criterion)."""
        return self.gain - 0.5 * self.free * math.log(self.left.size)

    @property
    def free(self) -> int:
        """How many of the effects' parameters took part in the fit."""
        return int(np.count_nonzero(~self.fit.idle))

    @cached_property
    def left(self) -> Real:
        """Whitened residual of the fitted rows, shape (rows,)."""
        return np.concatenate([self.fit.left[o.name][: o.fitted] for o in self.joint.seen])

    @cached_property
    def columns(self) -> Real:
        """Orthonormal sensitivities to everything that was fitted, shape (rows, q)."""
        return orthonormal(np.column_stack([self.joint.basis[0], self.fit.slopes]))

    @cached_property
    def foretold(self) -> Foretold:
        """Residuals with each condition left out."""
        return foretold(self.left, self.columns, conditions(self.joint))

    @property
    def degenerate(self) -> bool:
        """Whether an effect has been bent into something else: a shape of it that does anything has run into its bound.

        Or a strength into one beyond which these recordings would show something else.
        """
        low, high = self.joint.limits(self.fit.effects)
        named = [(e, p) for e in self.fit.effects for p in e.parameters]
        widest = np.array([p.bounds for _, p in named]).reshape(-1, 2)
        room = AT_BOUND * (high - low)
        shape_at = (self.fit.point <= low + room) | (self.fit.point >= high - room)
        ends = ((low, low > widest[:, 0]), (high, high < widest[:, 1]))
        strength_at = np.zeros(low.size, dtype=bool)
        for end, narrower in ends:
            near = np.abs(self.fit.point - end) <= AT_BOUND * np.where(end == 0, high - low, np.abs(end))
            strength_at |= near & narrower & (low < high)
        return any(
            bool(strength) if p.name in e.strengths else bool(shape) and not p.open_ended
            for (e, p), strength, shape in zip(named, strength_at, shape_at & ~self.fit.idle, strict=True)
        )

    @property
    def excess(self) -> float:
        """Sum of squares of what is left beyond noise."""
        return 2 * self.fit.nll - (self.left.size - self.columns.shape[1])

    @property
    def leaves_much(self) -> bool:
        """Whether so much is left beyond noise that something more could be worth adding."""
        return not self.noise_known or self.excess > LEAST_SHARE * 2 * self.gain

    @property
    def lacks_parts(self) -> bool:
        """Whether so much is left that parts of the last effect's law which are off may be what is missing."""
        plain, parts = self.fit.effects[-1].plain_leaves, parts_of(self.fit.effects[-1], _last(self.fit))
        short = not self.noise_known or self.excess > plain * (2 * self.gain + self.excess)
        return self.leaves_much and short and bool(parts[1])

    @property
    def noise_known(self) -> bool:
        """Whether anything but a residual tells the noise of every recording; else what is left may be mismatch."""
        return all(self.joint.noise.known(o) for o in self.joint.seen)

    def idle_part(self) -> tuple[str, ...] | None:
        """The part of the last effect's law that is missed least, where it is not worth its parameters; Wald's test."""
        effect, first = self.fit.effects[-1], self.fit.point.size - len(self.fit.effects[-1].parameters)
        at = {p.name: first + k for k, p in enumerate(effect.parameters)}
        on, _ = parts_of(effect, _last(self.fit))
        strong = [part for part in on if part[0] in effect.strengths]
        parts = [part for part in on if part not in strong or len(strong) > 1]
        free = np.flatnonzero(~self.fit.idle)
        q = self.joint.basis[0]
        slopes = self.fit.slopes[:, free]
        covariance = np.linalg.pinv(np.linalg.qr(slopes - q @ (q.T @ slopes), mode="r"), rcond=1e-9)
        worth: dict[tuple[str, ...], float] = {}
        for part in parts:
            mine = [int(np.flatnonzero(free == at[n])[0]) for n in part if at[n] in free]
            value = np.array([self.fit.point[at[n]] - rest(effect, effect.parameters[at[n] - first]) for n in part])
            value = value[[at[n] in free for n in part]]
            spread = covariance[mine] @ covariance[mine].T
            worth[part] = 0.5 * float(value @ np.linalg.lstsq(spread, value, rcond=1e-12)[0])
            worth[part] -= 0.5 * len(mine) * math.log(self.left.size)
        least = min(worth, key=lambda part: worth[part], default=None)
        return least if least is not None and worth[least] < 0 else None


def conditions(joint: JointFit) -> list[NDArray[np.intp]]:
    """Fitted rows of each condition."""
    numbers = np.concatenate([np.full(o.fitted, o.condition) for o in joint.seen])
    return [np.flatnonzero(numbers == number) for number in np.unique(numbers)]


def base_hypothesis(joint: JointFit) -> Hypothesis:
    """Nothing on."""
    return Hypothesis(joint.base, joint)


def attribute(
    joint: JointFit,
    beside: Hypothesis,
    effects: Sequence[Effect],
    found: Signatures,
    crew: Crew,
    progress: Callable[[str], None],
    hopeless: float = HOPELESS,
    kept: Kept | None = None,
) -> list[Hypothesis]:
    """The hypotheses that have one more effect on than ``beside``, best first.

    Each is fitted with a few steps from its best starts; those that gain a fair share of what the best one does go on
    until they settle. Of an effect whose law has several parts only those that the start has on take part in this;
    where so much is left that something is missing, the others are let in as well.

    Parameters
    ----------
    joint : JointFit
    beside : Hypothesis
    effects : sequence of Effect
        Those that may be switched on.
    found : Signatures
        Beside ``beside``: they rank the starts.
    crew : Crew
        Where the fits run.
    progress : callable
    hopeless : float
        Share of the best gain below which an effect is not fitted to the end.
    kept : Kept, optional
        Fits that were finished before.
    """
    given, kept = beside.fit, kept or Kept()

    def few_steps(question: tuple[tuple[Effect, ...], Real, Fit, int]) -> Fit | None:
        return _tried(joint, *question, known=given.slopes if given.effects else None)

    best_score = found.best(beside.left)
    worth = WORTH_STARTS * max(best_score.values(), default=0.0)
    tasks = [
        ((*given.effects, effect), np.concatenate([given.point, point_of([effect], [start])]), given, FIRST_STEPS)
        for effect in effects
        if effect.id in best_score and effect.id not in given.ids
        for _, start in found.ranked(effect, beside.left)[: STARTS if best_score[effect.id] >= worth else 1]
    ]
    best: dict[str, Fit] = {}
    for k, fit in enumerate(kept.fits(crew, joint, few_steps, tasks, tasks)):
        ids = [effect.id for effect in tasks[k][0]]
        progress(f"{' + '.join(ids)} ({k + 1} of {len(tasks)} starts)")
        if fit is not None and (ids[-1] not in best or fit.nll < best[ids[-1]].nll):
            best[ids[-1]] = fit
    most = max((given.nll - fit.nll for fit in best.values()), default=0.0)
    promising = [fit for fit in best.values() if given.nll - fit.nll >= hopeless * most]
    hypotheses = [Hypothesis(fit, joint) for fit in best.values() if given.nll - fit.nll < hopeless * most]
    questions = [(fit.effects, fit.point, fit, None) for fit in promising]
    ended: list[Hypothesis] = []
    for k, fit in enumerate(kept.fits(crew, joint, lambda fit: simplest(joint, fit).fit, promising, questions)):
        if fit is not None:
            progress(f"{' + '.join(fit.ids)}, to the end ({k + 1} of {len(promising)})")
            ended.append(Hypothesis(fit, joint.near(fit)))
    ended.sort(key=lambda h: -h.score)
    if ended and (ended[0].leaves_much or ended[0].degenerate):
        fair = WORTH_WHOLE * max(given.nll - h.fit.nll for h in ended)
        partial = [h.fit for h in ended if h.lacks_parts and given.nll - h.fit.nll >= fair]
        partial = partial[: MOST_WHOLE if given.effects else None]
        wholes = [(fit.effects, fit.point, fit, "whole") for fit in partial]
        for k, fit in enumerate(kept.fits(crew, joint, lambda fit: shaped(joint, fit, beside).fit, partial, wholes)):
            if fit is not None:
                progress(f"{' + '.join(fit.ids)}, the whole law ({k + 1} of {len(partial)})")
                ended = [h for h in ended if h.ids != fit.ids] + [Hypothesis(fit, joint.near(fit))]
    return sorted([*hypotheses, *ended], key=lambda h: -h.score)


def shaped(joint: JointFit, fit: Fit, beside: Hypothesis) -> Hypothesis:
    """A fit that has settled, gone on with so many parts of its last effect's law as are worth their parameters."""
    near = joint.near(fit)
    plain = Hypothesis(fit, near)
    given = fit.point[: fit.point.size - _last(fit).size]
    others = superposed(joint, fit.effects[-1], beside.left, beside.columns)
    known = beside.fit.slopes if beside.ids else None
    tried = [_tried(near, fit.effects, fit.point, fit, FIRST_STEPS, True, known)]
    for values in others:
        point = np.concatenate([given, coordinates(fit.effects[-1], values)])
        tried.append(_tried(joint, fit.effects, point, beside.fit, FIRST_STEPS, True, known))
    begun = min((one for one in tried if one is not None), key=lambda one: one.nll, default=None)
    if begun is None or Hypothesis(begun, near).score <= plain.score:
        return plain
    whole = simplest(joint, begun, whole=True)
    return whole if whole.score > plain.score else plain


def simplest(joint: JointFit, fit: Fit, whole: bool = False) -> Hypothesis:
    """A fit gone on with until it settles, less the parts of its last effect's law that are not worth it."""
    best, tried = settled(joint, fit, whole), set()
    while True:
        effect = best.fit.effects[-1]
        on, _ = parts_of(effect, _last(best.fit))
        shapes = [part for part in on if part[0] not in effect.strengths]  # where it is plain may be another minimum
        idle = best.idle_part()
        parts = [part for part in ([idle] if idle else []) + shapes if part not in tried]
        if not parts:
            return best
        tried.add(parts[0])
        fewer = settled(joint, _without(best.fit, parts[0]))
        if fewer.score > best.score:
            best, tried = fewer, set()


def _last(fit: Fit) -> Real:
    """Coordinates of the last effect."""
    return fit.point[fit.point.size - len(fit.effects[-1].parameters) :]


def _without(fit: Fit, part: tuple[str, ...]) -> Fit:
    """The fit with a part of the last effect's law off: where to begin."""
    point = fit.point.copy()
    first = point.size - len(fit.effects[-1].parameters)
    for k, p in enumerate(fit.effects[-1].parameters, start=first):
        if p.name in part:
            point[k] = rest(fit.effects[-1], p)
    return replace(fit, point=point, nll=math.inf)


def settled(joint: JointFit, fit: Fit, whole: bool = False) -> Hypothesis:
    """A fit gone on with until it settles, sensitivities taken anew on the way."""
    for _ in range(MOST_ROUNDS):
        near = joint.near(fit)
        following = _tried(near, fit.effects, fit.point, fit, whole=whole) or fit
        gained = fit.nll - following.nll
        fit, joint = following, near
        if gained < max(SETTLED, FAR_FROM_RIGHT * (fit.nll - 0.5 * sum(o.fitted for o in joint.seen))):
            break
    return Hypothesis(fit, joint)


def _tried(
    joint: JointFit,
    effects: Sequence[Effect],
    point: Real,
    begin: Fit,
    steps: int = MOST_STEPS,
    whole: bool = False,
    known: Real | None = None,
) -> Fit | None:
    """A fit that goes on from another's base parameters; None where the start cannot be simulated."""
    try:
        return joint.fit(effects, point, begin.head, most_steps=steps, whole=whole, known=known)
    except NUMERICAL:
        return None
