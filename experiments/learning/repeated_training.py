"""Repeated training: methods that learn are trained several times, in parallel, because trainings differ widely.

A folder stores policies and results. They are reused, but refused if they were made with other settings or other code.
"""

from __future__ import annotations

import argparse
import errno
import functools
import json
import os
import sys
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.envs.task import CONTEXT_NAMES
from inkjet_env.experiments.benchmark.metrics import Places, crossed_bootstrap
from inkjet_env.experiments.execution.cluster import run_each, workers_of
from inkjet_env.experiments.execution.jobs import ClusterError
from inkjet_env.experiments.execution.provenance import code_digest, first_difference, versions
from inkjet_env.experiments.learning.heads import Heads, descended
from inkjet_env.experiments.learning.policies import Policy, PolicyFileError
from inkjet_env.progress import shown_progress
from inkjet_env.storage import archive_bytes, remove_unfinished, write_atomically
from inkjet_env.typing import Real

Arrays = dict[str, NDArray[Any]]
ResultTable = tuple[tuple[str, ...], list[tuple[str, ...]]]
"""Header and rows."""

TRAININGS = 10
SEED_STEP = 1000
"""Difference between the seeds of successive trainings: more than the heads that one training evaluates in parallel."""
FEW = 6
"""Smallest number of trainings for an interval that covers a further training."""
RESAMPLES = 2000
LEAST = {"evaluations": 1, "heads": 2, "labelling": 1, "seed": 0, "trainings": 1, "workers": 1}
"""Smallest permitted value of each option."""
SOURCES = (
    *("inkjet_env/*.py", "inkjet_env/printhead/**/*.py", "inkjet_env/plant/**/*.py", "inkjet_env/envs/**/*.py"),
    "optimizers/**/*.py",
    *(f"experiments/learning/{name}.py" for name in ("heads", "learners", "policies", "few_shot_tuners")),
    *(f"experiments/learning/{name}.py" for name in ("model_based_tuner", "possible_heads", "learnt_prior")),
    *(f"experiments/learning/{name}.py" for name in ("recurrent_policy", "recurrent_training", "benches")),
    "experiments/tuning/proposals.py",
)
"""Files that determine the numbers of a study."""


class KeptFileError(ValueError):
    """A stored file is damaged, or was made with other settings or other code; the message names it."""


def seeds(seed: int, trainings: int) -> list[int]:
    """One seed per training."""
    return [seed + SEED_STEP * k for k in range(trainings)]


@functools.cache
def circumstances() -> dict[str, Any]:
    """Code and package versions on which numbers depend besides their settings, as plain JSON values."""
    return {"code": code_digest(SOURCES), "versions": versions()}


def kept_policy(
    path: Path, asked: Mapping[str, Any], train: Callable[[], Policy], observation: Sequence[str] = CONTEXT_NAMES
) -> Policy:
    """The policy stored in a file; if there is no file, one is trained and stored.

    Parameters
    ----------
    path : Path
        Path of the policy's .npz file.
    asked : mapping
        Settings of the training, as plain JSON values.
    train : callable
        Trains and returns the policy.
    observation : sequence of str
        Name of each number of an observation.

    Raises
    ------
    KeptFileError, PolicyFileError
        The stored policy was trained with other settings or other code, or the file is not a policy.
    """
    wanted = {**asked, **circumstances()}
    if not path.exists():
        policy = train()
        replace(policy, made={**policy.made, "asked": wanted}).save(path)
    policy = Policy.load(path, observation)
    _check_asked(path, policy.made.get("asked"), wanted)
    return policy


def kept_arrays(path: Path, asked: Mapping[str, Any], make: Callable[[], Arrays]) -> Arrays:
    """The arrays stored in a file; if there is no file, they are made and stored.

    Parameters
    ----------
    path : Path
        Path of the .npz file.
    asked : mapping
        Settings with which they are made, as plain JSON values.
    make : callable
        Makes and returns the arrays by name.

    Raises
    ------
    KeptFileError
        The stored arrays were made with other settings or other code, or the file is damaged.
    """
    wanted = {**asked, **circumstances()}
    if not path.exists():
        made = make()
        write_atomically(path, archive_bytes({**made, "asked": np.array(json.dumps(wanted))}))
        return made
    try:
        with np.load(path, allow_pickle=False) as archive:
            found = {name: archive[name] for name in archive.files}
        stored = json.loads(str(found.pop("asked")))
    except (ValueError, KeyError, TypeError, EOFError, OSError, NotImplementedError, zipfile.BadZipFile) as error:
        if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
            raise  # the file could not be read, but may be intact
        reason = "it holds pickled objects, which are never loaded" if "pickle" in str(error) else error
        raise KeptFileError(
            f"{path}: is damaged ({str(reason).rstrip('.') or type(error).__name__}). Delete it to make it again."
        ) from None
    _check_asked(path, stored, wanted)
    return found


def _check_asked(path: Path, stored: Any, wanted: Mapping[str, Any]) -> None:
    if difference := first_difference(stored, dict(wanted)):
        raise KeptFileError(
            f"{path} was made with other settings or code: {difference}. Give another folder, or delete that file to "
            "make it again."
        )


def best_costs_V(folder: Path, heads: Heads, starts: int, seed: int) -> Real:
    """Best cost in volts of ``starts`` descents on each head, shape (heads,); stored in the folder and reused."""
    count = len(heads.observations)

    def make() -> Arrays:
        best_V = np.empty(count)
        with shown_progress("best known", count) as progress:
            for k in range(count):
                best_V[k] = descended(heads.one(k), starts, seed + k)[1]
                progress(k + 1)
        return {"best_V": best_V}

    asked = {"labelling": starts, "seed": seed, "heads": count, "first": heads.observations[0].tolist()}
    return kept_arrays(folder / "best-known.npz", asked, make)["best_V"]


