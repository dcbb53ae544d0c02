"""``inkjet tune``: the closed loop from recordings to a waveform that was checked on the head."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from inkjet_env.cli.arguments import check_outputs, chosen_cost, chosen_limits, chosen_seed, named_values
from inkjet_env.cli.campaign_reading import (
    Implausible,
    Interval,
    Reading,
    ScopeChannel,
    ScopeColumns,
    ScopeState,
    notes_of,
    warn,
)
from inkjet_env.cli.exit_status import INTERRUPTED
from inkjet_env.cli.options import CostA, CostB, Effective, JsonFile, Limits, OwnEffects, TargetHeight, Window

if TYPE_CHECKING:
    from inkjet_env.experiments.tuning.session import Tuned
    from inkjet_env.rig import Rig

REPORT = "report.html"


def tune(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR",
            help="folder of a campaign; if it is missing or empty, the default battery is recorded first",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="folder of the session, which resumes there; DIR-tuning unless given")
    ] = None,
    rig: Annotated[
        str | None,
        typer.Option(
            help="what takes recordings: a printhead.json, which a virtual rig simulates, or module:Class of a rig of "
            "your own; without it, people take them through the session's folders"
        ),
    ] = None,
    requests: Annotated[int, typer.Option(help="largest number of recordings to tell rival effects apart", min=0)] = 3,
    refinements: Annotated[
        int, typer.Option(help="largest number of further waveforms near the best one, each checked", min=0)
    ] = 2,
    risk: Annotated[
        str, typer.Option(help="how a waveform is judged on the heads that remain possible: mean, cvar or worst")
    ] = "cvar",
    budget: Annotated[int, typer.Option(help="evaluations of each search for a waveform", min=8)] = 2000,
    frequency: Annotated[
        float, typer.Option(help="expected resonance in Hz, for the drives of a first campaign", min=1.0)
    ] = 50e3,
    snr_db: Annotated[float, typer.Option("--snr-db", help="signal-to-noise ratio of the virtual rig, in dB")] = 45.0,
    limits: Limits = None,
    waveform: Annotated[
        Path | None,
        typer.Option(help="file for the waveform to fire: .csv, or .ini with segments of a print controller"),
    ] = None,
    workers: Annotated[int, typer.Option(help="number of processes of a diagnosis", min=1)] = 2,
    seed: Annotated[int | None, typer.Option(help="seed of all random numbers (0)")] = None,
    json: JsonFile = None,
    report: Annotated[
        Path | None, typer.Option(help="file for the page: .html; report.html in the session's folder unless given")
    ] = None,
    effect: OwnEffects = None,
    cost_a: CostA = None,
    cost_b: CostB = None,
    effective: Effective = None,
    target_height: TargetHeight = None,
    window: Window = None,
    channel: ScopeChannel = None,
    columns: ScopeColumns = None,
    initial_state: ScopeState = None,
    interval: Interval = None,
    implausible: Implausible = False,
) -> None:
    """Diagnose a head, ask for the recordings that settle most, optimise, check waveforms on the head, and choose.

    \b
    inkjet tune campaign \\
        --limits lowest_V=-60,highest_V=60,rise_V_per_us=20,step_us=0.1 \\
        --waveform waveform.ini

    \b
    inkjet tune bench --rig head.json --seed 1

    The drives to record are written to DIR-tuning/requests; put each recording into DIR-tuning/answers under the same
    name and run the same command again. With --rig nobody has to. Ctrl-C loses nothing. A page, report.html, shows
    what to record, and in the end the waveform beside the others, the checks, and how it was found.
    """
    from inkjet_env.cli.own_effects import register_own
    from inkjet_env.experiments.execution.held_folder import held
    from inkjet_env.experiments.tuning.exchange import Exchange, WaitingError
    from inkjet_env.experiments.tuning.report import write_page
    from inkjet_env.experiments.tuning.session import Session, TuneSettings
    from inkjet_env.naming import check_name
    from inkjet_env.plant.head_ensemble import RISKS
    from inkjet_env.printhead.window import DEFAULT_WINDOW_S
    from inkjet_env.progress import shown_steps
    from inkjet_env.rig.record import LOWEST_SNR_dB
    from inkjet_env.storage import write_json

    check_outputs(json=json, waveform=waveform, report=report)
    if report is not None and report.suffix.lower() != ".html":
        raise ValueError(f"--report must end in .html; got {report}.")
    check_name("--risk", risk, RISKS)
    if not snr_db >= LOWEST_SNR_dB:
        raise ValueError(f"--snr-db must be at least {LOWEST_SNR_dB:g} dB, or inf for no noise; got {snr_db:g}.")
    if waveform is not None and waveform.suffix.lower() not in (".csv", ".ini"):
        raise ValueError(f"--waveform must end in .csv or .ini; got {waveform}.")
    register_own(effect)
    reading = Reading.of(channel, columns, initial_state, interval, implausible)
    driver = chosen_limits(limits)
    instruments = None if rig is None else _rig(rig, chosen_seed(seed), snr_db, driver)
    settings = TuneSettings(
        requests, refinements, risk, budget, seed=chosen_seed(seed), frequency_Hz=frequency,
        limits=driver if limits is not None or instruments is None else instruments.limits(),
        cost=chosen_cost((cost_a, cost_b, effective, target_height)),
        window_s=DEFAULT_WINDOW_S if window is None else window,
    )  # fmt: skip
    session_folder = out or folder.with_name(f"{folder.resolve().name}-tuning")
    page, name = report or session_folder / REPORT, folder.resolve().name
    campaign = None
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        campaign = reading.campaign(folder)
        warn([*notes_of(campaign), *reading.warnings(campaign)])
    named = None if columns is None else named_values("--columns", columns)
    try:
        with held(session_folder, "tuning session"), shown_steps(f"tune {folder}") as progress:
            exchange = Exchange(session_folder, instruments, named)
            session = Session(session_folder, settings, exchange, campaign, progress, workers)
            tuned = session.run()
    except WaitingError as waiting:
        write_page(page, session, name, requests=waiting.requests)
        count = len(waiting.names)
        told = (
            f"{session_folder / 'requests'}: {count} {'drive' if count == 1 else 'drives'} to record, listed in "
            f"requests.csv. Put each recording into {session_folder / 'answers'} under the same name, and run the same "
            f"command again. {page} shows the drives."
        )
        print(told, file=sys.stderr if str(json) == "-" else sys.stdout)
        if json is not None:
            write_json(json, {"format": "tune/1", "waiting_for": list(waiting.names)})
        return
    except KeyboardInterrupt:
        print(
            f"Interrupted; finished steps are kept in {session_folder}. Run the same command to resume.",
            file=sys.stderr,
        )
        raise typer.Exit(INTERRUPTED) from None
    if waveform is not None:
        _write_waveform(waveform, tuned)
    if json is not None:
        write_json(json, tuned.as_json())
    write_page(page, session, name, tuned)
    if str(json) != "-":
        _print(tuned, session_folder, waveform)
        print(f"Report: {page}")


def _rig(name: str, seed: int, snr_dB: float, limits: Any) -> Rig:
    """The virtual rig of a printhead file, or a rig of the user's own."""
    from inkjet_env.plant.printhead_file import read_printhead
    from inkjet_env.plugins import is_place, plugin
    from inkjet_env.rig import VirtualRig

    if not is_place(name):
        return VirtualRig(read_printhead(name), seed, snr_dB, limits)
    try:
        found = plugin("inkjet_env.rigs", name)
        assert found is not None
        made = found.load()
        made = made() if callable(made) else made
    except ValueError as error:
        raise ValueError(f"--rig {name}: {error}") from None
    if not (callable(getattr(made, "record", None)) and callable(getattr(made, "limits", None))):
        raise ValueError(f"--rig {name}: a rig must have the methods record and limits; see inkjet_env.rig.Rig.")
    rig: Rig = made
    return rig


