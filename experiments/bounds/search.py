"""Search for a proof that no waveform of a problem costs less than a bound: branch and bound.

``python -m inkjet_env.experiments.bounds.search nominal --bound -24 --folder results/bound`` divides the waveforms by
their largest extremum, and each part into boxes, halved until each has a lower bound that is good enough. What is
proven is kept: the same command goes on after an interruption. The folder is the certificate, for
``inkjet_env.experiments.bounds.verification``.
"""

from __future__ import annotations

import argparse
import itertools
import json
import lzma
import math
import os
import shutil
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.experiments.bounds.cost_to_go import LEVELS, Grid, coarser, dwell_table, edge_table, ring_down
from inkjet_env.experiments.bounds.head_numbers import GAIN, STEEPEST, head_numbers
from inkjet_env.experiments.bounds.tree import FULL, PROVED, STOPPED, STUCK, influences, prove
from inkjet_env.experiments.bounds.windows import NEVER
from inkjet_env.experiments.execution.held_folder import held
from inkjet_env.printhead import Printhead
from inkjet_env.progress import shown_progress
from inkjet_env.storage import archive_bytes, json_text, remove_unfinished, write_atomically
from inkjet_env.typing import Real

MODULE = "inkjet_env.experiments.bounds.search"
FORMAT = "lower-bound/1"
MICRO = 1e-6


@dataclass(frozen=True)
class Settings:
    """How the search goes about it; what it proves does not depend on them.

    Attributes
    ----------
    width : float
        Width of a part in the largest extremum, relative to it.
    voltages : tuple of floats
        Ends of the ranges of −U2 of the tables, from 0 to 1 within its bounds.
    angles, turn : int
        Cells of the tables; see `Grid`.
    table_levels, table_step : int, float
        Halvings of the last edge's duration in the tables, and largest distance of its nodes in µs.
    pieces : int
        Number of times that the box of all waveforms is halved before its pieces are distributed.
    thresholds, steps, finest
        As for `tree.prove`.
    deepest, most : int
        Largest number of halvings of a piece, and of its boxes.
    """

    width: float = 0.04
    voltages: tuple[float, ...] = (
        *(0.0, 0.2, 0.4, 0.5, 0.6),
        *(0.62 + 0.02 * k for k in range(9)),
        *(0.8 + 0.01 * k for k in range(20)),
        1.0,
    )
    angles: int = 640
    turn: int = 60
    table_levels: int = 4
    table_step: float = 0.35
    pieces: int = 10
    thresholds: tuple[float, float] = (0.5, 0.5)
    steps: tuple[float, float] = (0.02, 0.5)
    finest: float = 12.0
    deepest: int = 100
    most: int = 200_000_000


@dataclass(frozen=True)
class Task:
    """What is to be proven, in µs and volts.

    Attributes
    ----------
    head : ndarray
        `head_numbers`.
    weights : tuple of two floats
        Weights of the effective extremum and of the next.
    lower, upper : ndarray, shape (7,)
        The waveforms: U1, −U2, then five durations.
    window : float
        Time within which extrema count.
    """

    head: Real
    weights: tuple[float, float]
    lower: Real
    upper: Real
    window: float

    @property
    def highest(self) -> float:
        """A bound of all extrema, in volts: what the edges push, if they all push the same way."""
        a, b = self.upper[:2]
        return float(self.head[GAIN] * self.head[STEEPEST] * (a + (a + b) + b))

    @property
    def ring(self) -> tuple[float, float, float, float]:
        """`ring_down`."""
        found: tuple[float, float, float, float] = ring_down(
            self.head, self.weights, float(self.upper[2:].sum()), self.window
        )
        return found


def task_of(one: Problem) -> Task:
    """The task of a problem.

    Raises
    ------
    ValueError
        Bounds of such problems cannot be proven; the message says why.
    """
    cost, head = one.cost, one.printhead
    obstacles = {
        "its head has effects beyond the base model": not isinstance(head, Printhead),
        "its costs are read with errors or late": bool(one.measurement_noise_V or one.instruments),
        "it is judged on several heads": one.spread is not None or one.ensemble is not None,
        "its waveforms follow one another": one.jetting_Hz != 0 or one.pulses != 0,
        "its drive does not begin in the periodic state": one.initial_state != "periodic",
        "its effective peak is not the largest one": cost.effective != "largest",
        "its cost has a target height": math.isfinite(cost.target_height_V),
        f"its weights are not A ≤ 0 and B ≥ 1: {cost.A:g} and {cost.B:g}": cost.A > 0 or cost.B < 1,
        "its voltages do not rise first and fall then": one.bounds.lower[0] < 0 or one.bounds.upper[1] > 0,
        "its window ends before its waveforms": one.window_s < sum(one.bounds.upper[2:]),
    }
    for why, stands in obstacles.items():
        if stands:
            raise ValueError(f"{one.name}: no bound can be proven, since {why}.")
    assert isinstance(head, Printhead)
    low, high = np.array(one.bounds.lower), np.array(one.bounds.upper)
    lower = np.concatenate([[low[0], -high[1]], low[2:] / MICRO])
    upper = np.concatenate([[high[0], -low[1]], high[2:] / MICRO])
    window = one.window_s / MICRO if math.isfinite(one.window_s) else 1e6
    return Task(head_numbers(head), (float(cost.A), float(cost.B)), lower, upper, window)


