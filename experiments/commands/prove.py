"""``inkjet prove``: the blind proof of the diagnosis."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from inkjet_env.cli.arguments import check_outputs
from inkjet_env.cli.exit_status import CHECK_FAILED, INTERRUPTED
from inkjet_env.cli.options import JsonFile
from inkjet_env.extras import check_installed

REPORT = "report.html"


def prove(
    out: Annotated[Path, typer.Option(help="results folder; finished cases found there are not repeated")] = Path(
        "results/proof"
    ),
    seed: Annotated[int | None, typer.Option(help="seed of the corpus, for development (1)")] = None,
    published: Annotated[
        bool,
        typer.Option(
            "--published", help="use the corpus of the published seed: once per version, when the code is final"
        ),
    ] = False,
    quick: Annotated[bool, typer.Option("--quick", help="60 cases of all kinds instead of all")] = False,
    only: Annotated[
        str | None,
        typer.Option(
            help="only cases of these effects, strengths (strong, medium, faint), families (null, effect, outside, "
            "base, pair) and sizes (whole, meagre, slow), separated by commas"
        ),
    ] = None,
    first: Annotated[
        int, typer.Option(help="only so many cases of each family, effects, strength and size; 0: all", min=0)
    ] = 0,
    adaptive: Annotated[
        bool,
        typer.Option(
            "--adaptive", help="then have up to three recordings that a diagnosis asks for taken, and diagnose again"
        ),
    ] = False,
    scheduler: Annotated[
        str | None,
        typer.Option(help="address of a Dask cluster, such as tcp://host:8786; local processes unless given"),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="number of processes on this machine; one per core unless given")
    ] = None,
    reoptimise: Annotated[
        int | None, typer.Option(help="number of heads whose waveform is re-optimised (100; with --quick 1)")
    ] = None,
    baselines: Annotated[
        int | None,
        typer.Option(
            help="number of cases on which the baselines refit, SINDy and NARX are tried too (60; with --quick 0)"
        ),
    ] = None,
    json: JsonFile = None,
    report: Annotated[
        Path | None, typer.Option(help="file for the report: .html; report.html in the folder unless given")
    ] = None,
) -> None:
    """Conceal effects in heads of an independent plant, diagnose them blind, and score the diagnoses.

    \b
    inkjet prove --quick --out results/quick-proof

    A plant that shares no code with the diagnosis draws heads, conceals effects in them and records campaigns under
    opaque names. The truth is sealed and its SHA-256 printed. Then a process that has access to only one campaign at a
    time runs "inkjet diagnose". The answers are hashed, the truth is unsealed, and everything is scored. The same
    command resumes a stopped proof. The exit status is 1 if a criterion of a first-rate diagnosis is not met.
    """
    from inkjet_env.experiments.proof.corpus import DEVELOPMENT_SEED, PUBLISHED_SEED
    from inkjet_env.experiments.proof.sealing import Settings

    check_installed("inkjet prove", "cli", "bench")
    check_outputs(json=json, report=report)
    for name, value, least in (("workers", workers, 1), ("reoptimise", reoptimise, 0), ("baselines", baselines, 0)):
        if value is not None and value < least:
            raise ValueError(f"--{name} must be at least {least}; got {value}.")
    if report is not None and report.suffix.lower() != ".html":
        raise ValueError(f"--report must end in .html; got {report}.")
    if scheduler is not None and workers is not None:
        raise ValueError(
            "--workers sets local processes, but the cluster of --scheduler has its own workers. Leave one out."
        )
    if published and seed is not None:
        raise ValueError("--published sets its own seed; leave out --seed.")
    if published and quick:
        raise ValueError("--published needs the full corpus, once per version; leave out --quick.")
    if seed is not None and seed < 0:
        raise ValueError(f"--seed must be at least 0; got {seed}.")
    if seed == PUBLISHED_SEED:
        raise ValueError(f"seed {seed} is the published one: give --published instead, once the code is final.")
    chosen = PUBLISHED_SEED if published else DEVELOPMENT_SEED if seed is None else seed
    names = tuple(name.strip() for name in only.split(",")) if only else ()
    settings = Settings(chosen, "quick" if quick else "full", only=names, first=first)
    asked = (
        (1 if quick else 100) if reoptimise is None else reoptimise,
        (0 if quick else 60) if baselines is None else baselines,
    )
    try:
        status = _proved(settings, out, scheduler, workers, asked, adaptive, json, report or out / REPORT)
    except KeyboardInterrupt:
        print(f"Interrupted; finished cases are kept in {out}. Run the same command to resume.", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from None
    raise typer.Exit(status)


def _proved(
    settings: Any,
    out: Path,
    scheduler: str | None,
    workers: int | None,
    asked: tuple[int, int],
    adaptive: bool,
    json: Path | None,
    report: Path,
) -> int:
    """Run the proof, write and print its score; return the exit status."""
    from inkjet_env.experiments.execution import cluster
    from inkjet_env.experiments.execution.held_folder import held
    from inkjet_env.experiments.proof.adaptive import adapt, adapt_case
    from inkjet_env.experiments.proof.judge import judge_case, questions
    from inkjet_env.experiments.proof.printing import print_rounds, print_score
    from inkjet_env.experiments.proof.protocol import Steps, answer_case, conceal_case, prove
    from inkjet_env.experiments.proof.report import write_page
    from inkjet_env.experiments.proof.score import score
    from inkjet_env.experiments.proof.sealing import check_folder
    from inkjet_env.storage import json_text, write_atomically, write_json

    steps = Steps(conceal_case, answer_case, judge_case)
    check_folder(out, settings)  # before any process is started
    with held(out, "proof"), cluster.workers_of(scheduler, workers) as client:
        outcome = prove(settings, out, client, steps, lambda draws: questions(draws, *asked))
        rounds = adapt(out, outcome, client, adapt_case, settings.rig) if adaptive else None
    found = score(outcome)
    if rounds is not None:
        found["adaptive"] = {"figures": rounds["figures"], "waveforms": rounds["waveforms"]}
    write_atomically(out / "score.json", json_text(found))
    write_page(report, found)
    if json is not None:
        write_json(json, found)
    if str(json) != "-":
        print_score(found)
        if rounds is not None:
            print_rounds(rounds)
        print(f"Report: {report}")
    return CHECK_FAILED if found["short"] else 0
