"""Compiled figures of merit of arrays of waveforms. Users call `batch.jetting_batch`."""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.printhead.compiled import branch_pieces, peak_cost, response_extrema, waveform_knots
from inkjet_env.printhead.compiled_edges import (
    FAST,
    HEAD_B1,
    HEAD_FULL_SCALE,
    MAX_DEGREE,
    OVERFLOW,
    SERIES_TERMS,
    piece_rate,
)
from inkjet_env.printhead.compiled_gradient import pole_of
from inkjet_env.printhead.compiled_responses import forced
from inkjet_env.printhead.kernel_cache import INTERNAL, kernel_jit

_jit = kernel_jit(__file__, fastmath=FAST)
_internal = kernel_jit(__file__, fastmath=FAST, **INTERNAL)
MOST_STEPS = 100
"""Largest number of steps of the search for the settling time; bisection alone takes 60."""


@_internal
def _amplitude(head, pole, gain, knots_s, pieces, found, time_s, rate, moment):
    """Complex amplitude in volts at a time after the first knot, from rest; Eq. (8b) of `resonator`."""
    amplitude = 0j
    at_s = 0.0
    for index in range(found):
        segment = int(pieces[index, 0])
        whole = knots_s[segment + 1] - knots_s[segment]
        start = knots_s[segment] + pieces[index, 1] * whole
        if start >= time_s:
            break
        duration = pieces[index, 2] * whole
        tau = min((time_s - start) / duration, 1.0)
        n = piece_rate(head, pieces[index, 3], pieces[index, 4], pieces[index, 5], rate)
        amplitude *= np.exp(pole * (start + tau * duration - at_s))
        amplitude += gain * forced(pole, duration, rate, n, tau, moment)
        at_s = start + tau * duration
    return amplitude * np.exp(pole * (time_s - at_s))


@_internal
def _settling_s(head, pole, gain, knots_s, pieces, found, sign, level_V, begin_s, end_s, rate, moment):
    """Time in seconds between two peaks at which ``sign y`` falls to a level: Newton's method within a bracket."""
    low, high = begin_s, end_s
    time_s = begin_s
    for _ in range(MOST_STEPS):
        amplitude = _amplitude(head, pole, gain, knots_s, pieces, found, time_s, rate, moment)
        above = sign * amplitude.imag - level_V
        if above > 0.0:
            low = time_s
        else:
            high = time_s
        if time_s == begin_s and above <= 0.0:
            return begin_s
        slope = sign * (pole * amplitude).imag
        step = -above / slope if slope != 0.0 else math.inf
        following = time_s + step
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - time_s) < 1e-13 or high - low < 1e-13:
            return following
        time_s = following
    return time_s


@_jit
def batch_figures(
    waveforms, heads, warm_up_periods, one_point, window_s, A, B, effective, threshold, settled, capacity, figures
):
    """Fill ``figures`` (n, 4) with those of `figures_of_merit.Jetting`; False if ``capacity`` was too small."""
    knots_s, knots_V = np.empty(6), np.empty(6)
    memory, pieces = np.empty(32), np.empty((40, 6))
    rate, series, stack = np.empty(MAX_DEGREE), np.empty(SERIES_TERMS + 2), np.empty((64, 4))
    moment = np.empty(MAX_DEGREE, dtype=np.complex128)
    times, peaks = np.empty(capacity), np.empty(capacity)
    state, no_knots = np.empty(2), np.empty(0)
    for i in range(waveforms.shape[0]):
        state[:] = 0.0
        head = heads[i if heads.shape[0] > 1 else 0]
        waveform_knots(waveforms[i], knots_s, knots_V)
        found = branch_pieces(knots_V, head[HEAD_FULL_SCALE], warm_up_periods, one_point, memory, pieces)
        count, _ = response_extrema(
            head, knots_s, pieces, found, window_s, state, rate, series, stack, times, peaks, no_knots
        )
        if count == OVERFLOW:
            return False
        _, e = peak_cost(peaks, count, 0.0, A, B, effective, threshold, math.inf)
        if e < 0 or peaks[e] == 0.0:
            figures[i, :] = math.nan
            continue
        largest = abs(peaks[e])
        residual = 0.0
        last = 0
        for k in range(count):
            if k > e:
                residual = max(residual, abs(peaks[k]))
            if abs(peaks[k]) >= settled * largest:
                last = k
        settling_s = math.inf  # the last peak in the window is still large, so settling is not observed
        if last < count - 1:
            pole = pole_of(head)
            settling_s = _settling_s(
                head, pole, head[HEAD_B1] / pole.imag, knots_s, pieces, found, math.copysign(1.0, peaks[last]),
                settled * largest, times[last], times[last + 1], rate, moment,
            )  # fmt: skip
        figures[i, 0], figures[i, 1], figures[i, 2] = largest, residual, settling_s
        figures[i, 3] = 1.0 / max(settling_s, knots_s[5])
    return True
