"""The page and the tables that a finished comparison is read from.

`write_report` puts beside the runs ``report.html``, which needs nothing but itself, and ``ranking.csv`` and
``ranking.json`` for machines. Tables depend on the runs alone: the same runs give the same bytes.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.benchmark import page
from experiments.benchmark.analysis import Comparison
from experiments.benchmark.mean_ranks import Summary
from experiments.benchmark.run_files import RunResult
from experiments.benchmark.settings import BenchOutcome
from experiments.benchmark.suite import VERSION, problem
from inkjet_env.reporting import plotting
from inkjet_env.storage import json_text, write_atomically

RANKING_FORMAT = "ranking/1"
GENERATION = 40
"""Evaluations of the paper's first generation."""
CSV_COLUMNS = (
    *("optimizer", "mean_rank", "mean_rank_low", "mean_rank_high", "problem", "runs"),
    *("median_regret_V", "regret_low_V", "regret_high_V"),
)


def write_report(outcome: BenchOutcome, summary: Summary) -> tuple[Path, dict[str, Any]]:
    """Write report.html, ranking.csv and ranking.json into the results folder.

    Returns
    -------
    page : Path
    ranking : dict
        What ranking.json holds; under "sentences", what a reader may conclude.
    """
    compared = Comparison(outcome)
    ranking = ranking_json(compared, summary)
    write_atomically(outcome.folder / "ranking.csv", ranking_csv(summary))
    write_atomically(outcome.folder / "ranking.json", json_text(ranking))
    file = outcome.folder / "report.html"
    settings = outcome.settings
    shown = "nominal" if "nominal" in settings.problems else settings.problems[0]
    runs = [r for r in outcome.results if (r.key.optimizer, r.key.problem) == (summary.winner, shown)]
    run = median_run(runs or outcome.results)
    waveforms = plotting.svg_text(before_after_figure(run))
    write_atomically(file, page.page(compared, summary.sentences, run.key, waveforms))
    return file, ranking


def ranking_json(compared: Comparison, summary: Summary) -> dict[str, Any]:
    """The ranking after the whole budget, and who is how good after each, as plain JSON values.

    Numbers that do not exist are null.
    """
    outcome = compared.outcome
    settings = outcome.settings
    return {
        "format": RANKING_FORMAT,
        "suite": VERSION,
        "settings": settings.to_json(),
        "sentences": [*compared.sentences("all", compared.budgets[-1]), *summary.sentences],
        "problems": [page.problem_json(name) for name in compared.problems],
        "entrants": [page.entrant_json(name, settings.budget_of(name)) for name in compared.optimizers],
        "standings": {str(b): page.standings_json(compared, "all", b) for b in compared.budgets},
        "friedman_p": _number(summary.friedman_p),
        "critical_difference": _number(summary.critical_difference),
        "ranking": [
            {
                "optimizer": standing.optimizer,
                "mean_rank": standing.mean_rank,
                "low": standing.low,
                "high": standing.high,
                "tied_with_winner": standing.tied_with_winner,
                "problems": {
                    name: {
                        "runs": score.runs,
                        "median_regret_V": score.regret.value,
                        "low": _number(score.regret.low),
                        "high": _number(score.regret.high),
                    }
                    for name in outcome.settings.problems
                    if (score := summary.score(standing.optimizer, name)) is not None
                },
            }
            for standing in summary.standings
        ],
        "unavailable": outcome.unavailable,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def ranking_csv(summary: Summary) -> str:
    """The ranking as CSV, one line for each optimiser and problem, the best optimiser first."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for standing in summary.standings:
        rank = (standing.mean_rank, standing.low, standing.high)
        for score in summary.scores:
            if score.optimizer == standing.optimizer:
                regret = (score.regret.value, score.regret.low, score.regret.high)
                writer.writerow([standing.optimizer, *rank, score.problem, score.runs, *regret])
    return text.getvalue()


def median_run(results: Sequence[RunResult]) -> RunResult:
    """The run whose final cost is the median (the better of the middle two)."""
    return sorted(results, key=lambda result: float(result.costs_V[-1]))[(len(results) - 1) // 2]


def before_after_figure(run: RunResult) -> Any:
    """Best waveform of a run's first 40 evaluations beside the best of all."""
    solved = problem(run.key.problem)
    first, final = solved.respond(run.best_point(GENERATION)), solved.respond(run.best_point())
    last = run.budget
    titles = (f"best of the first {min(GENERATION, last)} evaluations", f"best of all {last:,} evaluations")
    return plotting.draw_before_after(first, final, solved.cost, titles)
