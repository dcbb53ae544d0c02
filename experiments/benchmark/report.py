"""Report and tables of a finished comparison.

`write_report` writes into the folder of the runs the self-contained ``report.html``, and ``ranking.csv`` and
``ranking.json`` for programs. The tables depend on the runs alone: the same runs give the same bytes.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

from inkjet_env.experiments.benchmark import page
from inkjet_env.experiments.benchmark.analysis import Comparison
from inkjet_env.experiments.benchmark.conclusions import ranking_sentences, standings_sentences
from inkjet_env.experiments.benchmark.run_files import RunResult
from inkjet_env.experiments.benchmark.suite import VERSION, problem
from inkjet_env.reporting.waveform_figures import draw_before_after
from inkjet_env.storage import json_text, write_atomically

RANKING_FORMAT = "ranking/1"
GENERATION = 40
"""Number of evaluations in the first generation of 40 particles."""
CSV_COLUMNS = (
    *("optimizer", "mean_rank", "mean_rank_low", "mean_rank_high", "problem", "runs"),
    *("median_regret_V", "regret_low_V", "regret_high_V"),
)


def write_report(compared: Comparison) -> tuple[Path, dict[str, Any]]:
    """Write report.html, ranking.csv and ranking.json into the results folder.

    Returns
    -------
    page : Path
        Path of report.html.
    ranking : dict
        Content of ranking.json; "sentences" holds the conclusions in words.
    """
    folder, problems = compared.outcome.folder, compared.problems
    ranking = ranking_json(compared)
    write_atomically(folder / "ranking.csv", ranking_csv(compared))
    write_atomically(folder / "ranking.json", json_text(ranking))
    file = folder / "report.html"
    shown = "nominal" if "nominal" in problems else problems[0]
    runs = compared.runs.get((compared.ranking.optimizers[0], shown))
    run = best_run(runs or compared.outcome.results)
    write_atomically(file, page.page(compared, run, before_after_figure(run)))
    return file, ranking


def ranking_json(compared: Comparison) -> dict[str, Any]:
    """The ranking after the whole budget and the standings after each budget, as plain JSON values.

    Undefined numbers are null.
    """
    settings, ranking = compared.outcome.settings, compared.ranking
    return {
        "format": RANKING_FORMAT,
        "suite": VERSION,
        "settings": settings.to_json(),
        "sentences": [
            *standings_sentences(compared, "all", compared.budgets[-1]),
            *ranking_sentences(compared),
        ],
        "problems": [page.problem_json(name) for name in compared.problems],
        "entrants": [
            page.entrant_json(settings.entrant(name), settings.budget_of(name)) for name in compared.optimizers
        ],
        "standings": {str(b): page.standings_json(compared, "all", b) for b in compared.budgets},
        "friedman_p": _number(ranking.standings.friedman_p),
        "critical_difference": _number(ranking.standings.critical_difference),
        "ranking": [_ranked_json(compared, optimizer) for optimizer in ranking.optimizers],
        "unavailable": compared.outcome.unavailable,
    }


def _ranked_json(compared: Comparison, optimizer: str) -> dict[str, Any]:
    """Mean rank of one optimiser, and its median regret on every problem on which it can be used."""
    mean_rank = compared.ranking.mean_ranks[optimizer]
    problems = {}
    for name in compared.problems:
        if (optimizer, name) in compared.runs:
            regret = compared.ranking.median_regrets_V[optimizer, name]
            problems[name] = {
                "runs": len(compared.runs[optimizer, name]),
                "median_regret_V": regret.value,
                "low": _number(regret.low),
                "high": _number(regret.high),
            }
    return {
        "optimizer": optimizer,
        "mean_rank": mean_rank.estimate.value,
        "low": mean_rank.estimate.low,
        "high": mean_rank.estimate.high,
        "tied_with_winner": mean_rank.tied_with_winner,
        "problems": problems,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def ranking_csv(compared: Comparison) -> str:
    """The ranking as CSV, one line per optimiser and problem, the best optimiser first."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for optimizer in compared.ranking.optimizers:
        rank = astuple(compared.ranking.mean_ranks[optimizer].estimate)
        for name in compared.problems:
            if runs := compared.runs.get((optimizer, name)):
                regret = astuple(compared.ranking.median_regrets_V[optimizer, name])
                writer.writerow([optimizer, *rank, name, len(runs), *regret])
    return text.getvalue()


def best_run(results: Sequence[RunResult]) -> RunResult:
    """The run with the lowest final cost; the first of several."""
    return min(results, key=lambda result: float(result.costs_V[-1]))


def before_after_figure(run: RunResult) -> Any:
    """Best waveform of a run's first 40 evaluations and the best of all, side by side."""
    solved = problem(run.key.problem)
    first, final = solved.respond(run.best_point(GENERATION)), solved.respond(run.best_point())
    last = run.budget
    titles = (f"best of the first {min(GENERATION, last)} evaluations", f"best of all {last:,} evaluations")
    return draw_before_after(first, final, solved.cost, titles)