def parts_of(task: Task, bound_V: float, width: float) -> list[tuple[float, float]]:
    """Ranges of the largest extremum in volts: from where nothing can cost less, to the highest of all."""
    least = bound_V / task.weights[0]
    count = max(1, math.ceil(math.log(task.highest / least) / width)) if task.highest > least else 0
    ends = [least * (task.highest / least) ** (k / count) for k in range(count + 1)] if count else []
    return list(itertools.pairwise(ends))


class Tables:
    """What the rest of a waveform costs at least, for ranges of U2.

    Parameters
    ----------
    task : Task
    settings : Settings
    threads : int
        Number of threads.
    """

    def __init__(self, task: Task, settings: Settings, threads: int) -> None:
        self.task, self.settings, self.threads = task, settings, threads
        self.grid = Grid(settings.angles, settings.turn, largest=task.highest)
        self.shape = (self.grid.angles, self.grid.step(task.head), self.grid.smallest)
        ends = task.lower[1] + (task.upper[1] - task.lower[1]) * np.array(self.settings.voltages)
        self.low_b, self.high_b = ends[:-1].copy(), ends[1:].copy()
        size = (self.low_b.size, self.grid.labels(task.head), self.grid.angles, 3)
        self.edge = np.full(size, np.inf, np.float32)
        self.dwell = np.empty_like(self.edge)
        self.inner = np.full((self.low_b.size, 3), NEVER)

    def prepare(self, folder: Path) -> None:
        """Compute what holds for every part, what it costs after the effective extremum, or read it from the folder."""
        file = folder / "tables.npz"
        asked = json_text(
            [
                list(map(float, self.task.head)),
                self.task.weights,
                list(self.task.lower),
                list(self.task.upper),
                self.task.window,
                asdict(self.settings),
            ]
        )
        if file.exists():
            with np.load(file, allow_pickle=False) as kept:
                if str(kept["asked"]) == asked:
                    self.edge[:, :, :, 1:], self.inner[:, 1:] = kept["edge"], kept["inner"]
                    return
        self._each("tables for all parts", self._prepare)
        made = {"asked": np.array(asked), "edge": self.edge[:, :, :, 1:], "inner": self.inner[:, 1:]}
        write_atomically(file, archive_bytes(made))

    def _prepare(self, k: int) -> None:
        _task, table = self.task, np.empty(self.edge.shape[1:])
        self._last_edge(k, (NEVER, NEVER), (1, 2), table)
        self.edge[k, :, :, 1:] = _rounded_down(table[:, :, 1:])

    def for_part(self, limits: tuple[float, float]) -> tuple[Any, Any, Real, Real]:
        """Tables at the dwell and at the last edge, by levels, and their values near 0."""
        self._each(f"tables for {limits[0]:.3f} to {limits[1]:.3f} V", lambda k: self._for_part(k, limits))
        near_dwell = self.inner.copy()
        near_dwell[:, 1] = self.inner[:, 1:].min(axis=1)
        return _levels(self.dwell), _levels(self.edge), near_dwell, self.inner.copy()

    def _for_part(self, k: int, limits: tuple[float, float]) -> None:
        task, table, dwell = self.task, np.empty(self.edge.shape[1:]), np.empty(self.edge.shape[1:])
        self._last_edge(k, limits, (0, 0), table)
        self.edge[k, :, :, 0] = _rounded_down(table[:, :, 0])
        table[:, :, 1:] = self.edge[k, :, :, 1:]
        dwell_table(
            task.head, task.weights, table, self.inner[k], (float(task.lower[5]), float(task.upper[5])), self.shape,
            self.grid.turn, limits, dwell,
        )  # fmt: skip
        self.dwell[k] = _rounded_down(dwell)

    def _last_edge(self, k: int, limits: tuple[float, float], modes: tuple[int, int], table: Real) -> None:
        task, told = self.task, self.settings
        durations = float(task.lower[6]), float(task.upper[6])
        edge_table(
            task.head, task.weights, task.ring, self.low_b[k], self.high_b[k], durations, told.table_levels,
            told.table_step, self.shape, limits, modes, table, self.inner[k],
        )  # fmt: skip

    def _each(self, label: str, work: Any) -> None:
        with ThreadPoolExecutor(self.threads) as pool, shown_progress(label, self.low_b.size) as show:
            for done, one in enumerate(as_completed([pool.submit(work, k) for k in range(self.low_b.size)]), 1):
                one.result()
                show(done)


