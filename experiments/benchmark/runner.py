"""The comparison: problems × optimisers × repeats at equal budgets; it resumes where it was stopped.

A results folder holds ``bench.json`` (the settings), ``runs/`` (one file per finished run), ``timings/`` and, at the
end, the report. Finished runs are never overwritten.
"""

from __future__ import annotations

import functools
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.experiments.benchmark.entrants import entrant
from inkjet_env.experiments.benchmark.late_benches import searched_beside
from inkjet_env.experiments.benchmark.run_files import RunKey, RunResult, label_of, read_run, run_path, write_run
from inkjet_env.experiments.benchmark.run_objective import ObjectiveFailedError, RunObjective
from inkjet_env.experiments.benchmark.settings import LEFT_OUT, SOURCES, BenchOutcome, BenchSettings
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.experiments.execution.cluster import run_each, worker_count, workers_of
from inkjet_env.experiments.execution.held_folder import held
from inkjet_env.experiments.execution.provenance import code_digest, first_difference, versions
from inkjet_env.progress import shown_progress
from inkjet_env.storage import json_text, remove_unfinished, stored_object, write_atomically

REPEATS_A_JOB = 5
"""Number of runs that a worker does before it returns them; a lost worker's runs are repeated."""
Ended = tuple[RunKey, RunResult | None, dict[str, float], str]
"""A run that has ended: its key; its result, or None; seconds by activity; how it failed, in words."""
Batch = tuple[list[Ended], Exception | None]
"""The runs of a job that have ended, in order, and the exception that prevented the rest."""
SLOWEST_FIRST = ("optuna-", "sb3-", "nevergrad-", "cma-es", "lbfgsb", "scipy-dual")


def check_folder(folder: Path, settings: BenchSettings) -> None:
    """Check that the runs in a folder, if there are any, may be used by this bench.

    They may if nothing differs on which a run depends. Optimisers, problems and the number of repeats may differ; runs
    that are not asked for remain in the folder.

    Raises
    ------
    ValueError
        The folder belongs to a bench with other settings or to something else, or a run in it is a link.
    """
    file = folder / "bench.json"
    asked = settings.to_json()
    for run in (folder / "runs").glob("*.parquet"):
        if run.is_symlink():
            raise ValueError(f"{run}: is a link, and a run is written to its own folder only. Delete the link.")
    if file.exists():
        try:
            stored = stored_object(file)
            difference = first_difference(_decisive(stored, asked), _decisive(asked, stored))
        except (ValueError, TypeError, AttributeError, OSError) as error:
            why = str(error)[:120] if isinstance(error, ValueError) else "its entries are not those of a bench"
            raise ValueError(
                f"{file} is damaged ({why}). Delete the folder {folder} to start again, or give another folder."
            ) from None
        if difference:
            raise ValueError(
                f"{folder} holds a bench with other settings: {difference[:300]}. "
                "Give another folder, or the same settings to resume, or delete that folder."
            )
    elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(f"{folder} is neither empty nor a bench's results folder. Give another folder.")


def prepare_folder(folder: Path, settings: BenchSettings) -> None:
    """Make the parts of a bench's folder, without what a killed process left unfinished, and write its settings."""
    for part in ("runs", "timings"):
        (folder / part).mkdir(parents=True, exist_ok=True)
        remove_unfinished(folder / part)
    remove_unfinished(folder)
    write_atomically(folder / "bench.json", json_text(settings.to_json()))


def _decisive(settings: Mapping[str, Any], others: Mapping[str, Any]) -> dict[str, Any]:
    """The settings that must agree for two benches to share runs: everything in the label of a common run."""
    common = {
        part: [name for name in settings.get(part, ()) if name in others.get(part, ())]
        for part in ("optimizers", "problems")
    }
    whole = {name: settings.get(name) for name in ("format", "budget", "seed", "code", "versions")}
    of_names = {
        "shorter": {name: settings.get("shorter", {}).get(name) for name in sorted(common["optimizers"])},
        "options": {name: settings.get("options", {}).get(name) for name in sorted(common["optimizers"])},
        "problems": {name: settings["problems"][name] for name in sorted(common["problems"])},
        "plugins": {
            named: settings.get("plugins", {}).get(named)
            for part in ("optimizer", "problem")
            for named in (f"{part} {name}" for name in common[f"{part}s"])
        },
    }
    return whole | of_names


