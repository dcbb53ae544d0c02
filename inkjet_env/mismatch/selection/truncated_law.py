"""A branch law that is straight above some swing, which no polynomial follows; it is tried before an effect is blamed.

A ceramic whose play operators all yield below some threshold has such a law: its density p(r) ends there. It is still
the base model, with a full scale smaller than the recordings' largest swing.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from inkjet_env.mismatch.fitting.base_parameters import Head, in_convention
from inkjet_env.mismatch.fitting.fit_result import FitResult
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.selection.hypotheses import Hypothesis
from inkjet_env.plant.errors import NUMERICAL, SimulationError
from inkjet_env.typing import Real

NODES = 400
"""Number of points of the old law that the new one is fitted to."""
LEAST_SINE = 1e-5
"""Sine of the angle between what two laws can represent, below which they represent the same."""


def fit_truncated_law(joint: OutputErrorFit, chosen: Hypothesis, least: float = 0.0) -> OutputErrorFit | None:
    """The base model with a law that is straight above a smaller full scale, if it explains significantly more.

    Parameters
    ----------
    joint : OutputErrorFit
        Recordings, noise and base model.
    chosen : Hypothesis
        Hypothesis on the same recordings and noise; its effects are on when full scales are compared.
    least : float
        Least gain in log-likelihood.

    Returns
    -------
    OutputErrorFit or None
        With the best full scale. None if the residuals do not look like a bend of the law, or if no full scale gains
        more than each of ``least``, the penalty of one parameter (Schwarz's criterion), and the share of the mismatch
        by which the equations may be wrong.
    """
    settings = joint.settings.selection
    least = max(0.5 * math.log(chosen.residuals.size), settings.equation_error * chosen.gain, least)
    if max(_bend(joint, chosen, part) for part in settings.law_scales_screened) <= least:
        return None
    bends = {part: _bend(joint, chosen, part) for part in settings.law_scales}
    fits: dict[float, FitResult] = {}

    def nll(part: float) -> float:
        found = _fitted(joint, chosen, part)
        if found is None:
            return math.inf
        fits[part] = found
        return found.nll

    for part in sorted(bends, key=lambda part: -bends[part])[: settings.law_scales_fitted]:
        nll(part)
    if not fits:
        return None
    best, step = min(fits, key=lambda part: fits[part].nll), settings.law_scales[0] - settings.law_scales[1]
    limits = (best - step, min(best + step, 1.0))
    minimize_scalar(nll, bounds=limits, method="bounded", options={"xatol": settings.law_scale_tolerance})
    best = min(fits, key=lambda part: fits[part].nll)
    if chosen.fit.nll - fits[best].nll <= least:
        return None
    begun = joint.anew(head=fits[best].head)
    return joint.anew(head=in_convention(begun.base.head))


def _bend(joint: OutputErrorFit, chosen: Hypothesis, part: float) -> float:
    """Log-likelihood that laws of another full scale would gain over a hypothesis, less Schwarz's penalty.

    It is computed to first order, by projection, because a law enters linearly.
    """
    try:
        other = joint.anew(head=narrower(chosen.fit.head, part), base=joint.base)
        own, (columns, _) = chosen.columns, other.basis
    except NUMERICAL:
        return -math.inf
    for _ in range(2):  # twice, because they are nearly parallel
        columns = columns - own @ (own.T @ columns)
    u, sines, _ = np.linalg.svd(columns, full_matrices=False)
    new = u[:, sines > LEAST_SINE]
    return 0.5 * float(np.sum((new.T @ chosen.residuals) ** 2)) - 0.5 * new.shape[1] * math.log(chosen.residuals.size)


def _fitted(joint: OutputErrorFit, chosen: Hypothesis, part: float) -> FitResult | None:
    """A hypothesis fitted on from a law of another full scale; None if it cannot be simulated with that law."""
    try:
        begun = chosen.fit.moved(head=narrower(chosen.fit.head, part))
        return joint.near(begun).fit(begun.active, most_steps=joint.settings.selection.law_steps)
    except NUMERICAL:
        return None


def narrower(head: Head, part: float) -> Head:
    """The head with its full scale reduced to a share; its law is the polynomial nearest to the old one there.

    Raises
    ------
    SimulationError
        There is no valid head of this full scale.
    """
    old = head.printhead
    full_scale_V = part * old.full_scale_V
    x: Real = np.linspace(0.0, 1.0, NODES)
    swing = np.array([old.full_scale_V * old.branch_law.Q(part * at) for at in x]) / full_scale_V
    ascending = np.linalg.lstsq(x[:, None] ** np.arange(1, head.degree + 1), swing, rcond=None)[0]
    coefficients = (*(float(c) for c in ascending[::-1]), 0.0)
    try:
        return replace(head, printhead=replace(old, coefficients=coefficients, full_scale_V=full_scale_V))
    except ValueError as error:
        raise SimulationError(str(error)) from error
