"""Least cost over a box of waveforms from the windows of its extrema, and the division of boxes; see `enclosing`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.verification.enclosing import (
    A_WEIGHT,
    B_WEIGHT,
    COUNT,
    LAMBDA,
    MARGIN_V,
    NODES_MOST,
    OMEGA,
    RING,
    WINDOWS_MOST,
    find_windows,
    follow,
)

VOLT_US = 0.03
"""A width in V counts like this many µs when a box is halved."""
COARSE_US = 1.3
"""A box with a half width above this, in µs, is halved without a try; on the last edge, see `COARSE_LAST_US`."""
COARSE_LAST_US = 2.6
"""The same for the last edge, after which no corner moves."""
SIDES = 7
LATER, NONE = 0, 1


@njit(nogil=True)
def geometric(ratio, count):
    """Sum of the first ``count`` powers of ``ratio``, from the zeroth."""
    return 0.0 if count <= 0 else (1.0 - ratio**count) / (1.0 - ratio)


@njit(nogil=True)
def linear_least(
    weight, e_free, e, single, most, k, windows, radius, z, dz, low, high, where, err, short, end, tail
):  # fmt: skip
    """Least of one course's linear function over the box, in V.

    Parameters
    ----------
    weight : array of shape (windows,)
        Weight of each window.
    e_free : bool
        The effective extremum's part ``A |y_e|`` stands as ``A · most`` in place of its linear function.
    e : int
        Window of the effective extremum.
    single : bool
        Whether all of that window's weight is on one extremum, and it is not split.
    tail : float
        Weight of the modulus of the state at node ``end``, where the drive ends.
    """
    value = 0.0
    slopes = np.zeros(SIDES)
    for i in range(windows):
        w = weight[i]
        size = w * short[i] if w >= 0.0 else -w * err[i]
        if i == e and (e_free or not single):
            others = w - k[A_WEIGHT]
            size = (others - k[A_WEIGHT]) * err[i]
            # the largest extremum's modulus is a linear function only where its sign is known
            if e_free or low[i] <= 0.0:
                value += k[A_WEIGHT] * min(high[i], most)
                w = others
                size = others * err[i]
        if w == 0.0:
            value -= size
            continue
        node = where[i]
        y = z[node].imag
        sign = 1.0 if y > 0.0 else -1.0
        if low[i] <= 0.0 and w > 0.0:
            reach = max(high[i], 1e-12)
            sign = max(-1.0, min(1.0, 2.0 * y / reach))
        value += w * sign * y - size
        for j in range(SIDES):
            slopes[j] += w * sign * dz[node, j].imag
    plain = value
    for j in range(SIDES):
        plain -= abs(slopes[j]) * radius[j]
    if tail <= 0.0:
        return plain
    best = plain
    u = z[end] / abs(z[end]) if abs(z[end]) > 1e-12 else complex(0.0, 0.0)
    for trial in range(5):
        total = value + tail * ((u.conjugate() * z[end]).real - abs(u) * end_rest(end, err))
        for j in range(SIDES):
            total -= abs(slopes[j] + tail * (u.conjugate() * dz[end, j]).real) * radius[j]
        best = max(best, total)
        # next trial: weighted least squares of the slopes, clipped to the unit disc
        m11, m12, m22, v1, v2 = 1e-12, 0.0, 1e-12, 0.0, 0.0
        for j in range(SIDES):
            f = radius[j] * radius[j]
            if trial > 0:
                now = abs(slopes[j] + tail * (u.conjugate() * dz[end, j]).real) * radius[j]
                f /= max(now, 1e-6)
            x, y = tail * dz[end, j].real, tail * dz[end, j].imag
            m11 += f * x * x
            m12 += f * x * y
            m22 += f * y * y
            v1 -= f * x * slopes[j]
            v2 -= f * y * slopes[j]
        det = m11 * m22 - m12 * m12
        if not det > 1e-30:
            break
        u = complex((m22 * v1 - m12 * v2) / det, (m11 * v2 - m12 * v1) / det)
        if abs(u) > 1.0:
            u /= abs(u) * (1.0 + 1e-12)
    return best


@njit(nogil=True)
def end_rest(end, err):
    """What second derivatives contribute to the state at the drive's end, in V; kept behind the windows' errors."""
    return err[err.size - 1]


@njit(nogil=True)
def least_cost(centre, radius, least, most, k, law, sup1, sup2, z, dz, rest, seconds, cell, kind, low, high, where, err,
               short, weight):  # fmt: skip
    """Bound from below, in V, of the costs of a box's waveforms whose largest ``|extremum|`` is in ``least … most``."""
    n = follow(centre, radius, k, law, sup1, sup2, -1.0, z, dz, rest, seconds, cell)
    if n == 0:
        return -math.inf
    windows, clean = find_windows(n, radius, k, z, dz, rest, seconds, cell, False, kind, low, high, where, err, short)
    if windows >= 0 and not clean:
        windows, _ = find_windows(n, radius, k, z, dz, rest, seconds, cell, True, kind, low, high, where, err, short)
    if windows < 0:
        return -math.inf
    end = n
    while end > 0 and cell[end - 1] == 5:
        end -= 1
    err[err.size - 1] = rest[end]
    end_low = abs(z[end]) - rest[end]
    end_high = abs(z[end]) + rest[end]
    for j in range(SIDES):
        end_low -= abs(dz[end, j]) * radius[j]
        end_high += abs(dz[end, j]) * radius[j]
    end_low = max(end_low, 0.0)
    ratio = k[RING]
    count = int(k[COUNT])
    a, b = k[A_WEIGHT], k[B_WEIGHT]
    shape = k[OMEGA] / k[LAMBDA] * ratio  # an extremum of free motion within half a period is at least this times |z|
    rest_weight = 0.0 if clean else shape * geometric(ratio, count)
    next_weight = 0.0 if clean else shape * (b + ratio * geometric(ratio, count - 1))
    last_rest = geometric(ratio, count - 1)
    last_next = b + ratio * geometric(ratio, count - 2)
    last_e = a + b * ratio + ratio * ratio * geometric(ratio, count - 3)
    largest = least
    for i in range(windows):
        if kind[i] == 1:
            largest = max(largest, low[i])
    if largest > most:
        return math.inf
    bound = math.inf
    for e in range(windows):
        if high[e] < largest or low[e] > most:
            continue
        for variant in range(2):
            follows = variant == LATER
            if clean and e == windows - 1:
                if variant == NONE:
                    continue
                own = last_e
                follows = False
            elif variant == LATER:
                own = a + (1.0 if kind[e] == 2 else 0.0)
            else:
                own = a + b + (1.0 if kind[e] == 1 else 0.0)
            first = e + 1
            j = first
            while True:
                # the next extremum is in window j, or in none if it is not looked for
                tail = rest_weight
                if follows and j >= windows:
                    tail = next_weight
                for i in range(windows):
                    w = 1.0 if kind[i] == 1 else 0.0
                    if clean and i == windows - 1:
                        w = last_rest
                    if i == e:
                        w = own
                    elif follows and i == j:
                        w = b + (1.0 if kind[i] == 2 else 0.0)
                        if clean and i == windows - 1:
                            w = last_next
                    weight[i] = w
                plain = tail * end_low
                for i in range(windows):
                    if i == e:
                        plain += a * min(high[i], most) + (weight[i] - a) * max(low[i], 0.0)
                    else:
                        plain += weight[i] * low[i]
                if plain < bound:
                    course = plain
                    for free in range(2):
                        course = max(
                            course,
                            linear_least(
                                weight,
                                free == 1,
                                e,
                                clean and e == windows - 1,
                                most,
                                k,
                                windows,
                                radius,
                                z,
                                dz,
                                low,
                                high,
                                where,
                                err,
                                short,
                                end,
                                tail,
                            ),
                        )
                    bound = min(bound, course)
                if not follows or j >= windows or kind[j] == 1:
                    break
                j += 1
    if not clean and end_high >= largest:
        plain = a * min(end_high, most)
        for i in range(windows):
            if kind[i] == 1:
                plain += low[i]
        bound = min(bound, plain)
    return bound - MARGIN_V


