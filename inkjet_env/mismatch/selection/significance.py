"""Whether what an effect explains may be chance: by independent noise, and by its scatter between conditions."""

from __future__ import annotations

import numpy as np

from inkjet_env.mismatch.selection.clustered_errors import scatter_p_value
from inkjet_env.mismatch.selection.cross_validation import predicted
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, conditions
from inkjet_env.mismatch.selection.score_test import ScoreTest


def stands_out(without: Hypothesis, with_it: Hypothesis, tried: int) -> bool:
    """Whether what an effect adds differs from nothing by more than noise, and by more than it scatters.

    Where noise is not independent, as that of a coarse converter or of a slow drift, it may favour an effect in one
    condition by chance, far beyond what independent noise allows, but not in several by the same size. A gain beyond
    any doubt about the noise needs no such test.

    Parameters
    ----------
    without, with_it : Hypothesis
        Without the effect and with it.
    tried : int
        Number of effects of which it is the best.
    """
    settings, gain = with_it.joint.settings.selection, without.fit.nll - with_it.fit.nll
    if gain >= settings.undoubted_gain:
        return True
    free = int(np.count_nonzero(~with_it.fit.idle) - np.count_nonzero(~without.fit.idle))
    if p_value_bound(gain, max(free, 1), tried) > settings.significance_level:
        return False
    added = without.residuals - with_it.residuals
    length = float(np.linalg.norm(added))
    return scatter_p_value(length, added / length, with_it.predicted) <= settings.scatter_significance


def largest_by_scatter(base: Hypothesis, beside: ScoreTest) -> float:
    """See `Selection.scatter_p_value`."""
    scores, settings = beside.scores(base.residuals), base.joint.settings.selection
    best = int(np.argmax(np.abs(scores))) if scores.size else None
    if best is None or 0.5 * scores[best] ** 2 >= settings.undoubted_gain:
        return 0.0 if scores.size else 1.0
    direction = beside.column(best)
    rest = base.residuals - scores[best] * direction
    known = np.column_stack([base.columns, direction])
    left_out = predicted(rest, known, conditions(base.joint), settings.single_condition)
    return scatter_p_value(float(scores[best]), direction, left_out)


def p_value_bound(gain: float, parameters: int, tried: int) -> float:
    """Upper bound of the probability that the best of several tries gains as much from noise alone.

    Wilks's chi-square with Bonferroni's bound.

    Parameters
    ----------
    gain : float
        Gain in log-likelihood.
    parameters : int
        Number of free parameters that gain it.
    tried : int
        Number of tries.
    """
    from scipy.special import gammaincc

    return min(1.0, tried * float(gammaincc(parameters / 2, max(gain, 0.0))))
