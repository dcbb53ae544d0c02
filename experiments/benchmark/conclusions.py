"""Conclusions from a comparison, in sentences generated from its numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

from inkjet_env.estimate import Estimate
from inkjet_env.experiments.benchmark.analysis import REFERENCE, Comparison, Row, Standings

GRADIENT_COUNTS = {3: "by computing time here", 8: "the cost of finite differences"}
"""Numbers of evaluations as which a value with its gradient could count, with the reason."""
FEW_RUNS = 5
"""Smallest number of runs per optimiser and problem from which a difference is concluded."""
SIGNIFICANT = 0.05
"""Friedman's p-value below which the optimisers are said to differ."""


def standings_sentences(compared: Comparison, family: str, budget: int) -> tuple[str, ...]:
    """Conclusions after a budget: about the best optimiser, the paper's swarm, and the swarm as printed."""
    found = compared.standings(family, budget)
    by_name = {row.optimizer: row for row in found.rows}
    swarm, printed = by_name.get(REFERENCE), by_name.get("pso-printed")
    everywhere = [row for row in found.rows if row.applies == len(found.problems)]
    best = (everywhere or found.rows)[0]
    of = "" if best is found.rows[0] else " of those that can be used on all of these problems"
    also = f" ({level})" if (level := _level_with(best, found)) else ""
    where = "" if family == "all" else f" on the problems of the family {family}"
    said = [
        f"After {budget:,} evaluations{where}, {best.optimizer} has the best mean rank{of}{also}. Its regret is "
        f"{_ranged(best.quality)} of the problems' scales (interquartile mean over all runs).{_against(best)}"
        f"{_level_elsewhere(found, best)}{_with_dearer_gradients(compared, found)}"
    ]
    if swarm is not None and best is not swarm:
        place = 1 + sum(row.rank < swarm.rank for row in found.rows)
        also = f"; {level}" if (level := _level_with(swarm, found)) else ""
        said.append(
            f"{REFERENCE}, the paper's particle swarm with random factors and the usual coefficients, is number "
            f"{place} of {len(found.rows)} (mean rank {swarm.rank:.1f}{also}), with a regret of "
            f"{_ranged(swarm.quality)}."
        )
    if printed is not None and swarm is not None and printed is not best:
        said.append(
            f"pso-printed, the same swarm without random factors, as the paper prints its equations, has a regret of "
            f"{_ranged(printed.quality)}.{_against(printed)}"
        )
    return tuple(said)


