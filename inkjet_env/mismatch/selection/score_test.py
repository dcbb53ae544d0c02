"""Score test: what each effect would add to the recordings with the base parameters free to adapt, before any fit.

Signature and score of effect i at a start θ_i are Eq. (1) of docs/explanation/diagnosis.md,

    z_i = s_iᵀ r / ‖s_i‖,    s_i = (I − P_base) W (ŷ(θ_i) − ŷ(0)),                                               (1)

with ``r`` the whitened residuals, ``W`` the whitening and ``P_base`` the projector on the base parameters' Jacobian.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.plant import Effect
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.typing import Real

LEAST_OWN_POWER = 1e-9
"""Share of a signature's power that the base parameters must leave for it to be distinguishable from them."""


@dataclass(frozen=True, eq=False)
class ScoreTest(ABC):
    """Scores of the effects at all their starts.

    Attributes
    ----------
    effects : tuple of Effect
        Effect of each score, k of them.
    starts : tuple of dict
        Parameter values of each start, in their units.
    sizes : ndarray, shape (k,)
        ``‖s_i‖``: the number of standard deviations by which an effect of the start's strength shows.
    """

    effects: tuple[Effect, ...]
    starts: tuple[dict[str, float], ...]
    sizes: Real

    @abstractmethod
    def scores(self, residuals: Real) -> Real:
        """Score of each start, shape (k,): standard normal if the model with these residuals (rows,) is right."""

    @abstractmethod
    def column(self, k: int) -> Real:
        """Signature ``s_k / ‖s_k‖``, shape (rows,)."""

    @property
    @abstractmethod
    def gram(self) -> Real:
        """Cosines between the signatures, shape (k, k)."""

    @abstractmethod
    def beside(self, basis: Real) -> ScoreTest:
        """The test with all parameters that may adapt projected out: orthonormal columns, shape (rows, q)."""

    def p_value(self, score: float, rng: np.random.Generator, draws: int) -> float:
        """Probability that noise alone gives any column a score this large, from this many draws of noise."""
        if not self.sizes.size:
            return 1.0
        values, vectors = np.linalg.eigh(self.gram)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        largest = np.abs(rng.standard_normal((draws, values.size)) @ root.T).max(axis=1)
        above = int(np.sum(largest >= abs(score)))
        if above >= 20:
            return above / draws
        bound = self.sizes.size * math.erfc(abs(score) / math.sqrt(2))  # Bonferroni's, good in the tail
        return float(min(bound, (above + 1) / draws))

    def ranked(self, effect: Effect, residuals: Real, alike: float = 1.0) -> list[tuple[float, dict[str, float]]]:
        """Scores and starts of one effect, best first; strengths are scaled to what the recordings show.

        Of starts whose signatures have a cosine above ``alike``, only one is there: the one whose own strength is
        closest to what the recordings show, because a signature scaled far from its start is not that of the effect.
        """
        scores = self.scores(residuals)
        mine = [i for i, e in enumerate(self.effects) if e.id == effect.id]
        mine.sort(key=lambda i: -abs(float(scores[i])))
        scaling = np.abs(np.log(np.maximum(np.abs(scores), 1e-300) / self.sizes))
        cosines = np.abs(self.gram[np.ix_(mine, mine)]) if alike < 1 else np.eye(len(mine))
        kept, left = [], list(range(len(mine)))
        while left:
            like = [k for k in left if cosines[left[0], k] > alike] or left[:1]
            kept.append(mine[min(like, key=lambda k: scaling[mine[k]])])
            left = [k for k in left if k not in like]
        return [(float(scores[i]), _scaled(effect, self.starts[i], float(scores[i] / self.sizes[i]))) for i in kept]

    def best(self, residuals: Real) -> dict[str, float]:
        """Largest magnitude of a score, by the effect's id."""
        found: dict[str, float] = {}
        for effect, score in zip(self.effects, self.scores(residuals), strict=True):
            found[effect.id] = max(found.get(effect.id, 0.0), abs(float(score)))
        return found


@dataclass(frozen=True, eq=False)
class Signatures(ScoreTest):
    """The test beside the base model, with the signatures ``s_i`` over the fitted rows as unit columns.

    Attributes
    ----------
    columns : ndarray, shape (rows, k)
        ``s_i / ‖s_i‖``, the base parameters projected out.
    """

    columns: Real

    def scores(self, residuals: Real) -> Real:
        scores: Real = self.columns.T @ residuals  # Eq. (1)
        return scores

    def column(self, k: int) -> Real:
        column: Real = self.columns[:, k]
        return column

    @cached_property
    def gram(self) -> Real:
        gram: Real = self.columns.T @ self.columns
        return gram

    def beside(self, basis: Real) -> ScoreTest:
        return SignaturesBeside.of(self, basis)


