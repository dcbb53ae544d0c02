"""The commands on measuring campaigns: record (with the virtual rig), identify, evaluate."""

from __future__ import annotations

import shlex
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
)
from inkjet_env.cli.options import JsonFile, OwnEffects, PrintheadFile, WithRemainder

if TYPE_CHECKING:
    from inkjet_env.identification import Identification
    from inkjet_env.plant.augmented import AugmentedPrinthead
    from inkjet_env.printhead import Printhead
    from inkjet_env.recordings import Campaign

Folders = Annotated[
    list[Path], typer.Argument(metavar="DIR…", help="folder of a campaign; several are identified in parallel")
]


def record(
    folder: Folder,
    printhead: PrintheadFile = None,
    seed: Annotated[int | None, typer.Option(help="seed of the order and the noise (0)")] = None,
    snr_db: Annotated[
        float | None,
        typer.Option(
            "--snr-db",
            help="signal-to-noise ratio at each channel's strongest signal, in dB; the instruments' own unless given",
        ),
    ] = None,
    displacement: Annotated[
        bool, typer.Option("--displacement", help="record displacement with a laser vibrometer too")
    ] = False,
    plan: Annotated[
        bool,
        typer.Option("--plan", help="only write the drives as CSV files for a generator, and plan.csv; record nothing"),
    ] = False,
    hide: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT",
            help="an effect that the head has and its base model lacks, such as creep or second_mode, for a diagnosis "
            "to find; a wrong name lists all; may be repeated",
        ),
    ] = None,
    remainder: WithRemainder = True,
    effect: OwnEffects = None,
    json: JsonFile = None,
) -> None:
    """Record a complete campaign of a head with the virtual rig: strain gauge and self-sensing.

    \b
    inkjet record campaign --printhead printhead.json --seed 1

    \b
    inkjet record campaign --hide second_mode

    \b
    inkjet record drives --plan
    """
    from inkjet_env.cli.own_effects import register_own
    from inkjet_env.plant.printhead_file import chosen_head
    from inkjet_env.recordings import write_campaign
    from inkjet_env.rig import default_battery, displacement_battery, plan_csvs, record_campaign
    from inkjet_env.storage import write_json

    check_outputs((printhead,), json=json)
    _check_target(folder, plan)
    register_own(effect)
    head = _with_hidden(chosen_head(printhead, remainder), hide or [])
    battery = default_battery(head.frequency_Hz)
    if displacement:
        battery += displacement_battery(head.frequency_Hz)
    if plan:
        if snr_db is not None or seed is not None:
            raise ValueError("--plan writes drives, which have neither noise nor order; leave out --snr-db and --seed.")
        plan_csvs(folder, battery)
        said = f"{folder}: {len(battery)} drives, and plan.csv, which states how to record each and its purpose"
    else:
        campaign = record_campaign(head, chosen_seed(seed), battery=battery, snr_dB=snr_db)
        write_campaign(folder, campaign)
        said = f"{folder}: {len(campaign.recordings)} recordings"
        if hide:
            said += f"; to find what is hidden: inkjet diagnose {shlex.quote(str(folder))}"
    if json is not None:
        kind = "plan" if plan else "campaign"
        write_json(json, {"format": "recorded/1", "kind": kind, "folder": str(folder), "lines": len(battery)})
    if str(json) != "-":
        print(said)


