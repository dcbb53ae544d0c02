"""Hypotheses — effects that are on together — fitted from several starts and compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.crew import Crew
from inkjet_env.mismatch.fit import Fit
from inkjet_env.mismatch.foretold import Foretold, foretold, orthonormal
from inkjet_env.mismatch.joint_fit import JointFit
from inkjet_env.mismatch.kept import Kept
from inkjet_env.mismatch.signatures import Signatures, point_of
from inkjet_env.plant import Effect

Real = NDArray[np.float64]

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
        return self.gain - 0.5 * self.fit.point.size * math.log(self.left.size)

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
        """Whether an effect has been bent into something else: a shape of it has run into its bound."""
        low, high = self.joint.limits(self.fit.effects)
        named = [(e, p) for e in self.fit.effects for p in e.parameters]
        room = AT_BOUND * (high - low)
        at_bound = (self.fit.point <= low + room) | (self.fit.point >= high - room)
        return any(
            bool(at) and p.name not in e.strengths and not p.open_ended
            for (e, p), at in zip(named, at_bound, strict=True)
        )

    @property
    def excess(self) -> float:
        """Sum of squares of what is left beyond noise."""
        return 2 * self.fit.nll - (self.left.size - self.columns.shape[1])


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
    until they settle.

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
        return _tried(joint, *question)

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
    for k, fit in enumerate(kept.fits(crew, joint, lambda fit: settled(joint, fit).fit, promising, questions)):
        if fit is not None:
            progress(f"{' + '.join(fit.ids)}, to the end ({k + 1} of {len(promising)})")
            hypotheses.append(Hypothesis(fit, joint.near(fit)))
    return sorted(hypotheses, key=lambda h: -h.score)


def settled(joint: JointFit, fit: Fit) -> Hypothesis:
    """A fit gone on with until it settles, sensitivities taken anew on the way."""
    for _ in range(MOST_ROUNDS):
        near = joint.near(fit)
        following = _tried(near, fit.effects, fit.point, fit) or fit
        gained = fit.nll - following.nll
        fit, joint = following, near
        if gained < SETTLED:
            break
    return Hypothesis(fit, joint)


def _tried(joint: JointFit, effects: Sequence[Effect], point: Real, begin: Fit, steps: int | None = None) -> Fit | None:
    """A fit that goes on from another's base parameters; None where the start cannot be simulated."""
    try:
        if steps is None:
            return joint.fit(effects, point, begin.head)
        return joint.fit(effects, point, begin.head, most_steps=steps)
    except (ValueError, FloatingPointError, OverflowError):
        return None
