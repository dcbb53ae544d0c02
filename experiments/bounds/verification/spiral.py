"""Cells of the plane of the state ``z``, in which free motion shifts whole cells; see `tables`.

Write ``λ z = |λ| e^(ρ + iφ)`` with ``0 ≤ φ < 2π``, so that ``e^ρ = |z|`` and the slope ``Im(λ z)`` has the sign of
``sin φ``. In free motion ``z' = λ z`` the angle grows at the rate ``ω`` and ``u = ρ + (σ/ω) φ`` stays the same; where a
turn is completed, ``φ`` falls by ``2π`` and ``u`` by ``2π σ/ω``. Rows are ranges of ``u`` of equal width, from the
greatest one downwards, a whole number of rows per turn; columns are ranges of ``φ``, an even number per turn: the lines
of zero slope, ``φ = 0`` and ``φ = π``, are borders of cells, and every cell has one sign of the slope. States below the
last row lie in a disc around 0, the *core*.

Coarser levels hold the least value of 2 × 2 cells of the level before.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inkjet_env.experiments.bounds.verification.compiling import inner

SLACK = 1e-9
"""By how much an index, an angle or a relative size is widened for the rounding errors."""


class Grid(NamedTuple):
    """Cells of the plane.

    Attributes
    ----------
    angles : int
        Columns per turn.
    per_turn : int
        Rows by which a turn of free motion shifts.
    rows : int
        Number of rows; 0 if there are no tables.
    levels : int
        Number of levels.
    top : float
        Greatest ``u``, in the logarithm of V.
    height, width : float
        Ranges of ``u`` and of ``φ`` of a cell.
    slant : float
        ``σ/ω``.
    turned : float
        Angle of ``λ``.
    crest : float
        An extremum of free motion is this times ``|z|`` at its time, ``ω/|λ|``.
    core : float
        Radius of the core in V.
    """

    angles: int
    per_turn: int
    rows: int
    levels: int
    top: float
    height: float
    width: float
    slant: float
    turned: float
    crest: float
    core: float


def grid_of(sigma: float, omega: float, most_V: float, angles: int, height: float, core_V: float) -> Grid:
    """The cells for states of a modulus up to ``most_V``.

    Parameters
    ----------
    sigma, omega : float
        Decay and angular frequency of free motion, in 1/µs.
    most_V : float
        Bound of ``|z|`` in V.
    angles : int
        Columns per turn, a multiple of 16.
    height : float
        About the range of ``u`` of a row.
    core_V : float
        About the radius of the core in V.
    """
    slant = sigma / omega
    per_turn = max(1, round(2 * math.pi * slant / height))
    height = 2 * math.pi * slant / per_turn
    top = math.log(max(most_V, core_V) * (1 + 1e-6)) + 2 * math.pi * slant
    rows = max(16, math.ceil((top - math.log(core_V)) / height))
    levels = 1
    while angles >> (levels - 1) > 4 and (angles >> (levels - 1)) % 4 == 0:
        levels += 1
    turned = math.atan2(omega, -sigma)
    crest = omega / math.hypot(sigma, omega)
    core = math.exp(top - rows * height) * (1 + SLACK)
    return Grid(angles, per_turn, rows, levels, top, height, 2 * math.pi / angles, slant, turned, crest, core)


def no_grid() -> Grid:
    """What stands for the cells where there are no tables."""
    return Grid(16, 1, 0, 1, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0)


def level_offsets(grid: Grid, ranges: int) -> NDArray[np.int64]:
    """Where in a table each level begins, and the length of the table."""
    sizes = [ranges * -(-grid.rows // (1 << level)) * (grid.angles >> level) for level in range(grid.levels)]
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)


@inner
def block_middle(grid, row, col, rows, cols):
    """Middle of a block of cells, as a state in V."""
    angle = (col + 0.5 * cols) * grid.width
    log = grid.top - (row + 0.5 * rows) * grid.height - grid.slant * angle
    return np.exp(complex(log, angle - grid.turned))


@inner
def block_reach(grid, rows, cols):
    """Radius of a disc around the middle of a block that holds it, relative to the middle's modulus.

    The logarithm of ``z`` differs by at most ``h`` from that of the middle, and ``|e^w − 1| ≤ e^|w| − 1``.
    """
    up = 0.5 * (rows * grid.height + grid.slant * cols * grid.width)
    return (math.exp(math.hypot(up, 0.5 * cols * grid.width)) - 1.0) * (1.0 + SLACK)


@inner
def rounded_down(value):
    """A value of a table that single precision does not round up; it also allows for the rounding errors before."""
    if math.isinf(value):
        return np.float32(value)
    return np.float32(value - 1e-6 * abs(value) - 1e-6)


@njit(nogil=True)
def fill_levels(grid, offsets, ranges, which, table, kind):
    """Least values of the coarser levels for one range of ``b``, for one kind of value of a table."""
    for level in range(1, grid.levels):
        rows, cols = -(-grid.rows // (1 << level)), grid.angles >> level
        below_rows, below_cols = -(-grid.rows // (1 << (level - 1))), grid.angles >> (level - 1)
        here = offsets[level] + which * rows * cols
        below = offsets[level - 1] + which * below_rows * below_cols
        for row in range(rows):
            for col in range(cols):
                least = np.float32(np.inf)
                for r in range(2 * row, min(2 * row + 2, below_rows)):
                    for c in range(2 * col, 2 * col + 2):
                        least = min(least, table[below + r * below_cols + c, kind])
                table[here + row * cols + col, kind] = least
