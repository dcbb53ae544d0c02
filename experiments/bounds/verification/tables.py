"""Tables of the cost to go at the start of the second dwell and of the last edge, for all ``t4`` and ``t5``.

All that matters of the past there is the state ``z`` and ``b``. A table holds for ranges of ``b`` and cells of ``z``,
see `spiral`, a bound from below of what the extrema from there on weigh, of three kinds, see `last_edge`. A value holds
for every state of its cell, every ``b`` of its range and every duration of the problem. The sign of the slope at the
moment at which the past ends is part of the cell, so that no extremum is counted twice or left out there.

The kinds *passed* and *over* are the same for all ranges of the largest ``|extremum|``; *to come* is filled for each.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inkjet_env.experiments.bounds.verification.enclosing import OMEGA, SIGMA
from inkjet_env.experiments.bounds.verification.filling import fill_dwell, fill_edge
from inkjet_env.experiments.bounds.verification.kernels import kernels
from inkjet_env.experiments.bounds.verification.spiral import (
    SLACK,
    Grid,
    fill_levels,
    grid_of,
    level_offsets,
    no_grid,
)

RANGES_MOST = 200
"""About the most ranges of ``b``."""
CELLS_MOST = 60_000_000
"""Most cells of a table, in all ranges of ``b`` and levels."""
Single = NDArray[np.float32]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Resolution:
    """How fine the tables are.

    Attributes
    ----------
    angles : int
        Columns per turn, a multiple of 16.
    height : float
        About by which ratio less 1 the moduli of a row of cells differ.
    core_V : float
        About the radius of the disc around 0 that is one cell, in V.
    step_V : float
        Range of ``b`` above 60 % of its greatest value, in V; twice that above 40 %, four times below.
    levels : int
        Levels of pieces of the range of ``t5``: 8, 16, 32 … pieces.
    """

    angles: int = 384
    height: float = 0.0123
    core_V: float = 0.03
    step_V: float = 1.0
    levels: int = 6


class Tables(NamedTuple):
    """Tables as the compiled functions take them.

    Attributes
    ----------
    grid : Grid
        Cells; without rows if there are no tables.
    offsets : array
        Where each level begins.
    ends : array
        Ends of the ranges of ``b`` in V.
    edge, edge_core, dwell, dwell_core : float32 arrays of shapes (cells, 2) and (ranges, 2)
        Kinds *passed* and *over* at the start of the last edge and of the dwell before it, and for the core.
    own_edge, own_edge_core, own_dwell, own_dwell_core : float32 arrays of shapes (cells, 1) and (ranges, 1)
        Kind *to come*.
    """

    grid: Grid
    offsets: NDArray[np.int64]
    ends: Array
    edge: Single
    edge_core: Single
    dwell: Single
    dwell_core: Single
    own_edge: Single
    own_edge_core: Single
    own_dwell: Single
    own_dwell_core: Single


def no_tables() -> Tables:
    """What stands for the tables where they are not used."""
    return _empty(no_grid(), np.zeros(2, np.int64), np.zeros(2))


def _empty(grid: Grid, offsets: NDArray[np.int64], ends: Array) -> Tables:
    cells, ranges = int(offsets[-1]), ends.size - 1

    def unknown(number: int, kinds: int) -> Single:
        return np.full((number, kinds), -np.inf, np.float32)

    base = unknown(cells, 2), unknown(ranges, 2), unknown(cells, 2), unknown(ranges, 2)
    own = unknown(0, 1), unknown(0, 1), unknown(0, 1), unknown(0, 1)
    return Tables(grid, offsets, ends, *base, *own)


def ranges_of_b(low_V: float, high_V: float, step_V: float) -> Array:
    """Ends of the ranges of ``b``, narrower where it is great."""
    step_V = max(step_V, high_V / RANGES_MOST)
    ends = [high_V]
    while ends[-1] > low_V:
        share = ends[-1] / high_V
        ends.append(max(low_V, ends[-1] - step_V * (1 if share > 0.6 else 2 if share > 0.4 else 4)))
    if len(ends) == 1:
        ends.append(low_V)
    return np.array(ends[::-1])


class TableMaker:
    """Fills the tables of a problem.

    Parameters
    ----------
    k, law, sup1, sup2
        The problem in numbers, see `checking.Problem`.
    times : array of 4 floats
        Ranges of ``t4`` and ``t5`` in µs.
    levels : int
        Levels of pieces of the range of ``t5``.
    tables : Tables
        Tables to be filled.
    """

    def __init__(
        self, k: Array, law: Array, sup1: float, sup2: float, times: Array, levels: int, tables: Tables
    ) -> None:
        self._problem = (k, law, sup1, sup2, float(k[OMEGA]))
        self._times = times
        self._levels = levels
        self.tables = tables

    @property
    def ranges(self) -> int:
        """Number of ranges of ``b``."""
        return self.tables.ends.size - 1

    def fill_base(self, stop: NDArray[np.int64], pool: Executor) -> Iterator[Future[None]]:
        """Fill the kinds that all parts share; one piece of work per range of ``b``, which is handed to ``pool``."""
        t = self.tables
        for which in range(self.ranges):
            filled = (t.edge, t.edge_core, t.dwell, t.dwell_core)
            yield pool.submit(self._fill, which, False, np.inf, np.inf, filled, stop)

    def part_tables(self) -> Tables:
        """The tables with room for the kind *to come* of one part."""
        edge, edge_core, dwell, dwell_core = (
            np.full((len(array), 1), -np.inf, np.float32) for array in self.tables[3:7]
        )
        return self.tables._replace(own_edge=edge, own_edge_core=edge_core, own_dwell=dwell, own_dwell_core=dwell_core)

    def fill_part(
        self, own: Tables, least: float, most: float, stop: NDArray[np.int64], pool: Executor
    ) -> Iterator[Future[None]]:
        """Fill the kind *to come* for a range of the largest ``|extremum|`` in V, as `fill_base` does."""
        for which in range(self.ranges):
            filled = (own.own_edge, own.own_edge_core, own.own_dwell, own.own_dwell_core)
            yield pool.submit(self._fill, which, True, least, most, filled, stop)

    def _fill(
        self, which: int, to_come: bool, least: float, most: float, filled: tuple[Any, ...], stop: NDArray[np.int64]
    ) -> None:
        t = self.tables
        k, law, sup1, sup2, omega = self._problem
        edge, edge_core, dwell, dwell_core = filled
        b = 0.5 * (t.ends[which] + t.ends[which + 1])
        half_b = max(t.ends[which + 1] - b, b - t.ends[which]) * (1 + SLACK)
        dwell_us, edge_us = self._times[:2], self._times[2:]
        made = kernels(b, half_b, edge_us[0], edge_us[1], self._levels, k, law, sup1, sup2)
        if made is None:
            return
        of_all = (least, most, k)
        fill_edge(t.grid, which, self._levels, to_come, *of_all, *made, edge, edge_core, stop)
        fill_dwell(
            t.grid, which, dwell_us[0], dwell_us[1], omega, to_come, *of_all, edge, edge_core, t.edge, t.edge_core,
            dwell, dwell_core,
        )  # fmt: skip
        for table in (edge, dwell):
            for kind in range(table.shape[1]):
                fill_levels(t.grid, t.offsets, self.ranges, which, table, kind)


def table_maker(
    k: Array, law: Array, sup1: float, sup2: float, peak_V: float,
    lower: tuple[float, ...], upper: tuple[float, ...], resolution: Resolution,
) -> TableMaker | None:  # fmt: skip
    """What fills the tables of a problem; None if they would be larger than `CELLS_MOST`.

    Parameters
    ----------
    k, law, sup1, sup2, peak_V
        The problem in numbers, see `checking.Problem`.
    lower, upper : tuple of 7 floats
        Box of the problem in V and µs.
    resolution : Resolution
        How fine the tables are.
    """
    ends = ranges_of_b(lower[1], upper[1], resolution.step_V)
    grid = grid_of(float(k[SIGMA]), float(k[OMEGA]), peak_V, resolution.angles, resolution.height, resolution.core_V)
    offsets = level_offsets(grid, ends.size - 1)
    if offsets[-1] > CELLS_MOST:
        return None
    times = np.array([lower[5], upper[5], lower[6], upper[6]])
    return TableMaker(k, law, sup1, sup2, times, resolution.levels, _empty(grid, offsets, ends))
