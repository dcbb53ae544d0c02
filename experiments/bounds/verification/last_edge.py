"""Least cost to go at the start of the last edge, over all ``t5`` and a cell of states; see `tables`.

For a disc of states at the start, the enclosures of the response at the nodes of the edge are sums, see `kernels`.
Windows of extrema on the edge are found as `enclosing` describes. After the edge the motion is free: from the angle of
the state at its end the next extremum that all states of the disc have is known, and all later ones shrink by the same
ratio.

The cost to go of three kinds is summed from the last extremum backwards: all weigh 1 (*over*); the first one weighs
``B`` (*passed*); the largest is still to come (*to come*), it weighs ``A`` and the one after it ``B``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from inkjet_env.experiments.bounds.verification.compiling import inner
from inkjet_env.experiments.bounds.verification.courses import geometric
from inkjet_env.experiments.bounds.verification.enclosing import (
    A_WEIGHT,
    B_WEIGHT,
    COUNT,
    LAMBDA,
    OMEGA,
    RING,
    SIGMA,
)
from inkjet_env.experiments.bounds.verification.kernels import COARSEST
from inkjet_env.experiments.bounds.verification.spiral import SLACK

SURE = 0.7
"""Greatest ratio of a disc's radius to its middle's modulus with which its angle counts as known."""
TO_COME, PASSED, OVER = range(3)


@inner
def note_window(windows, count, before, after, top, bottom, crest, sag, side, b_weight):
    """Write down a window: kind, least and greatest ``|extremum|``, and what stands for it with weight 1 and ``B``.

    Parameters
    ----------
    before, after : int
        Signs of the slope around it, 0 if unknown.
    top, bottom, crest : float
        Greatest and least ``|y|`` at its nodes over the states, and the greatest of the least ``|y|`` at a node, in V.
    sag : float
        By how much ``y`` may differ between nodes, in V.
    side : int
        Sign of ``y`` in the window, 0 if it changes.
    """
    w = windows[count]
    kind = 0 if before == 0 or after == 0 else (1 if before != after else 2)
    low = max(0.0, bottom - sag) if side != 0 else 0.0
    high = top + sag
    w[0], w[1], w[2], w[3], w[4] = kind, low, high, low, low
    # where |y| rises before and falls after, one extremum is at least |y| at each node
    if kind == 1 and side != 0 and before == side and crest > low:
        w[3] = crest
        if (b_weight + 1.0) * low >= (b_weight - 1.0) * high:
            w[4] = crest


@inner
def piece_cost(n, at, end, z0, r0, sign0, least, most, k, windows):
    """Bounds of the three kinds of cost to go over one piece of the range of ``t5``, in V.

    Parameters
    ----------
    n, at, end
        Of the piece, see `kernels.kernels`.
    z0 : complex
        Middle of the disc of states at the start, in V.
    r0 : float
        Its radius in V.
    sign0 : int
        Sign of the slope at the start, 0 if unknown.
    least, most : float
        Range of the largest ``|extremum|`` in V.
    windows : array of shape (windows, 5)
        Working memory.
    """
    omega, sigma, size = k[OMEGA], k[SIGMA], k[LAMBDA]
    x0, y0 = z0.real, z0.imag
    m0 = abs(z0) + r0
    zero: Any = np.int64(0)
    count, side, before, sign_p = zero, zero, zero, zero
    is_open = False
    least_p, y_p, wide_p, spread, slope = 0.0, 0.0, 0.0, 0.0, 0.0
    top, bottom, crest, sag = 0.0, 0.0, 0.0, 0.0
    for j in range(n + 1):
        f = at[j]
        y = f[0] * x0 + f[1] * y0 + f[2]
        slope = f[3] * x0 + f[4] * y0 + f[5]
        far = f[14] * r0 + f[15] * m0
        wide = abs(f[6] * x0 + f[7] * y0 + f[8]) + f[12] + far
        spread = abs(f[9] * x0 + f[10] * y0 + f[11]) + f[13] + size * far
        known = abs(slope) - spread
        sign = zero
        if known > 0.0:
            sign = 1 if slope > 0.0 else -1
        if j == 0:
            if sign0 != 0:
                known = known if sign == sign0 else 0.0
                sign = sign0
        else:
            definite = sign != 0 and sign == sign_p and min(known, least_p) > f[18] + f[19] * m0
            if definite:
                if is_open:
                    note_window(windows, count, before, sign_p, top, bottom, crest, sag, side, k[B_WEIGHT])
                    count += 1
                    is_open = False
            else:
                if not is_open:
                    is_open = True
                    before = sign_p
                    top, bottom, crest, sag = abs(y_p) + wide_p, abs(y_p) - wide_p, abs(y_p) - wide_p, 0.0
                    side = 1 if y_p > 0.0 else -1
                top = max(top, abs(y) + wide)
                bottom = min(bottom, abs(y) - wide)
                crest = max(crest, abs(y) - wide)
                sag = max(sag, f[16] + f[17] * m0)
                if side != (1 if y > 0.0 else -1):
                    side = zero
        sign_p, least_p, y_p, wide_p = sign, known, y, wide
    # free motion after the edge
    ze = end[5] * z0 + end[0]
    de = end[1] * z0 + end[2]
    far = at[n, 14] * r0 + at[n, 15] * m0 + end[4].real
    re = abs(de) + abs(end[3]) + far
    mod = abs(ze)
    a_w, b_w, ratio, after_end = k[A_WEIGHT], k[B_WEIGHT], k[RING], int(k[COUNT])
    low1, high1 = 0.0, 0.0
    sure = re < SURE * mod
    if sure:
        spread_angle = math.asin(re / mod) + SLACK
        angle = (math.atan2(ze.imag, ze.real) + math.atan2(omega, -sigma)) % (2.0 * math.pi)
        sign = 1 if angle < math.pi else -1
        ahead = math.pi - angle % math.pi
        if ahead - spread_angle > SLACK:
            extended = max(0.0, ahead + spread_angle - math.pi)
        else:
            extended = ahead + spread_angle
            ahead += math.pi
            sign = -sign
            if not is_open:
                is_open = True
                before = sign_p
                top, bottom, crest, sag = abs(y_p) + wide_p, abs(y_p) - wide_p, abs(y_p) - wide_p, 0.0
                side = 1 if y_p > 0.0 else -1
        if is_open:
            time = extended / omega
            change = (abs(slope) + spread) * time + 0.5 * size * size * (mod + re) * time * time
            if abs(y_p) - wide_p <= change:
                side = zero
            top = max(top, abs(y_p) + wide_p + change)
            bottom = min(bottom, abs(y_p) - wide_p - change)
            note_window(windows, count, before, sign, top, bottom, crest, sag, side, b_w)
            count += 1
        turn = np.exp(complex(-sigma, omega) * (ahead / omega))
        middle = abs((turn * ze).imag)
        off = abs((turn * de).imag) + abs((turn * end[3]).imag) + abs(turn) * far
        late = max(0.0, ahead - spread_angle) / omega
        off += 0.5 * size * size * (mod + re) * math.exp(-sigma * late) * (spread_angle / omega) ** 2
        low1 = max(0.0, middle - off)
        high1 = middle + off
    elif is_open:
        note_window(windows, count, before, sign_p, top, bottom, crest, sag, side, b_w)
        count += 1
    largest = least
    feasible = low1 <= most
    for i in range(count):
        if windows[i, 0] == 1.0:
            largest = max(largest, windows[i, 3])
    if sure:
        largest = max(largest, low1)
        v2 = low1 * geometric(ratio, after_end - 1)
        v1 = low1 * (b_w + ratio * geometric(ratio, after_end - 2))
        v0 = math.inf
        if high1 >= largest and low1 <= most:
            factor = a_w + b_w * ratio + ratio * ratio * geometric(ratio, after_end - 3)
            v0 = factor * (min(high1, most) if factor < 0.0 else low1)
    else:
        small = omega / size * ratio * max(0.0, mod - re)
        v2 = small * geometric(ratio, after_end - 1)
        v1 = small * (b_w + ratio * geometric(ratio, after_end - 2))
        v0 = a_w * min(mod + re, most) if mod + re >= largest else math.inf
    for i in range(count - 1, -1, -1):
        w = windows[i]
        kind, low, high = w[0], w[1], w[2]
        can = high >= largest and low <= most
        peak = a_w * min(high, most)
        if kind == 1.0:
            if low > most:
                feasible = False
            v0 = w[3] + v0
            if can:
                v0 = min(v0, peak + v1, peak + (b_w + 1.0) * low + v2)
            v1 = b_w * w[4] + v2
            v2 = w[3] + v2
        else:
            extra = low if kind == 2.0 else 0.0
            if can:
                v0 = min(v0, peak + extra + v1, peak + b_w * low + v2)
            v1 = min(v1, b_w * low + extra + v2)
    if not feasible or largest > most:
        v0 = math.inf
    return v0, v1, v2


@inner
def least_over_pieces(z0, r0, sign0, least, most, to_come, levels, k, nodes, at, ends, windows, stack, values):
    """Bounds of the three kinds of cost to go over the whole range of ``t5``, in V, by branch and bound.

    Parameters
    ----------
    to_come : bool
        Whether the first kind alone is asked for, or the other two.
    stack, values : arrays of shapes (entries, 2) and (entries, 3)
        Working memory.
    """
    best0, best1, best2 = math.inf, math.inf, math.inf
    for i in range(COARSEST):
        stack[i, 0], stack[i, 1] = i, 0
        c0, c1, c2 = piece_cost(nodes[i], at[i], ends[i], z0, r0, sign0, least, most, k, windows)
        values[i, 0], values[i, 1], values[i, 2] = c0, c1, c2
    top = COARSEST
    while top > 0:
        # of the coarsest pieces the most promising one is next, below them the last one
        take = top - 1
        if top <= COARSEST:
            for i in range(top - 1):
                if to_come:
                    if values[i, 0] < values[take, 0]:
                        take = i
                elif values[i, 1] + values[i, 2] < values[take, 1] + values[take, 2]:
                    take = i
        i, level = stack[take, 0], stack[take, 1]
        v0, v1, v2 = values[take, 0], values[take, 1], values[take, 2]
        top -= 1
        stack[take, 0], stack[take, 1] = stack[top, 0], stack[top, 1]
        values[take, 0], values[take, 1], values[take, 2] = values[top, 0], values[top, 1], values[top, 2]
        if to_come:
            if not v0 < best0:
                continue
        elif v1 >= best1 and v2 >= best2:
            continue
        if level == levels - 1:
            best0, best1, best2 = min(best0, v0), min(best1, v1), min(best2, v2)
            continue
        first = COARSEST * ((1 << (level + 1)) - 1) + 2 * i
        for child in range(2):
            p = first + child
            c0, c1, c2 = piece_cost(nodes[p], at[p], ends[p], z0, r0, sign0, least, most, k, windows)
            stack[top, 0], stack[top, 1] = 2 * i + child, level + 1
            values[top, 0], values[top, 1], values[top, 2] = max(c0, v0), max(c1, v1), max(c2, v2)
            top += 1
        last, other = top - 1, top - 2
        worse = values[last, 0] > values[other, 0] if to_come else values[last, 1] > values[other, 1]
        if worse:
            for column in range(3):
                values[last, column], values[other, column] = values[other, column], values[last, column]
            stack[last, 0], stack[other, 0] = stack[other, 0], stack[last, 0]
    return best0, best1, best2