def _write_waveform(file: Path, tuned: Tuned) -> None:
    from inkjet_env.cli.drive_csv import DEFAULT_SAMPLE_RATE_Hz, sampled_waveform, write_columns
    from inkjet_env.recordings.segment_file import write_segments

    chosen = tuned.proposals[tuned.best].as_waveform
    if file.suffix.lower() == ".ini":
        write_segments(file, *chosen.knots())
        return
    time_s, drive_V = sampled_waveform(chosen, DEFAULT_SAMPLE_RATE_Hz)
    write_columns(file, {"time_s": time_s, "drive_V": drive_V})


def _print(tuned: Tuned, folder: Path, waveform: Path | None) -> None:
    from inkjet_env.experiments.tuning.session import NAMES
    from inkjet_env.reporting.tables import print_table

    for number, one in enumerate(tuned.rounds, start=1):
        print(f"Diagnosis {number}, of {one['recordings']} recordings: {one['headline']}")
    rows = [
        (
            f"{'→ ' if k == tuned.best else ''}{NAMES[one.name]}", f"{one.predicted_V:.3f}",
            f"{one.low_V:.3f} … {one.high_V:.3f}", f"{check.cost_V:.3f} ± {check.error_V:.3f}",
        )
        for k, (one, check) in enumerate(zip(tuned.proposals, tuned.checks, strict=True))
    ]  # fmt: skip
    print_table(("best waveform of the", "predicted (V)", "90 % of the heads (V)", "on the head (V)"), rows)
    best, check = tuned.proposals[tuned.best], tuned.checks[tuned.best]
    print(f"If small peaks count that the noise may hide, the chosen one costs {check.worst_V:.3f} V at worst.")
    values = " ".join(f"{v:.6g}" for v in best.waveform)
    print(f"waveform U1 U2 t1 t2 t3 t4 t5: {values}")
    print(f"{folder}: {tuned.recordings} recordings were taken in this session; log.md tells what was done")
    if waveform is not None:
        print(f"{waveform}: the waveform to fire")