@njit(nogil=True)
def check_leaf(lower, upper, least, most, bound, k, law, sup1, sup2, deepest, boxes_most, stop, failed, work):
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
        The problem, see `checking.constants`.
    deepest, boxes_most : int
        Most halvings one within another, and most boxes in all.
    stop : array of shape (1,)
        The work ends early as soon as this is not 0.
    failed : array of shape (2, 7)
        Receives the box that could not be shown.
    work : tuple of arrays
        See `working_memory`.

    Returns
    -------
    int
        Number of further halvings; −1 if the claim could not be shown; −2 if it was stopped.
    """
    z, dz, rest, seconds, cell, kind, low, high, where, err, short, weight, lows, highs, depths, centre, radius = work
    lows[0] = lower
    highs[0] = upper
    depths[0] = 0
    top = 0
    boxes = 0
    while top >= 0:
        if stop[0] != 0:
            return -2
        boxes += 1
        widest, side = -1.0, 0
        coarse = False
        for j in range(SIDES):
            centre[j] = 0.5 * (lows[top, j] + highs[top, j])
            radius[j] = max(highs[top, j] - centre[j], centre[j] - lows[top, j]) * (1.0 + 1e-14)
            scaled = radius[j] * (VOLT_US if j < 2 else 1.0)
            coarse = coarse or scaled > (COARSE_LAST_US if j == SIDES - 1 else COARSE_US)
            if scaled > widest:
                widest, side = scaled, j
        if not coarse:
            value = least_cost(
                centre, radius, least, most, k, law, sup1, sup2,
                z, dz, rest, seconds, cell, kind, low, high, where, err, short, weight,
            )  # fmt: skip
            if value >= bound:
                top -= 1
                continue
        if depths[top] >= deepest or boxes > boxes_most or widest <= 0.0:
            failed[0] = lows[top]
            failed[1] = highs[top]
            return -1
        depth = depths[top] + 1
        lows[top + 1] = lows[top]
        highs[top + 1] = highs[top]
        highs[top + 1, side] = centre[side]
        lows[top, side] = centre[side]
        depths[top] = depth
        depths[top + 1] = depth
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
    )
