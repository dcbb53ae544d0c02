"""``inkjet optimize``: run one optimiser on one problem, write the best waveform as CSV, resume interrupted runs."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from inkjet_env.cli.arguments import (
    CostGiven,
    check_outputs,
    check_rate,
    chosen_cost,
    chosen_limits,
    chosen_seed,
)
from inkjet_env.cli.exit_status import INTERRUPTED
from inkjet_env.cli.options import (
    CostA,
    CostB,
    DropFrequency,
    Effective,
    InitialState,
    JsonFile,
    Limits,
    OwnEffects,
    PlotFile,
    PrintheadFile,
    TargetHeight,
    Window,
    WithRemainder,
)
from inkjet_env.cli.own_effects import register_own

if TYPE_CHECKING:
    from inkjet_env.experiments.benchmark.problem import Problem
    from inkjet_env.optimizers.loop import Run
    from inkjet_env.plant.head_ensemble import HeadEnsemble
    from inkjet_env.printhead import Waveform

SAMPLE_RATE_HZ = 100e6


OPTIMIZER_HELP = "pso, pso-printed, cma-es, lbfgsb-multistart, random …, or module:Class; a wrong name lists them all"


def optimize(
    optimizer: Annotated[str | None, typer.Option(help=f"{OPTIMIZER_HELP} (pso)")] = None,
    problem: Annotated[str | None, typer.Option(help="name of a problem, or module:name (nominal)")] = None,
    particles: Annotated[int | None, typer.Option(help="number of particles of pso and pso-printed (40)")] = None,
    generations: Annotated[int | None, typer.Option(help="number of generations of pso and pso-printed (50)")] = None,
    budget: Annotated[int | None, typer.Option(help="number of evaluations, for any optimiser (2000)")] = None,
    seed: Annotated[int | None, typer.Option(help="seed of all random numbers (0)")] = None,
    printhead: PrintheadFile = None,
    remainder: WithRemainder = True,
    effect: OwnEffects = None,
    robust: Annotated[
        str | None,
        typer.Option(
            help="search for the lowest mean, cvar (mean of the worst fifth) or worst cost over the heads that the "
            "recordings leave possible, which diagnose wrote into the file of --printhead"
        ),
    ] = None,
    cost_a: CostA = None,
    cost_b: CostB = None,
    effective: Effective = None,
    target_height: TargetHeight = None,
    drop_frequency: DropFrequency = None,
    window: Window = None,
    initial_state: InitialState = None,
    out: Annotated[
        Path,
        typer.Option(
            help="file for the best waveform: CSV with time_s and drive_V, uniformly sampled, 0 V at both ends; or, if "
            "it ends in .ini, segments of a print controller"
        ),
    ] = Path("optimum.csv"),
    sample_rate: Annotated[float, typer.Option(help="sample rate of that CSV file, in Hz")] = SAMPLE_RATE_HZ,
    generator: Annotated[
        str | None,
        typer.Option(help="write it for an arbitrary waveform generator: siglent, rigol, keysight or rohde-schwarz"),
    ] = None,
    amplifier: Annotated[float, typer.Option(help="gain of the amplifier behind that generator")] = 1.0,
    limits: Limits = None,
    plot: PlotFile = None,
    json: JsonFile = None,
    resume: Annotated[
        Path | None, typer.Option(help="resume exactly from the .npz file that an interrupted run wrote beside its CSV")
    ] = None,
) -> None:
    """Search with one optimiser for the waveform with the lowest cost.

    \b
    inkjet optimize --optimizer pso --particles 40 --generations 50 --seed 1 \\
        --out waveform.csv

    \b
    inkjet optimize --drop-frequency 20e3 --target-height 4 --cost-a -50 \\
        --out waveform.csv

    \b
    inkjet optimize --printhead corrected.json \\
        --effect my_effects:QuadraticStiffness

    \b
    inkjet optimize \\
        --limits lowest_V=0,highest_V=48,rise_V_per_us=20,step_us=0.1 \\
        --out waveform.ini

    \b
    inkjet optimize --printhead corrected.json --robust cvar \\
        --optimizer cma-es --out waveform.csv

    With --limits, only waveforms that the driver can do are tried, and what that costs is told.

    Ctrl-C keeps the best waveform so far and a record from which --resume continues.
    """
    from dataclasses import replace

    from inkjet_env.experiments.benchmark.single_run import Optimisation, RunningRecord, read_record
    from inkjet_env.plant.augmented import AugmentedPrinthead
    from inkjet_env.plant.printhead_file import chosen_head, remainder_sentence

    check_outputs((printhead,), out=out, plot=plot, json=json, record=_record_file(out))
    check_rate(sample_rate)
    _check_style(out, generator, amplifier)
    register_own(effect)
    settings = {
        "--optimizer": optimizer,
        "--problem": problem,
        "--particles": particles,
        "--generations": generations,
        "--budget": budget,
        "--seed": seed,
        "--printhead": printhead,
        "--robust": robust,
        "--no-remainder": None if remainder else True,
        "--cost-a": cost_a,
        "--cost-b": cost_b,
        "--effective": effective,
        "--target-height": target_height,
        "--drop-frequency": drop_frequency,
        "--window": window,
        "--initial-state": initial_state,
        "--limits": limits,
    }
    recorded: Any = None
    if resume is not None:
        named = ("--optimizer", "--problem")  # names of plug-ins, whose code a record alone does not import
        if given := [name for name, value in settings.items() if value is not None and name not in named]:
            raise ValueError(f"--resume takes all settings from {resume}; leave out {', '.join(given)}.")
        trusted = {option: f"{option[2:]} {settings[option]}" for option in named if settings[option] is not None}
        plan, recorded = read_record(resume, trusted.values())
        if given := [option for option, name in trusted.items() if name not in plan.plugins()]:
            raise ValueError(f"--resume takes all settings from {resume}; leave out {', '.join(given)}.")
    else:
        name = "pso" if optimizer is None else optimizer
        options, evaluations = swarm_options(name, particles, generations, budget)
        chosen = chosen_problem(problem, (cost_a, cost_b, effective, target_height), window, initial_state)
        for option, value in (("--robust", robust), ("--drop-frequency", drop_frequency)):
            if value is not None:
                check_combines(option, chosen, problem)
        if robust is not None:
            check_changeable(chosen)
            chosen = replace(chosen, ensemble=_ensemble(printhead, remainder), risk=robust)
        if printhead is not None:
            check_changeable(chosen)
            with_effects = isinstance(new_head := chosen_head(printhead, remainder), AugmentedPrinthead)
            if with_effects:
                check_combines(f"a --printhead with effects, such as {printhead},", chosen, problem)
            chosen = replace(chosen, name="custom", printhead=new_head)
        if limits is not None:
            check_changeable(chosen)
            box = replace(chosen.bounds, limits=chosen_limits(limits))
            chosen = replace(chosen, name="custom", bounds=box, known=None)
        if drop_frequency is not None:
            if robust is not None:
                raise ValueError("give --robust or --drop-frequency, not both.")
            check_changeable(chosen)
            chosen = _at_drop_frequency(chosen, drop_frequency)
        plan = Optimisation(chosen, name, evaluations, chosen_seed(seed), options)
    head, largest_V = (
        plan.problem.printhead,
        max(map(abs, (plan.problem.bounds.lower[1], plan.problem.bounds.upper[0]))),
    )
    if (said := remainder_sentence(head, ("self_sensing",), largest_V)) is not None:
        print(said, file=sys.stderr)
    replayed = 0 if recorded is None else len(recorded[1])
    run = plan.carry_out(recorded, RunningRecord(_record_file(out), plan, replayed))
    unlimited = None
    if run.complete and plan.problem.bounds.limits is not None:
        unlimited = plan.without_limits().carry_out(label=f"{plan.optimizer} without the driver's limits")
    _finish_optimize(plan, run, unlimited, out, (sample_rate, generator, amplifier), plot, json, effect)
    for record in (_record_file(out), resume):
        if record is not None:
            record.unlink(missing_ok=True)  # only now that the outputs are written
    if unlimited is not None and not unlimited.complete:
        print("Interrupted; what the driver's limits cost is not known.", file=sys.stderr)
        raise typer.Exit(INTERRUPTED)


def _at_drop_frequency(problem: Problem, drop_frequency_Hz: float) -> Problem:
    """The problem with drops at that rate, and durations narrowed until the longest waveform fits into a period."""
    from dataclasses import replace

    from inkjet_env.cli.arguments import drop_period_s

    box = problem.bounds
    if drop_frequency_Hz == 0:
        return replace(problem, name="custom", jetting_Hz=0.0)
    period_s = drop_period_s(drop_frequency_Hz, sum(box.lower[2:]))
    if box.longest_s > period_s:
        shortest_s, longest_s = sum(box.lower[2:]), sum(box.upper[2:])
        kept = (period_s - shortest_s) / (longest_s - shortest_s)
        durations_s = [low + kept * (high - low) for low, high in zip(box.lower[2:], box.upper[2:], strict=True)]
        box = replace(box, upper=(*box.upper[:2], *durations_s))
        print(
            f"Each of the five durations is at most {1e6 * max(durations_s):.4g} µs, so that every waveform fits into "
            f"{1e6 * period_s:.4g} µs.",
            file=sys.stderr,
        )
    return replace(problem, name="custom", jetting_Hz=drop_frequency_Hz, bounds=box, known=None)


def _ensemble(printhead: Path | None, remainder: bool) -> HeadEnsemble:
    """The heads that the recordings behind a printhead file leave possible."""
    from inkjet_env.plant.head_ensemble import read_ensemble

    if printhead is None:
        raise ValueError("--robust needs the --printhead that diagnose wrote with --printhead-out.")
    found = read_ensemble(printhead)
    if found is None:
        raise ValueError(
            f"{printhead}: it does not say which heads the recordings leave possible. Write it with inkjet diagnose "
            "CAMPAIGN --printhead-out FILE, also if nothing is missing."
        )
    return found if remainder else found.without_remainder()


def _check_style(out: Path, generator: str | None, amplifier: float) -> None:
    """Raise ``ValueError``, before any work, if the waveform cannot be written as asked."""
    from inkjet_env.naming import check_name
    from inkjet_env.recordings.generator_file import MAKERS

    if generator is None:
        if amplifier != 1.0:
            raise ValueError("--amplifier states the gain behind a --generator; give that too.")
        return
    check_name("--generator", generator, MAKERS)
    if out.suffix.lower() == ".ini":
        raise ValueError(f"{out} would hold segments of a print controller; with --generator, let it end in .csv.")
    if not 0 < amplifier < float("inf"):
        raise ValueError(f"--amplifier must be a positive gain; got {amplifier:g}.")


def _finish_optimize(
    plan: Any,
    run: Run,
    unlimited: Run | None,
    out: Path,
    style: tuple[float, str | None, float],
    plot: Path | None,
    json: Path | None,
    own: list[str] | None,
) -> None:
    """Write and print the result of an optimisation, complete or interrupted.

    ``unlimited`` is the same search without the driver's limits, if there are any.
    """
    from inkjet_env.cli.printing import print_figures
    from inkjet_env.experiments.benchmark.single_run import write_record
    from inkjet_env.jetting.figures_of_merit import figures_json, jetting
    from inkjet_env.printhead import Waveform
    from inkjet_env.storage import write_json

    if run.best_point is None:
        print("Interrupted before the first evaluation; nothing was written.", file=sys.stderr)
        raise typer.Exit(INTERRUPTED)
    without = None
    if unlimited is not None and unlimited.complete:
        without = min(unlimited.best_cost, run.best_cost)  # what is legal is possible without limits too
    found = plan.optimum_json(run, without)
    figures = jetting(plan.problem.respond(run.best_point), plan.problem.cost)
    found |= figures_json(figures)
    waveform = Waveform.from_array(found["waveform"])
    record = _record_file(out)
    if not run.complete:
        write_record(record, plan, run)
    written = _write_waveform(out, waveform, *style)
    if plot is not None:
        from inkjet_env.reporting.plotting import write_picture
        from inkjet_env.reporting.waveform_figures import draw_response

        write_picture(plot, draw_response(plan.problem.respond(run.best_point), plan.problem.cost))
    if json is not None:
        write_json(json, found)
    if str(json) != "-":
        values = " ".join(f"{v:.6g}" for v in found["waveform"])
        print(f"{plan.optimizer} on {plan.problem.name}, seed {plan.seed}, {run.evaluations} evaluations:")
        print(f"cost {run.best_cost:.6f} V")
        print(f"waveform U1 U2 t1 t2 t3 t4 t5: {values}")
        if (spread := found.get("robust")) is not None:
            print(
                f"over {spread['heads']} heads that the recordings leave possible: mean {spread['mean']:.4f} V, "
                f"90 % from {spread['low']:.4f} to {spread['high']:.4f} V, worst {spread['worst']:.4f} V; "
                f"the fit itself {spread['cost_of_fit']:.4f} V"
            )
        if without is not None:
            print(
                f"It is within the driver's limits. Without them the same search reaches {without:.6f} V: they cost "
                f"{run.best_cost - without:.6f} V."
            )
        print_figures(figures)
        print(f"{out}: {written}")
    if not run.complete:
        again: list[Any] = ["inkjet", "optimize", "--resume", record, "--out", out]
        sample_rate, generator, amplifier = style
        if sample_rate != SAMPLE_RATE_HZ:
            again += ["--sample-rate", f"{sample_rate:.12g}"]
        if generator is not None:
            again += ["--generator", generator, "--amplifier", f"{amplifier:.12g}"]
        for plugin in plan.plugins():
            part, _, of = plugin.partition(" ")
            again += [f"--{part}", of]
        for option, value in (("--plot", plot), ("--json", json), *(("--effect", name) for name in own or ())):
            if value is not None:
                again += [option, value]
        print(
            f"Interrupted after {run.evaluations} of {plan.budget} evaluations; the best so far is kept. "
            f"To resume: {shlex.join(map(str, again))}",
            file=sys.stderr,
        )
        raise typer.Exit(INTERRUPTED)


def _write_waveform(out: Path, waveform: Waveform, sample_rate: float, generator: str | None, amplifier: float) -> str:
    """Write a waveform for a print controller, a generator, or as plain CSV; what was written, in words."""
    from inkjet_env.cli.drive_csv import sampled_waveform, write_columns
    from inkjet_env.recordings.generator_file import generator_text
    from inkjet_env.recordings.segment_file import write_segments
    from inkjet_env.storage import write_atomically

    if out.suffix.lower() == ".ini":
        write_segments(out, *waveform.knots())
        return "segments of a print controller"
    if generator is not None:
        text, note = generator_text(generator, *waveform.knots(), sample_rate, amplifier)
        write_atomically(out, text)
        if note is not None:
            print(f"{out}: {note}", file=sys.stderr)
        return f"for a generator of {generator}, before an amplifier of gain {amplifier:g}"
    time_s, drive_V = sampled_waveform(waveform, sample_rate)
    write_columns(out, {"time_s": time_s, "drive_V": drive_V})
    return f"{time_s.size} samples at {sample_rate:g} Hz"


def _record_file(out: Path) -> Path:
    """The file in which an interrupted run keeps its evaluations."""
    return out.with_name(f"{out.name}.evaluations.npz")


def chosen_problem(name: str | None, cost: CostGiven, window_s: float | None, initial_state: str | None) -> Problem:
    """The problem of that name with the requested changes; if there are any, it is called "custom"."""
    from dataclasses import replace

    from inkjet_env.experiments.benchmark.suite import problem
    from inkjet_env.printhead.hysteresis import periods_before_recording
    from inkjet_env.printhead.window import check_window

    base = problem("nominal" if name is None else name)
    changes: dict[str, Any] = {}
    if any(part is not None for part in cost):
        changes["cost"] = chosen_cost(cost, base.cost)
    if window_s is not None:
        changes["window_s"] = check_window(window_s)
    if initial_state is not None:
        periods_before_recording(initial_state)  # raises if the name is unknown
        changes["initial_state"] = initial_state
    if changes:
        check_changeable(base)
    return replace(base, name="custom", **changes) if changes else base


def check_changeable(problem: Problem) -> None:
    """Raise ``ValueError`` if a problem's numbers may depend on code that options cannot change."""
    from inkjet_env.experiments.benchmark.suite import provenance

    if provenance(problem.name) is not None:
        raise ValueError(f"{problem.name} is a problem of another package: options cannot change it. Change its code.")


