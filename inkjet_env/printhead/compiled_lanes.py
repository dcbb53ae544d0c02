"""Peak costs of eight waveforms side by side: the closed form of `compiled_edges`, written for vector instructions.

Users call `lanes.costs`, not this module. `compiled_cells` solves the edges; plateaus and the final ring-down are free.
No step depends on the lane, except that the few extrema are picked out. A waveform that a step cannot settle is left to
the scalar path, as are those that `kind_of` refuses.
"""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.printhead.compiled_cells import (
    CELL_RAD,
    FEWEST_TERMS,
    MOST_PEAKS,
    MOST_TERMS,
    SPLITS,
    TERMS_OF_A_CURVE,
    bernstein_weights,
    edge,
    solve_waiting,
)
from inkjet_env.printhead.compiled_edges import (
    FAST,
    HEAD_A0,
    HEAD_A1,
    HEAD_B1,
    HEAD_DEGREE,
    HEAD_END_SLOPE,
    HEAD_FULL_SCALE,
    HEAD_SLOPE,
    MAX_DEGREE,
)
from inkjet_env.printhead.kernel_cache import INTERNAL, kernel_jit
from inkjet_env.printhead.vector_functions import atan2, cos_sin, exp
from inkjet_env.printhead.vector_type import (
    LANES,
    bits,
    floor,
    load,
    magnitude,
    root,
    same,
    spread,
    store,
    where,
)

SCALAR, BELOW, BEYOND = 0, 1, 2
"""Kinds of waveforms: for the scalar path; with the largest swing below the full scale; with one beyond it."""
LONGEST_RAD = 40.0
"""Longest edge or plateau in lanes, in radians: a bound of the work, and of the arguments of sine and cosine."""
STRONGEST_DECAY = 4.0
"""Largest decay within a plateau in lanes, as an exponent."""
SHORTEST_S = 1e-12
"""Shortest piece of an edge in lanes, in seconds."""

_jit = kernel_jit(__file__, fastmath=FAST)
_internal = kernel_jit(__file__, fastmath=FAST, **INTERNAL)
_inlined = kernel_jit(__file__, fastmath=FAST, forceinline=True, **INTERNAL)


@_inlined
def _first_extremum(a0, sigma, omega, y, slope):
    """First extremum of a free ring-down: its time in seconds and its value in volts."""
    quadrature = (-1.0 * sigma * slope - a0 * y) / omega
    phase = atan2(slope, quadrature)
    before = phase < 0.0
    first_s = where(before, -1.0 * phase, math.pi - phase) / omega
    side = where(before, spread(-1.0), spread(1.0)) / root(slope * slope + quadrature * quadrature)
    c, s = -1.0 * side * quadrature, side * slope
    return first_s, exp(-1.0 * sigma * first_s) * (y * c + (slope + sigma * y) / omega * s)


@_inlined
def _advanced(a0, sigma, omega, duration, y, slope):
    """Response and slope after a free ring-down."""
    c, s = cos_sin(omega * duration)
    decay = exp(-1.0 * sigma * duration)
    c, s = decay * c, decay * s / omega
    return y * c + (slope + sigma * y) * s, slope * c - (sigma * slope + a0 * y) * s


@_internal
def _append_ringing(ratio, half_s, last_s, first_s, value, peaks, count):
    """Append the extrema of a plateau: the first one, and each next one times ``-ratio``; the lanes with too many."""
    too_many = 0
    for i in range(LANES):
        peak, time_s = value[i], first_s[i]
        while time_s <= last_s[i]:
            if count[i] == MOST_PEAKS:
                too_many |= 1 << i
                break
            peaks[LANES * count[i] + i] = peak
            count[i] += 1
            peak *= -ratio[i]
            time_s += half_s[i]
    return too_many


@_internal
def kind_of(waveform, head, window_s):
    """`SCALAR`, `BELOW` or `BEYOND`."""
    U1, W, F = waveform[0], -waveform[1], head[HEAD_FULL_SCALE]
    omega0, sigma = math.sqrt(head[HEAD_A0]), 0.5 * head[HEAD_A1]
    longest, total = 0.0, 0.0
    for k in range(2, 7):
        longest = max(longest, waveform[k])
        total += waveform[k]
    if not (U1 > 1e-6 and 1e-6 < W < F and total < window_s and sigma < 0.5 * omega0):
        return SCALAR
    if omega0 * longest > LONGEST_RAD or sigma * (longest + math.pi / (0.8 * omega0)) > STRONGEST_DECAY:
        return SCALAR
    shortest = min(waveform[2], waveform[4], waveform[6])
    swing = U1 + W
    if swing <= F:
        return BELOW if shortest >= SHORTEST_S else SCALAR
    # The pieces of edges 1 and 2 before and after x = 1.
    return BEYOND if shortest * min((swing - F) / swing, (F - W) / U1) >= SHORTEST_S else SCALAR


