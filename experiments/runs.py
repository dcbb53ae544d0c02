"""One run of the comparison: an optimiser, a problem, a repeat; and the file that keeps it.

A run's file depends on nothing but its key, its budget and the bench's seed, so that the same run gives the same bytes
on every occasion. How long it took is kept in another file.
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.problems import Problem, problem
from inkjet_env.storage import archive_bytes, json_text, write_atomically

RUN_FORMAT = "run/1"


class DamagedResultError(ValueError):
    """A result file that cannot be what the bench wrote."""


@dataclass(frozen=True)
class RunKey:
    """Which run: names of optimiser and problem, and the number of the repeat, from 0."""

    optimizer: str
    problem: str
    repeat: int

    def seed(self, bench_seed: int) -> int:
        """Seed of this run, 31 bits: a hash of its names, the same whatever else the bench holds."""
        text = f"{bench_seed}|{self.optimizer}|{self.problem}|{self.repeat}"
        return int.from_bytes(blake2b(text.encode(), digest_size=4).digest(), "big") >> 1

    @property
    def file_stem(self) -> str:
        """Name of its files, without ending."""
        return f"{self.problem}--{self.optimizer}--{self.repeat:03d}"


@dataclass(frozen=True)
class RunResult:
    """All evaluations of one run, in order.

    Parameters
    ----------
    key : RunKey
    seed : int
        Of the optimiser.
    points : ndarray, shape (budget, 7)
        In ``[-1, 1]``.
    costs : ndarray, shape (budget,)
        In volts.
    """

    key: RunKey
    seed: int
    points: NDArray[np.float64]
    costs: NDArray[np.float64]

    def best_so_far(self) -> NDArray[np.float64]:
        """Least cost up to each evaluation, in volts, shape (budget,)."""
        return np.minimum.accumulate(self.costs)

    def best_point(self, evaluations: int | None = None) -> NDArray[np.float64]:
        """Best point of the first ``evaluations`` (all unless given), in ``[-1, 1]``, shape (7,)."""
        return self.points[int(np.argmin(self.costs[:evaluations]))]

    def to_bytes(self) -> bytes:
        """Content of the run's file."""
        label = {
            "format": RUN_FORMAT,
            "optimizer": self.key.optimizer,
            "problem": self.key.problem,
            "repeat": self.key.repeat,
            "seed": self.seed,
        }
        return archive_bytes(
            {"label": np.array(json.dumps(label)), "points": self.points, "costs": self.costs},
        )


def run_path(folder: Path, key: RunKey) -> Path:
    """Where a bench's folder keeps a run."""
    return folder / "runs" / f"{key.file_stem}.npz"


def timing_path(folder: Path, key: RunKey) -> Path:
    """Where a bench's folder keeps how long a run took."""
    return folder / "timings" / f"{key.file_stem}.json"


def write_run(folder: Path, result: RunResult, seconds: dict[str, float]) -> None:
    """Store a run: first its timing, then the result, whose presence means that the run is done."""
    write_atomically(timing_path(folder, result.key), json_text(seconds))
    write_atomically(run_path(folder, result.key), result.to_bytes())


def read_seconds(folder: Path, key: RunKey) -> dict[str, float]:
    """Seconds that a run spent, by what it spent them on; empty where that was lost."""
    try:
        return dict(json.loads(timing_path(folder, key).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return {}


def read_run(folder: Path, key: RunKey, bench_seed: int, budget: int) -> RunResult:
    """Read a run and check that it is whole and is the run asked for.

    Raises
    ------
    DamagedResultError
        The file is not what the bench writes for this run; the message names it and says what to do.
    """
    path = run_path(folder, key)
    try:
        with np.load(path, allow_pickle=False) as archive:
            label = json.loads(str(archive["label"]))
            points, costs = archive["points"], archive["costs"]
    except (ValueError, KeyError, EOFError, OSError, zipfile.BadZipFile, NotImplementedError) as error:
        raise _damaged(path, f"it cannot be read ({type(error).__name__})") from None
    seed = key.seed(bench_seed)
    expected = {
        "format": RUN_FORMAT,
        "optimizer": key.optimizer,
        "problem": key.problem,
        "repeat": key.repeat,
        "seed": seed,
    }
    if label != expected:
        raise _damaged(path, f"it is labelled {label} instead of {expected}")
    if points.dtype != np.float64 or costs.dtype != np.float64:
        raise _damaged(path, f"it holds points of {points.dtype} and costs of {costs.dtype} instead of float64")
    if points.shape != (budget, 7) or costs.shape != (budget,):
        raise _damaged(path, f"it holds points {points.shape} and costs {costs.shape} for a budget of {budget}")
    if not (np.isfinite(costs).all() and (np.abs(points) <= 1).all()):
        raise _damaged(path, "it holds a cost that is not finite or a point outside the box")
    result = RunResult(key, seed, points, costs)
    if difference := first_other_cost(problem(key.problem), points, costs):
        raise _damaged(path, difference)
    return result


def first_other_cost(problem: Problem, points: NDArray[np.float64], costs: NDArray[np.float64]) -> str:
    """Say which recorded cost is not what its point costs here; empty where all are."""
    again = problem.evaluate(points)
    wrong = ~np.isclose(again, costs, rtol=1e-9, atol=1e-9)
    if not wrong.any():
        return ""
    i = int(np.argmax(wrong))
    return f"evaluation {i + 1} costs {again[i]:.9g} V here, not the {costs[i]:.9g} V it records"


def _damaged(path: Path, reason: str) -> DamagedResultError:
    return DamagedResultError(f"{path} is damaged: {reason}. Delete that file to have its run done again.")