def check_combines(what: str, problem: Problem, name: str | None) -> None:
    """Raise ``ValueError`` if what was given cannot be combined with a problem of that name."""
    reasons = {
        "is judged on a lot of heads": problem.spread is not None,
        "reads peaks with errors": bool(problem.measurement_noise_V),
        "fires drops at a rate of its own": what == "--robust" and bool(problem.jetting_Hz),
    }
    for reason, applies in reasons.items():
        if applies:
            raise ValueError(f"{what} cannot be combined with --problem {name}, which {reason}. Leave one of them out.")


def swarm_options(
    name: str, particles: int | None, generations: int | None, budget: int | None
) -> tuple[dict[str, Any], int]:
    """Options of the optimiser and its budget, from the command-line options."""
    from inkjet_env.experiments.benchmark.problem import MAX_BUDGET

    for label, value in (("--particles", particles), ("--generations", generations), ("--budget", budget)):
        if value is not None and value < 1:
            raise ValueError(f"{label} must be at least 1; got {value}.")
        if value is not None and value > MAX_BUDGET:
            raise ValueError(f"{label} must be at most {MAX_BUDGET:,}; got {value}.")
    if (particles or 40) * (generations or 50) > MAX_BUDGET:
        raise ValueError(f"--particles × --generations must be at most {MAX_BUDGET:,}.")
    if not name.startswith("pso"):
        if particles is not None or generations is not None:
            raise ValueError(
                f"--particles and --generations apply to pso and pso-printed only; give {name} a --budget."
            )
        return {}, budget or 2000
    if generations is not None and budget is not None:
        raise ValueError("give --generations or --budget, not both: the budget is particles × generations.")
    return {"particles": particles or 40}, budget or (particles or 40) * (generations or 50)
