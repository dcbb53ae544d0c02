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


def dynamics(hypothesis: Hypothesis) -> dict[str, Estimate]:
    """``a0, a1, b1`` of a hypothesis's head, everything else fitted along.

    Intervals are those of the logarithm, widened where more than noise is left. What no recording tells has an interval
    that is its value alone: ``b1`` without self-sensing, and all three without a fast channel.
    """
    fit, joint = hypothesis.fit, hypothesis.joint
    head = fit.head
    law, d = head.printhead, head.degree
    directions = np.zeros((3, head.size + fit.point.size))
    directions[0, d] = directions[1, d + 1] = 1.0
    if "self_sensing" in head.gains:
        # Law and gains share a scale, set by the law's swing: b1 is as sure as both together.
        directions[2, :d] = 1 / float(law.branch_law.Q(1.0))
        if "self_sensing" in head.free_gains:
            directions[2, d + 2 + head.free_gains.index("self_sensing")] = 1.0
    q, r = joint.basis
    across = q.T @ fit.slopes
    _, beyond = np.linalg.qr(fit.slopes - q @ across)
    columns = np.block([[r, across], [np.zeros((beyond.shape[0], head.size)), beyond]])
    loud = max(1.0, 2 * fit.nll / max(hypothesis.left.size - hypothesis.columns.shape[1], 1))
    errors = np.sqrt(loud) * _errors(columns, directions)
    errors[errors > UNTOLD] = 0.0
    values = {"a0": law.a0, "a1": law.a1, "b1": law.b1}
    return {
        name: Estimate(value, value * math.exp(-QUANTILE_90 * error), value * math.exp(QUANTILE_90 * error))
        for (name, value), error in zip(values.items(), errors, strict=True)
    }


def _errors(columns: Real, directions: Real) -> Real:
    """Standard error of each direction, shape (k,); 0 of one that nothing tells."""
    size = np.linalg.norm(columns, axis=0)
    told = size > 1e-9 * size.max()
    inverse = np.linalg.pinv(columns[:, told] / size[told], rcond=1e-9)
    result: Real = np.linalg.norm((directions[:, told] / size[told]) @ inverse, axis=1)
    return result
