"""Mean ranks of optimisers over problems, and how far the runs and the problems determine them.

Two questions are kept apart. *On these problems*, is one optimiser better than another? The runs are resampled and the
ranking is made anew each time. *On problems like these in general?* There the problems are the sample, and few of them
prove little: the Friedman test and Nemenyi's critical difference say how little (Demšar, JMLR 7 (2006) 1).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.estimate import Estimate
from inkjet_env.typing import Real

CONFIDENCE = 0.95
RESAMPLES = 10_000
RESOLUTION_V = 1e-6
"""Regrets that differ by less are ties: nobody measures a microvolt of peak cost."""
ENOUGH_PROBLEMS = 5
"""To be a sample of problems: what Friedman's test or a posterior tells of fewer could not be relied on."""


@dataclass(frozen=True)
class MeanRank:
    """Mean rank of one optimiser over the problems, and what other runs of all might have made of it.

    Parameters
    ----------
    estimate : Estimate
        Mean rank, 1 is best, with its 95 % bootstrap interval.
    tied_with_winner : bool
        Whether resampling the runs leaves open which of the two has the better mean rank; True of the winner itself.
    """

    estimate: Estimate
    tied_with_winner: bool


def median_interval(values: ArrayLike, rng: np.random.Generator) -> Estimate:
    """Median of ``values``, shape (n,), and its 95 % percentile-bootstrap interval; NaN ends of a single value."""
    from scipy.stats import bootstrap

    values = np.asarray(values, dtype=np.float64)
    if values.size < 2:
        return Estimate(float(np.median(values)), math.nan, math.nan)
    found = bootstrap(
        (values,),
        np.median,
        confidence_level=CONFIDENCE,
        method="percentile",  # BCa breaks down for a median among ties
        n_resamples=2000,
        rng=rng,
    ).confidence_interval
    return Estimate(float(np.median(values)), float(found.low), float(found.high))


def mean_ranks(medians_V: ArrayLike) -> Real:
    """Mean over problems of each optimiser's rank; regrets within a microvolt share a rank.

    Parameters
    ----------
    medians_V : array_like, shape (..., optimisers, problems)
        Median regrets in volts.

    Returns
    -------
    ndarray, shape (..., optimisers)

    Examples
    --------
    >>> mean_ranks([[0.0, 1.0], [1.0, 1.0], [2.0, 0.0]])
    array([1.75, 2.25, 2.  ])
    """
    from scipy.stats import rankdata

    return rankdata(np.round(np.asarray(medians_V) / RESOLUTION_V), axis=-2).mean(axis=-1)


def resampled_mean_ranks(regrets_V: Real, rng: np.random.Generator, resamples: int = RESAMPLES) -> Real:
    """Mean ranks of rankings made from resampled runs, shape (resamples, optimisers).

    Parameters
    ----------
    regrets_V : ndarray, shape (optimisers, problems, runs)
        Final regrets in volts.
    rng : Generator
        Draws the runs.
    resamples : int
        How many rankings are made.
    """
    optimizers, problems, runs = regrets_V.shape
    medians_V = np.empty((resamples, optimizers, problems))
    for i in range(optimizers):
        for j in range(problems):
            medians_V[:, i, j] = np.median(rng.choice(regrets_V[i, j], (resamples, runs)), axis=1)
    return mean_ranks(medians_V)


def mean_rank_intervals(regrets_V: Mapping[str, ArrayLike], rng: np.random.Generator) -> dict[str, MeanRank]:
    """Mean rank of each optimiser with its interval, in the order given.

    Parameters
    ----------
    regrets_V : mapping of str to array_like, shape (problems, runs)
        Final regrets in volts of each optimiser.
    rng : Generator
        Draws the runs.

    Notes
    -----
    Another optimiser is told from the winner where it ranks behind in all but ``0.05 / (optimisers − 1)`` of the
    resampled rankings (Bonferroni: the chance of one false distinction among all is about 5 %; the winner comes from
    the same runs, which of eighteen optimisers that are equal made it 3 to 9 %).
    """
    values_V = np.array(list(regrets_V.values()), dtype=np.float64)
    means = mean_ranks(np.median(values_V, axis=2))
    resampled = resampled_mean_ranks(values_V, rng)
    low, high = np.percentile(resampled, [50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE)], axis=0)
    level = (1 - CONFIDENCE) / max(1, len(means) - 1)
    not_behind = np.mean(resampled <= resampled[:, [np.argmin(means)]], axis=0)
    return {
        name: MeanRank(Estimate(float(means[i]), float(low[i]), float(high[i])), bool(not_behind[i] > level))
        for i, name in enumerate(regrets_V)
    }


def friedman_and_nemenyi(medians_V: Real) -> tuple[float, float]:
    """Friedman's p value and Nemenyi's critical difference of mean ranks at 5 %.

    NaN with fewer than three optimisers or `ENOUGH_PROBLEMS` problems.

    Parameters
    ----------
    medians_V : ndarray, shape (optimisers, problems)
        Median regrets in volts.
    """
    from scipy.stats import friedmanchisquare, studentized_range

    optimizers, problems = medians_V.shape
    if optimizers < 3 or problems < ENOUGH_PROBLEMS:
        return math.nan, math.nan
    rounded = np.round(medians_V / RESOLUTION_V)
    if (rounded == rounded[0]).all():
        return 1.0, math.nan
    critical = studentized_range.ppf(CONFIDENCE, optimizers, np.inf) / math.sqrt(2)
    difference = critical * math.sqrt(optimizers * (optimizers + 1) / (6 * problems))
    return float(friedmanchisquare(*rounded).pvalue), float(difference)
