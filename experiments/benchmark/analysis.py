"""A finished comparison as numbers: for a family of problems, or all, and a budget, who is how good and how surely.

Regrets of different problems are compared after division by the problem's own scale: what the best of 50 random
waveforms is worse than the best known, on the average. Runs are resampled within each problem for what is said of these
problems; what is said of problems in general takes the problems as the sample. Intervals are of one figure at a time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import optimizers
from experiments.benchmark.entrants import entrant
from experiments.benchmark.mean_ranks import ENOUGH_PROBLEMS, RESOLUTION_V, friedman_and_nemenyi, mean_ranks
from experiments.benchmark.metrics import (
    Estimate,
    SignedRank,
    bayesian_signed_rank,
    expected_running_time,
    interquartile_mean,
    probability_of_improvement,
    running_time_distribution,
    stratified,
)
from experiments.benchmark.regret import best_known_cost, scale_V
from experiments.benchmark.run_files import RunResult
from experiments.benchmark.settings import BenchOutcome
from experiments.benchmark.suite import family_of
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
GRADIENT_COUNTS = {3: "which is its computing time here", 8: "which is what differences would take"}
"""Evaluations that one with its gradient may also be counted as, and why."""
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


class Comparison:
    """The runs of a bench, ready to be asked.

    Parameters
    ----------
    outcome : BenchOutcome
    """

    def __init__(self, outcome: BenchOutcome) -> None:
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

    def regrets(self, optimizer: str, name: str, budget: int) -> Real:
        """Regret after a budget, in the problem's scale, shape (runs,); infinite where it has no run so long."""
        runs = self.runs.get((optimizer, name), [])
        if not runs or runs[0].budget < budget:
            return np.full(self.outcome.settings.repeats, math.inf)
        kept = np.array([float(run.kept_V(budget)) for run in runs])
        regrets_V = RESOLUTION_V * np.round((kept - best_known_cost(name)) / RESOLUTION_V)  # nearer than that is a tie
        regrets: Real = regrets_V / scale_V(name)
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
        return stratified(lambda h: expected_running_time(h[..., 0], budget), [hits], rng, RESAMPLES)

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
        scales_V = np.array([scale_V(name) for name in problems])
        medians = np.array([np.median(values, axis=0) * scales_V for values in used.values()])
        ranks = dict(zip(used, mean_ranks(medians), strict=True))
        p, difference = friedman_and_nemenyi(medians)
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
                improvement = stratified(probability_of_improvement, [mine, theirs], rng, RESAMPLES)
                if shared.sum() >= ENOUGH_PROBLEMS:
                    signed_rank = bayesian_signed_rank(np.median(mine, axis=0), np.median(theirs, axis=0), ALIKE, rng)
        return Row(
            optimizer,
            int(usable.sum()),
            stratified(interquartile_mean, [values], rng, RESAMPLES),
            stratified(lambda x: np.mean(x <= SOLVED, axis=(-2, -1)), [values], rng, RESAMPLES),
            rank,
            improvement,
            signed_rank,
        )

    def sentences(self, family: str, budget: int) -> tuple[str, ...]:
        """What a reader may conclude, after a budget: of the best, of the paper's swarm, of it as printed."""
        found = self.standings(family, budget)
        by_name = {row.optimizer: row for row in found.rows}
        swarm, printed = by_name.get(REFERENCE), by_name.get("pso-printed")
        everywhere = [row for row in found.rows if row.applies == len(found.problems)]
        best = (everywhere or found.rows)[0]
        of = "" if best is found.rows[0] else " of those that can be used on all of these problems"
        also = f" ({level})" if (level := _level_with(best, found)) else ""
        where = "" if family == "all" else f" on the problems of the family {family}"
        said = [
            f"After {budget:,} evaluations{where} {best.optimizer}, the best by mean rank{of}{also}, leaves a regret "
            f"of {_ranged(best.quality)} of the problems' scales (interquartile mean of all runs){self._against(best)}."
            f"{_level_elsewhere(found, best)}{self._with_dearer_gradients(found)}"
        ]
        if swarm is not None and best is not swarm:
            place = 1 + sum(row.rank < swarm.rank for row in found.rows)
            also = f"{level}; " if (level := _level_with(swarm, found)) else ""
            said.append(
                f"The paper's method, a particle swarm, with random factors and the usual coefficients ({REFERENCE}), "
                f"is at place {place} of {len(found.rows)} ({also}mean rank {swarm.rank:.1f}), with a regret of "
                f"{_ranged(swarm.quality)}."
            )
        if printed is not None and swarm is not None and printed is not best:
            said.append(
                f"Without random factors, as the paper prints its equations (pso-printed), it leaves "
                f"{_ranged(printed.quality)}{self._against(printed)}."
            )
        return tuple(said)

    def _with_dearer_gradients(self, found: Standings) -> str:
        """Where those who are given gradients would stand if these cost more, in words; nothing if nobody is."""
        if found.budget < max(GRADIENT_COUNTS):
            return ""
        said = ""
        for row in found.rows:
            if optimizers.uses_gradient(entrant(row.optimizer).optimizer):
                ranks = [
                    f"{self._rank_at(found, row.optimizer, found.budget // count):.1f} if it counted as {count}, {why}"
                    for count, why in GRADIENT_COUNTS.items()
                ]
                said += (
                    f" {row.optimizer} is given exact gradients, each counted as one evaluation with its value; its "
                    f"mean rank of {row.rank:.1f} would be {', and '.join(ranks)}."
                )
        return said

    def _rank_at(self, found: Standings, optimizer: str, budget: int) -> float:
        """Mean rank of an optimiser among the others if its runs had ended after fewer evaluations."""
        names = [row.optimizer for row in found.rows]
        medians = [
            [
                np.median(self.regrets(name, on, budget if name == optimizer else found.budget)) * scale_V(on)
                for on in found.problems
            ]
            for name in names
        ]
        return float(mean_ranks(medians)[names.index(optimizer)])

    @staticmethod
    def _against(row: Row) -> str:
        """How an optimiser stands to the reference, in words; nothing of the reference itself."""
        if not math.isfinite(row.improvement.value):
            return ""
        rank = row.signed_rank
        ends = (
            f"; a run of it ends lower than one of {REFERENCE} with probability {_ranged(row.improvement, decimals=2)}"
        )
        if not math.isfinite(rank.first):
            return ends
        return (
            f"{ends}, and over problems like these it is better with posterior probability {rank.first:.2f}, alike "
            f"with {rank.alike:.2f}, worse with {rank.second:.2f}"
        )


def _level_with(row: Row, found: Standings) -> str:
    """Who has the same mean rank, in words; empty where nobody has."""
    level = [other.optimizer for other in found.rows if other is not row and other.rank == row.rank]
    return f"level with {' and '.join(level)}" if level else ""


def _level_elsewhere(found: Standings, best: Row) -> str:
    """How many are level with the best if the problems are a sample, in words; nothing of too few problems."""
    if not math.isfinite(found.critical_difference):
        return ""
    level = sum(row is not best and abs(row.rank - best.rank) < found.critical_difference for row in found.rows)
    told = f"tell its mean rank of {best.rank:.1f} from those of"
    told = f"cannot {told} {level} of the other {len(found.rows) - 1}" if level else f"{told} all others"
    return f" As a sample of problems these {told} (Nemenyi's critical difference: {found.critical_difference:.1f})."


def _ranged(estimate: Estimate, decimals: int | None = None) -> str:
    """A number and its interval: two digits that count, or so many decimals."""
    written = [
        f"{value:.2g}" if decimals is None else f"{value:.{decimals}f}"
        for value in (estimate.value, estimate.low, estimate.high)
    ]
    return f"{written[0]} ({written[1]} to {written[2]})"