@_jit
def kinds_of(waveforms, heads, window_s, levels, kinds, keys):
    """Fill ``kinds`` (n,) with `kind_of` each waveform (n, 7) on its head (1 or n rows), and ``keys`` (n,) of integers.

    The durations of the three edges are alike, to one of so many ``levels``, where keys are equal: eight such waveforms
    are cut into the same numbers of cells.
    """
    longest = np.full(3, 1e-300)
    for i in range(waveforms.shape[0]):
        for k in range(3):
            longest[k] = max(longest[k], waveforms[i, 2 + 2 * k])
    for i in range(waveforms.shape[0]):
        kinds[i] = kind_of(waveforms[i], heads[i if heads.shape[0] > 1 else 0], window_s)
        key = 0
        for k in range(3):
            key = key * levels + min(int(waveforms[i, 2 + 2 * k] / longest[k] * levels), levels - 1)
        keys[i] = key


@_internal
def _gather(waveforms, heads, order, begin, lines, laws, count):
    """Write waveforms and heads as lanes: ``lines`` of numbers, ``laws`` of Q'; return the largest degree."""
    degree = 1
    for i in range(LANES):
        row = order[min(begin + i, order.shape[0] - 1)]
        head = heads[row if heads.shape[0] > 1 else 0]
        degree = max(degree, int(head[HEAD_DEGREE]))
        for k in range(7):
            lines[LANES * k + i] = waveforms[row, k]
        lines[7 * LANES + i], lines[8 * LANES + i], lines[9 * LANES + i] = head[HEAD_A0], head[HEAD_A1], head[HEAD_B1]
        lines[10 * LANES + i], lines[11 * LANES + i] = head[HEAD_FULL_SCALE], head[HEAD_END_SLOPE]
        for k in range(MAX_DEGREE):
            laws[LANES * k + i] = head[HEAD_SLOPE + k]
        count[i] = 0
    return degree


@_internal
def _fill_rate(laws, degree, x, dx, scale_V, rate):
    """Fill ``rate`` with ``dv/dτ`` in volts, lowest power first, on pieces from ``x`` to ``x + dx``."""
    for k in range(degree):
        store(rate, LANES * k, load(laws, LANES * k))
    if bits(x > 0.0):
        for k in range(degree - 1):  # Taylor shift by repeated synthetic division
            for j in range(degree - 2, k - 1, -1):
                store(rate, LANES * j, load(rate, LANES * j) + x * load(rate, LANES * (j + 1)))
    factor = scale_V
    for k in range(degree):
        factor = factor * dx
        store(rate, LANES * k, load(rate, LANES * k) * factor)


@_internal
def _largest(vector, values):
    """The largest of eight numbers."""
    store(values, 0, vector)
    largest = values[0]
    for i in range(1, LANES):
        largest = max(largest, values[i])
    return largest


@_internal
def _cost_of_lane(i, peaks, count, first_V, second_V, tail_V, A, B, target_height_V):
    """Peak cost of a lane, Eq. (9) of `cost`; ``tail_V`` is what the peaks of the final ring-down add up to."""
    total, largest, e = tail_V, -1.0, -1
    for k in range(count):
        height = abs(peaks[LANES * k + i])
        total += height
        if height > largest:
            largest, e = height, k
    after = abs(peaks[LANES * (e + 1) + i]) if e + 1 < count else first_V
    if first_V > largest:
        largest, after = first_V, second_V
    return total + A * min(largest, target_height_V) - largest + (B - 1.0) * after  # the peak cost, Eq. (9)


