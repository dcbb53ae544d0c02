"""Heads drawn from what the recordings leave possible: parameters within their covariance, and rival effects."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.mismatch.selection.base_intervals import (
    SINGULAR,
    directions_of_dynamics,
    loudness,
    sensitivities_of_all,
    standard_errors,
)
from inkjet_env.mismatch.selection.hypotheses import Hypothesis
from inkjet_env.mismatch.settings import EnsembleSettings
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.plant.head_ensemble import HeadEnsemble
from inkjet_env.plant.remainder import Remainder
from inkjet_env.printhead import Printhead, Waveform
from inkjet_env.typing import Real


def drawn_heads(
    rivals: Sequence[tuple[Hypothesis, float]],
    order: int,
    remainder: Remainder | None,
    settings: EnsembleSettings,
    rng: np.random.Generator,
) -> HeadEnsemble | None:
    """Heads of rival hypotheses, each drawn from the joint covariance of its parameters.

    Parameters
    ----------
    rivals : sequence of (Hypothesis, float)
        Hypotheses that explain the recordings, with their probabilities; the first is the chosen one.
    order : int
        Order of the recording at which effects that change within the session are evaluated.
    remainder : Remainder, optional
        Discrepancy model of the chosen hypothesis: it is on in as many heads as it is off.
    settings : EnsembleSettings
        Number of heads.
    rng : Generator
        Of the draws.

    Returns
    -------
    HeadEnsemble or None
        None if a head cannot be simulated even at the fit.
    """
    total = math.fsum(weight for _, weight in rivals)
    heads: list[Printhead | AugmentedPrinthead] = []
    weights: list[float] = []
    for k, (hypothesis, weight) in enumerate(rivals):
        count = max(1, round(settings.heads * weight / total))
        drawn = _drawn(hypothesis, count, order, rng)
        if not drawn:
            if k == 0:
                return None
            continue
        heads += drawn
        weights += [weight / len(drawn)] * len(drawn)
    if remainder is not None:
        fit = rivals[0][0].fit
        heads.append(AugmentedPrinthead(fit.head.printhead, fit.active.pairs, fit.head.gains, order, remainder))
        weights.append(math.fsum(weights))
    return HeadEnsemble(tuple(heads), tuple(weights))


def _drawn(
    hypothesis: Hypothesis, count: int, order: int, rng: np.random.Generator
) -> list[Printhead | AugmentedPrinthead]:
    """So many heads, of which the first is the fit itself; fewer if some cannot be simulated."""
    fit, joint = hypothesis.fit, hypothesis.joint
    factor, size = _factor(hypothesis), fit.head.size
    low, high = joint.limits(fit.active.effects)
    trial = _trial(max((o.excitation.drive_V for o in joint.observed), key=np.ptp))
    found: list[Printhead | AugmentedPrinthead] = []
    for k in range(count):
        step = factor @ rng.standard_normal(factor.shape[1]) if k else np.zeros(len(factor))
        theta = np.clip(
            fit.active.theta + step[size:], np.minimum(low, fit.active.theta), np.maximum(high, fit.active.theta)
        )
        try:
            head, active = fit.head.moved(step[:size]), fit.active.at(theta)
            pairs = tuple(pair for pair in active.pairs if not pair[0].random)
            drawn: Printhead | AugmentedPrinthead = head.printhead
            if pairs:
                drawn = AugmentedPrinthead(head.printhead, pairs, head.gains, order)
            drawn.respond(trial)
        except (*NUMERICAL, ValueError):
            continue
        found.append(drawn)
    return found


def _trial(drive_V: Real) -> Waveform:
    """A waveform as high as a recorded drive: a head that cannot answer it is no head."""
    return Waveform(max(float(drive_V.max()), 0.0), min(float(drive_V.min()), 0.0), 3e-6, 9e-6, 6e-6, 9e-6, 3e-6)


def _factor(hypothesis: Hypothesis) -> Real:
    """Factor of the covariance of the base parameters' step and the effects' coordinates, shape (p, q).

    It is that of Eq. (2) of docs/explanation/identification.md, with each row as much larger as the robust standard
    error of its parameter is; of the law and the gains, as that of ``b1``. Directions that the recordings do not
    determine are left out.
    """
    fit, size = hypothesis.fit, hypothesis.fit.head.size
    columns, _ = sensitivities_of_all(hypothesis)
    norms = np.linalg.norm(columns, axis=0)
    norms[norms <= SINGULAR * norms.max()] = np.inf
    _, values, axes = np.linalg.svd(columns / norms, full_matrices=False)
    seen = values > SINGULAR * values.max(initial=0.0)
    factor = loudness(hypothesis) * (axes[seen].T / values[seen]) / norms[:, None]
    of_effects = np.eye(len(factor))[size:]
    classical, robust = standard_errors(hypothesis, np.vstack([directions_of_dynamics(hypothesis), of_effects]))
    wider = np.where((classical > 0) & np.isfinite(robust), robust / np.maximum(classical, 1e-300), 1.0)
    rows = np.full(len(factor), wider[2])
    rows[fit.head.degree : fit.head.degree + 2] = wider[:2]
    rows[size:] = wider[3:]
    return np.asarray(rows[:, None] * factor)