def each(label: str, function: Callable[..., Any], jobs: Mapping[str, tuple[Any, ...]], workers: int) -> dict[str, Any]:
    """Results of a module-level function for every job, by name; computed on ``workers`` processes, or here for one."""
    found: dict[str, Any] = {}
    with shown_progress(label, len(jobs)) as progress:

        def keep(name: str, result: Any) -> None:
            found[name] = result
            progress(len(found), name)

        progress(0)  # the first job takes minutes
        if workers == 1:
            for name, arguments in jobs.items():
                keep(name, function(*arguments))
        else:
            with workers_of(None, workers) as client:
                run_each(client, function, {name: functools.partial(tuple, job) for name, job in jobs.items()}, keep)
    return found


def median_of(regrets_V: Real, rng: np.random.Generator) -> dict[str, Any]:
    """Median of regrets in volts, shape (trainings, heads), with its interval, and the median of each training."""

    found = crossed_bootstrap(functools.partial(_median, regrets_V), regrets_V.shape, rng, RESAMPLES)
    return found.as_json() | {"each": np.median(regrets_V, axis=1).tolist()}


def median_difference(regrets_V: Real, reference_V: Real, rng: np.random.Generator) -> dict[str, Any]:
    """Difference of two median regrets on the same heads, in volts, with its interval.

    Parameters
    ----------
    regrets_V, reference_V : ndarray, shape (trainings, heads)
        Regrets in volts of a method and of the reference; the numbers of trainings may differ.
    rng : Generator
        Draws the bootstrap resamples.
    """

    def difference(mine: Places, theirs: Places, heads: Places) -> float:
        return _median(regrets_V, mine, heads) - _median(reference_V, theirs, heads)

    return crossed_bootstrap(difference, (len(regrets_V), *reference_V.shape), rng, RESAMPLES).as_json()


def _median(values: Real, trainings: Places, heads: Places) -> float:
    return float(np.median(values[trainings[:, None], heads]))


def with_interval(entry: Mapping[str, float] | None, digits: str = ".2f", nothing: str = "") -> str:
    """A value with its interval, as text; ``nothing`` where there is none."""
    if entry is None:
        return nothing
    return f"{entry['value']:{digits}} ({entry['low']:{digits}} … {entry['high']:{digits}})"


def spread_of(each_V: Sequence[float], digits: str = ".2f") -> str:
    """The smallest and the largest of several trainings, as text; empty for one training."""
    return f"{min(each_V):{digits}} … {max(each_V):{digits}}" if len(each_V) > 1 else ""


def over(heads: int, trainings: int) -> str:
    """The sample over which the medians and intervals of a table are taken, in words."""
    some = f"over {heads} unseen heads"
    if trainings == 1:
        return f"{some}, with a 95 % interval over heads alone: each method was trained once, and trainings differ"
    both = f"{some} and {trainings} trainings of each learning method"
    if trainings < FEW:
        return f"{both}, with an interval over both that is too narrow for 95 %, which takes {FEW} trainings"
    return f"{both}, with a 95 % interval over both"


def run_command(
    module: str,
    folder: Path,
    description: str | None,
    evaluations: int,
    heads: int,
    run: Callable[..., Mapping[str, Any]],
    tables: Callable[[Mapping[str, Any]], Sequence[ResultTable]],
    legend: Callable[[Mapping[str, Any]], str],
    arguments: list[str] | None,
) -> None:
    """Run a study from the command line: ``run`` gets the options by name; ``tables`` and ``legend`` are printed.

    Parameters
    ----------
    module, description : str
        Name of the study's module, and what its help says.
    folder : Path
        Folder of the results unless given.
    evaluations, heads : int
        Evaluations of one training and number of test heads unless given.
    run : callable
        Carries out the study with the options as keyword arguments, and returns its results.
    tables, legend : callable
        Header and rows of each table of the results, and the explanation of their numbers.
    arguments : list of str, optional
        Arguments of the command line; those of the process unless given.
    """
    from inkjet_env.reporting.tables import print_table

    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=description)
    parser.add_argument("--folder", type=Path, default=folder)
    parser.add_argument("--evaluations", type=int, default=evaluations, help="number of evaluations per training")
    parser.add_argument("--heads", type=int, default=heads, help="number of test heads")
    parser.add_argument("--labelling", type=int, default=60, help="number of descents per test head")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--trainings", type=int, default=TRAININGS, help="number of trainings of each learning method")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="number of processes; one per core unless given"
    )
    chosen = vars(parser.parse_args(arguments))
    for name, least in LEAST.items():
        if chosen[name] < least:
            parser.error(f"--{name} must be at least {least}; got {chosen[name]}.")
    folder = chosen["folder"]
    if folder.exists() and not folder.is_dir():
        parser.error(f"--folder must be a folder; {folder} is a file. Give another name.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        remove_unfinished(folder)
        found = run(**chosen)
        for table in tables(found):
            print_table(*table)
        print(legend(found))
    except (PolicyFileError, KeptFileError, ClusterError, OSError) as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    except KeyboardInterrupt:
        print(f"Interrupted; finished trainings and tests are kept in {folder}.", file=sys.stderr)
        sys.exit(130)
