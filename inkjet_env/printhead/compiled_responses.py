"""Compiled loops over waveforms: peak costs with their gradients, responses at given times, and their derivatives.

Users call `batch` and `inkjet_env.torch`, not this module.
"""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.printhead.compiled import branch_pieces, peak_cost, response_extrema, start_in_train, waveform_knots
from inkjet_env.printhead.compiled_edges import (
    FAST,
    HEAD_B1,
    HEAD_FULL_SCALE,
    MAX_DEGREE,
    OVERFLOW,
    SERIES_TERMS,
    piece_rate,
)
from inkjet_env.printhead.compiled_gradient import moments, pole_of, pull_back, scratch_of_pull_back
from inkjet_env.printhead.kernel_cache import kernel_jit

_jit = kernel_jit(__file__, fastmath=FAST)


@_jit
def _slope_of_cost(peaks, k, e, A, B, target_height_V):
    """Derivative of the cost, Eq. (9) of `cost`, with respect to the signed height of peak k; peak e is effective."""
    weight = 1.0
    if k == e:
        weight = A if abs(peaks[k]) < target_height_V else 0.0
    elif e >= 0 and k == e + 1:
        weight = B
    return -weight if peaks[k] < 0.0 else weight


@_jit
def batch_costs_and_gradients(
    waveforms, heads, warm_up_periods, one_point, window_s, period_s, earlier_drops, A, B, effective, threshold,
    target_height_V, capacity, costs, gradients, head_gradients,
):  # fmt: skip
    """Peak cost of each waveform and its gradient (n, 7) in the waveform; False if ``capacity`` was too small.

    ``head_gradients``, shape (n, HEAD_PARAMETERS), is filled with that in the head, unless it is (n, 0).
    """
    knots_s, knots_V = np.empty(6), np.empty(6)
    memory, pieces = np.empty(32), np.empty((40, 6))
    rate, series, stack = np.empty(MAX_DEGREE), np.empty(SERIES_TERMS + 2), np.empty((64, 4))
    times, peaks, weights = np.empty(capacity), np.empty(capacity), np.empty(capacity)
    scratch = scratch_of_pull_back()
    state, no_knots = np.empty(2), np.empty(0)
    for i in range(waveforms.shape[0]):
        head = heads[i if heads.shape[0] > 1 else 0]
        waveform_knots(waveforms[i], knots_s, knots_V)
        found = branch_pieces(knots_V, head[HEAD_FULL_SCALE], warm_up_periods, one_point, memory, pieces)
        state[:] = 0.0
        if period_s < math.inf and not start_in_train(
            head, knots_s, pieces, found, period_s, earlier_drops, state, rate, series, stack, times, peaks, no_knots
        ):
            return False
        count, tail = response_extrema(
            head, knots_s, pieces, found, window_s, state, rate, series, stack, times, peaks, no_knots
        )
        if count == OVERFLOW:
            return False
        costs[i], e = peak_cost(peaks, count, tail, A, B, effective, threshold, target_height_V)
        for k in range(count):
            weights[k] = _slope_of_cost(peaks, k, e, A, B, target_height_V)
        pull_back(
            head, knots_s, pieces, found, warm_up_periods, period_s, earlier_drops, times, weights, count, scratch,
            gradients[i], head_gradients[i],
        )  # fmt: skip
    return True


@_jit
def forced(pole, duration, rate, n, tau, moment):
    """The sum of Eq. (8b) at fraction ``tau`` of a piece, in volts."""
    moments(pole * duration * tau, n, moment)
    total = 0j
    power = 1.0
    for k in range(n):
        power *= tau
        total += rate[k] * power * moment[k]
    return total


@_jit
def batch_responses(waveforms, heads, warm_up_periods, one_point, period_s, earlier_drops, times, responses):
    """Fill ``responses`` (n, k) in volts at ascending ``times`` (k,) ≥ 0: the amplitude, Eq. (8b) of `resonator`."""
    knots_s, knots_V = np.empty(6), np.empty(6)
    memory, pieces, rate = np.empty(32), np.empty((40, 6)), np.empty(MAX_DEGREE)
    moment = np.empty(MAX_DEGREE, dtype=np.complex128)
    for i in range(waveforms.shape[0]):
        head = heads[i if heads.shape[0] > 1 else 0]
        waveform_knots(waveforms[i], knots_s, knots_V)
        found = branch_pieces(knots_V, head[HEAD_FULL_SCALE], warm_up_periods, one_point, memory, pieces)
        pole = pole_of(head)
        gain = head[HEAD_B1] / pole.imag
        amplitude = 0j
        done = 0
        index = 0
        for segment in range(6):  # the last one is the final ring-down
            whole = knots_s[segment + 1] - knots_s[segment] if segment < 5 else math.inf
            more = True
            while more:
                is_forced = segment < 5 and index < found and int(pieces[index, 0]) == segment
                start, duration, n = knots_s[segment], whole, 0
                if is_forced:
                    start += pieces[index, 1] * whole
                    duration = pieces[index, 2] * whole
                    n = piece_rate(head, pieces[index, 3], pieces[index, 4], pieces[index, 5], rate)
                while done < times.shape[0] and times[done] < start + duration:
                    value = amplitude * np.exp(pole * (times[done] - start))
                    if is_forced:
                        value += gain * forced(pole, duration, rate, n, (times[done] - start) / duration, moment)
                    responses[i, done] = value.imag
                    done += 1
                if segment < 5:
                    amplitude *= np.exp(pole * duration)
                    if is_forced:
                        amplitude += gain * forced(pole, duration, rate, n, 1.0, moment)
                        index += 1
                more = segment < 5 and index < found and int(pieces[index, 0]) == segment
        if period_s < math.inf:
            left = amplitude * np.exp(pole * (period_s - knots_s[5])) / (1.0 - np.exp(pole * period_s))
            if earlier_drops < math.inf:
                left *= 1.0 - np.exp(pole * (earlier_drops * period_s))
            for k in range(times.shape[0]):
                responses[i, k] += (left * np.exp(pole * times[k])).imag


@_jit
def batch_pull_back(
    waveforms, heads, warm_up_periods, one_point, period_s, earlier_drops, times, weights, gradients, head_gradients
):
    """`pull_back` of each waveform with its row of ``weights`` (n, k) at common ``times`` (k,)."""
    knots_s, knots_V = np.empty(6), np.empty(6)
    memory, pieces = np.empty(32), np.empty((40, 6))
    scratch = scratch_of_pull_back()
    for i in range(waveforms.shape[0]):
        head = heads[i if heads.shape[0] > 1 else 0]
        waveform_knots(waveforms[i], knots_s, knots_V)
        found = branch_pieces(knots_V, head[HEAD_FULL_SCALE], warm_up_periods, one_point, memory, pieces)
        pull_back(
            head, knots_s, pieces, found, warm_up_periods, period_s, earlier_drops, times, weights[i], times.shape[0],
            scratch, gradients[i], head_gradients[i],
        )  # fmt: skip