def _with_dearer_gradients(compared: Comparison, found: Standings) -> str:
    """Mean rank of the optimisers that use gradients if these cost more, in words; empty if there are none."""
    if found.budget < max(GRADIENT_COUNTS):
        return ""
    said = ""
    for row in found.rows:
        if compared.outcome.settings.uses_gradient(row.optimizer):
            ranks = []
            for count, why in GRADIENT_COUNTS.items():
                rank = compared.rank_if_ended_after(found.budget // count, row.optimizer, found)
                ranks.append(f"{rank:.1f} if that counted as {count} ({why})")
            said += (
                f" {row.optimizer} uses exact gradients, and a value with its gradient counts as one evaluation; its "
                f"mean rank of {row.rank:.1f} would be {' and '.join(ranks)}."
            )
    return said


def _against(row: Row) -> str:
    """Comparison of an optimiser with the reference, as sentences; empty for the reference itself."""
    if not math.isfinite(row.improvement.value):
        return ""
    rank = row.signed_rank
    ends = (
        f" One of its runs ends with a lower cost than one of {REFERENCE} with probability "
        f"{_ranged(row.improvement, decimals=2)}."
    )
    if not math.isfinite(rank.first):
        return ends
    return (
        f"{ends} Over all problems of this kind it is better than {REFERENCE} with posterior probability "
        f"{rank.first:.2f}, equivalent with {rank.alike:.2f} and worse with {rank.second:.2f}."
    )


def _level_with(row: Row, found: Standings) -> str:
    """The optimisers with the same mean rank, in words; empty if there are none."""
    level = [other.optimizer for other in found.rows if other is not row and other.rank == row.rank]
    return f"tied with {' and '.join(level)}" if level else ""


def _level_elsewhere(found: Standings, best: Row) -> str:
    """Number of optimisers level with the best if the problems are a sample, in words; empty for too few problems."""
    if not math.isfinite(found.critical_difference):
        return ""
    level = sum(row is not best and abs(row.rank - best.rank) < found.critical_difference for row in found.rows)
    differs = f"does not differ significantly from those of {level} of" if level else "differs significantly from"
    others = "the other" if level else "those of the other"
    return (
        f" If these problems are taken as a sample, its mean rank of {best.rank:.1f} {differs} {others} "
        f"{len(found.rows) - 1} (Nemenyi's critical difference: {found.critical_difference:.1f})."
    )


def _ranged(estimate: Estimate, decimals: int | None = None) -> str:
    """A number and its interval, if it has one, with two significant digits, or with ``decimals`` decimals."""
    value, low, high = (
        f"{number:.2g}" if decimals is None else f"{number:.{decimals}f}"
        for number in (estimate.value, estimate.low, estimate.high)
    )
    return value if math.isnan(estimate.low) else f"{value} ({low} to {high})"


def ranking_sentences(compared: Comparison) -> tuple[str, ...]:
    """Conclusions from the ranking after the whole budget: the winner, those tied with it, the problems as a sample."""
    settings, ranking = compared.outcome.settings, compared.ranking
    winner, *others = ranking.optimizers
    said = [
        f"With {settings.budget:,} evaluations per run, {winner} has the best mean rank "
        f"({ranking.mean_ranks[winner].estimate.value:.2f} of {1 + len(others)}) over "
        f"{_count(len(settings.problems), 'problem')}, {_count(settings.repeats, 'run')} each."
    ]
    tied = [name for name in others if ranking.mean_ranks[name].tied_with_winner]
    if settings.repeats < FEW_RUNS:
        said.append("So few runs cannot distinguish the optimisers; use more repeats.")
    elif tied:
        does = "does" if len(tied) == 1 else "do"
        rest = "" if len(tied) == len(others) else "; all others rank significantly lower"
        said.append(f"On these problems {_listed(tied)} {does} not differ significantly from it{rest} (95 %).")
    elif others:
        said.append("On these problems every other optimiser ranks significantly lower (95 %).")
    shorter = [name for name in settings.optimizers if settings.budget_of(name) < settings.budget]
    if shorter:
        lengths = ", ".join(f"{name} ({settings.budget_of(name):,} evaluations)" for name in shorter)
        said.append(f"Compared only up to the end of their shorter runs, and not in this ranking: {lengths}.")
    p = ranking.standings.friedman_p
    if math.isfinite(p):
        said.append(
            f"If these {len(settings.problems)} problems are taken as a sample, the optimisers "
            f"{'differ' if p < SIGNIFICANT else 'do not differ'} significantly (Friedman test, p = {p:.2g}). "
            "Problems that are variants of one another count for less than their number."
        )
    return tuple(said)


def winner_sentence(compared: Comparison) -> str:
    """Which optimiser won at the whole budget, and how sure that is, in one sentence."""
    settings, ranking = compared.outcome.settings, compared.ranking
    winner, *others = ranking.optimizers
    tied = [name for name in others if ranking.mean_ranks[name].tied_with_winner]
    wins = "wins"
    if settings.repeats < FEW_RUNS and others:
        wins, sure = "is ahead", ", but so few runs cannot tell the optimisers apart"
    elif tied:
        sure = f"; {_listed(tied)} {'is' if len(tied) == 1 else 'are'} not significantly worse"
    else:
        sure = ", significantly ahead of all others" if others else ""
    return (
        f"{winner} {wins} with {settings.budget:,} evaluations: mean rank "
        f"{ranking.mean_ranks[winner].estimate.value:.2f} of {1 + len(others)} on "
        f"{_count(len(settings.problems), 'problem')}, {_count(settings.repeats, 'run')} each{sure}."
    )


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
