"""Check of one leaf: every waveform of its box costs at least the bound, where necessary after the box is halved.

Where ``t5``, or ``t4`` and ``t5``, are wide, the box is followed up to a table of the cost to go, which holds for all
of them, see `arriving`. Does that not show the claim, the other sides are halved, and where they are narrow the
duration that the table stood for. A box without wide sides is bound on its own, see `courses`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.verification.arriving import CELLS_MOST, arriving_cost
from inkjet_env.experiments.bounds.verification.compiling import inner
from inkjet_env.experiments.bounds.verification.courses import SIDES, least_cost
from inkjet_env.experiments.bounds.verification.enclosing import NODES_MOST, WINDOWS_MOST

VOLT_US = 0.03
"""A width in V counts like this many µs when a box is halved."""
COARSE_US = 1.3
"""A box with a half width above this, in µs, is halved without a try; on the last edge, see `COARSE_LAST_US`."""
COARSE_LAST_US = 2.6
"""The same for the last edge, after which no corner moves."""
FINE_DWELL_US = 0.02
"""Where no half width before a free ``t4`` is above this, in µs, ``t4`` is halved."""
FINE_EDGE_US = 0.02
"""Where no half width before a free ``t5`` is above this, in µs, ``t5`` is halved."""
NARROW_US = 0.2
"""Where no half width is above this, in µs, a box is halved along the side that changes the extrema most."""
T4, T5 = 5, 6
# up to where a box is followed: to the table of the dwell, to that of the last edge, to the end
TO_DWELL, TO_EDGE, TO_END = range(3)


@inner
def most_effective(windows, where, dz, radius):
    """The side that changes the extrema most, to first order; −1 if none does."""
    most, side = 0.0, -1
    for j in range(SIDES):
        change = 0.0
        for i in range(windows):
            change += abs(dz[where[i], j].imag) * radius[j]
        if change > most:
            most, side = change, j
    return side


@njit(nogil=True, inline="always")
def check_leaf(
    lower, upper, least, most, bound, k, law, sup1, sup2, tables, deepest, boxes_most, stop, failed, work, tried
):  # fmt: skip
    """Show that every waveform of a box costs at least ``bound``, where necessary by halving it.

    Parameters
    ----------
    lower, upper : array of shape (7,)
        Ends of the box in V and µs.
    least, most : float
        Range of the largest ``|extremum|`` of the waveforms that the claim is about, in V.
    bound : float
        Claimed bound in V.
    k, law, sup1, sup2
        The problem, see `checking.Problem`.
    tables : Tables
        Tables for this range of the largest ``|extremum|``.
    deepest, boxes_most : int
        Most halvings one within another, and most boxes in all.
    stop : array of shape (1,)
        The work ends early as soon as this is not 0.
    failed : array of shape (2, 7)
        Receives the box that could not be shown.
    work : tuple of arrays
        See `working_memory`.
    tried : array of shape (3,)
        Counts the bounds that are computed: up to the dwell, up to the last edge, and up to the end.

    Returns
    -------
    int
        Number of further halvings; −1 if the claim could not be shown; −2 if it was stopped.
    """
    (
        z, dz, rest, seconds, cell, kind, low, high, where, err, short, weight, lows, highs, depths, centre, radius,
        ways, cells, found,
    ) = work  # fmt: skip
    for j in range(SIDES):
        lows[0, j], highs[0, j] = lower[j], upper[j]
    depths[0] = 0
    ways[0] = TO_DWELL if tables.grid.rows > 0 else TO_END
    top = 0
    boxes = 0
    while top >= 0:
        if stop[0] != 0:
            return -2
        boxes += 1
        for j in range(SIDES):
            centre[j] = 0.5 * (lows[top, j] + highs[top, j])
            radius[j] = max(highs[top, j] - centre[j], centre[j] - lows[top, j]) * (1.0 + 1e-14)
        way = ways[top]
        if way < TO_END and radius[T5] <= COARSE_LAST_US:
            way = TO_END
        if way == TO_DWELL and radius[T4] <= COARSE_US:
            way = TO_EDGE
        sides = T4 if way == TO_DWELL else (T5 if way == TO_EDGE else SIDES)
        widest, side = -1.0, 0
        coarse = False
        for j in range(sides):
            scaled = radius[j] * (VOLT_US if j < 2 else 1.0)
            coarse = coarse or scaled > (COARSE_LAST_US if j == T5 else COARSE_US)
            if scaled > widest:
                widest, side = scaled, j
        if not coarse:
            tried[way] += 1
            if way == TO_END:
                value, windows = least_cost(
                    centre, radius, least, most, k, law, sup1, sup2,
                    z, dz, rest, seconds, cell, kind, low, high, where, err, short, weight,
                )  # fmt: skip
            else:
                value = arriving_cost(
                    way == TO_DWELL, centre, radius, least, most, k, law, sup1, sup2, tables,
                    z, dz, rest, seconds, cell, kind, low, high, where, err, short, weight, cells, found,
                )  # fmt: skip
            if value >= bound:
                top -= 1
                continue
            if way == TO_DWELL and widest <= FINE_DWELL_US:
                way, widest, side = TO_EDGE, radius[T4], T4
            elif way == TO_EDGE and widest <= FINE_EDGE_US:
                way, widest, side = TO_END, radius[T5], T5
            elif way == TO_END and widest <= NARROW_US:
                effective = most_effective(windows, where, dz, radius)
                side = effective if effective >= 0 else side
        if depths[top] >= deepest or boxes > boxes_most or widest <= 0.0:
            for j in range(SIDES):
                failed[0, j], failed[1, j] = lows[top, j], highs[top, j]
            return -1
        depth = depths[top] + 1
        for j in range(SIDES):
            lows[top + 1, j], highs[top + 1, j] = lows[top, j], highs[top, j]
        highs[top + 1, side] = centre[side]
        lows[top, side] = centre[side]
        depths[top] = depth
        depths[top + 1] = depth
        ways[top] = way
        ways[top + 1] = way
        top += 1
    return (boxes - 1) // 2


def working_memory(deepest: int) -> tuple[Any, ...]:
    """Arrays in which one thread works on leaves that are halved at most ``deepest`` times."""
    nodes = NODES_MOST + 1
    return (
        np.empty(nodes, np.complex128),
        np.empty((nodes, SIDES), np.complex128),
        np.empty(nodes),
        np.empty((nodes, 3)),
        np.empty(nodes, np.int64),
        np.empty(WINDOWS_MOST, np.int64),
        np.empty(WINDOWS_MOST),
        np.empty(WINDOWS_MOST),
        np.empty(WINDOWS_MOST, np.int64),
        np.empty(WINDOWS_MOST + 1),
        np.empty(WINDOWS_MOST),
        np.empty(WINDOWS_MOST),
        np.empty((deepest + 2, SIDES)),
        np.empty((deepest + 2, SIDES)),
        np.empty(deepest + 2, np.int64),
        np.empty(SIDES),
        np.empty(SIDES),
        np.empty(deepest + 2, np.int64),
        np.empty((CELLS_MOST, 8)),
        np.empty((3, 5)),
    )
