"""What the runs of a comparison allow one to say: regrets, ranks, their uncertainty, and that in a sentence.

Two questions are kept apart. *On these problems*, is one optimiser better than another? The runs are resampled and the
ranking made anew each time. *On problems like these in general?* There the problems are the sample, and few of them
prove little: the Friedman test and Nemenyi's critical difference say how little (Demšar, JMLR 7 (2006) 1).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from experiments.benchmark.regret import final_regrets
from experiments.benchmark.settings import BenchOutcome
from inkjet_env.typing import Real

CONFIDENCE = 0.95
RESAMPLES = 10_000
RESOLUTION_V = 1e-6
"""Regrets that differ by less are ties: nobody measures a microvolt of peak cost."""
ENOUGH_PROBLEMS = 5
"""To be a sample of problems: what Friedman's test or a posterior tells of fewer could not be relied on."""


@dataclass(frozen=True)
class Interval:
    """A median and its bootstrap interval; ``low`` and ``high`` are NaN where one run tells nothing of the spread."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Score:
    """One optimiser on one problem.

    Parameters
    ----------
    optimizer, problem : str
    runs : int
    regret : Interval
        Median over the runs of final best cost − best known cost, in volts.
    """

    optimizer: str
    problem: str
    runs: int
    regret: Interval


@dataclass(frozen=True)
class Standing:
    """One optimiser over all problems.

    Parameters
    ----------
    optimizer : str
    mean_rank : float
        Over the problems, of the rank of its median regret; 1 is best, ties share.
    low, high : float
        Bootstrap interval of the mean rank.
    tied_with_winner : bool
        Whether resampling the runs leaves open which of the two has the better mean rank.
    """

    optimizer: str
    mean_rank: float
    low: float
    high: float
    tied_with_winner: bool


@dataclass(frozen=True)
class Summary:
    """Everything the report tells: scores, standings from best to worst, Friedman's and Nemenyi's numbers, sentences.

    ``friedman_p`` and ``critical_difference`` are NaN with fewer than three optimisers or five problems.
    """

    scores: tuple[Score, ...]
    standings: tuple[Standing, ...]
    friedman_p: float
    critical_difference: float
    sentences: tuple[str, ...]

    @property
    def winner(self) -> str:
        """The optimiser of the best mean rank."""
        return self.standings[0].optimizer

    def score(self, optimizer: str, problem: str) -> Score | None:
        """The score of one optimiser on one problem; None where it cannot be used there."""
        return next((s for s in self.scores if (s.optimizer, s.problem) == (optimizer, problem)), None)


def median_interval(values: ArrayLike, rng: np.random.Generator) -> Interval:
    """Median of ``values``, shape (n,), and its 95 % percentile-bootstrap interval."""
    from scipy.stats import bootstrap

    values = np.asarray(values, dtype=np.float64)
    if values.size < 2:
        return Interval(float(np.median(values)), math.nan, math.nan)
    found = bootstrap(
        (values,),
        np.median,
        confidence_level=CONFIDENCE,
        method="percentile",  # BCa breaks down for a median among ties
        n_resamples=2000,
        rng=rng,
    ).confidence_interval
    return Interval(float(np.median(values)), float(found.low), float(found.high))


def mean_ranks(medians: ArrayLike) -> Real:
    """Mean over problems of each optimiser's rank; regrets within a microvolt share a rank.

    Parameters
    ----------
    medians : array_like, shape (..., optimisers, problems)
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

    return rankdata(np.round(np.asarray(medians) / RESOLUTION_V), axis=-2).mean(axis=-1)


def resampled_mean_ranks(regrets: Real, rng: np.random.Generator, resamples: int = RESAMPLES) -> Real:
    """Mean ranks of rankings made from resampled runs, shape (resamples, optimisers).

    Parameters
    ----------
    regrets : ndarray, shape (optimisers, problems, runs)
    """
    optimizers, problems, runs = regrets.shape
    medians = np.empty((resamples, optimizers, problems))
    for i in range(optimizers):
        for j in range(problems):
            medians[:, i, j] = np.median(rng.choice(regrets[i, j], (resamples, runs)), axis=1)
    return mean_ranks(medians)


