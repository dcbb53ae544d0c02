"""``inkjet scan``: what press engineers look at, for one waveform on one or several heads."""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inkjet_env.cli.arguments import check_outputs, chosen_cost
from inkjet_env.cli.campaign_reading import Implausible, Interval, Reading, ScopeChannel, ScopeColumns, ScopeState
from inkjet_env.cli.options import CostA, CostB, Effective, JsonFile, OwnEffects, TargetHeight, WithRemainder
from inkjet_env.progress import shown_steps

if TYPE_CHECKING:
    from inkjet_env.jetting import Scan
    from inkjet_env.plant.augmented import AugmentedPrinthead
    from inkjet_env.printhead import Printhead, Waveform

PUBLISHED_BEST = (100.0, -100.0, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6)
"""U1 U2 in volts, t1 … t5 in seconds; costs the published head a hundredth of a volt more than its best known one."""


def scan(
    heads: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[HEAD]…",
            help="printhead.json files and folders of campaigns, which are identified first; the published head unless "
            "given",
        ),
    ] = None,
    waveform: Annotated[
        tuple[float, float, float, float, float, float, float] | None,
        typer.Option(
            help="U1 U2 t1 t2 t3 t4 t5: two voltages and five durations; the published head's best one unless given",
            metavar="U1 U2 t1 t2 t3 t4 t5",
        ),
    ] = None,
    optimum: Annotated[
        Path | None, typer.Option(help="JSON file of optimize, whose waveform is scanned in place of --waveform")
    ] = None,
    vary: Annotated[str, typer.Option(help="two parameters of the robustness map, each changed by ±5 %")] = "t2,t4",
    points: Annotated[int, typer.Option(help="number of widths and voltages; twice as many frequencies")] = 121,
    plot: Annotated[Path | None, typer.Option("--plot", help="figure of all scans: .png, .svg or .pdf")] = None,
    out: Annotated[Path | None, typer.Option(help="table of all curves: .csv")] = None,
    json: JsonFile = None,
    remainder: WithRemainder = True,
    effect: OwnEffects = None,
    cost_a: CostA = None,
    cost_b: CostB = None,
    effective: Effective = None,
    target_height: TargetHeight = None,
    channel: ScopeChannel = None,
    columns: ScopeColumns = None,
    initial_state: ScopeState = None,
    interval: Interval = None,
    implausible: Implausible = False,
) -> None:
    """Scan a waveform: pulse width, voltage and jetting frequency, and a map of its robustness.

    \b
    inkjet scan --plot scan.png

    \b
    inkjet scan corrected.json campaign --optimum optimum.json --plot scan.png \\
        --out scan.csv --json scan.json

    A head with effects is shown with and without them.
    """
    from inkjet_env.cli.own_effects import register_own
    from inkjet_env.jetting import scan as scan_of
    from inkjet_env.printhead import Waveform
    from inkjet_env.reporting.scan_figures import MOST_HEADS, draw_scans
    from inkjet_env.storage import write_atomically, write_json

    files = [path for path in heads or [] if path.is_file()]
    check_outputs((*files, optimum), out=out, plot=plot, json=json)
    if out is not None and out.suffix.lower() != ".csv":
        raise ValueError(f"--out must end in .csv; got {out}.")
    if waveform is not None and optimum is not None:
        raise ValueError("give --waveform or --optimum, not both.")
    register_own(effect)
    cost = chosen_cost((cost_a, cost_b, effective, target_height))
    fired = _optimum(optimum) if optimum is not None else Waveform.from_array(waveform or PUBLISHED_BEST)
    names = tuple(name.strip() for name in vary.split(","))
    reading = Reading.of(channel, columns, initial_state, interval, implausible)
    chosen = _chosen(heads or [], remainder, reading)
    if len(chosen) > MOST_HEADS:
        raise ValueError(
            f"{len(chosen)} heads, with and without effects, do not fit into one figure; at most {MOST_HEADS} do."
        )
    with shown_steps("scan") as progress:
        found = [scan_of(head, fired, name, cost, names, points, progress=progress) for name, head in chosen.items()]
    if plot is not None:
        from inkjet_env.reporting.plotting import write_picture

        write_picture(plot, draw_scans(found))
    if out is not None:
        write_atomically(out, _table(found))
    if json is not None:
        scans = [one.as_json() for one in found]
        write_json(json, {"format": "scan/1", "waveform": fired.to_array().tolist(), "scans": scans})
    if str(json) != "-":
        _print(found)


def _optimum(file: Path) -> Waveform:
    """The waveform of an ``optimum/1``."""
    from inkjet_env.printhead import Waveform
    from inkjet_env.storage import stored_object

    try:
        return Waveform.from_array(stored_object(file).get("waveform", []))
    except ValueError as error:
        reason = str(error).rstrip(".")
        raise ValueError(f"{file}: it must be the JSON file of optimize, with its waveform: {reason}.") from None


def _chosen(paths: Sequence[Path], remainder: bool, reading: Reading) -> dict[str, Printhead | AugmentedPrinthead]:
    """The heads by the names that figures show."""
    from inkjet_env.cli.identify_folders import identify_one
    from inkjet_env.plant.augmented import AugmentedPrinthead
    from inkjet_env.plant.printhead_file import chosen_head
    from inkjet_env.printhead import Printhead

    found: dict[str, Printhead | AugmentedPrinthead] = {}
    named: list[str] = []
    for path in paths:
        head: Printhead | AugmentedPrinthead
        if path.is_dir():
            head, name = identify_one(path, reading, {})[1].printhead, path.resolve().name
        else:
            head, name = chosen_head(path, remainder), path.stem
        if not head.has_dynamics:
            raise ValueError(f"{path}: nothing is known of this head's resonance, so no response can be simulated.")
        named.append(name)
        unused = name if named.count(name) == 1 else f"{name} {named.count(name)}"
        if isinstance(head, AugmentedPrinthead):
            effects = " and ".join(e.id.replace("_", " ") for e, _ in head.effects)
            found[f"{unused}, base part"] = head.printhead
            found[f"{unused}, with {effects or 'its remainder'}"] = head
        else:
            found[unused] = head
    return found or {"published": Printhead.published()}


def _table(scans: Sequence[Scan]) -> str:
    """All curves as CSV, one row a value."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["head", "quantity", "value", "unit", "effective_V", "residual_V", "cost_V"])
    for one in scans:
        for curve in (one.width, one.voltage, one.frequency):
            columns = zip(curve.values, curve.effective_V, curve.residual_V, curve.cost_V, strict=True)
            for value, *figures in columns:
                numbers = [f"{v:.9g}" for v in (value, *figures)]
                rows.writerow([one.head, curve.quantity, numbers[0], curve.unit, *numbers[1:]])
    return text.getvalue()


def _print(scans: Sequence[Scan]) -> None:
    from inkjet_env.reporting.tables import print_table

    rows = []
    for one in scans:
        best = int(one.width.cost_V.argmin())
        low, high = one.frequency_change
        rows.append(
            (
                one.head, f"{one.robustness.middle_V:.3f}", f"{one.width.values[best] * 1e6:.2f}",
                f"{one.width.cost_V[best]:.3f}", f"{100 * low:+.1f} … {100 * high:+.1f}",
                f"{one.steady_up_to_Hz / 1e3:.2f}", f"{one.robustness.loss_V:.3f}",
            )
        )  # fmt: skip
    print_table(
        (
            "head", "cost (V)", "best width (µs)", "its cost (V)", "peak in a train (%)", "within 10 % up to (kHz)",
            "lost at ±5 % (V)",
        ),
        rows,
    )  # fmt: skip
    sys.stdout.flush()
