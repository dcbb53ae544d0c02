"""The tree of boxes: which side is halved, and the walk through it with a lower bound at every box."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.box_bound import WHOLE, WINDOW_COLUMNS, prefix_bound, whole_bound
from inkjet_env.experiments.bounds.head_numbers import GAIN, OMEGA, SIGMA
from inkjet_env.experiments.bounds.table_cells import CELL_COLUMNS
from inkjet_env.experiments.bounds.trajectory import NODE_COLUMNS, PARAMETERS
from inkjet_env.typing import Real

PROVEN = 7
"""Symbol of a box whose bound is good enough; smaller ones are numbers of sides."""
PROVED, FULL, STUCK, STOPPED = range(4)
"""How a walk ends."""
DWELL = 3
"""Segments that are followed of a box: those up to the dwell before the last edge, one more, or `WHOLE`."""


def influences(head: Real, lower: Real, upper: Real) -> Real:
    """By how many volts the response can change at most with a unit of each side of a box, shape (7,)."""
    pole = math.hypot(head[SIGMA], head[OMEGA])
    volts = head[GAIN] * np.array([upper[0], upper[0] + upper[1], upper[1]])
    up, down, back = pole * volts
    per_volt = head[GAIN]
    return np.array([2 * per_volt, 3 * per_volt, up, up + down / 2, up + down / 2, up + down, back])


@njit(cache=True)
def halved_side(influence, followed, thresholds, low, high):
    """Which side of a box is halved, and what is followed of it from now on: its side is −1 while that must change."""
    count = 2 + followed
    best, side = -1.0, 0
    for k in range(count):
        weight = influence[k] * 0.5 * (high[k] - low[k])
        if weight > best:
            best, side = weight, k
    if followed < WHOLE and best <= thresholds[followed - DWELL]:
        return -1
    return side


@njit(cache=True)
def box_bound(
    head, weights, ring, limits, target, followed, low, high, steps, dwell, edge, inner_dwell, inner_edge, low_b,
    high_b, grid, finest, nodes, end, reach, to_go, windows, cells,
):  # fmt: skip
    """Lower bound of a box, in volts."""
    if followed == WHOLE:
        return whole_bound(head, weights, ring, limits, target, low, high, steps, nodes, end, reach, to_go, windows)
    if followed == DWELL:
        return prefix_bound(
            head, weights, limits, target, followed, low, high, steps, dwell, inner_dwell, low_b, high_b, grid, finest,
            nodes, end, reach, to_go, windows, cells,
        )  # fmt: skip
    return prefix_bound(
        head, weights, limits, target, followed, low, high, steps, edge, inner_edge, low_b, high_b, grid, finest, nodes,
        end, reach, to_go, windows, cells,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def prove(
    head, weights, ring, limits, target, influence, thresholds, lower, upper, steps, dwell, edge, inner_dwell,
    inner_edge, low_b, high_b, grid, finest, deepest, symbols, counts, stop,
):  # fmt: skip
    """Halve a box until every part has a lower bound of ``target`` volts at least.

    Parameters
    ----------
    thresholds : tuple of two floats
        Largest influence of a side in volts, below which more of the waveform is followed.
    deepest : int
        Largest number of times that a box is halved.
    symbols : ndarray of uint8, shape (n,)
        Filled with the boxes, each before its lower and its upper half: the side that was halved, or `PROVEN`.
    counts : ndarray, shape (4,)
        Numbers of bounds that were computed, by what is followed, and the number of symbols.
    stop : ndarray, shape (1,)
        The walk ends when this is not zero.

    Returns
    -------
    int
        `PROVED`; `FULL` if ``symbols`` is too short; `STUCK` if a box was halved as often as allowed, ``lower`` and
        ``upper`` are then its; `STOPPED`.
    """
    nodes, end, reach = np.zeros((20000, NODE_COLUMNS)), np.zeros(1 + PARAMETERS, np.complex128), np.zeros(2)
    to_go, windows = np.zeros(3), np.zeros((80, WINDOW_COLUMNS))
    cells = np.zeros((20000, CELL_COLUMNS))
    lows, highs = np.empty((deepest + 2, PARAMETERS)), np.empty((deepest + 2, PARAMETERS))
    depths, starts = np.zeros(deepest + 2, np.int64), np.zeros(deepest + 2, np.int64)
    lows[0], highs[0], starts[0] = lower, upper, DWELL
    waiting = 1
    written = 0
    while waiting > 0:
        if stop[0] != 0:
            return STOPPED
        waiting -= 1
        low, high = lows[waiting].copy(), highs[waiting].copy()
        depth, followed = depths[waiting], starts[waiting]
        while True:
            counts[followed - DWELL] += 1
            found = box_bound(
                head, weights, ring, limits, target, followed, low, high, steps, dwell, edge, inner_dwell, inner_edge,
                low_b, high_b, grid, finest, nodes, end, reach, to_go, windows, cells,
            )  # fmt: skip
            side = 0
            if found >= target:
                break
            side = halved_side(influence, followed, thresholds, low, high)
            if side >= 0:
                break
            followed += 1
        if written == symbols.size:
            return FULL
        symbols[written] = PROVEN if found >= target else side
        written += 1
        counts[3] = written
        if found >= target:
            continue
        if depth == deepest:
            lower[:], upper[:] = low, high
            return STUCK
        middle = 0.5 * (low[side] + high[side])
        for half in range(1, -1, -1):  # the lower half is taken first
            lows[waiting], highs[waiting] = low, high
            if half == 0:
                highs[waiting, side] = middle
            else:
                lows[waiting, side] = middle
            depths[waiting], starts[waiting] = depth + 1, followed
            waiting += 1
    return PROVED
