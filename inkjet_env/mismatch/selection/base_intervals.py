"""The dynamics a0, a1 and b1 of a fitted head with 90 % intervals.

The covariance of all fitted parameters is Eq. (2) of docs/explanation/identification.md,

    Cov(θ̂) = (JᵀJ)⁻¹ JᵀS J (JᵀJ)⁻¹,                                                                              (2)

with ``J`` the whitened Jacobian and ``S = s² I``; ``s²`` is 1 if the residuals are noise alone, and larger if not. If
conditions scatter by significantly more, `robust_errors` tells by how much.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from inkjet_env.identification import Estimate
from inkjet_env.identification.outcome import QUANTILE_90
from inkjet_env.mismatch.selection.clustered_errors import robust_errors
from inkjet_env.mismatch.selection.hypotheses import Hypothesis
from inkjet_env.typing import Real

SINGULAR = 1e-9
"""Share of a matrix's largest singular value, or of its largest column's norm, below which a value counts as zero."""


def dynamics(hypothesis: Hypothesis) -> dict[str, Estimate]:
    """``a0, a1, b1`` of a hypothesis's head with their intervals, all other parameters free.

    Intervals are computed for the logarithm and widened where residuals exceed the noise. A parameter that no recording
    identifies has an infinite interval: without self-sensing ``b1``, whose sign is then unknown too, and without a fast
    channel all three. So have all three if the fit has not converged.

    Parameters
    ----------
    hypothesis : Hypothesis
        The fit.

    Returns
    -------
    dict of str to Estimate
        ``a0`` in 1/s², ``a1`` and ``b1`` in 1/s.
    """
    law = hypothesis.fit.head.printhead
    unidentifiable = hypothesis.joint.settings.selection.unidentifiable
    _, errors = standard_errors(hypothesis, directions_of_dynamics(hypothesis))
    if not hypothesis.fit.converged:
        errors = np.full(3, np.inf)
    return {
        "a0": _estimate(law.a0, errors[0], 0.0, unidentifiable),
        "a1": _estimate(law.a1, errors[1], 0.0, unidentifiable),
        "b1": _estimate(law.b1, errors[2], -math.inf, unidentifiable),
    }


def directions_of_dynamics(hypothesis: Hypothesis) -> Real:
    """``ln a0``, ``ln a1`` and ``ln b1`` as combinations of all fitted parameters, shape (3, p)."""
    fit = hypothesis.fit
    head, d = fit.head, fit.head.degree
    directions = np.zeros((3, head.size + fit.active.theta.size))
    directions[0, d] = directions[1, d + 1] = 1.0
    if "self_sensing" in head.gains:
        # Law and gains share a scale, set by the law's swing: b1 is as uncertain as both together.
        directions[2, :d] = 1 / float(head.printhead.branch_law.Q(1.0))
        if "self_sensing" in head.free_gains:
            directions[2, d + 2 + head.free_gains.index("self_sensing")] = 1.0
    return directions


def standard_errors(hypothesis: Hypothesis, directions: Real) -> tuple[Real, Real]:
    """Standard errors by Eq. (2), and those that hold where the model is slightly wrong, shape (k,) each.

    Parameters
    ----------
    hypothesis : Hypothesis
        The fit.
    directions : ndarray, shape (k, p)
        Combinations of the base parameters' step and the effects' coordinates.

    Returns
    -------
    classical, robust : ndarray, shape (k,)
        Infinite, the latter, where the recordings do not determine a combination.
    """
    joint = hypothesis.joint
    columns, basis = sensitivities_of_all(hypothesis)
    weights, unknown = _weights(columns, directions, joint.settings.selection.unidentifiable)
    classical = loudness(hypothesis) * np.linalg.norm(weights, axis=1)  # Eq. (2)
    errors = robust_errors(classical, weights, basis, hypothesis.predicted, joint.settings.selection)
    errors[unknown] = np.inf
    return classical, errors


def sensitivities_of_all(hypothesis: Hypothesis) -> tuple[Real, Real]:
    """Whitened sensitivities to all fitted parameters, shape (q, p), in the coordinates of a basis, shape (rows, q)."""
    q, r = hypothesis.joint.basis
    jacobian = hypothesis.fit.jacobian
    across = q.T @ jacobian
    further, beyond = np.linalg.qr(jacobian - q @ across)
    zeros = np.zeros((beyond.shape[0], hypothesis.fit.head.size))
    return np.block([[r, across], [zeros, beyond]]), np.hstack([q, further])


def loudness(hypothesis: Hypothesis) -> float:
    """Ratio of residuals to noise, at least 1: ``s`` of Eq. (2)."""
    freedom = max(hypothesis.residuals.size - hypothesis.columns.shape[1], 1)
    return math.sqrt(max(1.0, 2 * hypothesis.fit.nll / freedom))


def _estimate(value: float, error: float, least: float, unidentifiable: float) -> Estimate:
    """A value with its interval, from its logarithm's standard error; ``least`` … ∞ if it is not identifiable."""
    if error > unidentifiable:
        return Estimate(value, least, math.inf)
    ends = (value * math.exp(-QUANTILE_90 * error), value * math.exp(QUANTILE_90 * error))
    return Estimate(value, min(ends), max(ends))


def _weights(columns: Real, directions: Real, unidentifiable: float) -> tuple[Real, NDArray[np.bool_]]:
    """Combinations of rows that estimate each direction, shape (k, rows), and which cannot be identified, shape (k,).

    ``columns`` (rows, p) is the Jacobian or its triangle, ``directions`` (k, p) are combinations of the parameters.
    """
    size = np.linalg.norm(columns, axis=0)
    determined = size > SINGULAR * size.max()
    scaled, aims = columns[:, determined] / size[determined], directions[:, determined] / size[determined]
    _, values, axes = np.linalg.svd(scaled)
    least = SINGULAR * values.max(initial=0.0)
    across = axes[np.count_nonzero(values > least) :]  # directions that the columns do not determine, within rounding
    beyond = np.linalg.norm(aims @ across.T, axis=1) > unidentifiable * least
    unknown = beyond | directions[:, ~determined].any(axis=1) | ~directions.any(axis=1)
    return aims @ np.linalg.pinv(scaled, rcond=SINGULAR), unknown