def run_bench(
    settings: BenchSettings, folder: Path, workers: int | None = None, scheduler: str | None = None
) -> BenchOutcome:
    """Do every run of the bench that ``folder`` does not hold yet, and return all results; other benches are kept out.

    In your own script, call it under ``if __name__ == "__main__":``, because it starts processes.

    Parameters
    ----------
    settings : BenchSettings
        Problems, optimisers, repeats, budget and seed.
    folder : Path
        Folder of the results; created if missing.
    workers : int, optional
        Number of processes on this machine; the number of cores unless given.
    scheduler : str, optional
        Address of a Dask cluster, such as ``tcp://host:8786``, which does the runs instead of local processes.

    Raises
    ------
    ValueError
        The folder belongs to another bench, which may be running, or holds a damaged file, or the cluster cannot do the
        work.
    ObjectiveFailedError
        The objective of a problem fails at a point; finished runs are kept.
    KeyboardInterrupt
        On Ctrl-C; finished runs are kept.
    """
    check_folder(folder, settings)
    with held(folder, "bench"):
        prepare_folder(folder, settings)
        return _run_in(folder, settings, workers, scheduler)


def _run_in(folder: Path, settings: BenchSettings, workers: int | None, scheduler: str | None) -> BenchOutcome:
    """Do the missing runs in a folder that this process holds."""
    from inkjet_env import optimizers

    reasons = optimizers.availability(entrant(name).optimizer for name in settings.optimizers)
    unavailable = {
        name: reason for name in settings.optimizers if (reason := reasons[entrant(name).optimizer]) is not None
    }
    keys = [
        RunKey(optimizer, name, repeat)
        for name in settings.problems
        for optimizer in settings.optimizers
        if optimizer not in unavailable and applies(optimizer, name)
        for repeat in range(settings.repeats)
    ]
    described = settings.to_json()
    results = {key: read_run(folder, key, label_of(key, described)) for key in keys if run_path(folder, key).exists()}
    missing = [key for key in keys if key not in results]
    if results and missing:
        print(f"{len(results)} of {len(keys)} runs are finished already; resuming.", file=sys.stderr, flush=True)
    asked = {key.file_stem for key in keys}
    if others := sum(file.stem not in asked for file in (folder / "runs").glob("*.parquet")):
        runs = "1 run" if others == 1 else f"{others} runs"
        print(f"Not requested, and so not in the report: {runs} in {folder}.", file=sys.stderr)
    if missing:
        failures = _perform_all(missing, settings, folder, results, len(keys), workers, scheduler)
        unavailable |= failures
    scored = [results[key] for key in keys if key.optimizer not in unavailable]
    if settings.optimizers == BenchSettings.default().optimizers:
        unavailable |= LEFT_OUT
    return BenchOutcome(settings, folder, scored, unavailable)


def applies(optimizer: str, name: str) -> bool:
    """Whether an optimiser can be used on a problem: the problem has gradients if the optimiser needs them."""
    from inkjet_env import optimizers

    return problem(name).has_gradient or not optimizers.uses_gradient(entrant(optimizer).optimizer)


def _perform_all(
    missing: Sequence[RunKey],
    settings: BenchSettings,
    folder: Path,
    results: dict[RunKey, RunResult],
    total: int,
    workers: int | None,
    scheduler: str | None,
) -> dict[str, str]:
    """Do the missing runs in parallel and store each as it ends; return the optimisers that failed, with the reason."""
    from inkjet_env import optimizers

    described = settings.to_json()
    # Compile once in this process: the workers find the compiled code on disk.
    problem("nominal").evaluate_with_gradient([[0.0] * 7])
    failures: dict[str, str] = {}
    done = len(results)
    batches: dict[str, list[RunKey]] = {}
    for key in sorted(missing, key=_slowness):
        part = f"{key.problem}--{key.optimizer}--{key.repeat // REPEATS_A_JOB:03d}"
        batches.setdefault(part, []).append(key)
    jobs = {part: functools.partial(_job, keys, settings, described) for part, keys in batches.items()}
    useful_s = 0.0
    methods = {entrant(key.optimizer).optimizer for key in missing}
    preload = ["inkjet_env.experiments.benchmark.preloaded", *sorted(optimizers.modules(methods))]
    start_s = time.perf_counter()
    with shown_progress("bench", total, done) as progress, workers_of(scheduler, workers, preload) as client:
        begin_s = time.perf_counter()

        def keep(_: str, batch: Batch) -> None:
            nonlocal done, useful_s
            ended, stopped_by = batch
            for key, result, seconds, failure in ended:
                done += 1
                useful_s += seconds.get("total", 0.0)
                if result is None:
                    failures.setdefault(key.optimizer, f"failed on {key.problem}, repeat {key.repeat}: {failure}")
                else:
                    write_run(folder, result, label_of(key, described), seconds)
                    results[key] = result
                progress(done, f"{key.optimizer} on {key.problem}")
            if stopped_by is not None:
                raise stopped_by

        run_each(client, perform_some, jobs, keep)
        work_s = time.perf_counter() - begin_s
        share = useful_s / (work_s * max(worker_count(client), 1))
    print(
        f"The workers started within {begin_s - start_s:.1f} s and worked for {work_s:.1f} s: {100 * share:.0f} % of "
        "that on optimisers and objective, the rest on sending, storing and waiting for the last runs.",
        file=sys.stderr,
    )
    return failures


