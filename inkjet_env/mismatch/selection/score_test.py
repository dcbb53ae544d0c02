"""What each effect would add to the recordings, base parameters free to adapt: the cheap look before any fit."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.plant import Effect
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.typing import Real

DRAWS = 2000
UNLIKE = 0.95
"""Cosine of the signatures of two starting points that are both worth trying."""
MOST_STARTS = 4
"""Of an effect's whole law."""
LEAST_SHARE = 1e-9
"""A signature of which less is left beside the base parameters than this share cannot be told from them."""


@dataclass(frozen=True, eq=False)
class Signatures:
    """Unit columns over the fitted rows, one for each start of each effect; what the base can say is projected out.

    Attributes
    ----------
    effects : tuple of Effect
        Of each column.
    starts : tuple of dict
        Values of each column's start.
    columns : ndarray, shape (rows, k)
    sizes : ndarray, shape (k,)
        Of the projected signature before it was scaled: how many standard deviations the start's own strength shows.
    """

    effects: tuple[Effect, ...]
    starts: tuple[dict[str, float], ...]
    columns: Real
    sizes: Real

    def scores(self, residuals: Real) -> Real:
        """Standard normal where the model that left ``residuals`` (rows,) is right, one a column."""
        scores: Real = self.columns.T @ residuals
        return scores

    def beside(self, basis: Real) -> Signatures:
        """What is left beside more orthonormal columns, shape (rows, q)."""
        columns = self.columns - basis @ (basis.T @ self.columns)
        size = np.linalg.norm(columns, axis=0)
        told = size > math.sqrt(LEAST_SHARE)
        chosen = np.flatnonzero(told)
        return Signatures(
            tuple(self.effects[i] for i in chosen),
            tuple(self.starts[i] for i in chosen),
            columns[:, told] / size[told],
            self.sizes[told] * size[told],
        )

    def chance(self, score: float, rng: np.random.Generator) -> float:
        """Probability that noise alone gives any column a score this large."""
        if not self.sizes.size:
            return 1.0
        gram = self.columns.T @ self.columns
        values, vectors = np.linalg.eigh(gram)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        largest = np.abs(rng.standard_normal((DRAWS, values.size)) @ root.T).max(axis=1)
        above = int(np.sum(largest >= abs(score)))
        if above >= 20:
            return above / DRAWS
        bound = self.sizes.size * math.erfc(abs(score) / math.sqrt(2))  # Bonferroni's, good in the tail
        return float(min(bound, (above + 1) / DRAWS))

    def ranked(self, effect: Effect, residuals: Real) -> list[tuple[float, dict[str, float]]]:
        """Scores and starts of one effect, best first; strengths scaled to what the recordings show."""
        scores = self.scores(residuals)
        mine = [i for i, e in enumerate(self.effects) if e.id == effect.id]
        mine.sort(key=lambda i: -abs(float(scores[i])))
        return [(float(scores[i]), _scaled(effect, self.starts[i], float(scores[i] / self.sizes[i]))) for i in mine]

    def best(self, residuals: Real) -> dict[str, float]:
        """By effect's id, the largest score's size."""
        found: dict[str, float] = {}
        for effect, score in zip(self.effects, self.scores(residuals), strict=True):
            found[effect.id] = max(found.get(effect.id, 0.0), abs(float(score)))
        return found


def signatures(
    joint: OutputErrorFit,
    effects: Iterable[Effect],
    context: FitContext,
) -> Signatures:
    """Signatures of all effects at all their starts."""
    excitations = [o.excitation for o in joint.seen if o.channel != "drive_monitor"]
    tasks = [(effect, start) for effect in effects for start in effect.starts(joint.base.head.printhead, excitations)]

    def column(task: tuple[Effect, dict[str, float]]) -> Real | None:
        try:
            return joint.signature(*task)
        except NUMERICAL:
            return None

    q, _ = joint.basis
    shown, columns, sizes = [], [], []
    for k, (task, found) in enumerate(zip(tasks, context.pool.map(column, tasks), strict=True)):
        context.progress(f"what {task[0].id} would add ({k + 1} of {len(tasks)})")
        if found is None or not np.isfinite(found).all():
            continue
        projected = found - q @ (q.T @ found)
        size = float(np.linalg.norm(projected))
        if size > math.sqrt(LEAST_SHARE) * float(np.linalg.norm(found)) and size > 1e-9:
            shown.append(task)
            columns.append(projected / size)
            sizes.append(size)
    rows = int(joint.ends[-1])
    return Signatures(
        tuple(effect for effect, _ in shown),
        tuple(start for _, start in shown),
        np.column_stack(columns) if columns else np.zeros((rows, 0)),
        np.array(sizes),
    )


def superposed(joint: OutputErrorFit, effect: Effect, residuals: Real, basis: Real) -> list[dict[str, float]]:
    """Where a fit of an effect's whole law may begin, what looks most like the residual first, all unlike each other.

    Parameters
    ----------
    joint : OutputErrorFit
    effect : Effect
    residuals : ndarray, shape (rows,)
        Whitened residual without the effect.
    basis : ndarray, shape (rows, q)
        Orthonormal columns of what may adapt.
    """
    excitations = [o.excitation for o in joint.seen if o.channel != "drive_monitor"]
    law = effect.superposed(joint.base.head.printhead, excitations)
    if law is None:
        return []
    plain, starts, weights = law
    try:
        columns = np.column_stack([joint.signature(effect, values) for values in plain])
    except NUMERICAL:
        return []
    columns -= basis @ (basis.T @ columns)
    gram = columns.T @ columns
    size = np.sqrt(np.maximum(weights.multiply(weights @ gram).sum(axis=1), 1e-300))
    scores = np.asarray(weights @ (columns.T @ residuals)) / size
    found: list[int] = []
    for k in np.argsort(-np.abs(scores)):
        alike = weights[found] @ gram @ weights[[k]].toarray()[0] / (size[found] * size[k])
        if not found or np.abs(alike).max() < UNLIKE:
            found.append(int(k))
        if len(found) == MOST_STARTS:
            break
    return [_scaled(effect, starts[k], float(scores[k] / size[k])) for k in found]


def _scaled(effect: Effect, start: dict[str, float], factor: float) -> dict[str, float]:
    """A start with its strengths multiplied: within bounds, and by no more than a fit may trust the linear picture."""
    factor = math.copysign(min(max(abs(factor), 0.05), 3.0), factor)
    values = dict(start)
    for p in effect.parameters:
        if p.name in effect.strengths:
            scaled = p.coordinate(start[p.name]) * (abs(factor) if p.scale == "reciprocal" else factor)
            low, high = p.bounds
            values[p.name] = p.value(min(max(scaled, low), high))
    return values
