"""Compiled kernels of the printhead: the same closed form as `resonator`, written for speed.

Users call `batch`, not this module. `compiled_edges` solves one stretch of the response; this file chains the
stretches, from a waveform to its peaks and their cost.
"""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.printhead import hysteresis
from inkjet_env.printhead.compiled_edges import (
    FAST,
    HEAD_A0,
    HEAD_A1,
    HEAD_B1,
    HEAD_FULL_SCALE,
    MAX_DEGREE,
    OVERFLOW,
    SERIES_TERMS,
    edge_extrema,
    piece_rate,
    ring_down_extrema,
    rotation,
    solve_piece,
)
from inkjet_env.printhead.kernel_cache import INTERNAL, kernel_jit
from inkjet_env.printhead.resonator import JUMP_S, ROUNDING

EFFECTIVE_LARGEST, EFFECTIVE_FIRST, EFFECTIVE_THRESHOLD = 0, 1, 2
"""Rules for the effective peak; see `cost.PeakCost`."""

_jit = kernel_jit(__file__, fastmath=FAST)
_internal = kernel_jit(__file__, fastmath=FAST, **INTERNAL)
_jit_hysteresis = kernel_jit(hysteresis.__file__, fastmath=FAST)

branch_pieces = _jit_hysteresis(hysteresis.branch_pieces)
play_operators = _jit_hysteresis(hysteresis.play_operators)


@_jit
def response_extrema(head, knots_s, pieces, piece_count, window_s, state, rate, series, stack, times, peaks, knots_y):
    """Find every extremum of the response to branch pieces, in time order.

    Parameters
    ----------
    head : ndarray, shape (HEAD_COLUMNS,)
        One row of `batch.head_table`.
    knots_s : ndarray, shape (n,)
        Times of the drive's knots, in seconds.
    pieces : ndarray, shape (≥ piece_count, 6)
        Branch pieces from `hysteresis.branch_pieces`.
    piece_count : int
        Number of rows of ``pieces`` in use.
    window_s : float
        Extrema later than this are left out, in seconds; may be infinite.
    state : ndarray, shape (2,)
        Response and its slope (V, V/s) at the first knot; on return, at the last one.
    rate, series, stack : ndarray
        Scratch of shapes (MAX_DEGREE,), (SERIES_TERMS + 2,) and (64, 4).
    times, peaks : ndarray
        Filled with times in seconds and values in volts.
    knots_y : ndarray, shape (n,) or (0,)
        Filled with the response at the knots, in volts, unless empty.

    Returns
    -------
    count : int
        Number of extrema, or `OVERFLOW` when ``times`` is too short.
    tail_V : float
        Summed magnitude of the extrema beyond the list, in volts; 0 for a finite window.
    """
    a0, a1 = head[HEAD_A0], head[HEAD_A1]
    pole_re = -0.5 * a1
    omega0 = math.sqrt(a0)
    pole_im = math.sqrt((omega0 + pole_re) * (omega0 - pole_re))
    y, slope = state[0], state[1]
    heading, size = slope, abs(y)
    count = 0
    tail = 0.0
    if knots_y.shape[0] > 0:
        knots_y[0] = y
    last = knots_s.shape[0] - 1
    segment = 0
    index = 0
    while segment < last:
        # Next piece, or the whole segment if the drive is constant on it.
        whole = knots_s[segment + 1] - knots_s[segment]
        start = knots_s[segment]
        forced = index < piece_count and int(pieces[index, 0]) == segment
        duration = whole
        n = 0
        if forced:
            start += pieces[index, 1] * whole
            duration = pieces[index, 2] * whole
            n = piece_rate(head, pieces[index, 3], pieces[index, 4], pieces[index, 5], rate)
        if start > window_s:
            break
        change = 0.0
        for k in range(n):
            change += rate[k] / (k + 1.0)
        at_rest = y == 0.0 and slope == 0.0
        if duration < JUMP_S:
            slope += head[HEAD_B1] * change
        elif forced or not at_rest:
            curvature = -a1 * slope - a0 * y
            if forced:
                curvature += head[HEAD_B1] * rate[0] / duration
            begin = slope if slope != 0.0 else curvature
            if heading * begin < 0.0:
                if count >= times.shape[0]:
                    return OVERFLOW, 0.0
                times[count] = start
                peaks[count] = y
                count += 1
            if forced:
                terms = solve_piece(head, y, slope, duration, rate, n, series)
                ring_y, ring_slope = 0.0, 0.0
                if terms < 0:
                    ring_y = y - series[0]
                    ring_slope = slope - (series[1] / duration if n > 1 else 0.0)
                count, y, slope, curvature = edge_extrema(
                    head, pole_re, pole_im, start, duration, pieces[index, 3], pieces[index, 4], pieces[index, 5],
                    series, terms, ring_y, ring_slope, y, slope, curvature, stack, times, peaks, count,
                )  # fmt: skip
                if count == OVERFLOW:
                    return OVERFLOW, 0.0
            else:
                count, tail = ring_down_extrema(pole_re, pole_im, a0, y, slope, start, duration, times, peaks, count)
                if count == OVERFLOW:
                    return OVERFLOW, 0.0
                c, s = rotation(pole_re, pole_im, duration)
                y, slope = y * c + (slope - pole_re * y) * s, slope * c + (pole_re * slope - a0 * y) * s
                curvature = -a1 * slope - a0 * y
            heading = slope if slope != 0.0 else -curvature
            size *= math.exp(pole_re * duration)
        if forced:
            size += abs(head[HEAD_B1] * change / pole_im)
        quadrature = (slope - pole_re * y) / pole_im
        if y * y + quadrature * quadrature < (ROUNDING * size) ** 2:
            y, slope, heading = 0.0, 0.0, 0.0
        if forced:
            index += 1
        if not (index < piece_count and int(pieces[index, 0]) == segment):
            segment += 1
            if knots_y.shape[0] > 0:
                knots_y[segment] = y
    state[0], state[1] = y, slope
    if knots_s[last] <= window_s:
        begin = slope if slope != 0.0 else -y
        if heading * begin < 0.0:
            if count >= times.shape[0]:
                return OVERFLOW, 0.0
            times[count] = knots_s[last]
            peaks[count] = y
            count += 1
        count, tail = ring_down_extrema(
            pole_re, pole_im, a0, y, slope, knots_s[last], window_s - knots_s[last], times, peaks, count
        )
        if count == OVERFLOW:
            return OVERFLOW, 0.0
    while count > 0 and times[count - 1] > window_s:
        count -= 1
    return count, tail


