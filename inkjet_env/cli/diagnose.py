"""The command diagnose: where recordings and model differ, and which physics the model lacks."""

from __future__ import annotations

import itertools
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from inkjet_env.cli.arguments import check_outputs, chosen_seed
from inkjet_env.cli.campaign_reading import (
    Folder,
    Implausible,
    Interval,
    Reading,
    ScopeChannel,
    ScopeColumns,
    ScopeState,
    files_of,
    print_notes,
    warn,
)
from inkjet_env.cli.exit_status import INTERRUPTED
from inkjet_env.cli.options import JsonFile, OwnEffects
from inkjet_env.cli.printing import print_diagnosis
from inkjet_env.progress import shown_steps

if TYPE_CHECKING:
    from collections.abc import Container, Mapping

    from inkjet_env.mismatch import Diagnosis

NEXT = "next.csv"


def diagnose(
    folder: Folder,
    printhead: Annotated[
        Path | None, typer.Option(help="printhead.json to start from; identified from the campaign unless given")
    ] = None,
    effect: OwnEffects = None,
    printhead_out: Annotated[
        Path | None, typer.Option(help="file for the corrected printhead, to use with --printhead: .json")
    ] = None,
    report: Annotated[Path | None, typer.Option(help="report with all findings: .html")] = None,
    json: JsonFile = None,
    next_out: Annotated[
        Path | None,
        typer.Option(help="file for the drive of the next experiment: .csv; next.csv beside the JSON unless given"),
    ] = None,
    hold_out: Annotated[
        str | None,
        typer.Option(
            "--hold-out",
            "--held-out",
            help="recordings to exclude from every fit and to test each named effect on, separated by commas; chosen "
            "by condition unless given",
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="seed of all random numbers (0)")] = None,
    workers: Annotated[int | None, typer.Option(help="number of processes (2)")] = None,
    checkpoint: Annotated[
        Path | None,
        typer.Option(
            help="folder for finished fits, from which an interrupted run resumes; beside the JSON, report or "
            "printhead file unless given"
        ),
    ] = None,
    channel: ScopeChannel = None,
    columns: ScopeColumns = None,
    initial_state: ScopeState = None,
    interval: Interval = None,
    implausible: Implausible = False,
) -> None:
    """Find where recordings and model differ, which physics the model lacks, and how much adding it improves the fit.

    \b
    inkjet diagnose campaign --printhead-out corrected.json \\
        --report diagnosis.html --json diagnosis.json

    \b
    inkjet diagnose campaign --effect my_effects:QuadraticStiffness

    With --effect, your own effects are tried in addition to the catalogue's.
    """
    from inkjet_env.cli.own_effects import register_own

    next_named = next_out is not None
    if next_out is None and json is not None and str(json) != "-":
        next_out = json.parent / NEXT
    files = {"printhead-out": printhead_out, "report": report, "next-out": next_out}
    check_outputs((printhead, *files_of(folder)), json=json, **files)
    for (name, file), ending in zip(files.items(), (".json", ".html", ".csv"), strict=True):
        if file is not None and file.suffix.lower() != ending:
            raise ValueError(f"--{name} must end in {ending}; got {file}.")
    if workers is not None and workers < 1:
        raise ValueError(f"--workers must be at least 1; got {workers}.")
    options: dict[str, Any] = {}
    if own := register_own(effect):
        from inkjet_env.plant import catalogue

        options["effects"] = (*catalogue(), *own)
    if hold_out is not None:
        options["held_out"] = tuple(name.strip() for name in hold_out.split(","))
    if workers is not None:
        options["workers"] = workers
    from inkjet_env.mismatch import clear_checkpoint

    reading = Reading.of(channel, columns, initial_state, interval, implausible)
    options["checkpoint"] = checkpoint = _checkpoint_folder(checkpoint, json, report, printhead_out)
    try:
        found = _diagnosed(folder, printhead, reading, chosen_seed(seed), options)
    except KeyboardInterrupt:
        if checkpoint is None:
            print("Interrupted; no fits were kept. Use --checkpoint FOLDER to keep finished fits.", file=sys.stderr)
        else:
            print(
                f"Interrupted; finished fits are kept in {checkpoint}. Run the same command to resume.", file=sys.stderr
            )
        raise typer.Exit(INTERRUPTED) from None
    written = _written(found, json, files, next_named)
    if str(json) != "-":
        print_diagnosis(found)
        for what, file in written.items():
            print(f"{file}: {what}")
    if checkpoint is not None:
        sys.stdout.flush()
        clear_checkpoint(checkpoint)  # only now: whatever failed above can be done again without the fits


