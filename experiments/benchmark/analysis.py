"""Statistics of a finished comparison: each optimiser's results by problem and budget, with their uncertainty.

Regrets on different problems are compared after division by the problem's own scale: the mean regret of the best of 50
random waveforms. Statements about these problems resample the runs within each problem; statements about problems in
general take the problems as the sample. Each interval holds for one number alone.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from inkjet_env.estimate import Estimate
from inkjet_env.experiments.benchmark.mean_ranks import (
    ENOUGH_PROBLEMS,
    RESOLUTION_V,
    MeanRank,
    friedman_and_nemenyi,
    mean_rank_intervals,
    mean_ranks,
    median_interval,
)
from inkjet_env.experiments.benchmark.metrics import (
    SignedRank,
    bayesian_signed_rank,
    expected_running_time,
    interquartile_mean,
    probability_of_improvement,
    running_time_distribution,
    stratified_bootstrap,
)
from inkjet_env.experiments.benchmark.regret import best_known_cost, regrets_V, scale_V
from inkjet_env.experiments.benchmark.run_files import RunResult
from inkjet_env.experiments.benchmark.settings import BenchOutcome
from inkjet_env.experiments.benchmark.suite import family_of
from inkjet_env.typing import Real

BUDGETS = (50, 150, 2000, 20_000)
TARGETS = tuple(float(t) for t in np.logspace(0, -4, 41))
"""Target regrets of the running-time distribution, in the problem's scale."""
SOLVED = 0.01
"""Regret in the problem's scale at which a problem counts as solved."""
ALIKE = 0.01
"""Difference of median regrets, in the problem's scale, that is practically irrelevant."""
REFERENCE = "pso"
"""The paper's optimiser, with which the others are compared."""
RESAMPLES = 1000


@dataclass(frozen=True, eq=False)
class Row:
    """One optimiser on a family of problems, after a budget.

    Attributes
    ----------
    optimizer : str
        Name of the entrant.
    applies : int
        Number of the problems on which it can be used.
    quality : Estimate
        Interquartile mean of the regret in the problems' scales. Runs on problems where it cannot be used count as
        infinite, so the mean is infinite if they are more than a quarter.
    solved : Estimate
        Fraction of runs with a regret of at most a hundredth of the scale.
    rank : float
        Mean over the problems of its rank by median regret; 1 is best.
    improvement : Estimate
        Probability that one of its runs ends lower than one of the reference's.
    signed_rank : SignedRank
        Comparison with the reference over such problems; ``first`` is this optimiser. NaN if they share fewer than
        five.
    """

    optimizer: str
    applies: int
    quality: Estimate
    solved: Estimate
    rank: float
    improvement: Estimate
    signed_rank: SignedRank


@dataclass(frozen=True, eq=False)
class Standings:
    """All optimisers on a family of problems, after a budget, the best mean rank first.

    ``friedman_p`` and ``critical_difference`` are NaN with fewer than three optimisers or five problems.
    """

    family: str
    budget: int
    problems: tuple[str, ...]
    rows: tuple[Row, ...]
    friedman_p: float
    critical_difference: float


@dataclass(frozen=True, eq=False)
class Ranking:
    """All optimisers on all problems after the whole budget, with the uncertainty due to the runs.

    Attributes
    ----------
    standings : Standings
        Best first, with Friedman's p-value and Nemenyi's critical difference.
    mean_ranks : mapping of str to MeanRank
        Mean rank by optimiser.
    median_regrets_V : mapping of (str, str) to Estimate
        Median final regret in volts with its 95 % interval, by optimiser and problem, where it can be used.
    """

    standings: Standings
    mean_ranks: Mapping[str, MeanRank]
    median_regrets_V: Mapping[tuple[str, str], Estimate]

    @property
    def optimizers(self) -> tuple[str, ...]:
        """Names of the optimisers, from the best mean rank to the worst."""
        return tuple(row.optimizer for row in self.standings.rows)


