"""Measures of optimisers over many instances: time to a target, quality of the final result, pairwise comparison.

Everything here is arithmetic on arrays. *Runs* are repeats on one instance; *instances* are problems. Statements about
problems in general take the instances as the sample, never the repeats.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkjet_env.estimate import Estimate
from inkjet_env.typing import Real

Places = NDArray[np.int64]
"""Indices of the rows or columns that were drawn."""

CONFIDENCE = 0.95
RESAMPLES = 2000
AT_ONCE = 100
PRIOR_STRENGTH = 0.5
"""Weight of the pseudo-observation of no difference in `bayesian_signed_rank`, in observations (Benavoli et al.)."""


def first_hits(best_so_far: ArrayLike, targets: ArrayLike) -> Real:
    """Number of evaluations after which each run meets each target, shape (runs, targets); infinite if it never does.

    Parameters
    ----------
    best_so_far : array_like, shape (runs, evaluations)
        Lowest regret up to each evaluation, in volts.
    targets : array_like, shape (targets,)
        Target regrets in volts.

    Examples
    --------
    >>> first_hits([[5.0, 2.0, 2.0, 0.5]], [3.0, 0.5, 0.1])
    array([[ 2.,  4., inf]])
    """
    curves = np.asarray(best_so_far, dtype=np.float64)
    met = curves[:, None, :] <= np.asarray(targets, dtype=np.float64)[None, :, None]
    hits: Real = np.where(met.any(axis=2), met.argmax(axis=2) + 1.0, math.inf)
    return hits


def expected_running_time(hits: ArrayLike, budgets: ArrayLike) -> Real:
    """Evaluations of all runs together per run that met the target; infinite if none did.

    Hansen, Auger, Ros, Mersmann, Tušar & Brockhoff, COCO, Optim. Methods Softw. 36 (2021) 114: the expected time of
    an optimiser that is restarted until it succeeds.

    Parameters
    ----------
    hits : array_like, shape (..., runs)
        Evaluations to the target, from `first_hits`.
    budgets : array_like, shape (runs,) or ()
        Budget of each run in evaluations.

    Returns
    -------
    ndarray, shape (...)
        Expected running time in evaluations.

    Examples
    --------
    >>> float(expected_running_time([10.0, math.inf, 30.0], 100))
    70.0
    """
    found = np.asarray(hits, dtype=np.float64)
    successes = np.isfinite(found).sum(axis=-1)
    spent = np.minimum(found, budgets).sum(axis=-1)
    time: Real = np.where(successes > 0, spent / np.maximum(successes, 1), math.inf)
    return time


def simulated_restarts(hits: ArrayLike, budgets: ArrayLike, rng: np.random.Generator, draws: int = RESAMPLES) -> Real:
    """Running times in evaluations of an optimiser that is restarted until it meets the target, shape (draws,).

    Runs are drawn with replacement and their evaluations added until one succeeds (COCO, as above). Infinite if no
    run ever does.
    """
    found = np.atleast_1d(np.asarray(hits, dtype=np.float64))
    spent = np.minimum(found, budgets)
    success = np.isfinite(found)
    if not success.any():
        return np.full(draws, math.inf)
    total, going = np.zeros(draws), np.arange(draws)
    while going.size:
        drawn = rng.integers(0, found.size, going.size)
        total[going] += spent[drawn]
        going = going[~success[drawn]]
    return total


def running_time_distribution(times: ArrayLike, evaluations: ArrayLike) -> Real:
    """Fraction of (run, target, instance) triples met after each number of evaluations; COCO's ECDF.

    Parameters
    ----------
    times : array_like
        Running times in evaluations, any shape; infinite where a target was never met.
    evaluations : array_like, shape (n,)
        Numbers of evaluations.

    Returns
    -------
    ndarray, shape (n,)
        Fraction of the triples, 0 to 1.
    """
    ordered = np.sort(np.ravel(np.asarray(times, dtype=np.float64)))
    share: Real = np.searchsorted(ordered, np.asarray(evaluations, dtype=np.float64), side="right") / ordered.size
    return share


def interquartile_mean(scores: ArrayLike) -> Real:
    """Mean of the middle half of all runs on all instances, shape (..., runs, instances), over the last two axes.

    Agarwal, Schwarzer, Castro, Courville & Bellemare, NeurIPS 34 (2021): less sensitive to single runs than the mean,
    and more efficient than the median. As there, a quarter of the values, rounded down, is cut off at either end.

    Examples
    --------
    >>> float(interquartile_mean([[0.0, 1.0], [2.0, 99.0]]))
    1.5
    """
    values = np.asarray(scores, dtype=np.float64)
    flat = np.sort(values.reshape(*values.shape[:-2], -1), axis=-1)
    cut = flat.shape[-1] // 4
    mean: Real = flat[..., cut : flat.shape[-1] - cut].mean(axis=-1)
    return mean


def probability_of_improvement(first: ArrayLike, second: ArrayLike) -> Real:
    """Probability that a run of the first ends lower than one of the second on a random instance.

    Ties count half. Agarwal et al., as above: the mean over instances of the Mann–Whitney statistic.

    Parameters
    ----------
    first, second : array_like, shape (..., runs, instances)
        Regrets: lower is better. The numbers of runs may differ.

    Returns
    -------
    ndarray, shape (...)
        Probability, 0 to 1.
    """
    a, b = (np.asarray(scores, dtype=np.float64) for scores in (first, second))
    mine, theirs = a[..., :, None, :], b[..., None, :, :]
    axes = (-3, -2, -1)
    better: Real = (mine < theirs).mean(axis=axes) + 0.5 * (mine == theirs).mean(axis=axes)
    return better


def performance_profile(scores: ArrayLike, levels: ArrayLike) -> Real:
    """Fraction of runs on all instances that end at or below each level, shape (levels,).

    The run-score distribution of Agarwal et al., as above, for scores where lower is better.
    """
    return running_time_distribution(scores, levels)


def stratified_bootstrap(
    statistic: Callable[..., Real],
    samples: Sequence[ArrayLike],
    rng: np.random.Generator,
    resamples: int = RESAMPLES,
) -> Estimate:
    """A statistic of runs on given instances and its 95 % percentile interval; runs are drawn within each instance.

    Parameters
    ----------
    statistic : callable
        Maps one array of shape (..., runs, instances) per sample to an array of shape (...).
    samples : sequence of array_like, shape (runs, instances) each
        Scores of one or more optimisers.
    rng : Generator
        Draws the runs.
    resamples : int
        Number of bootstrap resamples.
    """
    arrays = [np.asarray(sample, dtype=np.float64) for sample in samples]
    value = float(statistic(*arrays))
    if any(len(array) < 2 for array in arrays):
        return Estimate(value, math.nan, math.nan)
    drawn = np.concatenate([statistic(*(_resampled(a, rng, some) for a in arrays)) for some in _parts(resamples)])
    tails = 50 * (1 - CONFIDENCE)
    # a resample without any success is infinitely bad: ranks are taken, nothing between them
    low, high = np.percentile(drawn, [tails, 100 - tails], method="inverted_cdf")
    return Estimate(value, float(low), float(high))


def crossed_bootstrap(
    statistic: Callable[..., float], shape: tuple[int, ...], rng: np.random.Generator, resamples: int = RESAMPLES
) -> Estimate:
    """A statistic of a fully crossed table, with an interval that generalises to other rows and other columns.

    Rows and columns are drawn with replacement, independently (Owen, The pigeonhole bootstrap, Ann. Appl. Stat. 1
    (2007) 386). With few of them the interval would undercover, so the percentiles are widened according to Student's
    distribution and the n - 1 of a variance (Hesterberg's expanded percentiles, Am. Stat. 69 (2015) 371), with n the
    smaller of the two counts; if the larger axis dominates, the coverage exceeds 95 %. No interval is wider than the
    range of the resamples: if five rows or fewer dominate, it still undercovers. A single row is taken as fixed, and
    the interval is over columns alone.

    Parameters
    ----------
    statistic : callable
        Maps one int array per axis (indices of rows, of columns, possibly repeated) to a number.
    shape : tuple of int
        Number of rows, columns and so on; at least one of them is 2 or more.
    rng : Generator
        Draws rows and columns.
    resamples : int
        Number of bootstrap resamples.
    """
    value = statistic(*(np.arange(count) for count in shape))
    drawn = np.array([statistic(*(rng.integers(0, count, count) for count in shape)) for _ in range(resamples)])
    tail = 100 * _expanded_tail(min(count for count in shape if count > 1))
    low, high = np.percentile(drawn, [tail, 100 - tail], method="inverted_cdf")
    return Estimate(value, float(low), float(high))


def _expanded_tail(count: int) -> float:
    """Fraction of resamples beyond either end of an interval from ``count`` samples; the normal tail for many."""
    from scipy.special import ndtr, stdtrit

    return float(ndtr(-math.sqrt(count / (count - 1)) * stdtrit(count - 1, (1 + CONFIDENCE) / 2)))


def _parts(resamples: int) -> list[int]:
    """Sizes of the batches in which the resamples are drawn, so that arrays stay small."""
    return [min(AT_ONCE, resamples - begun) for begun in range(0, resamples, AT_ONCE)]


def _resampled(values: Real, rng: np.random.Generator, count: int) -> Real:
    """Runs drawn with replacement within each instance, shape (count, runs, instances)."""
    drawn: Real = np.take_along_axis(values[None], rng.integers(0, len(values), (count, *values.shape)), axis=1)
    return drawn


@dataclass(frozen=True)
class SignedRank:
    """Posterior probabilities, over all such instances, that the first is better, both are alike, the second is better.

    "Better" is meant as in Wilcoxon's test: by the mean of two instances' differences. It is not the probability of
    being better on the next instance.
    """

    first: float
    alike: float
    second: float


def bayesian_signed_rank(
    first: ArrayLike, second: ArrayLike, alike: float, rng: np.random.Generator, draws: int = 20_000
) -> SignedRank:
    """Bayesian signed-rank test over instances.

    Benavoli, Corani, Demšar & Zaffalon, J. Mach. Learn. Res. 18 (2017) 77, section 4.2: a Dirichlet process over the
    differences, with a pseudo-observation of zero difference. In each draw the largest of three fractions of pairs of
    instances wins (the mean of the two differences is better, within ``alike``, or worse).

    Parameters
    ----------
    first, second : array_like, shape (instances,)
        One number per instance, such as the median regret: lower is better.
    alike : float
        Difference that is practically irrelevant, at least 0, in the unit of the scores.
    rng : Generator
        Draws from the posterior.
    draws : int
        Number of posterior draws.
    """
    difference = np.concatenate([[0.0], np.asarray(second, dtype=np.float64) - np.asarray(first, dtype=np.float64)])
    pairs = difference[:, None] + difference[None, :]
    weights = rng.dirichlet([PRIOR_STRENGTH, *np.ones(difference.size - 1)], draws)
    better, worse = pairs > 2 * alike, pairs < -2 * alike
    of_first = np.einsum("di,ij,dj->d", weights, better, weights, optimize=True)
    of_second = np.einsum("di,ij,dj->d", weights, worse, weights, optimize=True)
    shares = np.column_stack([of_first, 1 - of_first - of_second, of_second])
    won = shares >= shares.max(axis=1, keepdims=True) - 1e-12
    first_, alike_, second_ = (won / won.sum(axis=1, keepdims=True)).mean(axis=0)
    return SignedRank(float(first_), float(alike_), float(second_))