def _checkpoint_folder(given: Path | None, *outputs: Path | None) -> Path | None:
    """Folder for finished fits: the one given, or one beside the first output file; None without either."""
    if given is not None and given.exists() and not given.is_dir():
        raise ValueError(f"--checkpoint must be a folder, new or existing; {given} is a file.")
    named = [path for path in outputs if path is not None and str(path) != "-"]
    return given or (named[0].with_name(f"{named[0].name}.fits") if named else None)


def _diagnosed(
    folder: Path, printhead: Path | None, reading: Reading, seed: int, options: Mapping[str, Any]
) -> Diagnosis:
    """Read, check and diagnose the campaign of a folder; warnings go to standard error."""
    import numpy as np

    from inkjet_env.mismatch import diagnose
    from inkjet_env.printhead import Printhead

    head = None if printhead is None else Printhead.from_json(printhead)
    with shown_steps(f"diagnose {folder}") as progress:
        campaign = reading.campaign(folder, progress)
        warnings = reading.warnings(campaign, head)
        try:
            found = diagnose(campaign, head, rng=np.random.default_rng(seed), progress=progress, **options)
        finally:
            warn(warnings)  # they may explain a failure
    print_notes(campaign)
    return found


def _written(
    found: Diagnosis, json: Path | None, files: Mapping[str, Path | None], next_named: bool
) -> dict[str, Path]:
    """Write the requested files, once the contents of all are ready; each file by its description."""
    from inkjet_env.reporting.diagnosis_report import diagnosis_html, experiment_csv, head_words
    from inkjet_env.storage import json_text, write_atomically, write_json

    head_file, report, drive_file = files.values()
    drives: dict[Path, str] = {}
    names: list[str | None] = []
    for number, experiment in enumerate(found.next_experiments, start=1):
        if not experiment.drive_V or drive_file is None:
            names.append(None)
            continue
        text = experiment_csv(experiment)
        file = drive_file if number == 1 else drive_file.with_name(f"{drive_file.stem}-{number}{drive_file.suffix}")
        if not next_named:
            file = _free_name(file, text, drives)
        drives[file] = text
        beside = Path() if json is None or str(json) == "-" else json.parent
        names.append(Path(os.path.relpath(file, beside)).as_posix())
    page = None if report is None else diagnosis_html(found)
    head = None if head_file is None else json_text(found.augmented_json())
    verdict = None if json is None else found.as_json(names)
    written = {}
    for number, (file, text) in enumerate(drives.items(), start=1):
        write_atomically(file, text)
        written["drive of the next experiment" + (f", {number}" if len(drives) > 1 else "")] = file
    if head_file is not None and head is not None:
        write_atomically(head_file, head)
        ready = ", ready for --printhead" if found.printhead.has_dynamics and found.effects else ""
        written[f"{head_words(found)}{ready}"] = head_file
    if report is not None and page is not None:
        write_atomically(report, page)
        written["report"] = report
    if json is not None:
        write_json(json, verdict)
    return written


def _free_name(file: Path, content: str, taken: Container[Path]) -> Path:
    """The file, or one numbered after it, that is not taken, and does not exist or holds this content."""
    numbered = (file.with_name(f"{file.stem}-{number}{file.suffix}") for number in itertools.count(2))
    return next(
        tried
        for tried in itertools.chain([file], numbered)
        if tried not in taken and (not tried.exists() or (tried.is_file() and tried.read_bytes() == content.encode()))
    )
