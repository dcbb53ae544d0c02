"""The comparison: problems × optimisers × repeats at equal budgets; resumes where it was stopped.

A results folder holds ``bench.json`` (the settings), ``runs/`` (one file a finished run), ``timings/`` and, in the
end, the report. Finished runs are never written again.
"""

from __future__ import annotations

import functools
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.benchmark.entrants import entrant
from experiments.benchmark.run_files import RunKey, RunResult, label_of, read_run, run_path, write_run
from experiments.benchmark.settings import LEFT_OUT, SOURCES, BenchOutcome, BenchSettings
from experiments.benchmark.suite import problem
from experiments.execution.cluster import run_each, worker_count, workers_of
from experiments.execution.provenance import code_digest, first_difference, versions
from inkjet_env.progress import shown_progress
from inkjet_env.storage import json_text, remove_unfinished, write_atomically

REPEATS_A_JOB = 5
"""Runs that a worker does before it tells of them; a lost worker's are done again."""
Ended = tuple[RunKey, RunResult | None, dict[str, float], str]
"""A run that has ended: its result, or None; seconds by what they were spent on; how it failed, in words."""
SLOWEST_FIRST = ("optuna-", "sb3-", "nevergrad-", "cma-es", "lbfgsb", "scipy-dual")


def open_folder(folder: Path, settings: BenchSettings) -> None:
    """Make ``folder`` this bench's own, or check that its runs may be among this bench's.

    They may where nothing differs that a run hangs on; other optimisers, other problems and more or fewer repeats may
    be asked for, and runs that are not asked for stay where they are.

    Raises
    ------
    ValueError
        It belongs to a bench of other settings, or to something else. Nothing in it is changed.
    """
    file = folder / "bench.json"
    asked = settings.to_json()
    if file.exists():
        try:
            stored = json.loads(file.read_text(encoding="utf-8"))
            if not isinstance(stored, dict):
                raise ValueError("it is not a JSON object")
            difference = first_difference(_decisive(stored, asked), _decisive(asked, stored))
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(
                f"{file} is damaged ({error}). Delete the folder {folder} to begin again, or give another folder."
            ) from None
        if difference:
            raise ValueError(
                f"{folder} holds a bench of other settings: {difference}. "
                "Give another folder, or the same settings to go on, or delete that folder."
            )
    elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(f"{folder} is neither empty nor a bench's results folder. Give another folder.")
    for part in ("runs", "timings"):
        (folder / part).mkdir(parents=True, exist_ok=True)
        remove_unfinished(folder / part)
    remove_unfinished(folder)
    write_atomically(file, json_text(asked))


def _decisive(settings: Mapping[str, Any], others: Mapping[str, Any]) -> dict[str, Any]:
    """What must be the same in two benches for their runs to be of one: all that a run of both is labelled with."""
    common = {
        part: [name for name in settings.get(part, ()) if name in others.get(part, ())]
        for part in ("optimizers", "problems")
    }
    whole = {name: settings.get(name) for name in ("format", "budget", "seed", "code", "versions")}
    of_names = {
        "shorter": {name: settings.get("shorter", {}).get(name) for name in sorted(common["optimizers"])},
        "options": {name: settings.get("options", {}).get(name) for name in sorted(common["optimizers"])},
        "problems": {name: settings["problems"][name] for name in sorted(common["problems"])},
    }
    return whole | of_names


def run_bench(
    settings: BenchSettings, folder: Path, workers: int | None = None, scheduler: str | None = None
) -> BenchOutcome:
    """Do every run of the bench that ``folder`` does not hold yet, and return all results.

    In a script of your own, call it under ``if __name__ == "__main__":``, for it starts processes.

    Parameters
    ----------
    settings : BenchSettings
    folder : Path
        Made if missing.
    workers : int, optional
        Processes on this machine; as many as there are cores unless given.
    scheduler : str, optional
        Of a Dask cluster, as ``tcp://host:8786``, which does the runs in place of processes here.

    Raises
    ------
    ValueError
        The folder is another bench's, or holds a damaged file; or the cluster cannot do the work.
    KeyboardInterrupt
        On Ctrl-C; runs that were finished are kept.
    """
    import optimizers

    open_folder(folder, settings)
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
    told = settings.to_json()
    results = {key: read_run(folder, key, label_of(key, told)) for key in keys if run_path(folder, key).exists()}
    missing = [key for key in keys if key not in results]
    if results and missing:
        print(f"{len(results)} of {len(keys)} runs are there already; going on.", file=sys.stderr, flush=True)
    asked = {key.file_stem for key in keys}
    if others := sum(file.stem not in asked for file in (folder / "runs").glob("*.parquet")):
        print(f"{others} runs in {folder} are not asked for, and on no page unless they are.", file=sys.stderr)
    if missing:
        failures = _perform_all(missing, settings, folder, results, len(keys), workers, scheduler)
        unavailable |= failures
    scored = [results[key] for key in keys if key.optimizer not in unavailable]
    if settings.optimizers == BenchSettings.default().optimizers:
        unavailable |= LEFT_OUT
    return BenchOutcome(settings, folder, scored, unavailable)