def _rounded_down(values: Real) -> NDArray[np.float32]:
    """Values of half the size, none larger; what no course does is infinite."""
    with np.errstate(over="ignore"):
        found = values.astype(np.float32)
    return np.nextafter(found, np.float32(-np.inf), where=np.isfinite(found), out=found)


def _levels(tables: NDArray[np.float32]) -> tuple[NDArray[np.float32], ...]:
    """Tables and ever coarser ones, for `cost_to_go.look_up`."""
    found = [tables]
    for _ in range(LEVELS - 1):
        found.append(np.array([coarser(one) for one in found[-1]]))
    return tuple(found)


def halved(lower: Real, upper: Real, sides: Sequence[int]) -> tuple[Real, Real]:
    """The part of a box after halvings: ``side`` where the lower half is kept, ``~side`` where the upper one is."""
    lower, upper = lower.copy(), upper.copy()
    for side in sides:
        k = side if side >= 0 else ~side
        middle = 0.5 * (lower[k] + upper[k])
        if side >= 0:
            upper[k] = middle
        else:
            lower[k] = middle
    return lower, upper


class Search:
    """A proof that is under way in a folder.

    Parameters
    ----------
    folder : Path
        Folder of the certificate.
    one : Problem
    bound_V : float
        What is to be proven, in volts.
    threads : int
        Number of threads.
    settings : Settings, optional
    """

    def __init__(
        self, folder: Path, one: Problem, bound_V: float, threads: int = 1, settings: Settings | None = None
    ) -> None:
        self.folder, self.threads, self.bound_V = folder, threads, bound_V
        self.settings = settings or Settings()
        self.task = task_of(one)
        self.parts = parts_of(self.task, bound_V, self.settings.width)
        self.influence = influences(self.task.head, self.task.lower, self.task.upper)
        self.stop = np.zeros(1, np.int64)
        self.header = {
            "format": FORMAT,
            "problem": {"name": one.name, **one.settings()},
            "bound_V": bound_V,
            "parts": [list(limits) for limits in self.parts],
        }
        self.kept = folder / "certificate.json"
        if self.kept.exists() and json.loads(self.kept.read_text()) != self.header:
            raise ValueError(f"{self.kept} is for another problem, bound or division. Give another folder.")
        folder.mkdir(parents=True, exist_ok=True)
        remove_unfinished(folder)
        write_atomically(self.kept, json_text(self.header))

    def pieces(self) -> list[tuple[list[int], Real, Real]]:
        """The pieces of the box of all waveforms, with the halvings that lead to them, in the certificate's order."""
        found: list[tuple[list[int], Real, Real]] = [([], self.task.lower, self.task.upper)]
        for _ in range(self.settings.pieces):
            found = [
                ([*sides, way], *halved(self.task.lower, self.task.upper, [*sides, way]))
                for sides, lower, upper in found
                for side in [int(np.argmax(self.influence[:5] * (upper - lower)[:5]))]
                for way in (side, ~side)
            ]
        return found

    def run(self, seconds: float = math.inf) -> None:
        """Prove what is not proven yet, for so long.

        Raises
        ------
        ValueError
            A box cannot be proven: the bound does not hold, or is too close to the least cost.
        """
        begun = time.monotonic()
        ready: Tables | None = None
        for number, limits in enumerate(self.parts):
            if self.file(number).exists():
                continue
            if ready is None:
                ready = Tables(self.task, self.settings, self.threads)
                ready.prepare(self.folder)
            if time.monotonic() - begun > seconds:
                break
            self._part(number, limits, ready, begun + seconds)
        if all(self.file(number).exists() for number in range(len(self.parts))):
            (self.folder / "tables.npz").unlink(missing_ok=True)

    def file(self, number: int) -> Path:
        """File of the tree of a part."""
        return self.folder / f"part-{number:02}.xz"

    def _part(self, number: int, limits: tuple[float, float], ready: Tables, until: float) -> None:
        tables, told = ready.for_part(limits), self.settings
        pieces = self.pieces()
        folder = self.folder / f"part-{number:02}"
        folder.mkdir(exist_ok=True)
        remove_unfinished(folder)
        files = [folder / f"{k:04}.xz" for k in range(len(pieces))]
        left = [k for k, file in enumerate(files) if not file.exists()]

        def work(k: int) -> None:
            if self.stop[0]:
                return
            lower, upper = pieces[k][1].copy(), pieces[k][2].copy()
            symbols, counts = np.empty(told.most, np.uint8), np.zeros(4, np.int64)
            began = time.monotonic()
            ended = prove(
                self.task.head, self.task.weights, self.task.ring, limits, self.bound_V, self.influence,
                told.thresholds, lower, upper, told.steps, *tables, ready.low_b, ready.high_b, ready.shape, told.finest,
                told.deepest, symbols, counts, self.stop,
            )  # fmt: skip
            if ended == STOPPED:
                return
            if ended != PROVED:
                why = {STUCK: "cannot be proven", FULL: "is divided into too many boxes"}[ended]
                box = ", ".join(f"{low:.6g} to {high:.6g}" for low, high in zip(lower, upper, strict=True))
                raise ValueError(
                    f"{self.bound_V:g} V is not proven: with the largest extremum between {limits[0]:.4f} and "
                    f"{limits[1]:.4f} V, the box of waveforms {box} (U1 and −U2 in V, durations in µs) {why}. Give a "
                    "lower bound."
                )
            spent = {"bounds": [int(n) for n in counts[:3]], "seconds": time.monotonic() - began}
            write_atomically(files[k].with_suffix(".json"), json_text(spent))
            write_atomically(files[k], lzma.compress(symbols[: counts[3]].tobytes(), preset=1))

        label = f"largest extremum {limits[0]:.3f} to {limits[1]:.3f} V"
        with (
            ThreadPoolExecutor(self.threads) as pool,
            shown_progress(label, len(files), len(files) - len(left)) as show,
        ):
            done = len(files) - len(left)
            running = [pool.submit(work, k) for k in left]
            try:
                for one in as_completed(running):
                    one.result()
                    done += not self.stop[0]
                    show(done)
                    if time.monotonic() > until:
                        self.stop[0] = 1
            except BaseException:
                self.stop[0] = 1
                raise
        if all(file.exists() for file in files):
            self._join(number, pieces, files)
            shutil.rmtree(folder)

    def _join(self, number: int, pieces: list[tuple[list[int], Real, Real]], files: list[Path]) -> None:
        """Write the tree of a part into one file: each box before its lower and its upper half."""
        stream, spent, bounds = bytearray(), 0.0, np.zeros(3)
        before: list[int] = []
        for (sides, _, _), file in zip(pieces, files, strict=True):
            same = next((k for k, (a, b) in enumerate(zip(before, sides, strict=False)) if a != b), len(before))
            # where the lower half is left for the upper one the box has been written
            stream += bytes(side for side in sides[same + 1 if before else 0 :])
            stream += lzma.decompress(file.read_bytes())
            told = json.loads(file.with_suffix(".json").read_text())
            spent, bounds = spent + told["seconds"], bounds + told["bounds"]
            before = sides
        count = {"boxes": len(stream), "bounds": [int(n) for n in bounds], "seconds": spent}
        write_atomically(self.file(number).with_suffix(".json"), json_text(count))
        write_atomically(self.file(number), lzma.compress(bytes(stream), preset=6))


