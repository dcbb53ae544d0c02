"""One run of the comparison (an optimiser, a problem, a repeat) and the file that stores it.

A run is stored by its improvements: the number of evaluations after which a lower cost was reported, the waveform and
its true cost. The file is a Parquet table whose label identifies the run and its code. It depends on nothing else, so
the same run always gives the same bytes. The run's computing time is stored in another file.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import blake2b, sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkjet_env.experiments.benchmark.cost_check import first_other, first_other_cost
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.experiments.execution.provenance import first_difference
from inkjet_env.extras import extra
from inkjet_env.printhead.waveform import PARAMETER_NAMES
from inkjet_env.storage import json_text, stored_object, write_atomically
from inkjet_env.typing import Real

RUN_FORMAT = "run/2"
LABEL = b"inkjet"
LABELLED = (
    *("format", "optimizer", "options", "problem", "problem_sha256"),
    *("repeat", "seed", "budget", "code", "versions"),
)
"""Names of the entries in a run's label."""
NUMBERS = ("told_V", "cost_V", *PARAMETER_NAMES)


class DamagedResultError(ValueError):
    """A result file is not as the bench wrote it."""


@dataclass(frozen=True)
class RunKey:
    """Identifies a run: the names of optimiser and problem, and the number of the repeat, from 0."""

    optimizer: str
    problem: str
    repeat: int

    def seed(self, bench_seed: int) -> int:
        """Seed of this run, 31 bits: a hash of the key and the bench's seed, independent of the bench's other runs."""
        text = f"{bench_seed}|{self.optimizer}|{self.problem}|{self.repeat}"
        return int.from_bytes(blake2b(text.encode(), digest_size=4).digest(), "big") >> 1

    @property
    def file_stem(self) -> str:
        """Name of the run's files without ending."""
        return f"{self.problem}--{self.optimizer}--{self.repeat:03d}".replace(":", ".")


