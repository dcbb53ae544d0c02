"""``inkjet bench``: compare the optimisers on the problem suite."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inkjet_env.cli.arguments import check_outputs, chosen_seed
from inkjet_env.cli.exit_status import INTERRUPTED
from inkjet_env.cli.options import JsonFile
from inkjet_env.extras import check_installed

if TYPE_CHECKING:
    from inkjet_env.experiments.benchmark.settings import BenchOutcome


OF_RUNS = ("problems", "optimizers", "repeats", "budget", "seed", "workers", "scheduler")
"""Options that say what is run."""


def bench(
    context: typer.Context,
    results: Annotated[Path, typer.Option(help="results folder; runs found there are not repeated")] = Path(
        "results/bench"
    ),
    problems: Annotated[
        str | None,
        typer.Option(help='names separated by commas, module:name for your own, or "all"; five problems unless given'),
    ] = None,
    optimizers: Annotated[
        str | None,
        typer.Option(
            help='names separated by commas, module:Class for your own, or "all"; all but the slowest unless given'
        ),
    ] = None,
    repeats: Annotated[int, typer.Option(help="number of runs of each optimiser on each problem")] = 15,
    budget: Annotated[int, typer.Option(help="number of evaluations in each run")] = 2000,
    seed: Annotated[int, typer.Option(help="seed from which all other seeds are derived")] = 0,
    workers: Annotated[
        int | None, typer.Option(help="number of processes on this machine; one per core unless given")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(help="address of a Dask cluster, such as tcp://host:8786; local processes unless given"),
    ] = None,
    merge: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FOLDER",
            help="rank the finished runs of this folder beside those of others, which are given likewise; nothing is "
            "run; the report goes to --results",
        ),
    ] = None,
    coco: Annotated[
        Path | None, typer.Option(help="folder for the runs as logs of COCO, for its post-processing cocopp")
    ] = None,
    json: JsonFile = None,
) -> None:
    """Compare the optimisers on the problem suite; the same command resumes where it was stopped.

    \b
    inkjet bench --optimizers pso,pso-printed,cma-es --problems nominal \\
        --repeats 5 --results results/quick

    \b
    inkjet bench --optimizers pso,my_lab:Annealing \\
        --problems nominal,my_lab:tall_drop --repeats 5 --results results/lab

    \b
    inkjet bench --merge results/quick --merge results/lab \\
        --results results/merged
    """
    from inkjet_env.experiments.benchmark.runner import run_bench
    from inkjet_env.experiments.benchmark.settings import BenchSettings

    check_installed("inkjet bench", "cli", "bench")
    check_outputs(json=json)
    if merge:
        from inkjet_env.experiments.benchmark.merged import merged

        if given := [name for name in OF_RUNS if getattr(context.get_parameter_source(name), "name", "") != "DEFAULT"]:
            raise ValueError(f"--merge runs nothing: what is compared stands in its folders. Leave out --{given[0]}.")
        _report(merged(merge, results), json, coco)
        return
    if workers is not None and workers < 1:
        raise ValueError(f"--workers must be at least 1; got {workers}.")
    if scheduler is not None and workers is not None:
        raise ValueError(
            "--workers sets local processes, but the cluster of --scheduler has its own workers. Leave one out."
        )
    chosen = {
        label: tuple(name.strip() for name in names.split(",") if name.strip())
        for label, names in (("problems", problems), ("optimizers", optimizers))
        if names is not None
    }
    if chosen.get("optimizers") == ("all",):
        from inkjet_env.experiments.benchmark.entrants import entrants

        chosen["optimizers"] = entrants()
    if chosen.get("problems") == ("all",):
        from inkjet_env.experiments.benchmark.suite import installed, suite

        chosen["problems"] = (*suite(), *installed())
    settings = BenchSettings.default(repeats=repeats, budget=budget, seed=chosen_seed(seed), **chosen)
    try:
        outcome = run_bench(settings, results, workers, scheduler)
    except KeyboardInterrupt:
        print(f"Interrupted; finished runs are kept in {results}. Run the same command to resume.", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from None
    _report(outcome, json, coco)


def _report(outcome: BenchOutcome, json: Path | None, coco: Path | None) -> None:
    """Write report and tables, and print the ranking."""
    from inkjet_env.experiments.benchmark.analysis import Comparison
    from inkjet_env.experiments.benchmark.report import write_report
    from inkjet_env.storage import write_json

    comparison = Comparison(outcome)
    page, ranking = write_report(comparison)
    if coco is not None:
        from inkjet_env.experiments.benchmark.interfaces.coco_logs import write_coco_logs

        write_coco_logs(comparison, coco)
    if json is not None:
        write_json(json, ranking)
    if str(json) != "-":
        from inkjet_env.experiments.benchmark.ranking_tables import print_ranking

        print_ranking(ranking)
        print(f"Report: {page}")
        if coco is not None:
            print(f"Logs for COCO: {coco}; python -m cocopp {coco}/*/ makes its page.")
