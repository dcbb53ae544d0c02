"""How well a fit knows the head's own numbers: a0, a1 and b1 with 90 % intervals."""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.identification import Estimate
from inkjet_env.identification.outcome import QUANTILE_90
from inkjet_env.mismatch.selection.hypotheses import Hypothesis
from inkjet_env.typing import Real

UNTOLD = 5.0
"""A standard error of a logarithm beyond which a value is not told at all."""
SINGULAR = 1e-9
"""Of a matrix's largest singular value, or column: what is smaller counts as nothing."""


def dynamics(hypothesis: Hypothesis) -> dict[str, Estimate]:
    """``a0, a1, b1`` of a hypothesis's head, everything else fitted along.

    Intervals are those of the logarithm, widened where more than noise is left. What no recording tells has an infinite
    interval: ``b1``, whose sign is then unknown too, without self-sensing, and all three without a fast channel. So
    does all of a fit that has not converged.
    """
    fit, joint = hypothesis.fit, hypothesis.joint
    head = fit.head
    law, d = head.printhead, head.degree
    directions = np.zeros((3, head.size + fit.active.theta.size))
    directions[0, d] = directions[1, d + 1] = 1.0
    if "self_sensing" in head.gains:
        # Law and gains share a scale, set by the law's swing: b1 is as sure as both together.
        directions[2, :d] = 1 / float(law.branch_law.Q(1.0))
        if "self_sensing" in head.free_gains:
            directions[2, d + 2 + head.free_gains.index("self_sensing")] = 1.0
    q, r = joint.basis
    across = q.T @ fit.jacobian
    _, beyond = np.linalg.qr(fit.jacobian - q @ across)
    columns = np.block([[r, across], [np.zeros((beyond.shape[0], head.size)), beyond]])
    loud = max(1.0, 2 * fit.nll / max(hypothesis.residuals.size - hypothesis.columns.shape[1], 1))
    errors = np.sqrt(loud) * _errors(columns, directions) if fit.converged else np.full(3, np.inf)
    return {
        "a0": _estimate(law.a0, errors[0], 0.0),
        "a1": _estimate(law.a1, errors[1], 0.0),
        "b1": _estimate(law.b1, errors[2], -math.inf),
    }


def _estimate(value: float, error: float, least: float) -> Estimate:
    """A value and its interval, from its logarithm's standard error; all from ``least`` on where it is not told."""
    if error > UNTOLD:
        return Estimate(value, least, math.inf)
    ends = (value * math.exp(-QUANTILE_90 * error), value * math.exp(QUANTILE_90 * error))
    return Estimate(value, min(ends), max(ends))


def _errors(columns: Real, directions: Real) -> Real:
    """Standard error of each direction, shape (k,); infinite of one that nothing tells."""
    size = np.linalg.norm(columns, axis=0)
    told = size > SINGULAR * size.max()
    scaled, aims = columns[:, told] / size[told], directions[:, told] / size[told]
    result: Real = np.linalg.norm(aims @ np.linalg.pinv(scaled, rcond=SINGULAR), axis=1)
    _, values, axes = np.linalg.svd(scaled)
    least = SINGULAR * values.max(initial=0.0)
    across = axes[np.count_nonzero(values > least) :]  # what no combination of the columns tells, as good as nothing
    beyond = np.linalg.norm(aims @ across.T, axis=1) > UNTOLD * least
    result[beyond | directions[:, ~told].any(axis=1) | ~directions.any(axis=1)] = np.inf
    return result