@dataclass(frozen=True, eq=False)
class SignaturesBeside(ScoreTest):
    """The test with further columns projected out of the signatures, which are not written: they are large.

    Attributes
    ----------
    whole : Signatures
        The signatures before.
    chosen : ndarray of int, shape (k,)
        Places in it of those that the further columns do not reproduce.
    basis : ndarray, shape (rows, q)
        The further columns, orthonormal.
    inside : ndarray, shape (q, k)
        Coefficients of the chosen columns on the basis.
    own : ndarray, shape (k,)
        Lengths of what the basis leaves of them.
    """

    whole: Signatures
    chosen: NDArray[np.intp]
    basis: Real
    inside: Real
    own: Real

    @classmethod
    def of(cls, whole: Signatures, basis: Real) -> SignaturesBeside:
        """The signatures with these orthonormal columns, shape (rows, q), projected out."""
        inside = basis.T @ whole.columns
        own = np.sqrt(np.maximum(1 - np.sum(inside**2, axis=0), 0.0))
        chosen = np.flatnonzero(own > math.sqrt(LEAST_OWN_POWER))
        return cls(
            tuple(whole.effects[i] for i in chosen),
            tuple(whole.starts[i] for i in chosen),
            whole.sizes[chosen] * own[chosen],
            whole,
            chosen,
            basis,
            inside[:, chosen],
            own[chosen],
        )

    def scores(self, residuals: Real) -> Real:
        left = residuals - self.basis @ (self.basis.T @ residuals)
        scores: Real = self.whole.scores(left)[self.chosen] / self.own
        return scores

    def column(self, k: int) -> Real:
        column: Real = (self.whole.columns[:, self.chosen[k]] - self.basis @ self.inside[:, k]) / self.own[k]
        return column

    @cached_property
    def gram(self) -> Real:
        whole = self.whole.gram[np.ix_(self.chosen, self.chosen)]
        gram: Real = (whole - self.inside.T @ self.inside) / np.outer(self.own, self.own)
        return gram

    def beside(self, basis: Real) -> ScoreTest:
        return self.whole.beside(basis)


def signatures(
    joint: OutputErrorFit,
    effects: Iterable[Effect],
    context: FitContext,
) -> Signatures:
    """Signatures of all effects at all their starts.

    Parameters
    ----------
    joint : OutputErrorFit
        Recordings, noise and base model.
    effects : iterable of Effect
        Effects with their starts.
    context : FitContext
        Processes and progress messages.

    Returns
    -------
    Signatures
        Without the starts that cannot be simulated or cannot be distinguished from the base parameters.
    """
    excitations = [o.excitation for o in joint.seen if o.channel != "drive_monitor"]
    tasks: list[tuple[Effect, dict[str, float]]] = []
    for effect in effects:
        with suppress(*NUMERICAL):  # an effect that finds no start on these recordings is not tried
            tasks.extend((effect, start) for start in effect.starts(joint.base.head.printhead, excitations))

    def column(task: tuple[Effect, dict[str, float]]) -> Real | None:
        try:
            return joint.signature(*task)
        except NUMERICAL:
            return None

    q, _ = joint.basis
    shown, columns, sizes = [], [], []
    for k, (task, found) in enumerate(zip(tasks, context.pool.map(column, tasks), strict=True)):
        context.progress(f"score test of {task[0].id} ({k + 1} of {len(tasks)})")
        if found is None or not np.isfinite(found).all():
            continue
        projected = found - q @ (q.T @ found)  # s_i of Eq. (1)
        size = float(np.linalg.norm(projected))
        if size > math.sqrt(LEAST_OWN_POWER) * float(np.linalg.norm(found)) and size > 1e-9:
            shown.append(task)
            columns.append(projected / size)
            sizes.append(size)
    rows = int(joint.ends[-1])
    return Signatures(
        tuple(effect for effect, _ in shown),
        tuple(start for _, start in shown),
        np.array(sizes),
        np.column_stack(columns) if columns else np.zeros((rows, 0)),
    )


def superposed(joint: OutputErrorFit, effect: Effect, residuals: Real, basis: Real) -> list[dict[str, float]]:
    """Starting points for a fit of an effect's whole law, those most like the residuals first, none alike.

    Parameters
    ----------
    joint : OutputErrorFit
        Recordings, noise and base model.
    effect : Effect
        Effect whose law has further terms; see `Effect.superposed`.
    residuals : ndarray, shape (rows,)
        Whitened residuals without the effect.
    basis : ndarray, shape (rows, q)
        Orthonormal columns of the parameters that may adapt.

    Returns
    -------
    list of dict of str to float
        Values of the effect's parameters, in their units; empty where the fit may start at the plain law.
    """
    excitations = [o.excitation for o in joint.seen if o.channel != "drive_monitor"]
    try:
        law = effect.superposed(joint.base.head.printhead, excitations)
        if law is None:
            return []
        plain, starts, weights = law
        columns = np.column_stack([joint.signature(effect, values) for values in plain])
    except NUMERICAL:
        return []
    columns -= basis @ (basis.T @ columns)
    gram = columns.T @ columns
    size = np.sqrt(np.maximum(weights.multiply(weights @ gram).sum(axis=1), 1e-300))
    scores = np.asarray(weights @ (columns.T @ residuals)) / size
    settings = joint.settings.selection
    found: list[int] = []
    for k in np.argsort(-np.abs(scores)):
        alike = weights[found] @ gram @ weights[[k]].toarray()[0] / (size[found] * size[k])
        if not found or np.abs(alike).max() < settings.alike_starts:
            found.append(int(k))
        if len(found) == settings.most_law_starts:
            break
    return [_scaled(effect, starts[k], float(scores[k] / size[k])) for k in found]


def _scaled(effect: Effect, start: dict[str, float], factor: float) -> dict[str, float]:
    """A start with its strengths multiplied, by no more than linearisation can be trusted."""
    return effect.scaled(start, math.copysign(min(max(abs(factor), 0.05), 3.0), factor))
