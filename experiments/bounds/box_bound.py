"""Lower bounds of the cost of every waveform of a box.

`prefix_bound` follows the response for the first segments and looks up what the rest costs at least; it takes each
number at its worst, so its gap shrinks with the box. `whole_bound` follows all of it, and takes the extrema together
as linear functions of the waveform: their slopes cancel near a minimum, and its gap shrinks with the square."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.table_cells import DONE, JUST, LATER, gradient_of, look_up, tilted
from inkjet_env.experiments.bounds.trajectory import (
    BEND,
    BEND_BEFORE,
    BEND_BEFORE_RADIUS,
    BEND_CHANGE,
    BEND_RADIUS,
    CELL,
    GRADIENT,
    PARAMETERS,
    SECOND,
    SLOPE,
    SLOPE_CHANGE,
    SLOPE_RADIUS,
    Y_RADIUS,
    Y,
    follow,
)
from inkjet_env.experiments.bounds.windows import NEVER, pass_all, pass_nodes, sign_of, sure

NOTHING = -1e300
"""What is known where an array was too short or a table too small."""
ROUNDING = 1e-9
"""Volts that are taken off for rounding."""
(FIRST, LAST, REFERENCE, SPREAD, RISES_BEFORE, CERTAIN, SINGLE) = range(7)
"""Columns of a window: its nodes; that of least slope; how far the response of any waveform in the window is from that
at this node, in volts; sign of the slope before, 0 if unknown; whether there is an extremum for certain; one only."""
WINDOW_COLUMNS = 7
WHOLE, NONE = np.int64(5), np.int64(-1)
"""All segments of a waveform, and no window; numbers of numpy, as `table_cells.LATER`."""
PASSES = 4
"""Passes of the search for the best multipliers."""


@njit(cache=True)
def prefix_bound(
    head, weights, limits, target, segments, low, high, steps, levels, inners, low_b, high_b, grid, finest, nodes, end,
    reach, to_go, windows, cells,
):  # fmt: skip
    """Lower bound in volts, from the first 3 or 4 segments and tables for what follows.

    Parameters
    ----------
    head, weights, limits, grid
        As for `cost_to_go.edge_table`.
    target : float
        The bound is made no better than this, in volts.
    segments : int
        3: the tables are those of the dwell, 4: those of the last edge.
    low, high : ndarray, shape (7,)
        Ends of the box; what follows is that for which the tables were made.
    steps : tuple of two floats
        Shortest and longest distance of nodes, in µs.
    levels : tuple of arrays
        Tables for the ranges of U2 and their unions, stacked as by `tables.with_unions`.
    inners : ndarray, shape (ranges and unions, 3)
        Cost to go near 0.
    low_b, high_b : ndarray, shape (ranges,)
        The ranges of −U2 in volts, in order.
    finest : float
        Number of cells of a table across the disc of ``z``.
    nodes, end, reach, to_go, windows, cells : ndarray
        Scratch.
    """
    last = follow(head, segments, low, high, steps[0], steps[1], nodes, end, reach)
    if last < 0:
        return NOTHING
    # The ranges from a to b are looked up as few unions: one at an odd a or an even b is its own, the rest are pairs.
    a, b = np.int64(0), np.int64(low_b.size - 1)
    while a < b and high_b[a] <= low[1]:
        a += 1
    while a < b and low_b[b] >= high[1]:
        b -= 1
    count, start, size = np.int64(0), np.int64(0), np.int64(low_b.size)
    while a <= b:
        if a % 2 == 1:
            count = _add_cells(head, levels, inners, start + a, grid, end[0], reach[0], finest, cells, count)
            a += 1
        if b % 2 == 0 and a <= b:
            count = _add_cells(head, levels, inners, start + b, grid, end[0], reach[0], finest, cells, count)
            b -= 1
        if count < 0:
            return NOTHING
        a, b, start, size = a // 2, b // 2, start + size, (size + 1) // 2
    radius = 0.5 * (high - low)
    known = sign_of(nodes[last])
    found = NEVER
    for slope in range(-1, 2, 2):
        if known * slope >= 0:
            one = _prefix_bound(
                weights, limits, target, slope, radius, last, count, nodes, end, reach, to_go, windows, cells
            )
            found = min(found, one)
            if found < target:
                break
    return found


@njit(cache=True)
def _add_cells(head, levels, inners, k, grid, z, radius, finest, cells, count):
    """`look_up` in the table of one range or union; −1 stays −1."""
    if count < 0:
        return count
    some = (levels[0][k], levels[1][k], levels[2][k], levels[3][k], levels[4][k], levels[5][k])
    return look_up(head, some, inners[k], grid, z, radius, finest, cells, count)


@njit(cache=True)
def _prefix_bound(weights, limits, target, slope, radius, last, count, nodes, end, reach, to_go, windows, cells):
    """Lower bound for one sign of the slope where tables take over."""
    for mode in range(3):
        to_go[mode] = tilted(cells, count, mode, slope, end[0], 0j)
    later, just, done = to_go[0], to_go[1], to_go[2]
    pass_nodes(weights, nodes, last, sign_of(nodes[0]), slope, limits[0], limits[1], to_go)
    plain = to_go[0] - ROUNDING
    if plain >= target:
        return plain
    windowed = _find_windows(nodes, last, slope, radius, windows)
    if windowed < 0:
        return plain
    tilt = 0j if later >= NEVER else gradient_of(cells, count, LATER, slope, end[0])
    found = NEVER
    if later < NEVER:
        tail = (tilted(cells, count, LATER, slope, end[0], tilt), tilt)
        found = _together(weights, tail, 0.0, limits[1], NONE, NONE, windowed, windows, nodes, end, reach[1], radius)
    tilt = 0j if just >= NEVER else gradient_of(cells, count, JUST, slope, end[0])
    tail_just = (tilted(cells, count, JUST, slope, end[0], tilt), tilt)
    tilt = 0j if done >= NEVER else gradient_of(cells, count, DONE, slope, end[0])
    tail_done = (tilted(cells, count, DONE, slope, end[0], tilt), tilt)
    for effective in range(windowed):
        if not _can_be(nodes, windows[effective], limits[0]):
            continue
        following = effective + 1 if windows[effective, SINGLE] else effective
        while following <= windowed:
            tail = tail_done if following < windowed else tail_just
            if tail[0] < NEVER:
                value = _together(
                    weights, tail, 0.0, limits[1], effective, following, windowed, windows, nodes, end, reach[1], radius
                )  # fmt: skip
                found = min(found, value)
            if following > effective and following < windowed and windows[following, CERTAIN]:
                break
            following += 1
    return max(plain, found - ROUNDING)


@njit(cache=True)
def _can_be(nodes, window, least):
    """Whether an extremum of a window can be as high as ``least``, in volts."""
    at = nodes[int(window[REFERENCE])]
    return abs(at[Y]) + at[Y_RADIUS] + window[SPREAD] >= least


@njit(cache=True)
def whole_bound(head, weights, ring, limits, target, low, high, steps, nodes, end, reach, to_go, windows):
    """Lower bound in volts, from all five segments; `NEVER` if every waveform of the box exceeds the limits.

    Parameters
    ----------
    head, weights, limits, target, steps, nodes, end, reach, to_go, windows
        As for `prefix_bound`.
    ring : tuple of floats
        `cost_to_go.ring_down`.
    """
    least, most = limits
    last = follow(head, WHOLE, low, high, steps[0], steps[1], nodes, end, reach)
    if last < 0:
        return NOTHING
    # Each number at its worst.
    smallest = max(0.0, abs(end[0]) - reach[0])
    to_go[:] = NEVER
    if smallest * ring[2] <= most:
        if abs(end[0]) + reach[0] >= least:
            to_go[0] = ring[3] * (smallest * ring[2] if ring[3] >= 0.0 else abs(end[0]) + reach[0])
        to_go[1], to_go[2] = ring[1] * smallest, ring[0] * smallest
        pass_all(weights, nodes, last, sign_of(nodes[0]), least, most, to_go)
    if to_go[0] >= target:
        return to_go[0] - ROUNDING
    radius = 0.5 * (high - low)
    known = sign_of(nodes[last])
    found = 0.0 if ring[3] >= 0.0 else ring[3] * (abs(end[0]) + reach[0])
    for slope in range(-1, 2, 2):
        if known * slope < 0:
            continue
        count = _find_windows(nodes, last, slope, radius, windows)
        if count < 0:
            return to_go[0] - ROUNDING
        for effective in range(count):
            if not _can_be(nodes, windows[effective], least):
                continue
            following = effective + 1 if windows[effective, SINGLE] else effective
            while following <= count:
                factor = ring[0] if following < count else ring[1]
                value = _together(
                    weights, (0.0, 0j), factor, most, effective, following, count, windows, nodes, end, reach[1], radius
                )  # fmt: skip
                found = min(found, value)
                if following > effective and following < count and windows[following, CERTAIN]:
                    break
                following += 1
    return max(found, to_go[0]) - ROUNDING


@njit(cache=True)
def _find_windows(nodes, last, slope_after, radius, windows):
    """Fill the windows in time order; their number, or −1 if there are too many.

    ``slope_after`` is the sign of the slope at the last node.
    """
    count = 0
    inside = sign_of(nodes[0]) == 0
    before, start = sign_of(nodes[0]), 0
    for k in range(1, last + 1):
        if sure(nodes[k - 1], nodes[k]):
            sign = 1 if nodes[k, SLOPE] > 0.0 else -1
            if inside:
                if count == windows.shape[0]:
                    return -1
                windows[count, FIRST], windows[count, LAST], windows[count, RISES_BEFORE] = start, k - 1, before
                windows[count, CERTAIN] = 1.0 if before != 0 and before != sign else 0.0
                count += 1
                inside = False
            before = sign
        elif not inside:
            inside, start = True, k - 1
    if inside:
        if count == windows.shape[0]:
            return -1
        windows[count, FIRST], windows[count, LAST], windows[count, RISES_BEFORE] = start, last, before
        windows[count, CERTAIN] = 1.0 if before != 0 and before != slope_after else 0.0
        count += 1
    for number in range(count):
        _describe(nodes, radius, windows[number])
    return count


@njit(cache=True)
def _describe(nodes, radius, window):
    """Fill reference, spread and whether there is a single extremum."""
    first, last = int(window[FIRST]), int(window[LAST])
    reference = first
    for k in range(first, last + 1):
        if abs(nodes[k, SLOPE]) < abs(nodes[reference, SLOPE]):
            reference = k
    at = nodes[reference]
    spread = 0.0
    for k in range(first, last + 1):
        linear = nodes[k, SECOND] + at[SECOND]
        for j in range(PARAMETERS):
            linear += abs(nodes[k, GRADIENT + j] - at[GRADIENT + j]) * radius[j]
        away = abs(nodes[k, Y] - at[Y]) + min(linear, nodes[k, Y_RADIUS] + at[Y_RADIUS])
        between = 0.0
        if k > first:
            between = nodes[k, SLOPE_CHANGE] * nodes[k, CELL] / 8.0
        if k < last:
            between = max(between, nodes[k + 1, SLOPE_CHANGE] * nodes[k + 1, CELL] / 8.0)
        spread = max(spread, away + between)
    # The curvature keeps its sign, so that there is one extremum; its height follows from the slope at the reference.
    bend, sign = NEVER, 0
    for k in range(first + 1, last + 1):
        half = 0.5 * nodes[k, BEND_CHANGE]
        for now, off in (
            (nodes[k, BEND_BEFORE], nodes[k, BEND_BEFORE_RADIUS]),
            (nodes[k, BEND], nodes[k, BEND_RADIUS]),
        ):
            mine = 1 if now > 0.0 else -1
            if sign == 0:
                sign = mine
            if mine != sign:
                bend = -1.0
            bend = min(bend, abs(now) - off - half)
    window[SINGLE] = 1.0 if window[CERTAIN] and bend > 0.0 and sign != 0 else 0.0
    if window[SINGLE]:
        spread = min(spread, (abs(at[SLOPE]) + at[SLOPE_RADIUS]) ** 2 / (2.0 * bend))
    window[REFERENCE], window[SPREAD] = reference, spread


@njit(cache=True)
def _together(weights, tail, factor, most, effective, following, count, windows, nodes, end, second, radius):
    """Least cost in volts with these windows of the effective and the next extremum, all terms taken together.

    What follows the last node costs at least ``tail[0] + Re(tail[1]̄ (z − z₀)) + factor |z|``; ``effective`` is −1 if
    the effective extremum is there.

    A magnitude is at least ``m y`` for any m from −1 to 1, and ``|z|`` at least ``Re(ū z)`` for ``|u| ≤ 1``: whatever
    the multipliers, the sum is a lower bound, linear in the waveform but for second derivatives. Good multipliers are
    found one after another.
    """
    A, B = weights
    n = 0
    weight, value, over, under = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    slopes = np.empty((count, PARAMETERS))
    multiplier = np.empty(count)
    total = np.zeros(PARAMETERS)
    constant = 0.0
    at = nodes[int(windows[max(effective, 0), REFERENCE])]
    spread = windows[max(effective, 0), SPREAD]
    if effective < 0:
        pass
    elif following == effective:
        constant = min(A + B, 0.0) * min(abs(at[Y]) + at[Y_RADIUS] + spread, most) - 2.0 * B * spread
    else:
        if abs(at[Y]) > at[Y_RADIUS]:
            constant = A * (abs(at[Y]) + spread + at[SECOND])
            sign = 1.0 if at[Y] > 0.0 else -1.0
            for j in range(PARAMETERS):
                total[j] = A * sign * at[GRADIENT + j]
        else:  # of either sign
            constant = A * min(abs(at[Y]) + at[Y_RADIUS] + spread, most)
    for number in range(count):
        if number == effective or not (number == following or windows[number, CERTAIN]):
            continue
        one = nodes[int(windows[number, REFERENCE])]
        weight[n], value[n] = (B if number == following else 1.0), one[Y]
        # A maximum is at least as high as the reference, a minimum at most; that is enough for one of the two signs.
        over[n] = under[n] = one[SECOND] + windows[number, SPREAD]
        if windows[number, CERTAIN] and (number != following or windows[number, SINGLE]):
            if windows[number, RISES_BEFORE] > 0.0:
                over[n] = one[SECOND]
            else:
                under[n] = one[SECOND]
        slopes[n] = one[GRADIENT : GRADIENT + PARAMETERS]
        multiplier[n] = 1.0 if value[n] > over[n] else (-1.0 if -value[n] > under[n] else 0.0)
        for j in range(PARAMETERS):
            total[j] += weight[n] * multiplier[n] * slopes[n, j]
        n += 1
    size = abs(end[0])
    tilt = tail[1]
    constant += tail[0] - abs(tilt) * second
    along, across = (end[0].real / size, end[0].imag / size) if size > second else (0.0, 0.0)
    for j in range(PARAMETERS):
        total[j] += tilt.real * end[1 + j].real + tilt.imag * end[1 + j].imag
        total[j] += factor * (along * end[1 + j].real + across * end[1 + j].imag)
    for _ in range(PASSES):
        for k in range(n):
            best, chosen = NOTHING, multiplier[k]
            for candidate in range(PARAMETERS + 3):
                m = candidate - PARAMETERS - 1.0
                if candidate < PARAMETERS:
                    if slopes[k, candidate] == 0.0:
                        continue
                    m = multiplier[k] - total[candidate] / (weight[k] * slopes[k, candidate])
                    if not -1.0 < m < 1.0:
                        continue
                gained = weight[k] * (m * value[k] - abs(m) * (over[k] if m > 0.0 else under[k]))
                for j in range(PARAMETERS):
                    gained -= abs(total[j] + weight[k] * (m - multiplier[k]) * slopes[k, j]) * radius[j]
                if gained > best:
                    best, chosen = gained, m
            for j in range(PARAMETERS):
                total[j] += weight[k] * (chosen - multiplier[k]) * slopes[k, j]
            multiplier[k] = chosen
        for axis in range(2 if factor > 0.0 else 0):
            now, other = (along, across) if axis == 0 else (across, along)
            part = end[0].real if axis == 0 else end[0].imag
            most_now = math.sqrt(max(0.0, 1.0 - other * other))
            best, chosen = NOTHING, now
            for candidate in range(PARAMETERS + 3):
                u = (candidate - PARAMETERS - 1.0) * most_now
                if candidate < PARAMETERS:
                    slope = end[1 + candidate].real if axis == 0 else end[1 + candidate].imag
                    if slope == 0.0:
                        continue
                    u = now - total[candidate] / (factor * slope)
                    if not -most_now < u < most_now:
                        continue
                gained = factor * (u * part - math.hypot(u, other) * second)
                for j in range(PARAMETERS):
                    slope = end[1 + j].real if axis == 0 else end[1 + j].imag
                    gained -= abs(total[j] + factor * (u - now) * slope) * radius[j]
                if gained > best:
                    best, chosen = gained, u
            for j in range(PARAMETERS):
                slope = end[1 + j].real if axis == 0 else end[1 + j].imag
                total[j] += factor * (chosen - now) * slope
            if axis == 0:
                along = chosen
            else:
                across = chosen
    found = constant + factor * (along * end[0].real + across * end[0].imag - math.hypot(along, across) * second)
    for k in range(n):
        found += weight[k] * (
            multiplier[k] * value[k] - abs(multiplier[k]) * (over[k] if multiplier[k] > 0.0 else under[k])
        )
    for j in range(PARAMETERS):
        found -= abs(total[j]) * radius[j]
    return found