class Comparison:
    """The ranked runs of a finished bench: the source of every number in its files, reports and tables.

    Parameters
    ----------
    outcome : BenchOutcome
        The finished bench.

    Raises
    ------
    ValueError
        No optimiser has a run with the whole budget.
    """

    def __init__(self, outcome: BenchOutcome) -> None:
        if not any(result.budget == outcome.settings.budget for result in outcome.results):
            reasons = "".join(f" {name}: {reason}" for name, reason in outcome.unavailable.items())
            raise ValueError(f"no optimiser of {outcome.folder} could be run, so there is nothing to compare.{reasons}")
        self.outcome = outcome
        self.problems = outcome.settings.problems
        self.budgets = (*(b for b in BUDGETS if b < outcome.settings.budget), outcome.settings.budget)
        self.runs: dict[tuple[str, str], list[RunResult]] = {}
        for result in outcome.results:
            self.runs.setdefault((result.key.optimizer, result.key.problem), []).append(result)
        self.optimizers = tuple(dict.fromkeys(optimizer for optimizer, _ in self.runs))
        self.families = tuple(dict.fromkeys(family_of(name) for name in self.problems))
        self._standings: dict[tuple[str, int], Standings] = {}

    def in_family(self, family: str) -> tuple[str, ...]:
        """Problems of a family; all problems for "all"."""
        return tuple(name for name in self.problems if family in ("all", family_of(name)))

    def regrets_V(self, optimizer: str, name: str, budget: int) -> Real:
        """Regret in volts after a budget, shape (runs,); infinite if there is no run of that length."""
        runs = self.runs.get((optimizer, name), [])
        if not runs or runs[0].budget < budget:
            return np.full(self.outcome.settings.repeats, math.inf)
        return regrets_V(runs, budget)

    def regrets(self, optimizer: str, name: str, budget: int) -> Real:
        """Regret in the problem's scale, Eq. (1) of `regret`, shape (runs,); rounded to a microvolt first."""
        rounded_V = RESOLUTION_V * np.round(self.regrets_V(optimizer, name, budget) / RESOLUTION_V)
        regrets: Real = rounded_V / scale_V(name)  # Eq. (1)
        return regrets

    def hits(self, optimizer: str, name: str, targets: Sequence[float] = TARGETS) -> Real:
        """Evaluations until each target regret is met, shape (runs, targets); infinite if it never is.

        Targets are in the problem's scale. Where peaks are measured with errors, a waveform meets a target even if
        another one with a lower reading is kept later.
        """
        runs = self.runs.get((optimizer, name), [])
        found = np.full((len(runs) or self.outcome.settings.repeats, len(targets)), math.inf)
        for row, run in zip(found, runs, strict=False):
            regret = (run.costs_V - best_known_cost(name)) / scale_V(name)  # Eq. (1)
            for k, target in enumerate(targets):
                met = np.flatnonzero(regret <= target)
                row[k] = run.evaluations[met[0]] if met.size else math.inf
        return found

    def running_times(self, optimizer: str, family: str, evaluations: Sequence[int]) -> Real:
        """Fraction of targets met on a family after each number of evaluations, shape (n,)."""
        times = [self.hits(optimizer, name).ravel() for name in self.in_family(family)]
        return running_time_distribution(np.concatenate(times), evaluations)

    def expected_time(self, optimizer: str, name: str, target: float, rng: np.random.Generator) -> Estimate:
        """Expected evaluations to meet a target on a problem, including restarts, with an interval over runs."""
        hits = self.hits(optimizer, name, [target])
        runs = self.runs.get((optimizer, name), [])
        if not runs:
            return Estimate(math.inf, math.nan, math.nan)
        budget = runs[0].budget
        return stratified_bootstrap(lambda h: expected_running_time(h[..., 0], budget), [hits], rng, RESAMPLES)

    def standings(self, family: str, budget: int) -> Standings:
        """Standings on a family after a budget; computed once, so every caller gets the same numbers."""
        if (family, budget) not in self._standings:
            self._standings[family, budget] = self._standings_of(family, budget)
        return self._standings[family, budget]

    def _standings_of(self, family: str, budget: int) -> Standings:
        rng = np.random.default_rng(self.outcome.settings.seed)
        problems = self.in_family(family)
        regrets = {
            optimizer: np.column_stack([self.regrets(optimizer, name, budget) for name in problems])
            for optimizer in self.optimizers
        }
        used = {optimizer: values for optimizer, values in regrets.items() if np.isfinite(values).any()}
        medians_V = np.array([[np.median(self.regrets_V(one, name, budget)) for name in problems] for one in used])
        ranks = dict(zip(used, mean_ranks(medians_V), strict=True))
        p, difference = friedman_and_nemenyi(medians_V)
        rows = []
        for optimizer, values in used.items():
            rows.append(self._row(optimizer, values, regrets.get(REFERENCE), float(ranks[optimizer]), rng))
        rows.sort(key=lambda row: row.rank)
        return Standings(family, budget, problems, tuple(rows), p, difference)

    @staticmethod
    def _row(optimizer: str, values: Real, reference: Real | None, rank: float, rng: np.random.Generator) -> Row:
        nothing = Estimate(math.nan, math.nan, math.nan)
        improvement, signed_rank = nothing, SignedRank(math.nan, math.nan, math.nan)
        usable = np.isfinite(values).all(axis=0)
        if reference is not None and optimizer != REFERENCE:
            shared = usable & np.isfinite(reference).all(axis=0)
            if shared.any():
                mine, theirs = values[:, shared], reference[:, shared]
                improvement = stratified_bootstrap(probability_of_improvement, [mine, theirs], rng, RESAMPLES)
                if shared.sum() >= ENOUGH_PROBLEMS:
                    signed_rank = bayesian_signed_rank(np.median(mine, axis=0), np.median(theirs, axis=0), ALIKE, rng)
        return Row(
            optimizer,
            int(usable.sum()),
            stratified_bootstrap(interquartile_mean, [values], rng, RESAMPLES),
            stratified_bootstrap(lambda x: np.mean(x <= SOLVED, axis=(-2, -1)), [values], rng, RESAMPLES),
            rank,
            improvement,
            signed_rank,
        )

    def rank_if_ended_after(self, budget: int, optimizer: str, found: Standings) -> float:
        """Mean rank that an optimiser would have in these standings if its runs had ended after ``budget``."""
        names = [row.optimizer for row in found.rows]
        medians_V = [
            [
                np.median(self.regrets_V(name, on, budget if name == optimizer else found.budget))
                for on in found.problems
            ]
            for name in names
        ]
        return float(mean_ranks(medians_V)[names.index(optimizer)])

    @functools.cached_property
    def ranking(self) -> Ranking:
        """All optimisers with the whole budget on all problems, with the uncertainty due to the runs."""
        rng, budget = np.random.default_rng(self.outcome.settings.seed), self.outcome.settings.budget
        standings = self.standings("all", budget)
        ranked = {row.optimizer for row in standings.rows}
        names = [name for name in self.optimizers if name in ranked]
        final_V = {name: [self.regrets_V(name, on, budget) for on in self.problems] for name in names}
        medians_V = {
            (name, on): median_interval(final_V[name][k], rng)
            for k, on in enumerate(self.problems)
            for name in names
            if (name, on) in self.runs
        }
        return Ranking(standings, mean_rank_intervals(final_V, rng), medians_V)