def applies(optimizer: str, name: str) -> bool:
    """Whether a problem has what an optimiser needs: gradients, where it uses them."""
    import optimizers

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
    """Do the missing runs side by side, storing each as it ends; return the optimisers that broke down."""
    told = settings.to_json()
    # Compile once, here: the workers find the compiled code on disk.
    problem("nominal").evaluate_with_gradient([[0.0] * 7])
    failures: dict[str, str] = {}
    done = len(results)
    batches: dict[str, list[RunKey]] = {}
    for key in sorted(missing, key=_slowness):
        part = f"{key.problem}--{key.optimizer}--{key.repeat // REPEATS_A_JOB:03d}"
        batches.setdefault(part, []).append(key)
    jobs = {part: functools.partial(_job, keys, settings, told) for part, keys in batches.items()}
    useful_s = 0.0
    with shown_progress("bench", total, done) as progress, workers_of(scheduler, workers) as client:
        begin_s = time.perf_counter()

        def keep(_: str, ended: list[Ended]) -> None:
            nonlocal done, useful_s
            for key, result, seconds, failure in ended:
                done += 1
                useful_s += seconds.get("optimizer", 0.0) + seconds.get("objective", 0.0)
                if result is None:
                    failures.setdefault(key.optimizer, f"broke down on {key.problem}, repeat {key.repeat}: {failure}")
                else:
                    write_run(folder, result, label_of(key, told), seconds)
                    results[key] = result
                progress(done, f"{key.optimizer} on {key.problem}")

        run_each(client, perform_some, jobs, keep)
        at_work_s = (time.perf_counter() - begin_s) * worker_count(client)
    if at_work_s:
        elsewhere = 100 * (1 - useful_s / at_work_s)
        print(
            f"Optimisers and objective took {100 - elsewhere:.0f} % of the workers' time; the other {elsewhere:.0f} % "
            "went into starting, storing and waiting for the last runs.",
            file=sys.stderr,
        )
    return failures


def _job(keys: Sequence[RunKey], settings: BenchSettings, told: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(keys), settings, told["code"], told["versions"]


def perform_some(
    keys: Sequence[RunKey], settings: BenchSettings, code: str, packages: Mapping[str, str]
) -> list[Ended]:
    """What `perform` makes of these runs, at a worker.

    Raises
    ------
    ValueError
        The worker's code, or one of its packages, is another.
    """
    if _own_code() != code:
        raise ValueError(
            "the code is not the one that this bench was begun with, here or at a worker. Put that code back on all "
            "machines, start the workers again, and give the same command; or give another folder."
        )
    if difference := first_difference(dict(packages), _own_versions()):
        raise ValueError(
            f"a worker has another package than this bench was begun with: {difference}. Install the same on all "
            "machines, start the workers again, and give the same command."
        )
    return [perform(key, settings) for key in keys]


@functools.cache
def _own_code() -> str:
    """Of the code that this process has loaded: it is read once."""
    return code_digest(SOURCES)


@functools.cache
def _own_versions() -> dict[str, str]:
    return versions()


def _slowness(key: RunKey) -> int:
    for rank, prefix in enumerate(SLOWEST_FIRST):
        if key.optimizer.startswith(prefix):
            return rank
    return len(SLOWEST_FIRST)


def perform(key: RunKey, settings: BenchSettings) -> Ended:
    """Do one run: its result and seconds, or else how it failed, in words."""
    from optimizers.loop import minimise

    seed = key.seed(settings.seed)
    asked = problem(key.problem)
    asked.read(np.zeros((1, 7)), seed)  # nobody's run is charged with loading the compiled code
    if asked.has_gradient:
        asked.evaluate_with_gradient(np.zeros((1, 7)))
    objective = asked.as_measured(seed)
    begin_s = time.perf_counter()
    try:
        budget = settings.budget_of(key.optimizer)
        optimizer = entrant(key.optimizer).made(budget, seed)
        if torch := sys.modules.get("torch"):
            torch.set_num_threads(1)
        run = minimise(objective, optimizer, budget)
    except Exception as error:  # whatever a third party's optimiser throws is reported, not scored
        return key, None, {}, f"{type(error).__name__}: {error}"
    seconds = {
        "optimizer": run.optimizer_seconds,
        "objective": run.objective_seconds,
        "total": time.perf_counter() - begin_s,
    }
    return key, RunResult.of(key, run.points, run.costs), seconds, ""