def _job(keys: Sequence[RunKey], settings: BenchSettings, described: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(keys), settings, described["code"], described["versions"], described.get("plugins", {})


def perform_some(
    keys: Sequence[RunKey],
    settings: BenchSettings,
    code: str,
    packages: Mapping[str, str],
    plugins: Mapping[str, Mapping[str, str]],
) -> Batch:
    """Do these runs at a worker with `perform`; if one raises an exception, the runs before it are still returned.

    Raises
    ------
    ValueError
        The worker has other code, another version of a package, or another plug-in of a name.
    """
    if own_code() != code:
        raise ValueError(
            "the code differs, here or at a worker, from the code with which this bench was started. Restore that code "
            "on all machines, restart the workers and repeat the command, or give another folder."
        )
    if difference := first_difference(dict(packages), own_versions()):
        raise ValueError(
            f"a worker's packages differ from those with which this bench was started: {difference}. Install the same "
            "on all machines, restart the workers and repeat the command."
        )
    if difference := first_difference(dict(plugins), settings.plugins()):
        raise ValueError(
            f"a worker's plug-ins differ from those with which this bench was started: {difference}. Install the same "
            "on all machines, restart the workers and repeat the command."
        )
    ended: list[Ended] = []
    for key in keys:
        try:
            ended.append(perform(key, settings))
        except Exception as error:
            error.add_note(f"At the worker:\n{traceback.format_exc()}")  # the traceback itself is not sent back
            return ended, error
    return ended, None


@functools.cache
def own_code() -> str:
    """Digest of the code that this process has loaded; computed once."""
    return code_digest(SOURCES)


@functools.cache
def own_versions() -> dict[str, str]:
    """Versions of the packages that this process has loaded; read once."""
    return versions()


def _slowness(key: RunKey) -> int:
    for rank, prefix in enumerate(SLOWEST_FIRST):
        if key.optimizer.startswith(prefix):
            return rank
    return len(SLOWEST_FIRST)


def perform(key: RunKey, settings: BenchSettings) -> Ended:
    """Do one run; return its result and seconds, or how its optimiser failed, in words.

    Raises
    ------
    ObjectiveFailedError
        The objective failed, not the optimiser.
    """
    from inkjet_env.optimizers.loop import ObjectiveError, minimise

    seed = key.seed(settings.seed)
    first = RunObjective(key, seed)  # so that no run's time includes loading the compiled code
    first.evaluate(np.zeros((1, 7)))
    if problem(key.problem).has_gradient:
        first.evaluate_with_gradient(np.zeros((1, 7)))
    objective = RunObjective(key, seed)
    begin_s = time.perf_counter()
    try:
        budget = settings.budget_of(key.optimizer)
        instruments = problem(key.problem).instruments
        optimizer = entrant(key.optimizer).made(budget, seed, instruments)
        if torch := sys.modules.get("torch"):
            torch.set_num_threads(1)
        if instruments:
            late, spent = searched_beside(objective, optimizer, instruments, seed)
            seconds = {"total": time.perf_counter() - begin_s}
            return key, RunResult.of(key, late.points, late.costs, spent), seconds, ""
        run = minimise(objective, optimizer, budget)
    except ObjectiveFailedError:
        raise
    except ObjectiveError as error:
        raise objective.failed(str(error)) from error
    except Exception as error:  # any exception of a third-party optimiser is reported, not scored
        return key, None, {}, f"{type(error).__name__}: {error}"
    seconds = {
        "optimizer": run.optimizer_seconds,
        "objective": run.objective_seconds,
        "total": time.perf_counter() - begin_s,
    }
    return key, RunResult.of(key, run.points, run.costs), seconds, ""