def standings(regrets: Mapping[str, ArrayLike], rng: np.random.Generator) -> tuple[Standing, ...]:
    """Optimisers from the best mean rank to the worst.

    Parameters
    ----------
    regrets : mapping of str to array_like, shape (problems, runs)
        Final regrets in volts of each optimiser.

    Notes
    -----
    Another optimiser is told from the winner where it ranks behind in all but ``0.05 / (optimisers − 1)`` of the
    resampled rankings (Bonferroni: the chance of one false distinction among all is about 5 %; the winner comes from
    the same runs, which of eighteen optimisers that are equal made it 3 to 9 %).
    """
    names = list(regrets)
    values = np.array([regrets[name] for name in names], dtype=np.float64)
    means = mean_ranks(np.median(values, axis=2))
    resampled = resampled_mean_ranks(values, rng)
    low, high = np.percentile(resampled, [50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE)], axis=0)
    order = np.argsort(means, kind="stable")
    level = (1 - CONFIDENCE) / max(1, len(names) - 1)
    not_behind = np.mean(resampled <= resampled[:, order[:1]], axis=0)
    return tuple(
        Standing(names[i], float(means[i]), float(low[i]), float(high[i]), bool(not_behind[i] > level)) for i in order
    )


def friedman_and_nemenyi(medians: Real) -> tuple[float, float]:
    """Friedman's p value and Nemenyi's critical difference of mean ranks at 5 %, for medians (optimisers, problems).

    NaN with fewer than three optimisers or `ENOUGH_PROBLEMS` problems.
    """
    from scipy.stats import friedmanchisquare, studentized_range

    optimizers, problems = medians.shape
    if optimizers < 3 or problems < ENOUGH_PROBLEMS:
        return math.nan, math.nan
    rounded = np.round(medians / RESOLUTION_V)
    if (rounded == rounded[0]).all():
        return 1.0, math.nan
    critical = studentized_range.ppf(CONFIDENCE, optimizers, np.inf) / math.sqrt(2)
    difference = critical * math.sqrt(optimizers * (optimizers + 1) / (6 * problems))
    return float(friedmanchisquare(*rounded).pvalue), float(difference)


def summarise(outcome: BenchOutcome) -> Summary:
    """Summary of a finished comparison, of the runs that had its whole budget; the same numbers for the same runs."""
    results = [result for result in outcome.results if result.budget == outcome.settings.budget]
    if not results:
        raise ValueError(f"no optimiser of {outcome.folder} could be run, so there is nothing to compare.")
    rng = np.random.default_rng(outcome.settings.seed)
    regrets = final_regrets(results)
    problems = outcome.settings.problems
    scores = []
    for name in problems:
        for optimizer, by_problem in regrets.items():
            values = by_problem.get(name)
            if values is None:
                continue
            scores.append(Score(optimizer, name, values.size, median_interval(values, rng)))
    never = np.full(outcome.settings.repeats, math.inf)  # what cannot be used on a problem ranks last there
    stacked = {optimizer: np.array([by.get(name, never) for name in problems]) for optimizer, by in regrets.items()}
    order = standings(stacked, rng)
    p, difference = friedman_and_nemenyi(np.array([np.median(values, axis=1) for values in stacked.values()]))
    return Summary(tuple(scores), order, p, difference, conclusions(outcome, order, p))


def conclusions(
    outcome: BenchOutcome,
    order: Sequence[Standing],
    friedman_p: float,
) -> tuple[str, ...]:
    """What the ranking allows one to say, in sentences made from the numbers."""
    settings, winner = outcome.settings, order[0]
    said = [
        f"With {settings.budget:,} evaluations a run, {winner.optimizer} has the best mean rank "
        f"({winner.mean_rank:.2f} of {len(order)}) over {_count(len(settings.problems), 'problem')}, "
        f"{_count(settings.repeats, 'run')} each."
    ]
    tied = [s.optimizer for s in order[1:] if s.tied_with_winner]
    if settings.repeats < 5:
        said.append("So few runs tell no optimiser from another with any confidence; repeat more often.")
    elif tied:
        others = "" if len(tied) == len(order) - 1 else "; the others rank behind it"
        said.append(f"On these problems {_listed(tied)} cannot be told from it{others} (95 %).")
    elif len(order) > 1:
        said.append("On these problems every other optimiser ranks behind it (95 %).")
    shorter = [name for name in settings.optimizers if settings.budget_of(name) < settings.budget]
    if shorter:
        told = (f"{name} ({settings.budget_of(name):,} evaluations)" for name in shorter)
        said.append(f"Compared up to the end of their shorter runs only, and not in this ranking: {', '.join(told)}.")
    if math.isfinite(friedman_p):
        said.append(
            f"Taken as a sample of problems, these {len(settings.problems)} say that the optimisers "
            f"{'differ' if friedman_p < 0.05 else 'do not differ significantly'} (Friedman, p = {friedman_p:.2g}). "
            "Problems that are variants of one another are a smaller sample than they count."
        )
    return tuple(said)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
