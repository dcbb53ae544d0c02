"""The comparison's runner against nevergrad's own, on the same job: time, and the results left after a kill.

``python -m inkjet_env.experiments.benchmark.studies.runner_overhead`` gives both the same job: three nevergrad
optimisers, some problems, the same number of runs of 2,000 evaluations each, and the same number of processes. First
both run to the end; then both are started again and killed half-way. nevergrad's runner (`nevergrad.benchmark.core`) is
used unchanged; its collection of test functions, which needs dozens of packages that are not installed, is not
loaded."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
import types
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas

from inkjet_env.experiments.benchmark.suite import BENCHED, problem
from inkjet_env.reporting.tables import print_table

METHODS = ("TwoPointsDE", "OnePlusOne", "PSO")
NAME = "inkjet"


@dataclass(frozen=True)
class Job:
    """The job of both: runs of each optimiser on each problem, evaluations per run, number of processes."""

    repeats: int
    budget: int
    workers: int

    @property
    def runs(self) -> int:
        """Total number of runs."""
        return len(METHODS) * len(BENCHED) * self.repeats

    @property
    def arguments(self) -> list[str]:
        """The job as command-line arguments."""
        return ["--repeats", str(self.repeats), "--budget", str(self.budget), "--workers", str(self.workers)]


def run_theirs(file: Path, job: Job) -> None:
    """Do the job with nevergrad's runner, which writes a table at the end."""
    import nevergrad
    import torch
    from nevergrad.common.decorators import Registry

    plans: Any = Registry()
    for module in ("experiments", "frozenexperiments", "gymexperiments"):
        empty: Any = types.ModuleType(f"nevergrad.benchmark.{module}")
        empty.registry, empty.Experiment = plans, None
        sys.modules[empty.__name__] = empty
    from nevergrad.benchmark import xpbase
    from nevergrad.benchmark.__main__ import launch
    from nevergrad.functions import ExperimentFunction

    xpbase.torch = torch  # nevergrad does not import it if a package of its collection is missing

    class OnProblem(ExperimentFunction):
        """One problem of the suite in the form of nevergrad's functions."""

        def __init__(self, name: str) -> None:
            box = nevergrad.p.Array(init=[0.0] * 7, lower=-1.0, upper=1.0).set_name("box")
            super().__init__(lambda point: float(problem(name).evaluate(point)[0]), box)
            self.add_descriptors(name=name)

    def plan(seed: int | None = None) -> Iterator[Any]:
        count = 0
        for _ in range(job.repeats):
            for name in BENCHED:
                for method in METHODS:
                    yield xpbase.Experiment(OnProblem(name), method, budget=job.budget, seed=(seed or 0) + count)
                    count += 1

    plans.register_name(NAME, plan)
    problem(BENCHED[0]).evaluate([[0.0] * 7])
    launch(NAME, num_workers=job.workers, seed=1, output=file)


def ours(folder: Path, job: Job) -> list[str]:
    """The command that does the job with this project's runner."""
    named = ",".join(f"nevergrad-{method}" for method in METHODS)
    command = [
        sys.executable,
        "-m",
        "inkjet_env.experiments.cli",
        "bench",
        "--optimizers",
        named,
        "--results",
        str(folder),
    ]
    return command + job.arguments


def theirs(file: Path, job: Job) -> list[str]:
    """The command that does the job with nevergrad's runner."""
    return [
        sys.executable,
        "-W",
        "ignore",
        "-m",
        "inkjet_env.experiments.benchmark.studies.runner_overhead",
        "--theirs",
        str(file),
        *job.arguments,
    ]


def seconds_of(command: Sequence[str], after_s: float | None = None) -> float:
    """Run a command to its end, or kill it and its child processes after ``after_s``; return the seconds it took.

    Raises
    ------
    RuntimeError
        The command failed.
    """
    begin_s = time.perf_counter()
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(command, stdout=output, stderr=output, start_new_session=True)
        try:
            code = process.wait(after_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return time.perf_counter() - begin_s
        if code:
            output.seek(0)
            raise RuntimeError(f"{' '.join(command)} failed:\n{output.read().decode(errors='replace')[-2000:]}")
    return time.perf_counter() - begin_s


def kept(place: Path) -> int:
    """Number of runs with results: rows of a table that have one, or files of a folder."""
    if place.suffix == ".csv":
        return int(pandas.read_csv(place)["loss"].notna().sum()) if place.exists() else 0
    return len(list(place.glob("runs/*.parquet")))


def main(arguments: list[str] | None = None) -> None:
    """Time both runners, kill both, and print the comparison."""
    parser = argparse.ArgumentParser(
        prog="python -m inkjet_env.experiments.benchmark.studies.runner_overhead", description=__doc__
    )
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--budget", type=int, default=2000)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--theirs", type=Path, help=argparse.SUPPRESS)
    chosen = parser.parse_args(arguments)
    job = Job(chosen.repeats, chosen.budget, chosen.workers)
    if chosen.theirs is not None:
        run_theirs(chosen.theirs, job)
        return
    with tempfile.TemporaryDirectory() as scratch:
        rows = []
        for label, command, place in (
            ("inkjet bench", ours, Path(scratch) / "ours"),
            ("nevergrad's runner", theirs, Path(scratch) / "theirs.csv"),
        ):
            whole_s = seconds_of(command(place, job))
            done = kept(place)
            if done < job.runs:
                raise RuntimeError(f"{label} has ended with {done} results of {job.runs}.")
            stopped = place.with_name(f"stopped-{place.name}")
            seconds_of(command(stopped, job), whole_s / 2)
            rows.append((label, whole_s, done, kept(stopped)))
    print_table(
        ("runner", "seconds", "results at the end", f"of {job.runs}: kept after kill -9 half-way"),
        [(label, f"{seconds:.1f}", str(done), str(left)) for label, seconds, done, left in rows],
    )
    print(f"Time of inkjet bench over nevergrad's: {rows[0][1] / rows[1][1]:.2f} ({chosen.workers} processes each).")


if __name__ == "__main__":
    main()