def main(arguments: list[str] | None = None) -> None:
    """Search from the command line."""
    parser = argparse.ArgumentParser(prog=f"python -m {MODULE}", description=__doc__)
    parser.add_argument("problem", help="name of a problem of the suite")
    parser.add_argument("--bound", type=float, required=True, help="bound in volts")
    parser.add_argument("--folder", type=Path, required=True, help="folder of the certificate")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="number of threads; one per core")
    parser.add_argument("--hours", type=float, default=math.inf, help="time after which the search pauses")
    chosen = parser.parse_args(arguments)
    if chosen.bound >= 0 or chosen.workers < 1:
        parser.error("--bound must be below 0 and --workers at least 1.")
    try:
        with held(chosen.folder, "search"):
            search = Search(chosen.folder, problem(chosen.problem), chosen.bound, chosen.workers)
            search.run(3600 * chosen.hours)
            left = sum(not search.file(k).exists() for k in range(len(search.parts)))
    except ValueError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    except KeyboardInterrupt:
        print(f"Interrupted; what is proven is kept in {chosen.folder}.", file=sys.stderr)
        sys.exit(130)
    if left:
        print(f"{left} of {len(search.parts)} parts are left; the same command goes on.")
    else:
        print(f"{chosen.problem}: no waveform costs less than {chosen.bound:g} V.")


if __name__ == "__main__":
    main()
