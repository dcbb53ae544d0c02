"""Measures of optimisers over many instances: how soon a target is met, how good a run ends, who is better.

Everything here is arithmetic on arrays. *Runs* are repeats on one instance; *instances* are problems. What is said of
problems in general takes the instances as the sample, never the repeats.
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
"""Numbers of rows or columns that were drawn."""

CONFIDENCE = 0.95
RESAMPLES = 2000
AT_ONCE = 100
PRIOR_STRENGTH = 0.5
"""Of the pseudo-observation of no difference in `bayesian_signed_rank`, in observations; Benavoli et al.'s."""


def first_hits(best_so_far: ArrayLike, targets: ArrayLike) -> Real:
    """Evaluations after which each run has met each target, shape (runs, targets); infinite where it never did.

    Parameters
    ----------
    best_so_far : array_like, shape (runs, evaluations)
        Least regret up to each evaluation, in volts.
    targets : array_like, shape (targets,)
        Regrets, in volts.

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
    """Evaluations spent in all runs for every run that met the target; infinite where none did.

    Hansen, Auger, Ros, Mersmann, Tušar & Brockhoff, COCO, Optim. Methods Softw. 36 (2021) 114: the expected time of
    an optimiser that is begun again until it succeeds.

    Parameters
    ----------
    hits : array_like, shape (..., runs)
        From `first_hits`.
    budgets : array_like, shape (runs,) or ()
        Evaluations that each run had.

    Returns
    -------
    ndarray, shape (...)

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
    """Running times of an optimiser that is begun again until it meets the target, shape (draws,).

    Runs are drawn with replacement, and what each has spent is added, until one has succeeded (COCO, as above).
    Infinite where none ever did.
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
    """Share of (run, target, instance) triples that are met after each number of evaluations; COCO's ECDF.

    Parameters
    ----------
    times : array_like
        Running times, any shape; infinite where a target was never met.
    evaluations : array_like, shape (n,)

    Returns
    -------
    ndarray, shape (n,)
    """
    ordered = np.sort(np.ravel(np.asarray(times, dtype=np.float64)))
    share: Real = np.searchsorted(ordered, np.asarray(evaluations, dtype=np.float64), side="right") / ordered.size
    return share


def interquartile_mean(scores: ArrayLike) -> Real:
    """Mean of the middle half of all runs on all instances, shape (..., runs, instances); the last two are one sample.

    Agarwal, Schwarzer, Castro, Courville & Bellemare, NeurIPS 34 (2021): less moved by single runs than a mean, and
    tells more than a median. A quarter of the values, rounded down, is cut off at either end, as they do.

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
    """Chance that a run of the first ends lower than one of the second, on an instance drawn at random.

    Ties count half. Agarwal et al., as above: the mean over instances of the Mann–Whitney statistic.

    Parameters
    ----------
    first, second : array_like, shape (..., runs, instances)
        Regrets: less is better. The numbers of runs may differ.

    Returns
    -------
    ndarray, shape (...)
    """
    a, b = (np.asarray(scores, dtype=np.float64) for scores in (first, second))
    mine, theirs = a[..., :, None, :], b[..., None, :, :]
    axes = (-3, -2, -1)
    better: Real = (mine < theirs).mean(axis=axes) + 0.5 * (mine == theirs).mean(axis=axes)
    return better


def performance_profile(scores: ArrayLike, levels: ArrayLike) -> Real:
    """Share of runs on all instances that end at or below each level, shape (levels,).

    The distribution of run scores of Agarwal et al., as above, for scores of which less is better.
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
        Of as many arrays (..., runs, instances) as there are samples: an array (...).
    samples : sequence of array_like, shape (runs, instances) each
    rng : Generator
    resamples : int
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
    """A statistic of a table in which every row met every column, with an interval for other rows and other columns.

    Rows and columns are drawn with replacement, each by itself (Owen, The pigeonhole bootstrap, Ann. Appl. Stat. 1
    (2007) 386). Few of them would cover too seldom, so percentiles lie as far out as Student's distribution and the
    n - 1 of a variance ask for (Hesterberg's expanded percentiles, Am. Stat. 69 (2015) 371), with n the fewest; where
    the many decide, that is more than 95 %. No interval is wider than what there is: where five rows or fewer decide,
    it covers too seldom all the same. A single row is given, and the interval is over columns alone.

    Parameters
    ----------
    statistic : callable
        Of as many int arrays as there are axes: numbers of rows, of columns, each of which may come several times.
    shape : tuple of int
        How many of each; of one axis at least 2.
    rng : Generator
    resamples : int
    """
    value = statistic(*(np.arange(count) for count in shape))
    drawn = np.array([statistic(*(rng.integers(0, count, count) for count in shape)) for _ in range(resamples)])
    tail = 100 * _expanded_tail(min(count for count in shape if count > 1))
    low, high = np.percentile(drawn, [tail, 100 - tail], method="inverted_cdf")
    return Estimate(value, float(low), float(high))


def _expanded_tail(count: int) -> float:
    """Share of resamples beyond either end of an interval from so many; the normal tail where they are many."""
    from scipy.special import ndtr, stdtrit

    return float(ndtr(-math.sqrt(count / (count - 1)) * stdtrit(count - 1, (1 + CONFIDENCE) / 2)))


def _parts(resamples: int) -> list[int]:
    """So many at a time: arrays stay small."""
    return [min(AT_ONCE, resamples - begun) for begun in range(0, resamples, AT_ONCE)]


def _resampled(values: Real, rng: np.random.Generator, count: int) -> Real:
    """Runs drawn with replacement, for each instance by itself, shape (count, runs, instances)."""
    drawn: Real = np.take_along_axis(values[None], rng.integers(0, len(values), (count, *values.shape)), axis=1)
    return drawn


@dataclass(frozen=True)
class SignedRank:
    """Posterior probabilities that the first is better over all such instances, both are alike, the second is better.

    Better in the sense of Wilcoxon's test: of the mean of two instances' differences. It is no chance of being better
    on the next instance.
    """

    first: float
    alike: float
    second: float


def bayesian_signed_rank(
    first: ArrayLike, second: ArrayLike, alike: float, rng: np.random.Generator, draws: int = 20_000
) -> SignedRank:
    """Bayesian signed-rank test over instances.

    Benavoli, Corani, Demšar & Zaffalon, J. Mach. Learn. Res. 18 (2017) 77, section 4.2: a Dirichlet process over the
    differences, with a pseudo-observation of none; in each draw the largest of three shares of pairs of instances wins
    (the mean of the two differences is better, within ``alike``, or worse).

    Parameters
    ----------
    first, second : array_like, shape (instances,)
        One number an instance, such as the median regret: less is better.
    alike : float
        Difference that does not matter, at least 0.
    rng : Generator
    draws : int
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
