"""Values of the tables for one range of ``b``; see `tables`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.verification.compiling import inner
from inkjet_env.experiments.bounds.verification.enclosing import A_WEIGHT, B_WEIGHT
from inkjet_env.experiments.bounds.verification.kernels import COARSEST
from inkjet_env.experiments.bounds.verification.last_edge import (
    OVER,
    PASSED,
    TO_COME,
    least_over_pieces,
)
from inkjet_env.experiments.bounds.verification.spiral import (
    SLACK,
    block_middle,
    block_reach,
    rounded_down,
)

BLOCK_V = (4.0, 2.0, 1.0)
"""Below each of these moduli, in V, the blocks of cells that share their values have twice as many rows and columns."""
LARGE_V = 12.0
"""Above this modulus, in V, blocks of 2 × 2 cells share their values: such states cost much."""


@inner
def block_size(grid, row):
    """Rows and columns of the blocks in a row that share their values, a power of 2."""
    modulus = math.exp(grid.top - row * grid.height - grid.slant * math.pi)
    size = 1
    for bound in BLOCK_V:
        if modulus < bound:
            size *= 2
    if modulus > LARGE_V:
        size = 2
    while row % size != 0:
        size //= 2
    return size


@njit(nogil=True)
def fill_edge(grid, which, levels, to_come, least, most, k, nodes, at, ends, table, core, stop):
    """Fill one range of ``b`` of the table of the last edge.

    Parameters
    ----------
    grid : Grid
        The cells.
    which : int
        Number of the range of ``b``.
    levels : int
        Levels of pieces of the range of ``t5``.
    to_come : bool
        Whether the table is of the kind *to come* alone, or of the other two.
    least, most : float
        Range of the largest ``|extremum|`` in V, for the kind *to come*.
    nodes, at, ends : arrays
        Kernels for the range of ``b``, see `kernels.kernels`.
    table, core : float32 arrays of shapes (cells, kinds) and (ranges, kinds)
        Receive the values of the cells and of the core.
    stop : array of shape (1,)
        The work ends early as soon as this is not 0.
    """
    first = which * grid.rows * grid.angles
    windows = np.empty((at.shape[1] + 2, 5))
    stack = np.empty((4 * COARSEST + 2 * levels, 2), np.int64)
    values = np.empty((4 * COARSEST + 2 * levels, 3))
    v0, v1, v2 = least_over_pieces(
        complex(0.0, 0.0),
        grid.core,
        np.int64(0),
        least,
        most,
        to_come,
        levels,
        k,
        nodes,
        at,
        ends,
        windows,
        stack,
        values,
    )
    if to_come:
        core[which, 0] = rounded_down(v0)
    else:
        core[which, 0], core[which, 1] = rounded_down(v1), rounded_down(v2)
    row = np.int64(0)
    while row < grid.rows:
        size = block_size(grid, row)
        if stop[0] != 0:
            return
        below = min(row + size, grid.rows)
        for col in range(0, grid.angles, size):
            middle = block_middle(grid, row, col, size, size)
            radius = abs(middle) * block_reach(grid, size, size)
            sign = 1 if 2 * col < grid.angles else -1
            v0, v1, v2 = least_over_pieces(
                middle, radius, sign, least, most, to_come, levels, k, nodes, at, ends, windows, stack, values
            )
            for r in range(row, below):
                for c in range(col, col + size):
                    i = first + r * grid.angles + c
                    if to_come:
                        table[i, 0] = rounded_down(v0)
                    else:
                        table[i, 0], table[i, 1] = rounded_down(v1), rounded_down(v2)
        row += size


@inner
def running_minima(grid, first, table, kind, from_left, from_right):
    """Least values from the left and from the right end of each half turn, for each row."""
    half = grid.angles // 2
    for row in range(grid.rows):
        for begin in range(0, grid.angles, half):
            least = np.float32(np.inf)
            for c in range(begin, begin + half):
                least = min(least, table[first + row * grid.angles + c, kind])
                from_left[row, c] = least
            least = np.float32(np.inf)
            for c in range(begin + half - 1, begin - 1, -1):
                least = min(least, table[first + row * grid.angles + c, kind])
                from_right[row, c] = least


@inner
def least_between(grid, first, table, kind, core, from_left, from_right, row, low, high):
    """Least value of one kind on arrival in a row, between two columns of the same half turn, counted on over turns."""
    half = grid.angles // 2
    row += grid.per_turn * (low // grid.angles)
    if row >= grid.rows:
        return core
    begin = (low // half) * half
    turned = (low // grid.angles) * grid.angles
    if low == begin:
        return from_left[row, high - turned]
    if high == begin + half - 1:
        return from_right[row, low - turned]
    least = np.float32(np.inf)
    for c in range(low - turned, high - turned + 1):
        least = min(least, table[first + row * grid.angles + c, kind])
    return least


@njit(nogil=True)
def fill_dwell(grid, which, low_us, high_us, omega, to_come, least, most, k, own, own_core, base, base_core,
               table, core):  # fmt: skip
    """Fill one range of ``b`` of the table of the dwell before the last edge from that of the last edge.

    Free motion over ``t4`` carries a cell along its row; each line of zero slope on the way is one extremum.

    Parameters
    ----------
    low_us, high_us : float
        Range of ``t4``.
    own, own_core, base, base_core : float32 arrays
        Table of the last edge: the kind *to come*, and the other two.
    table, core : float32 arrays
        Receive the values.
    """
    zero = np.int64(0)
    half = grid.angles // 2
    first = which * grid.rows * grid.angles
    shift_low = math.floor(omega * low_us / grid.width - SLACK)
    shift_high = 1 + math.floor(omega * high_us / grid.width + SLACK)
    left = np.empty((3, grid.rows, grid.angles), np.float32)
    right = np.empty((3, grid.rows, grid.angles), np.float32)
    running_minima(grid, first, base, zero, left[PASSED], right[PASSED])
    running_minima(grid, first, base, zero + 1, left[OVER], right[OVER])
    if to_come:
        running_minima(grid, first, own, zero, left[TO_COME], right[TO_COME])
    core1, core2 = base_core[which, 0], base_core[which, 1]
    core0 = own_core[which, 0] if to_come else np.float32(np.inf)
    # in the core any number of extrema may pass
    passed = min(core1, core2)
    if to_come:
        v0 = float(core0)
        if grid.core >= least:
            v0 = min(v0, k[A_WEIGHT] * min(grid.core, most) + passed)
        core[which, 0] = rounded_down(v0)
    else:
        core[which, 0], core[which, 1] = passed, core2
    for row in range(grid.rows):
        up = grid.top - row * grid.height
        for col in range(grid.angles):
            best0, best1, best2 = math.inf, math.inf, math.inf
            last_half = (col + shift_high) // half
            first_half = (col + shift_low) // half
            for place in range(first_half, last_half + 1):
                low = max(col + shift_low, place * half)
                high = min(col + shift_high, place * half + half - 1)
                v1 = float(least_between(grid, first, base, zero, core1, left[PASSED], right[PASSED], row, low, high))
                v2 = float(least_between(grid, first, base, zero + 1, core2, left[OVER], right[OVER], row, low, high))
                v0 = math.inf
                if to_come:
                    v0 = float(
                        least_between(grid, first, own, zero, core0, left[TO_COME], right[TO_COME], row, low, high)
                    )
                for line in range(place, col // half, -1):
                    most_y = grid.crest * math.exp(up - grid.slant * math.pi * line) * (1.0 + SLACK)
                    least_y = most_y * math.exp(-grid.height) * (1.0 - 3.0 * SLACK)
                    v0 = math.inf if least_y > most else v0 + least_y
                    if most_y >= least and least_y <= most:
                        v0 = min(v0, k[A_WEIGHT] * min(most_y, most) + v1)
                    v1 = k[B_WEIGHT] * least_y + v2
                    v2 = least_y + v2
                best0, best1, best2 = min(best0, v0), min(best1, v1), min(best2, v2)
            i = first + row * grid.angles + col
            if to_come:
                table[i, 0] = rounded_down(best0)
            else:
                table[i, 0], table[i, 1] = rounded_down(best1), rounded_down(best2)