@_internal
def peak_cost(peaks, count, tail_V, A, B, effective, threshold, target_height_V):
    """Peak cost in volts of ``count`` peaks, Eq. (9) of `cost`; also the index of the effective peak, or −1."""
    e = -1
    total = tail_V
    largest = -1.0
    for i in range(count):
        magnitude = abs(peaks[i])
        total += magnitude
        if effective == EFFECTIVE_LARGEST:
            if magnitude > largest:
                largest = magnitude
                e = i
        elif e < 0 and (effective == EFFECTIVE_FIRST or magnitude >= threshold):
            e = i
    if e >= 0:  # Eq. (9)
        total += A * min(abs(peaks[e]), target_height_V) - abs(peaks[e])
        if e + 1 < count:
            total += (B - 1.0) * abs(peaks[e + 1])
    return total, e


@_internal
def waveform_knots(waveform, knots_s, knots_V):
    """Fill the six knots of a bipolar trapezoid, in seconds and volts."""
    knots_s[0] = 0.0
    for k in range(5):
        knots_s[k + 1] = knots_s[k] + waveform[2 + k]
    knots_V[0] = knots_V[5] = 0.0
    knots_V[1] = knots_V[2] = waveform[0]
    knots_V[3] = knots_V[4] = waveform[1]


@_internal
def start_in_train(
    head, knots_s, pieces, piece_count, period_s, earlier_drops, state, rate, series, stack, times, peaks, no_knots
):  # fmt: skip
    """Fill ``state`` (2,), in V and V/s, with its value at the start of a waveform after so many others.

    After infinitely many it solves ``s = e^{FT} s + e^{F(T - D)} r``, with ``r`` the state at the waveform's end D
    after a start at rest; after n of them, from rest, it is ``s - e^{nFT} s``. The other arguments are those of
    `response_extrema`; ``times`` and ``peaks`` are overwritten. False if they are too short.
    """
    duration_s = knots_s[-1]
    state[:] = 0.0
    count, _ = response_extrema(
        head, knots_s, pieces, piece_count, duration_s, state, rate, series, stack, times, peaks, no_knots
    )
    if count == OVERFLOW:
        return False
    a0, pole_re = head[HEAD_A0], -0.5 * head[HEAD_A1]
    omega0 = math.sqrt(a0)
    pole_im = math.sqrt((omega0 + pole_re) * (omega0 - pole_re))
    c, s = rotation(pole_re, pole_im, period_s - duration_s)
    y = state[0] * c + (state[1] - pole_re * state[0]) * s
    slope = state[1] * c + (pole_re * state[1] - a0 * state[0]) * s
    c, s = rotation(pole_re, pole_im, period_s)
    along, across, back = 1.0 - c + pole_re * s, -s, a0 * s
    other = 1.0 - c - pole_re * s
    determinant = along * other - across * back
    state[0] = (other * y - across * slope) / determinant
    state[1] = (along * slope - back * y) / determinant
    if earlier_drops < math.inf:
        y, slope = state[0], state[1]
        c, s = rotation(pole_re, pole_im, earlier_drops * period_s)
        state[0] -= y * c + (slope - pole_re * y) * s
        state[1] -= slope * c + (pole_re * slope - a0 * y) * s
    return True