@_jit
def lane_costs(waveforms, heads, order, beyond, window_s, A, B, target_height_V, costs, unsettled):
    """Peak cost of the waveforms (n, 7) that ``order`` lists, all of one kind, with the largest peak effective.

    ``beyond`` tells whether it is `BEYOND`. ``costs`` (n,) is filled in volts; ``unsettled`` (n,) is set where the
    scalar path has to do it again.
    """
    lines, laws, rate = np.empty(12 * LANES), np.empty(MAX_DEGREE * LANES), np.empty(MAX_DEGREE * LANES)
    whole, weights, weighted = np.empty(MOST_TERMS * LANES), np.empty((MAX_DEGREE, MAX_DEGREE)), 0
    values, peaks, count = np.empty(LANES), np.empty(MOST_PEAKS * LANES), np.empty(LANES, np.int64)
    ratios, half_s, last_s, first_s = np.empty(LANES), np.empty(LANES), np.empty(LANES), np.empty(LANES)
    places = (
        np.empty(MOST_PEAKS * LANES * MOST_TERMS),
        np.zeros(MOST_PEAKS * LANES),
        np.empty(MOST_PEAKS * LANES, np.int64),
    )
    work = values, np.empty(6 * LANES), np.empty((SPLITS, 3))
    for begin in range(0, order.shape[0], LANES):
        degree = _gather(waveforms, heads, order, begin, lines, laws, count)
        terms = max(FEWEST_TERMS, degree + TERMS_OF_A_CURVE)
        series = whole[: terms * LANES]
        if degree != weighted:
            bernstein_weights(degree, weights)
            weighted = degree
        a0, a1, b1 = load(lines, 7 * LANES), load(lines, 8 * LANES), load(lines, 9 * LANES)
        sigma = 0.5 * a1
        omega = root(a0 - sigma * sigma)
        ratio = exp(-math.pi * sigma / omega)
        store(ratios, 0, ratio)
        store(half_s, 0, math.pi / omega)
        F = load(lines, 10 * LANES)
        x_origin = -1.0 * load(lines, LANES) / F
        swing = (load(lines, 0) - load(lines, LANES)) / F
        zero, one = spread(0.0), spread(1.0)
        y, slope, total_s = zero, zero, zero
        waiting, again = 0, 0
        for segment in range(5):
            duration = load(lines, LANES * (2 + segment))
            total_s = total_s + duration
            if segment % 2 == 1:  # a plateau
                when_s, value = _first_extremum(a0, sigma, omega, y, slope)
                store(last_s, 0, duration)
                store(first_s, 0, when_s)
                store(values, 0, value)
                again |= bits(same(slope, zero))
                again |= _append_ringing(ratios, half_s, last_s, first_s, values, peaks, count)
                y, slope = _advanced(a0, sigma, omega, duration, y, slope)
                continue
            x_first, x_last = x_origin if segment == 0 else zero, x_origin if segment == 4 else swing
            x_cut = where(x_last < one, x_last, one)
            share = (x_cut - x_first) / (x_last - x_first)
            scale_V = F * (-1.0 if segment == 2 else 1.0)
            for part in range(2 if beyond and segment < 4 else 1):
                if part == 0:
                    part_s = duration * share
                    _fill_rate(laws, degree, x_first, x_cut - x_first, scale_V, rate)
                else:  # beyond the full scale, where the law is a straight line
                    part_s = duration * (1.0 - share)
                    store(rate, 0, load(lines, 11 * LANES) * scale_V * (x_last - one))
                cells = int(_largest(root(a0) * part_s, values) / CELL_RAD) + 1
                y, slope, waiting, open_lanes = edge(
                    cells, a0, a1, b1, part_s, rate, 1 if part else degree, weights, y, slope, series, work, places,
                    waiting, count,
                )  # fmt: skip
                again |= open_lanes
        again |= solve_waiting(terms, places, waiting, values, peaks)
        left_s = window_s - total_s
        when_s, value = _first_extremum(a0, sigma, omega, y, slope)
        again |= bits(same(slope, zero))
        following = floor((left_s - when_s) * omega / math.pi) + 1.0
        exponent = -math.pi * sigma / omega * following * 0.125
        kept = exp(where(exponent < -STRONGEST_DECAY, spread(-STRONGEST_DECAY), exponent))
        kept = kept * kept
        kept = kept * kept
        first = where(when_s <= left_s, magnitude(value), zero)
        store(first_s, 0, first)
        store(last_s, 0, where(following > one, first * ratio, zero))
        store(values, 0, first * (1.0 - kept * kept) / (1.0 - ratio))
        for i in range(min(LANES, order.shape[0] - begin)):
            row = order[begin + i]
            costs[row] = _cost_of_lane(i, peaks, count[i], first_s[i], last_s[i], values[i], A, B, target_height_V)
            unsettled[row] = (again >> i) & 1
