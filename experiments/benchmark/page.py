"""The HTML report of a comparison: one self-contained file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.cli.drive_csv import waveform_files
from inkjet_env.experiments.benchmark.analysis import REFERENCE, SOLVED, Comparison
from inkjet_env.experiments.benchmark.conclusions import ranking_sentences, standings_sentences, winner_sentence
from inkjet_env.experiments.benchmark.entrants import Entrant
from inkjet_env.experiments.benchmark.metrics import performance_profile
from inkjet_env.experiments.benchmark.plots import COLOURS, DASHES, pictures
from inkjet_env.experiments.benchmark.regret import best_known_cost, regret_quartiles_V, scale_V
from inkjet_env.experiments.benchmark.run_files import RunResult, read_seconds
from inkjet_env.experiments.benchmark.suite import VERSION, family_of, problem
from inkjet_env.experiments.execution.provenance import versions
from inkjet_env.jetting.figures_of_merit import jetting
from inkjet_env.printhead import Waveform
from inkjet_env.reporting.page import page_environment

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEVELS = np.logspace(-5, 1, 121)
GRID = 90
FLOOR_V = 1e-6


def page(compared: Comparison, run: RunResult, waveforms: Figure) -> str:
    """The report as HTML text.

    Parameters
    ----------
    compared : Comparison
        The comparison to report.
    run : RunResult
        The run that found the winning waveform.
    waveforms : Figure
        That waveform with its response.
    """
    environment = page_environment("inkjet_env.experiments.benchmark")
    data, settings = page_data(compared), compared.outcome.settings
    solved = problem(run.key.problem)
    waveform = Waveform.from_array(solved.bounds.from_unit(run.best_point()))
    return environment.get_template("comparison.html").render(
        verdict=winner_sentence(compared).rstrip("."),
        sentences=ranking_sentences(compared),
        pictures=pictures(data),
        run=run.key,
        cost_V=float(run.costs_V[-1]),
        waveform=waveform,
        files=waveform_files(waveform),
        waveforms=waveforms,
        settings=settings,
        unavailable=compared.outcome.unavailable,
        sources=settings.sources_json(),
        versions=versions(),
        reference=REFERENCE,
        suite=VERSION,
        data=data,
    )


def page_data(compared: Comparison) -> dict[str, Any]:
    """All data of the report, as plain JSON values."""
    rng = np.random.default_rng(compared.outcome.settings.seed)
    settings = compared.outcome.settings
    budget, budget_of = settings.budget, settings.budget_of
    spaced = np.round(np.geomspace(1, budget, GRID)).astype(int)
    evaluations = sorted({*spaced.tolist(), *compared.budgets})
    families = ("all", *compared.families) if len(compared.families) > 1 else ("all",)
    order = [row.optimizer for row in compared.standings("all", budget).rows]
    order += [name for name in compared.optimizers if name not in order]
    return {
        "families": list(families),
        "budgets": list(compared.budgets),
        "optimizers": order,
        "colours": list(COLOURS),
        "dashes": list(DASHES),
        "reference": REFERENCE,
        "floor_V": FLOOR_V,
        "evaluations": evaluations,
        "levels": LEVELS.tolist(),
        "standings": {
            family: {str(b): standings_json(compared, family, b) for b in compared.budgets} for family in families
        },
        "ecdf": {
            family: {
                name: compared.running_times(name, family, [e for e in evaluations if e <= budget_of(name)]).tolist()
                for name in order
            }
            for family in families
        },
        "profile": {family: {str(b): _profiles(compared, family, b) for b in compared.budgets} for family in families},
        "curves": {name: _curves(compared, name, evaluations) for name in compared.problems},
        "physical": {name: _physical(compared, name, order, rng) for name in compared.problems},
        "problems": [problem_json(name) for name in compared.problems],
        "entrants": [entrant_json(settings.entrant(name), budget_of(name)) for name in order],
        "seconds": {name: _seconds(compared, name) for name in order},
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def standings_json(compared: Comparison, family: str, budget: int) -> dict[str, Any]:
    """Standings on a family after a budget and the conclusions from them, as plain JSON values."""
    found = compared.standings(family, budget)
    rows = [
        {
            "optimizer": row.optimizer,
            "applies": row.applies,
            "rank": row.rank,
            "quality": row.quality.as_json(),
            "solved": row.solved.as_json(),
            "improvement": row.improvement.as_json(),
            "signed_rank": None if math.isnan(row.signed_rank.first) else vars(row.signed_rank),
        }
        for row in found.rows
    ]
    return {
        "problems": len(found.problems),
        "friedman_p": _finite(found.friedman_p),
        "critical_difference": _finite(found.critical_difference),
        "sentences": list(standings_sentences(compared, family, budget)),
        "rows": rows,
    }


def _profiles(compared: Comparison, family: str, budget: int) -> dict[str, list[float]]:
    names = compared.in_family(family)
    profiles = {}
    for optimizer in compared.optimizers:
        regrets = np.concatenate([compared.regrets(optimizer, name, budget) for name in names])
        if np.isfinite(regrets).any():
            profiles[optimizer] = performance_profile(regrets, LEVELS).tolist()
    return profiles


def _curves(compared: Comparison, name: str, evaluations: list[int]) -> dict[str, list[list[float]]]:
    """Quartiles of the regret in volts by optimiser, up to the length of its runs."""
    curves = {}
    for optimizer in compared.optimizers:
        runs = compared.runs.get((optimizer, name))
        if runs:
            reached = [count for count in evaluations if count <= runs[0].budget]
            curves[optimizer] = regret_quartiles_V(runs, reached).tolist()
    return curves


def _physical(
    compared: Comparison, name: str, order: list[str], rng: np.random.Generator
) -> dict[str, list[dict[str, Any]]]:
    """By budget, for each optimiser with runs of that length: figures of its median run, and its running times."""
    rows: dict[str, list[dict[str, Any]]] = {str(budget): [] for budget in compared.budgets}
    for optimizer in order:
        runs = compared.runs.get((optimizer, name))
        if not runs:
            continue
        times = {
            "expected": compared.expected_time(optimizer, name, SOLVED, rng).as_json(),
            "spent": sum(run.budget for run in runs),
        }
        for budget in compared.budgets:
            if runs[0].budget >= budget:
                rows[str(budget)].append({"optimizer": optimizer, **_median_figures(runs, name, budget), **times})
    return rows


def _median_figures(runs: Sequence[RunResult], name: str, budget: int) -> dict[str, Any]:
    """Cost and jetting figures of the run with the median result after a budget, as plain JSON values."""
    run = sorted(runs, key=lambda one: float(one.kept_V(budget)))[(len(runs) - 1) // 2]
    solved = problem(name)
    figures = jetting(solved.respond(run.best_point(budget)), solved.cost)
    return {
        "cost_V": float(run.kept_V(budget)),
        "told_V": float(run.lowest_told_V(budget)),
        "effective_V": _finite(figures.effective_V),
        "residual_mV": _finite(1e3 * figures.residual_V),
        "residual": _finite(figures.residual),
        "settling_us": _finite(1e6 * figures.settling_s),
        "highest_kHz": _finite(1e-3 * figures.highest_Hz),
    }


def _seconds(compared: Comparison, optimizer: str) -> float | None:
    """Mean computing time of a run in seconds; None if it is unknown."""
    found = [
        read_seconds(compared.outcome.folder, run.key).get("total", math.nan)
        for name in compared.problems
        for run in compared.runs.get((optimizer, name), ())
    ]
    known = [value for value in found if math.isfinite(value)]
    return float(np.mean(known)) if known else None


def entrant_json(who: Entrant, budget: int) -> dict[str, Any]:
    """An entrant's options, tuning effort, budget and remark, as plain JSON values."""
    return {
        "name": who.name,
        "settings": ", ".join(f"{option} {value:.3g}" for option, value in who.options.items()) or "defaults",
        "tuning": who.tuning_evaluations,
        "budget": budget,
        "remark": who.remark,
    }


def problem_json(name: str) -> dict[str, Any]:
    """A problem and its best known cost, as plain JSON values."""
    known = problem(name).best_known
    return {
        "name": name,
        "family": family_of(name),
        "best_V": best_known_cost(name),
        "scale_V": scale_V(name),
        "found_by": "" if known is None else known.found_by,
    }
