"""A finished comparison as numbers: who is how good, on which problems, after how many evaluations, and how surely.

Regrets of different problems are compared after division by the problem's own scale: what the best of 50 random
waveforms is worse than the best known, on the average. Runs are resampled within each problem for what is said of these
problems; what is said of problems in general takes the problems as the sample. Intervals are of one figure at a time.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.benchmark.mean_ranks import (
    ENOUGH_PROBLEMS,
    RESOLUTION_V,
    MeanRank,
    friedman_and_nemenyi,
    mean_rank_intervals,
    mean_ranks,
    median_interval,
)
from experiments.benchmark.metrics import (
    SignedRank,
    bayesian_signed_rank,
    expected_running_time,
    interquartile_mean,
    probability_of_improvement,
    running_time_distribution,
    stratified_bootstrap,
)
from experiments.benchmark.regret import best_known_cost, regrets_V, scale_V
from experiments.benchmark.run_files import RunResult
from experiments.benchmark.settings import BenchOutcome
from experiments.benchmark.suite import family_of
from inkjet_env.estimate import Estimate
from inkjet_env.typing import Real

BUDGETS = (50, 150, 2000, 20_000)
TARGETS = tuple(float(t) for t in np.logspace(0, -4, 41))
"""Of the distribution of running times: regrets in the problem's scale."""
SOLVED = 0.01
"""Regret in the problem's scale at which a problem counts as solved."""
ALIKE = 0.01
"""Difference of median regrets, in the problem's scale, that does not matter."""
REFERENCE = "pso"
"""The paper's optimiser, against which the others are held."""
RESAMPLES = 1000


@dataclass(frozen=True, eq=False)
class Row:
    """One optimiser on a family of problems, after a budget.

    Attributes
    ----------
    optimizer : str
    applies : int
        On how many of the problems it can be used.
    quality : Estimate
        Interquartile mean of the regret in the problems' scales. Where it cannot be used its runs count as infinitely
        bad, so it is infinite where those are more than a quarter.
    solved : Estimate
        Share of runs within a hundredth of the scale.
    rank : float
        Mean over the problems, of the median regret.
    improvement : Estimate
        Probability that a run of it ends lower than one of the reference.
    signed_rank : SignedRank
        Against the reference, over such problems; ``first`` is this one. NaN where they share fewer than five.
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
    """All optimisers on all problems after the whole budget, with the uncertainty that the runs leave.

    Attributes
    ----------
    standings : Standings
        Best first, with Friedman's and Nemenyi's numbers.
    mean_ranks : mapping of str to MeanRank
        By optimiser.
    median_regrets_V : mapping of (str, str) to Estimate
        By optimiser and problem: median final regret in volts with its 95 % interval. Only where it can be used.
    """

    standings: Standings
    mean_ranks: Mapping[str, MeanRank]
    median_regrets_V: Mapping[tuple[str, str], Estimate]

    @property
    def optimizers(self) -> tuple[str, ...]:
        """From the best mean rank to the worst."""
        return tuple(row.optimizer for row in self.standings.rows)


class Comparison:
    """The runs of a finished bench, ranked: every number of its files, pages and tables comes from here.

    Parameters
    ----------
    outcome : BenchOutcome

    Raises
    ------
    ValueError
        No optimiser has a run of the whole budget.
    """

    def __init__(self, outcome: BenchOutcome) -> None:
        if not any(result.budget == outcome.settings.budget for result in outcome.results):
            raise ValueError(f"no optimiser of {outcome.folder} could be run, so there is nothing to compare.")
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
        """Problems of a family; all where it is "all"."""
        return tuple(name for name in self.problems if family in ("all", family_of(name)))

    def regrets_V(self, optimizer: str, name: str, budget: int) -> Real:
        """Regret in volts after a budget, shape (runs,); infinite where it has no run so long."""
        runs = self.runs.get((optimizer, name), [])
        if not runs or runs[0].budget < budget:
            return np.full(self.outcome.settings.repeats, math.inf)
        return regrets_V(runs, budget)

    def regrets(self, optimizer: str, name: str, budget: int) -> Real:
        """The same in the problem's scale, shape (runs,); those within a microvolt are equal."""
        rounded_V = RESOLUTION_V * np.round(self.regrets_V(optimizer, name, budget) / RESOLUTION_V)
        regrets: Real = rounded_V / scale_V(name)
        return regrets

    def hits(self, optimizer: str, name: str, targets: Sequence[float] = TARGETS) -> Real:
        """Evaluations until each target is met, in the problem's scale, shape (runs, targets); infinite where never.

        Where peaks are read with errors a waveform meets a target also if another one, read better, is kept later.
        """
        runs = self.runs.get((optimizer, name), [])
        found = np.full((len(runs) or self.outcome.settings.repeats, len(targets)), math.inf)
        for row, run in zip(found, runs, strict=False):
            regret = (run.costs_V - best_known_cost(name)) / scale_V(name)
            for k, target in enumerate(targets):
                met = np.flatnonzero(regret <= target)
                row[k] = run.evaluations[met[0]] if met.size else math.inf
        return found

    def running_times(self, optimizer: str, family: str, evaluations: Sequence[int]) -> Real:
        """Share of targets met on a family after so many evaluations, shape (n,)."""
        times = [self.hits(optimizer, name).ravel() for name in self.in_family(family)]
        return running_time_distribution(np.concatenate(times), evaluations)

    def expected_time(self, optimizer: str, name: str, target: float, rng: np.random.Generator) -> Estimate:
        """Evaluations that it takes to meet a target on a problem, restarts counted; with an interval over runs."""
        hits = self.hits(optimizer, name, [target])
        runs = self.runs.get((optimizer, name), [])
        if not runs:
            return Estimate(math.inf, math.nan, math.nan)
        budget = runs[0].budget
        return stratified_bootstrap(lambda h: expected_running_time(h[..., 0], budget), [hits], rng, RESAMPLES)

    def standings(self, family: str, budget: int) -> Standings:
        """Who is how good on a family after a budget; whoever asks is told the same."""
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
        """Mean rank of an optimiser among the others of a standing if its runs had ended after fewer evaluations."""
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
        """All optimisers of the whole budget on all problems, with the uncertainty that the runs leave."""
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
