"""The tables of the cost to go for all ranges of U2: those of all parts of a proof, and those of one part."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.experiments.bounds.cost_to_go import Grid, dwell_table, edge_table
from inkjet_env.experiments.bounds.table_cells import LEVELS, coarser
from inkjet_env.experiments.bounds.task import Settings, Task
from inkjet_env.experiments.bounds.windows import NEVER
from inkjet_env.progress import shown_progress
from inkjet_env.storage import archive_bytes, json_text, write_atomically
from inkjet_env.typing import Real

SPENT = "tables.json"
"""File of the processor's seconds spent on tables, in the folder of the certificate and of each part."""


class Tables:
    """What the rest of a waveform costs at least, for ranges of U2.

    Parameters
    ----------
    task : Task
    settings : Settings
    threads : int
        Number of threads.

    Attributes
    ----------
    seconds : float
        The processor's seconds that were spent on the tables computed last.
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
        self.seconds = 0.0

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
        write_atomically(folder / SPENT, json_text({"seconds": self.seconds}))

    def _prepare(self, k: int) -> None:
        _task, table = self.task, np.empty(self.edge.shape[1:])
        self._last_edge(k, (NEVER, NEVER), (1, 2), table)
        self.edge[k, :, :, 1:] = _rounded_down(table[:, :, 1:])

    def for_part(self, limits: tuple[float, float]) -> tuple[Any, Any, Real, Real]:
        """Tables at the dwell and at the last edge, by levels, and their values near 0."""
        self._each(f"tables for {limits[0]:.3f} to {limits[1]:.3f} V", lambda k: self._for_part(k, limits))
        near_dwell = self.inner.copy()
        near_dwell[:, 1] = self.inner[:, 1:].min(axis=1)
        return _levels(self.dwell), _levels(self.edge), with_unions(near_dwell), with_unions(self.inner)

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
        def seconds(k: int) -> float:
            began = time.thread_time()
            work(k)
            return time.thread_time() - began

        self.seconds = 0.0
        with ThreadPoolExecutor(self.threads) as pool, shown_progress(label, self.low_b.size) as show:
            for done, one in enumerate(as_completed([pool.submit(seconds, k) for k in range(self.low_b.size)]), 1):
                self.seconds += one.result()
                show(done)


def _rounded_down(values: Real) -> NDArray[np.float32]:
    """Values of half the size, none larger; what no course does is infinite."""
    with np.errstate(over="ignore"):
        found = values.astype(np.float32)
    return np.nextafter(found, np.float32(-np.inf), where=np.isfinite(found), out=found)


def with_unions(tables: NDArray[Any]) -> NDArray[Any]:
    """Tables of ranges along the first axis; after them those of their unions by twos, then of these, to a single one.

    The cost to go of a union is the least of its ranges'; a last range without a partner stands alone.
    """
    found = [tables]
    while len(found[-1]) > 1:
        found.append(np.minimum.reduceat(found[-1], np.arange(0, len(found[-1]), 2), axis=0))
    return np.concatenate(found)


def _levels(tables: NDArray[np.float32]) -> tuple[NDArray[np.float32], ...]:
    """Tables of ranges and unions and ever coarser ones, for `table_cells.look_up`."""
    found = [with_unions(tables)]
    for _ in range(LEVELS - 1):
        found.append(np.array([coarser(one) for one in found[-1]]))
    return tuple(found)
