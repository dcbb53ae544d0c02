"""Where extrema can be, and what they cost at least: one pass backwards in time over the nodes of a trajectory.

A window is a stretch of time outside which the slope has a sign for every waveform of the box. Between windows with
slopes of different signs on either side there is an odd number of extrema, otherwise an even one; where the slope is
not known on one side, any number. The cost to go has three values: before the effective extremum, just after it, and
after the one that follows. It counts only courses whose extrema are nowhere higher than ``most`` and whose effective
one can be as high as ``least``, so that the effective one is the largest."""

from __future__ import annotations

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.trajectory import (
    CELL,
    SLOPE,
    SLOPE_CHANGE,
    SLOPE_RADIUS,
    Y_RADIUS,
    Y,
)

NEVER = 1e300
"""Cost of what no course does."""
RISING, FALLING = np.int64(1), np.int64(-1)
"""Signs of a slope; numbers of numpy, so that `pass_nodes` is compiled once."""
EVEN, ODD, ANY = 0, 1, 3
"""What is known of the number of extrema in a window."""
(FIRST, LAST, KIND, REFERENCE, SPREAD, SINGLE, RISES_BEFORE) = range(7)
"""Columns of a window: its nodes; what is known; the node of least slope; how far the response of any waveform within
the window is from that at this node, in volts; whether it holds one extremum for certain; sign of the slope before."""
WINDOW_COLUMNS = 7


@njit(cache=True)
def pass_window(weights, kind, low, high, least, most, to_go):
    """Take the cost to go, shape (3,), in volts, from after a window to before it.

    Parameters
    ----------
    weights : tuple of two floats
        Weights A ≤ 0 of the effective extremum and B ≥ 1 of the next.
    kind : int
        `EVEN`, `ODD` or `ANY`.
    low, high : float
        Limits of the magnitudes of extrema in the window, in volts.
    least, most : float
        Limits of the largest magnitude of all, in volts.
    """
    A, B = weights
    before, just, after = to_go[0], to_go[1], to_go[2]
    effective = high >= least
    top = min(high, most)
    if kind == ODD:
        if low > most:
            to_go[:] = NEVER
            return
        to_go[0] = low + before
        if effective:
            to_go[0] = min(to_go[0], min(A * top + just, A * top + B * low + low + after))
        to_go[1] = B * low + after
        to_go[2] = low + after
        return
    if low > most:
        return
    one = low if kind == EVEN else 0.0
    if effective:
        to_go[0] = min(before, min(A * top + one + just, A * top + B * low + after))
    to_go[1] = min(just, B * low + one + after)


@njit(cache=True)
def sure(earlier, later):
    """Whether the slope keeps its sign over the cell between two nodes."""
    left, right = abs(earlier[SLOPE]) - earlier[SLOPE_RADIUS], abs(later[SLOPE]) - later[SLOPE_RADIUS]
    same = earlier[SLOPE] * later[SLOPE] > 0.0
    return same and left > 0.0 and right > 0.0 and left + right > later[SLOPE_CHANGE]


@njit(cache=True)
def sign_of(node):
    """Sign of the slope at a node; 0 if it is not the same for every waveform of the box."""
    if abs(node[SLOPE]) <= node[SLOPE_RADIUS]:
        return 0
    return 1 if node[SLOPE] > 0.0 else -1


@njit(cache=True)
def pass_nodes(weights, nodes, last, slope_before, slope_after, least, most, to_go):
    """Take the cost to go from after the last node to before the first.

    ``slope_before`` and ``slope_after`` are signs of the slope at the first and the last node, 0 if unknown.
    """
    inside = sign_of(nodes[last]) == 0
    low, high, slack = NEVER, 0.0, 0.0
    if inside:
        low, high, slack = widened(nodes[last], low, high, slack)
    for k in range(last - 1, -1, -1):
        node, later = nodes[k], nodes[k + 1]
        if sure(node, later):
            sign = 1 if node[SLOPE] > 0.0 else -1
            if inside:
                _pass(weights, sign, slope_after, low, high, slack, least, most, to_go)
                inside = False
            slope_after = sign
            continue
        if not inside:
            inside = True
            low, high, slack = widened(later, NEVER, 0.0, 0.0)
        low, high, slack = widened(node, low, high, slack)
        if node[Y] * later[Y] < 0.0:
            low = 0.0
    if inside:
        _pass(weights, slope_before, slope_after, low, high, slack, least, most, to_go)


@njit(cache=True)
def pass_all(weights, nodes, last, slope_before, least, most, to_go):
    """As `pass_nodes`, whatever the sign of the slope at the last node may be."""
    sign = sign_of(nodes[last])
    if sign != 0:
        pass_nodes(weights, nodes, last, slope_before, sign, least, most, to_go)
        return
    before, just, after = to_go[0], to_go[1], to_go[2]
    pass_nodes(weights, nodes, last, slope_before, RISING, least, most, to_go)
    rising_before, rising_just, rising_after = to_go[0], to_go[1], to_go[2]
    to_go[0], to_go[1], to_go[2] = before, just, after
    pass_nodes(weights, nodes, last, slope_before, FALLING, least, most, to_go)
    to_go[0], to_go[1] = min(to_go[0], rising_before), min(to_go[1], rising_just)
    to_go[2] = min(to_go[2], rising_after)


@njit(cache=True)
def widened(node, low, high, slack):
    """Limits of the magnitude in a window that is widened by a node; slack: by how much it can be exceeded between."""
    magnitude = abs(node[Y])
    return (
        min(low, magnitude - node[Y_RADIUS]),
        max(high, magnitude + node[Y_RADIUS]),
        max(slack, node[SLOPE_CHANGE] * node[CELL] / 8.0),
    )


@njit(cache=True)
def _pass(weights, sign, slope_after, low, high, slack, least, most, to_go):
    kind = ANY if sign == 0 or slope_after == 0 else (EVEN if sign == slope_after else ODD)
    pass_window(weights, kind, max(0.0, low - slack), high + slack, least, most, to_go)
