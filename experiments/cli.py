"""The command ``inkjet``: simulate, optimize, bench; `campaign_commands` and `diagnosis_command` have the others.

Exit status: 0 done, 2 bad input (one sentence on standard error), 130 interrupted by Ctrl-C with what was done kept.
Whatever costs time to import is imported by the command that needs it.
"""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from experiments import campaign_commands, diagnosis_command
from experiments.arguments import (
    check_outputs,
    check_rate,
    chosen_cost,
    chosen_problem,
    chosen_seed,
    swarm_options,
)
from experiments.options import (
    CostA,
    CostB,
    Effective,
    InitialState,
    JsonFile,
    PlotFile,
    PrintheadFile,
    Window,
)
from experiments.progress import announce_compiling
from experiments.proof import command as proof_command

if TYPE_CHECKING:
    from optimizers.loop import Run

INTERRUPTED = 130
SAMPLE_RATE_HZ = 100e6
OPTIMIZERS_TOLD = "pso, pso-printed, cma-es, lbfgsb-multistart, random …; a wrong name lists them all"

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["--help", "-h"]},
)


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(version("inkjet-env"))
        raise typer.Exit


@app.callback()
def _inkjet(
    version: Annotated[
        bool, typer.Option("--version", help="the version, and nothing else", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """An inkjet printhead: record it, identify it, simulate it, optimise its waveform, compare optimisers.

    Units are SI (volts, seconds). Each command has its own --help with an example.
    """


@app.command()
def simulate(
    waveform: Annotated[
        tuple[float, float, float, float, float, float, float] | None,
        typer.Option(help="U1 U2 t1 t2 t3 t4 t5: two voltages and five durations", metavar="U1 U2 t1 t2 t3 t4 t5"),
    ] = None,
    drive: Annotated[Path | None, typer.Option(help="CSV with time_s and drive_V, in place of --waveform")] = None,
    out: Annotated[Path | None, typer.Option(help="with --drive: write time_s, drive_V, sensor_V as CSV")] = None,
    plot: PlotFile = None,
    json: JsonFile = None,
    printhead: PrintheadFile = None,
    cost_a: CostA = None,
    cost_b: CostB = None,
    effective: Effective = None,
    window: Window = None,
    initial_state: InitialState = None,
    hysteresis: Annotated[
        str, typer.Option(help="full_memory, one_point (the paper's formula) or, with --waveform, play_operators")
    ] = "full_memory",
) -> None:
    """One waveform, or any sampled drive, through the printhead: response, peaks, cost.

    inkjet simulate --waveform 100 -100 1e-6 10.49e-6 13.74e-6 9.81e-6 19.96e-6 --plot response.png

    inkjet simulate --drive waveform.csv --out response.csv
    """
    from experiments.drive_csv import read_drive, write_columns
    from experiments.problems import chosen_head
    from inkjet_env.plant.augmented import AugmentedPrinthead
    from inkjet_env.printhead import Waveform, respond_sampled
    from inkjet_env.storage import write_json

    check_outputs((drive, printhead), out=out, plot=plot, json=json)
    if waveform is not None and drive is not None:
        raise ValueError("give --waveform or --drive, not both.")
    head, cost = chosen_head(printhead), chosen_cost((cost_a, cost_b, effective))
    state = initial_state or "periodic"
    response: Any  # of a head with effects or without, to a waveform or samples
    if waveform is not None:
        if out is not None:
            raise ValueError("--out belongs to --drive. To sample a waveform's response, give the waveform as a CSV.")
        response = head.respond(Waveform.from_array(waveform), state, 350e-6 if window is None else window, hysteresis)
    elif drive is not None:
        samples = read_drive(drive)
        announce_compiling()
        try:
            window_s = 350e-6 if window is None else window
            if isinstance(head, AugmentedPrinthead):
                response = head.respond_sampled(*samples, state, hysteresis, window_s)
            else:
                response = respond_sampled(head, *samples, state, hysteresis, window_s=window_s)
        except ValueError as error:
            raise ValueError(f"{drive}: {error}") from None
    else:
        raise ValueError("give --waveform U1 U2 t1 t2 t3 t4 t5 or --drive FILE.csv.")
    found = {
        "format": "simulation/1",
        "peaks_V": [float(v) for v in response.peaks_V],
        "peak_times_s": [float(t) for t in response.peak_times_s],
        "effective_peak": cost.effective_index(response.peaks_V),
        "cost": response.cost(cost),
    }
    if plot is not None:
        from experiments.pictures import draw_response, write_picture

        write_picture(plot, draw_response(response, cost))
    if out is not None:
        write_columns(out, {name: getattr(response, name) for name in ("time_s", "drive_V", "sensor_V")})
    if json is not None:
        write_json(json, found)
    if str(json) != "-":
        from experiments.tables import print_peaks

        print_peaks(found)


@app.command()
def optimize(
    optimizer: Annotated[str | None, typer.Option(help=f"{OPTIMIZERS_TOLD} (pso)")] = None,
    problem: Annotated[str | None, typer.Option(help="a problem of the comparison's suite (nominal)")] = None,
    particles: Annotated[int | None, typer.Option(help="of pso and pso-printed (40)")] = None,
    generations: Annotated[int | None, typer.Option(help="of pso and pso-printed (50)")] = None,
    budget: Annotated[int | None, typer.Option(help="evaluations of any optimiser (2000)")] = None,
    seed: Annotated[int | None, typer.Option(help="of all random numbers (0)")] = None,
    printhead: PrintheadFile = None,
    cost_a: CostA = None,
    cost_b: CostB = None,
    effective: Effective = None,
    window: Window = None,
    initial_state: InitialState = None,
    out: Annotated[
        Path, typer.Option(help="best waveform as CSV: time_s, drive_V, uniformly sampled, first and last 0 V")
    ] = Path("optimum.csv"),
    sample_rate: Annotated[float, typer.Option(help="of that CSV, in Hz")] = SAMPLE_RATE_HZ,
    plot: PlotFile = None,
    json: JsonFile = None,
    resume: Annotated[
        Path | None, typer.Option(help="go on exactly from the .npz that an interrupted run left beside its CSV")
    ] = None,
) -> None:
    """Search for the waveform of the least cost with one optimiser.

    inkjet optimize --optimizer pso --particles 40 --generations 50 --seed 1 --out waveform.csv

    Ctrl-C keeps the best so far and the record to --resume from.
    """
    from dataclasses import replace

    from experiments.optimisation import Optimisation, read_record
    from experiments.problems import chosen_head

    check_outputs((printhead,), out=out, plot=plot, json=json, record=_record_file(out))
    check_rate(sample_rate)
    settings = {
        "--optimizer": optimizer,
        "--problem": problem,
        "--particles": particles,
        "--generations": generations,
        "--budget": budget,
        "--seed": seed,
        "--printhead": printhead,
        "--cost-a": cost_a,
        "--cost-b": cost_b,
        "--effective": effective,
        "--window": window,
        "--initial-state": initial_state,
    }
    recorded: Any = None
    if resume is not None:
        if given := [name for name, value in settings.items() if value is not None]:
            raise ValueError(f"--resume takes all settings from {resume}; leave out {', '.join(given)}.")
        plan, recorded = read_record(resume)
    else:
        name = "pso" if optimizer is None else optimizer
        options, evaluations = swarm_options(name, particles, generations, budget)
        chosen = chosen_problem(problem, None, (cost_a, cost_b, effective), window, initial_state)
        if printhead is not None:
            chosen = replace(chosen, name="custom", printhead=chosen_head(printhead))
        plan = Optimisation(chosen, name, evaluations, chosen_seed(seed), options)
    announce_compiling()
    run = plan.carry_out(recorded)
    _finish_optimize(plan, run, out, sample_rate, plot, json)


@app.command()
def bench(
    results: Annotated[Path, typer.Option(help="results folder; runs found there are not done again")] = Path(
        "results/bench"
    ),
    problems: Annotated[
        str | None, typer.Option(help='names, with commas between, or "all"; the usual five unless given')
    ] = None,
    optimizers: Annotated[
        str | None, typer.Option(help='names, with commas between, or "all"; all but the slowest unless given')
    ] = None,
    repeats: Annotated[int, typer.Option(help="runs of each optimiser on each problem")] = 15,
    budget: Annotated[int, typer.Option(help="evaluations of each run")] = 2000,
    seed: Annotated[int, typer.Option(help="all other seeds derive from it")] = 0,
    workers: Annotated[int | None, typer.Option(help="processes on this machine; one a core unless given")] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="of a Dask cluster, as tcp://host:8786; processes of this machine unless given")
    ] = None,
    json: JsonFile = None,
) -> None:
    """Compare the optimisers on the problem suite; resumes where it was stopped.

    inkjet bench --optimizers pso,pso-printed,cma-es --problems nominal --repeats 5 --results results/quick
    """
    from experiments.bench import BenchSettings, run_bench

    check_outputs(json=json)
    if workers is not None and workers < 1:
        raise ValueError(f"--workers must be at least 1; got {workers}.")
    if scheduler is not None and workers is not None:
        raise ValueError(
            "--workers belongs to this machine; a cluster given by --scheduler has its own. Leave one out."
        )
    chosen = {
        label: tuple(name.strip() for name in names.split(",") if name.strip())
        for label, names in (("problems", problems), ("optimizers", optimizers))
        if names is not None
    }
    if chosen.get("optimizers") == ("all",):
        from experiments.entrants import entrants

        chosen["optimizers"] = entrants()
    if chosen.get("problems") == ("all",):
        from experiments.suite import suite

        chosen["problems"] = tuple(suite())
    settings = BenchSettings.default(repeats=repeats, budget=budget, seed=chosen_seed(seed), **chosen)
    announce_compiling()
    try:
        outcome = run_bench(settings, results, workers, scheduler)
    except KeyboardInterrupt:
        print(f"Interrupted; finished runs are kept in {results}. The same command goes on.", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from None
    from experiments.report import write_report
    from experiments.statistics import summarise
    from inkjet_env.storage import write_json

    summary = summarise(outcome)
    page, ranking = write_report(outcome, summary)
    if json is not None:
        write_json(json, ranking)
    if str(json) != "-":
        from experiments.tables import print_ranking

        print_ranking(ranking)
        print(f"Report: {page}")


app.command()(campaign_commands.record)
app.command()(campaign_commands.identify)
app.command()(campaign_commands.evaluate)
app.command()(diagnosis_command.diagnose)
app.command()(proof_command.prove)


def _finish_optimize(plan: Any, run: Run, out: Path, sample_rate: float, plot: Path | None, json: Path | None) -> None:
    """Write what an optimisation found, whole or stopped, and say it."""
    from experiments.drive_csv import sampled_waveform, write_columns
    from experiments.optimisation import write_record
    from inkjet_env.printhead import Waveform
    from inkjet_env.storage import write_json

    if run.best_point is None:
        print("Interrupted before the first evaluation; nothing is written.", file=sys.stderr)
        raise typer.Exit(INTERRUPTED)
    found = plan.optimum_json(run)
    time_s, drive_V = sampled_waveform(Waveform.from_array(found["waveform"]), sample_rate)
    record = _record_file(out)
    if not run.complete:
        write_record(record, plan, run)
    write_columns(out, {"time_s": time_s, "drive_V": drive_V})
    if plot is not None:
        from experiments.pictures import draw_response, write_picture

        write_picture(plot, draw_response(plan.problem.respond(run.best_point), plan.problem.cost))
    if json is not None:
        write_json(json, found)
    if str(json) != "-":
        values = " ".join(f"{v:.6g}" for v in found["waveform"])
        print(f"{plan.optimizer} on {plan.problem.name}, seed {plan.seed}: cost {run.best_cost:.6f} V")
        print(f"after {run.evaluations} evaluations. Waveform (U1 U2 t1 t2 t3 t4 t5): {values}")
        print(f"{out}: {time_s.size} samples at {sample_rate:g} Hz")
    if not run.complete:
        again: list[Any] = ["inkjet", "optimize", "--resume", record, "--out", out]
        if sample_rate != SAMPLE_RATE_HZ:
            again += ["--sample-rate", f"{sample_rate:.12g}"]
        for option, file in (("--plot", plot), ("--json", json)):
            if file is not None:
                again += [option, file]
        print(
            f"Interrupted after {run.evaluations} of {plan.budget} evaluations; the best so far is kept. "
            f"To go on: {shlex.join(map(str, again))}",
            file=sys.stderr,
        )
        raise typer.Exit(INTERRUPTED)


def _record_file(out: Path) -> Path:
    """Where an interrupted run leaves its evaluations."""
    return out.with_name(f"{out.name}.evaluations.npz")


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run the command; turn whatever the user can mend into one sentence and exit status 2."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a terminal without µ is no reason to stop half-way
            stream.reconfigure(errors="replace")
    try:
        status = app(arguments, standalone_mode=False)
    except (ValueError, OSError) as error:
        _refuse(_os_sentence(error) if isinstance(error, OSError) else str(error))
    except KeyboardInterrupt:
        print("Interrupted.", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except Exception as error:
        if not hasattr(error, "format_message"):  # only Typer's own usage errors have one
            raise
        if type(error).__name__ == "NoArgsIsHelpError":
            print(error.format_message())
            sys.exit(2)
        _refuse(error.format_message())
    sys.exit(status or 0)


def _refuse(message: str) -> NoReturn:
    print(f"inkjet: {message}", file=sys.stderr)
    sys.exit(2)


def _os_sentence(error: OSError) -> str:
    return f"{error.filename}: {error.strerror}." if error.filename else str(error)


if __name__ == "__main__":
    main()
