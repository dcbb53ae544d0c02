"""Intervals of values over which the likelihood is rugged, such as the interval at which a generator updates.

Its updates jump from node to node of the simulation. So the likelihood's derivative says little about how far such a
value may be off, and finer nodes may move it by more than noise does.
"""

from __future__ import annotations

import numpy as np

from inkjet_env.mismatch.fitting.dataset import finer
from inkjet_env.mismatch.selection.hypotheses import Hypothesis
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.typing import Real


def rugged_reaches(chosen: Hypothesis, reaches: Real, quantile: float) -> Real:
    """Half-widths of the intervals of a hypothesis's coordinates, shape (k,), wider where the likelihood is rugged.

    The others held, the log-likelihood falls by half the squared quantile within the half-width, on one side at least.
    Added to it is how far the value would move with twice as many nodes. Nowhere is it narrower than ``reaches``, in
    which the others are free.

    Parameters
    ----------
    chosen : Hypothesis
        The hypothesis.
    reaches : ndarray, shape (k,)
        Half-widths by the derivatives.
    quantile : float
        Quantile of the normal distribution to which they belong.
    """
    active = chosen.fit.active
    rugged = [
        place
        for place, (effect, parameter) in enumerate(active.parameters)
        if parameter.name in effect.rugged and not chosen.fit.idle[place] and 0 < reaches[place] < np.inf
    ]
    if not rugged:
        return reaches
    found = reaches.copy()
    for place in rugged:
        found[place] *= _widening(chosen, place, reaches[place], quantile)
    return found + _numerical_shift(chosen)


def _widening(chosen: Hypothesis, place: int, reach: float, quantile: float) -> float:
    """Largest multiple of a half-width at which the log-likelihood, the others held, is not yet too low; at least 1."""
    active = chosen.fit.active
    low, high = chosen.joint.limits(active.effects)

    def gain(distance: float) -> float:
        theta = active.theta.copy()
        theta[place] = np.clip(theta[place] + distance, low[place], high[place])
        try:
            return chosen.fit.nll - chosen.joint.fit(active.at(theta), chosen.fit.head, most_steps=0).nll
        except NUMERICAL:
            return -np.inf

    multiples = np.geomspace(1.0, chosen.joint.settings.selection.most_rugged_reach, 9)
    gains = {side * m: gain(side * m * reach) for side in (-1.0, 1.0) for m in multiples}
    least = max(0.0, *gains.values()) - 0.5 * quantile**2
    return max([1.0, *(abs(m) for m, one in gains.items() if one >= least)])


def _numerical_shift(chosen: Hypothesis) -> Real:
    """How far each coordinate would move with twice as many nodes per sample, to first order, shape (k,)."""
    joint, fit = chosen.joint, chosen.fit
    moved = np.zeros(fit.jacobian.shape[1])
    here = joint.signals(fit.end, joint.seen)
    try:
        there = joint.signals(fit.end, finer(joint.seen, 2 * joint.seen[0].excitation.substeps))
    except NUMERICAL:
        return moved
    change = joint.stacked({o.name: here[o.name] - there[o.name] for o in joint.seen}, fit.active.pairs)
    free, (q, _) = np.flatnonzero(~fit.idle), joint.basis
    jacobian = fit.jacobian[:, free] - q @ (q.T @ fit.jacobian[:, free])
    moved[free] = np.abs(np.linalg.lstsq(jacobian, change - q @ (q.T @ change), rcond=1e-9)[0])
    return moved
