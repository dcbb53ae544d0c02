"""Mean ranks of optimisers over problems, with the uncertainty due to the runs and to the problems.

There are two separate questions. *On these problems*, is one optimiser better than another? The runs are resampled and
ranked again each time. *On problems like these in general?* Then the problems are the sample, and few of them prove
little: the Friedman test and Nemenyi's critical difference quantify how little (Demšar, JMLR 7 (2006) 1).
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
"""Regrets in volts that differ by less are ties: a microvolt of peak cost cannot be measured."""
ENOUGH_PROBLEMS = 5
"""Smallest number of problems taken as a sample: with fewer, Friedman's test or a posterior would be unreliable."""


@dataclass(frozen=True)
class MeanRank:
    """Mean rank of one optimiser over the problems, with the uncertainty due to the runs.

    Parameters
    ----------
    estimate : Estimate
        Mean rank, 1 is best, with its 95 % bootstrap interval.
    tied_with_winner : bool
        Whether, after resampling the runs, either of the two may have the better mean rank; True for the winner.
    """

    estimate: Estimate
    tied_with_winner: bool


def median_interval(values: ArrayLike, rng: np.random.Generator) -> Estimate:
    """Median of ``values``, shape (n,), and its 95 % percentile-bootstrap interval, NaN for a single value."""
    from scipy.stats import bootstrap

    values = np.asarray(values, dtype=np.float64)
    if values.size < 2:
        return Estimate(float(np.median(values)), math.nan, math.nan)
    found = bootstrap(
        (values,),
        np.median,
        confidence_level=CONFIDENCE,
        method="percentile",  # BCa fails for a median among ties
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
        Mean rank of each optimiser; 1 is best.

    Examples
    --------
    >>> mean_ranks([[0.0, 1.0], [1.0, 1.0], [2.0, 0.0]])
    array([1.75, 2.25, 2.  ])
    """
    from scipy.stats import rankdata

    return rankdata(np.round(np.asarray(medians_V) / RESOLUTION_V), axis=-2).mean(axis=-1)


def resampled_mean_ranks(regrets_V: Real, rng: np.random.Generator, resamples: int = RESAMPLES) -> Real:
    """Mean ranks computed from resampled runs, shape (resamples, optimisers).

    Parameters
    ----------
    regrets_V : ndarray, shape (optimisers, problems, runs)
        Final regrets in volts.
    rng : Generator
        Draws the runs.
    resamples : int
        Number of bootstrap resamples.
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
    Another optimiser is distinguished from the winner if it ranks behind in all but ``0.05 / (optimisers − 1)`` of the
    resampled rankings (Bonferroni: the probability of one false distinction among all is about 5 %. The winner is
    chosen from the same runs; with eighteen equal optimisers the probability was 3 to 9 %).
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
    """Friedman's p-value and Nemenyi's critical difference of mean ranks at 5 %.

    The critical difference of m optimisers on N problems is Eq. (2) of docs/explanation/statistics.md::

        CD = q sqrt(m (m + 1) / (6 N))        (2)

    with the Studentised range statistic q divided by √2. Both results are NaN with fewer than three optimisers or fewer
    than `ENOUGH_PROBLEMS` problems.

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
    difference = critical * math.sqrt(optimizers * (optimizers + 1) / (6 * problems))  # Eq. (2)
    return float(friedmanchisquare(*rounded).pvalue), float(difference)