@dataclass(frozen=True, eq=False)
class RunResult:
    """The improvements of one run, in order.

    Parameters
    ----------
    key : RunKey
        Optimiser, problem and repeat.
    budget : int
        Evaluations of the run.
    evaluations : ndarray of int, shape (k,)
        Numbers of evaluations after which a lower cost was reported; the first is 1.
    told_V : ndarray, shape (k,)
        That cost in volts as the optimiser received it, with measurement errors where the problem has them.
    costs_V : ndarray, shape (k,)
        True cost of the waveform in volts.
    points : ndarray, shape (k, 7)
        The waveform as a point in ``[-1, 1]``.
    """

    key: RunKey
    budget: int
    evaluations: NDArray[np.int64]
    told_V: Real
    costs_V: Real
    points: Real

    @classmethod
    def of(cls, key: RunKey, points: Real, told_V: Real, spent: NDArray[np.int64] | None = None) -> RunResult:
        """The run with these evaluations, in order.

        Where instruments work beside each other, ``spent`` is the time of each in evaluations, and what came after as
        many as there are does not count.
        """
        best = np.minimum.accumulate(told_V)
        better = np.flatnonzero(np.concatenate([[True], told_V[1:] < best[:-1]]))
        counts = better + 1
        if spent is not None:
            counts = spent[better]
            last = np.append(np.diff(counts) > 0, True) & (counts <= len(told_V))  # of those at the same time
            better, counts = better[last], counts[last]
        kept = points[better]
        of = problem(key.problem)
        costs_V = of.evaluate(kept) if of.measurement_noise_V else told_V[better].copy()
        return cls(key, len(told_V), counts, told_V[better].copy(), costs_V, kept)

    def kept_V(self, evaluations: ArrayLike) -> Real:
        """True cost in volts of the best waveform reported up to each number of evaluations, same shape."""
        kept: Real = self.costs_V[np.searchsorted(self.evaluations, np.asarray(evaluations), side="right") - 1]
        return kept

    def lowest_told_V(self, evaluations: ArrayLike) -> Real:
        """Reported cost of that waveform in volts, with measurement errors where the problem has them, same shape."""
        lowest: Real = self.told_V[np.searchsorted(self.evaluations, np.asarray(evaluations), side="right") - 1]
        return lowest

    def best_point(self, evaluations: int | None = None) -> Real:
        """Best point of the first ``evaluations`` (all unless given), in ``[-1, 1]``, shape (7,)."""
        last = len(self.evaluations) if evaluations is None else np.searchsorted(self.evaluations, evaluations, "right")
        point: Real = self.points[int(last) - 1]
        return point

    @extra("a file of runs")
    def to_bytes(self, label: Mapping[str, Any]) -> bytes:
        """Content of the run's file."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns = [self.evaluations, self.told_V, self.costs_V, *self.points.T]
        table = pa.table(dict(zip(("evaluation", *NUMBERS), map(np.ascontiguousarray, columns), strict=True)))
        whole = table.replace_schema_metadata({LABEL: json.dumps(label, sort_keys=True).encode()})
        buffer = io.BytesIO()
        pq.write_table(whole, buffer, compression="zstd")
        return buffer.getvalue()


def label_of(key: RunKey, settings: Mapping[str, Any]) -> dict[str, Any]:
    """The label of a run's file.

    Parameters
    ----------
    key : RunKey
        Optimiser, problem and repeat.
    settings : mapping
        Settings of the bench, from `BenchSettings.to_json`.
    """
    of = json.dumps(settings["problems"][key.problem], sort_keys=True)
    elsewhere = settings.get("plugins", {})
    names = f"optimizer {key.optimizer}", f"problem {key.problem}"
    used = {name: elsewhere[name] for name in names if name in elsewhere}
    return {
        "format": RUN_FORMAT,
        "optimizer": key.optimizer,
        "options": settings["options"].get(key.optimizer, {}),
        "problem": key.problem,
        "problem_sha256": sha256(of.encode()).hexdigest(),
        "repeat": key.repeat,
        "seed": key.seed(settings["seed"]),
        "budget": settings["shorter"].get(key.optimizer, settings["budget"]),
        "code": settings["code"],
        "versions": settings["versions"],
        **({"plugins": used} if used else {}),
    }


def run_path(folder: Path, key: RunKey) -> Path:
    """Path of a run's file in a bench's folder."""
    return folder / "runs" / f"{key.file_stem}.parquet"


def timing_path(folder: Path, key: RunKey) -> Path:
    """Path of a run's computing times in a bench's folder."""
    return folder / "timings" / f"{key.file_stem}.json"


def write_run(folder: Path, result: RunResult, label: Mapping[str, Any], seconds: dict[str, float]) -> None:
    """Store a run: its timing first, then the result, whose presence means that the run is finished."""
    write_atomically(timing_path(folder, result.key), json_text(seconds))
    write_atomically(run_path(folder, result.key), result.to_bytes(label))


def read_seconds(folder: Path, key: RunKey) -> dict[str, float]:
    """Seconds that a run took, by activity; empty if the file is missing or unreadable."""
    try:
        return stored_object(timing_path(folder, key))
    except (OSError, ValueError):
        return {}


@extra("a file of runs")
def read_run(folder: Path, key: RunKey, label: Mapping[str, Any]) -> RunResult:
    """Read a run and check that it is complete and is the run asked for.

    Raises
    ------
    DamagedResultError
        The file is not what the bench writes for this run; the message names the file and the remedy.
    """
    import pyarrow as pa

    path = run_path(folder, key)
    table, found = _read_file(path)
    try:
        evaluations = table["evaluation"].to_numpy().astype(np.int64, casting="safe")
        told_V, costs_V, *points = (table[name].to_numpy().astype(np.float64, casting="safe") for name in NUMBERS)
    except (pa.ArrowException, ValueError, KeyError, TypeError) as error:
        raise _damaged(path, f"it cannot be read ({type(error).__name__})") from None
    if difference := first_difference(found, dict(label)):
        raise _damaged(path, f"it is the file of another run: {difference}")
    result = RunResult(key, label["budget"], evaluations, told_V, costs_V, np.column_stack(points))
    if wrong := _what_is_wrong(result, label["seed"]):
        raise _damaged(path, wrong)
    return result


@extra("a table of runs")
def runs_table(folder: str | os.PathLike[str]) -> Any:
    """All runs of a bench's folder in one table, for your own queries and plots.

    Parameters
    ----------
    folder : str or Path
        Folder of a bench's results.

    Returns
    -------
    pyarrow.Table
        One row per improvement: ``optimizer``, ``problem``, ``repeat``, ``seed`` and ``budget`` of its run; the number
        of the ``evaluation``, the reported cost (``told_V``) and the true cost (``cost_V``) in volts, and the waveform,
        ``U1`` to ``t5`` in [-1, 1] of the problem's bounds. Two optimisers may have different budgets.

    Raises
    ------
    DamagedResultError
        A file cannot be read.
    ValueError
        There are no runs; or two differ in code, packages, options or problem, so that they must not be merged.
    """
    import pyarrow as pa

    tables: list[Any] = []
    first: dict[str, tuple[Path, dict[str, Any]]] = {}
    for path in sorted((Path(folder) / "runs").glob("*.parquet")):
        table, label = _read_file(path)
        if lacking := [name for name in LABELLED if name not in label]:
            raise _damaged(path, f"its label lacks {', '.join(lacking)}")
        decisive = {
            "": {name: label[name] for name in ("format", "code", "versions")},
            f"optimizer {label['optimizer']}": {name: label[name] for name in ("options", "budget")},
            f"problem {label['problem']}": {"problem_sha256": label["problem_sha256"]},
        }
        decisive |= {f"plugin {name}": entries for name, entries in label.get("plugins", {}).items()}
        for of, entries in decisive.items():
            known, its = first.setdefault(of, (path, entries))
            if difference := first_difference(its, entries, of):
                raise ValueError(f"{known.name} and {path.name} must not be merged: {difference}.")
        for name in ("budget", "seed", "repeat", "problem", "optimizer"):
            table = table.add_column(0, name, pa.array([label[name]] * len(table)))
        tables.append(table.replace_schema_metadata(None))
    if not tables:
        raise ValueError(f"{folder} holds no runs. Give the folder of a bench's results.")
    return pa.concat_tables(tables)


@extra("a file of runs")
def _read_file(path: Path) -> tuple[Any, dict[str, Any]]:
    """Table and label of a run's file, both unchecked."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
        return table, dict(json.loads((table.schema.metadata or {})[LABEL]))
    except (pa.ArrowException, ValueError, KeyError, TypeError, OSError, RecursionError) as error:
        raise _damaged(path, f"it cannot be read ({type(error).__name__})") from None


def _what_is_wrong(run: RunResult, seed: int) -> str:
    """Why these cannot be the improvements of a run, in words; empty if they can."""
    counts = run.evaluations
    if not (counts.size and counts[0] == 1 and (np.diff(counts) > 0).all() and counts[-1] <= run.budget):
        return f"its evaluations are not improvements of a run of {run.budget}"
    if not (np.isfinite(run.costs_V).all() and (np.abs(run.points) <= 1).all()):
        return "it holds a cost that is not finite or a point outside the box"
    if not (np.isfinite(run.told_V).all() and (np.diff(run.told_V) < 0).all()):
        return "the reported costs do not decrease"
    of = problem(run.key.problem)
    true_V = of.evaluate(run.points)
    if difference := first_other(true_V, run.costs_V, run.points, counts, lambda x, _: of.evaluate(x)):
        return difference
    return first_other_cost(of, run.points, run.told_V, seed, counts, true_V)


def _damaged(path: Path, reason: str) -> DamagedResultError:
    return DamagedResultError(f"{path} is damaged: {reason}. Delete that file to repeat its run.")