def identify(
    folders: Folders,
    out: Annotated[
        Path, typer.Option(help="file for the printhead; a folder if several campaigns are identified")
    ] = Path("printhead.json"),
    report: Annotated[Path | None, typer.Option(help="report with all curves: .html")] = None,
    json: JsonFile = None,
    degree: Annotated[
        int | None, typer.Option(help="degree of the branch law; chosen from the recordings unless given")
    ] = None,
    degree_rule: Annotated[
        str,
        typer.Option(
            help="how the degree is chosen: flattening (of the error over all recordings), strain_gauge (the same on "
            "the strain gauge alone, as in the paper) or held_out (error on drives left out in turn)"
        ),
    ] = "flattening",
    valid_density: Annotated[
        bool, typer.Option("--valid-density", help="enforce p(r) >= 0, a valid Prandtl-Ishlinskii density")
    ] = False,
    full_scale: Annotated[
        float | None, typer.Option(help="change of drive at which x = 1, in volts; the largest swing unless given")
    ] = None,
    held_out: Annotated[
        str | None,
        typer.Option(help="recordings to exclude from every fit, separated by commas; every fourth unless given"),
    ] = None,
    channel: ScopeChannel = None,
    columns: ScopeColumns = None,
    initial_state: ScopeState = None,
    interval: Interval = None,
    implausible: Implausible = False,
    workers: Annotated[int | None, typer.Option(help="number of processes for several campaigns (all cores)")] = None,
) -> None:
    """Identify a head's hysteresis and dynamics, with 90 % intervals, from a campaign.

    \b
    inkjet identify campaign --out printhead.json --report identification.html
    """
    from inkjet_env.cli.identify_folders import identify_folders, identify_one
    from inkjet_env.storage import write_json

    options: dict[str, Any] = {
        "degree": degree,
        "degree_rule": degree_rule,
        "valid_density": valid_density,
        "full_scale_V": full_scale,
        "held_out": None if held_out is None else tuple(name.strip() for name in held_out.split(",")),
    }
    reading = Reading.of(channel, columns, initial_state, interval, implausible)
    if workers is not None and workers < 1:
        raise ValueError(f"--workers must be at least 1; got {workers}.")
    if len(folders) > 1:
        if report is not None or json is not None:
            raise ValueError("--report and --json need a single campaign; give one folder.")
        identify_folders(folders, out, reading, options, workers)
        return
    check_outputs(files_of(folders[0]), out=out, report=report, json=json)
    if report is not None and report.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"--report must end in .html; got {report}.")
    campaign, found = identify_one(folders[0], reading, options)
    write_json(out, found.as_json())
    if report is not None:
        from inkjet_env.reporting.identification_report import write_identification_report

        write_identification_report(report, campaign.name, found)
    if json is not None:
        write_json(json, found.as_json())
    if str(json) != "-":
        _tell(campaign, found)
        if found.warning:
            ready = "written, but not to be used, see above"
        elif found.printhead.has_dynamics:
            ready = "ready for --printhead"
        else:
            ready = "ready for `inkjet evaluate` and `inkjet diagnose`; the others need the resonance"
        print(f"{out}: {ready}" + (f"; report: {report}" if report else ""))


def evaluate(
    folder: Folder,
    printhead: PrintheadFile = None,
    remainder: WithRemainder = True,
    effect: OwnEffects = None,
    json: JsonFile = None,
    channel: ScopeChannel = None,
    columns: ScopeColumns = None,
    initial_state: ScopeState = None,
    interval: Interval = None,
    implausible: Implausible = False,
) -> None:
    """Compare a printhead, as it is, with a campaign: free-run simulation of every recording, and the residual.

    \b
    inkjet evaluate campaign --printhead printhead.json

    \b
    inkjet evaluate campaign --printhead corrected.json \\
        --effect my_effects:QuadraticStiffness

    Only one offset per channel and, where it is free, the resonator's initial state are refitted.
    """
    from inkjet_env.cli.evaluation import evaluation_json
    from inkjet_env.cli.own_effects import register_own
    from inkjet_env.cli.printing import print_evaluation
    from inkjet_env.storage import write_json

    check_outputs((printhead, *files_of(folder)), json=json)
    register_own(effect)
    found, unit = evaluation_json(
        folder, printhead, Reading.of(channel, columns, initial_state, interval, implausible), remainder
    )
    if json is not None:
        write_json(json, found)
    if str(json) != "-":
        print_evaluation(found, unit)


def _with_hidden(head: Printhead | AugmentedPrinthead, names: list[str]) -> Printhead | AugmentedPrinthead:
    """The head with further effects of a usual size."""
    from dataclasses import replace

    from inkjet_env.naming import check_name
    from inkjet_env.plant.augmented import AugmentedPrinthead
    from inkjet_env.plant.registry import known_effects

    if not names:
        return head
    base = head if isinstance(head, AugmentedPrinthead) else AugmentedPrinthead(head, ())
    shown = {e.id: e for e in known_effects() if e.predictable}
    for name in names:
        check_name("--hide", name, sorted(shown))
    hidden = tuple((shown[name], shown[name].example_values(base.printhead)) for name in names)
    return replace(base, effects=base.effects + hidden)


def _check_target(folder: Path, plan: bool) -> None:
    """Protect measured data: the rig overwrites only its own campaigns, and drives need a folder without a campaign."""
    from inkjet_env.recordings import CampaignError
    from inkjet_env.recordings.data_package import DESCRIPTOR
    from inkjet_env.rig.record import SIMULATED

    if not (folder / DESCRIPTOR).is_file():
        return  # a pipe or a device there is refused by `write_campaign`
    if plan:
        raise CampaignError(f"{folder}: holds a campaign, and drives must not be mixed with it. Give another folder.")
    if SIMULATED not in (folder / DESCRIPTOR).read_text(encoding="utf-8", errors="replace"):
        raise CampaignError(
            f"{folder}: holds a campaign that the virtual rig did not record and that would be overwritten; nothing "
            "was written. Give another folder."
        )
    if sys.stdin.isatty() and sys.stderr.isatty():
        typer.confirm(f"{folder}: holds a campaign of the virtual rig. Replace it?", abort=True, err=True)


def _tell(campaign: Campaign, found: Identification) -> None:
    from inkjet_env.cli.printing import print_identification

    print_notes(campaign)
    print_identification(campaign.name, found)
