"""Least cost over a box of waveforms from the windows of its extrema; see `enclosing`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.verification.compiling import inner
from inkjet_env.experiments.bounds.verification.enclosing import (
    A_WEIGHT,
    B_WEIGHT,
    CELL_US,
    COUNT,
    LAMBDA,
    MARGIN_V,
    OMEGA,
    RING,
    at_rest,
    find_windows,
    follow,
)

SIDES = 7
LATER, NONE = 0, 1


@inner
def geometric(ratio, count):
    """Sum of the first ``count`` powers of ``ratio``, from the zeroth."""
    return 0.0 if count <= 0 else (1.0 - ratio**count) / (1.0 - ratio)


@inner
def linear_course(
    weight, e_free, e, single, most, k, windows, radius, z, dz, low, high, where, err, short, slopes
):  # fmt: skip
    """One course's linear function over the box: its value at the centre in V; its derivatives are added to `slopes`.

    An extremum stands for itself by its linear function, or by its least modulus where that makes the sum's least
    greater: where it is known badly, or is near 0.

    Parameters
    ----------
    weight : array of shape (windows,)
        Weight of each window.
    e_free : bool
        The effective extremum's part ``A |y_e|`` stands as ``A · most`` in place of its linear function.
    e : int
        Window of the effective extremum, −1 if it is in none.
    single : bool
        Whether all of that window's weight is on one extremum, and it is not split.
    slopes : array of shape (7,)
        Derivatives of what else is in the sum.
    """
    value = 0.0
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
        slope = w * sign_of(i, node, w, z, low, high)
        value += slope * z[node].imag - size
        for j in range(SIDES):
            slopes[j] += slope * dz[node, j].imag
    for i in range(windows):
        w = weight[i]
        if w <= 0.0 or i == e:
            continue
        node = where[i]
        slope = w * sign_of(i, node, w, z, low, high)
        gained = w * (low[i] + short[i]) - slope * z[node].imag
        change = gained
        for j in range(SIDES):
            change += (abs(slopes[j]) - abs(slopes[j] - slope * dz[node, j].imag)) * radius[j]
        if change > 0.0:
            value += gained
            for j in range(SIDES):
                slopes[j] -= slope * dz[node, j].imag
    return value


@inner
def sign_of(i, node, weight, z, low, high):
    """The sign of a window's extrema, or what stands for it, between −1 and 1, where it is not known."""
    y = z[node].imag
    if low[i] <= 0.0 and weight > 0.0:
        return max(-1.0, min(1.0, 2.0 * y / max(high[i], 1e-12)))
    return 1.0 if y > 0.0 else -1.0


@inner
def linear_least(
    weight, e_free, e, single, most, k, windows, radius, z, dz, low, high, where, err, short, end, tail
):  # fmt: skip
    """Least of one course's linear function over the box, in V; see `linear_course`.

    Parameters
    ----------
    tail : float
        Weight of the modulus of the state at node ``end``, where the drive ends.
    """
    slopes = np.zeros(SIDES)
    value = linear_course(
        weight, e_free, e, single, most, k, windows, radius, z, dz, low, high, where, err, short, slopes
    )  # fmt: skip
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


@inner
def end_rest(end, err):
    """What second derivatives contribute to the state at the drive's end, in V; kept behind the windows' errors."""
    return err[err.size - 1]


@njit(nogil=True)
def least_cost(centre, radius, least, most, k, law, sup1, sup2, z, dz, rest, seconds, cell, kind, low, high, where, err,
               short, weight):  # fmt: skip
    """Bound from below, in V, of the costs of a box's waveforms whose largest ``|extremum|`` is in ``least … most``.

    Also the number of windows of extrema, 0 where there is no bound.
    """
    at_rest(z, dz, rest)
    n = follow(np.int64(0), np.int64(5), CELL_US, centre, radius, k, law, sup1, sup2, -1.0, z, dz, rest, seconds, cell)
    if n == 0:
        return -math.inf, np.int64(0)
    windows, clean = np.int64(-1), False
    for attempt in range(2):
        # the second one leaves out the time after the drive
        if attempt == 0 or (windows >= 0 and not clean):
            windows, clean, _, _ = find_windows(
                n, radius, k, z, dz, rest, seconds, cell, attempt == 1, kind, low, high, where, err, short
            )
    if windows < 0:
        return -math.inf, np.int64(0)
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
        return math.inf, windows
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
    return bound - MARGIN_V, windows