@_jit
def _costs(
    waveforms, heads, warm_up_periods, one_point, window_s, period_s, earlier_drops, A, B, effective, threshold,
    target_height_V, capacity, costs,
):  # fmt: skip
    """`batch_costs`, compiled once for ``period_s`` None, without `start_in_train`, and once for a number."""
    knots_s, knots_V = np.empty(6), np.empty(6)
    memory, pieces = np.empty(32), np.empty((40, 6))
    rate, series, stack = np.empty(MAX_DEGREE), np.empty(SERIES_TERMS + 2), np.empty((64, 4))
    times, peaks = np.empty(capacity), np.empty(capacity)
    state, no_knots = np.empty(2), np.empty(0)
    for i in range(waveforms.shape[0]):
        state[:] = 0.0
        head = heads[i if heads.shape[0] > 1 else 0]
        waveform_knots(waveforms[i], knots_s, knots_V)
        found = branch_pieces(knots_V, head[HEAD_FULL_SCALE], warm_up_periods, one_point, memory, pieces)
        # numba leaves out a branch on None if nothing else is in its condition
        if period_s is not None:  # noqa: SIM102
            if not start_in_train(
                head, knots_s, pieces, found, period_s, earlier_drops, state, rate, series, stack, times, peaks,
                no_knots,
            ):  # fmt: skip
                return False
        count, tail = response_extrema(
            head, knots_s, pieces, found, window_s, state, rate, series, stack, times, peaks, no_knots
        )
        if count == OVERFLOW:
            return False
        costs[i], _ = peak_cost(peaks, count, tail, A, B, effective, threshold, target_height_V)
    return True


def batch_costs(waveforms, heads, settings, capacity, costs):
    """Peak cost of each waveform (n, 7) on its head ((1 or n), HEAD_COLUMNS); False if ``capacity`` was too small.

    ``settings`` are those of `_costs`, from ``warm_up_periods`` to ``target_height_V``. With an infinite ``period_s``
    the resonator rests at the waveform's start; otherwise it still rings from the ``earlier_drops`` waveforms before.
    The kernel is compiled for each of the two when it is first needed.
    """
    warm_up_periods, one_point, window_s, period_s, *others = settings
    period_s = None if period_s == math.inf else period_s
    return _costs(waveforms, heads, warm_up_periods, one_point, window_s, period_s, *others, capacity, costs)
