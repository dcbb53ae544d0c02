"""Compiled kernels of the environment: actions to waveforms, waveforms to peaks, readings of peaks to costs.

Users call `task`, not this module.
"""

from __future__ import annotations

import numpy as np

from inkjet_env.printhead import compiled, compiled_edges
from inkjet_env.printhead.kernel_cache import kernel_jit

EDGE = 1.0 + 4.0 * float(np.spacing(np.float32(1.0)))
"""Largest magnitude that is still the bound: 4 roundings in single precision, as rescaling makes, beyond 1."""

_jit = kernel_jit(__file__)


@_jit
def waveforms_of_actions(points, lower, upper, waveforms):
    """Fill waveforms (n, 7) from points (n, 7), as `Bounds.from_unit`; False if one is NaN or beyond `EDGE`."""
    for i in range(points.shape[0]):
        for k in range(points.shape[1]):
            if not abs(points[i, k]) <= EDGE:
                return False
            point = min(max(points[i, k], -1.0), 1.0)
            value = ((1.0 - point) * lower[k] + (1.0 + point) * upper[k]) / 2.0
            waveforms[i, k] = min(max(value, lower[k]), upper[k])
    return True


@_jit
def batch_peaks(waveforms, heads, warm_up_periods, one_point, window_s, times, peaks, counts, tails):
    """Fill times in seconds and signed peaks in volts, (n, capacity) each, of each waveform (n, 7).

    ``counts`` and ``tails`` receive their number and the summed magnitude beyond them, in volts. ``heads`` has 1 or n
    rows. Returns False if ``peaks`` was too narrow.
    """
    knots_s, knots_V = np.empty(6), np.empty(6)
    memory, pieces = np.empty(32), np.empty((40, 6))
    rate, series = np.empty(compiled_edges.MAX_DEGREE), np.empty(compiled_edges.SERIES_TERMS + 2)
    stack = np.empty((64, 4))
    state, no_knots = np.empty(2), np.empty(0)
    for i in range(waveforms.shape[0]):
        state[:] = 0.0
        head = heads[i if heads.shape[0] > 1 else 0]
        compiled.waveform_knots(waveforms[i], knots_s, knots_V)
        found = compiled.branch_pieces(
            knots_V, head[compiled_edges.HEAD_FULL_SCALE], warm_up_periods, one_point, memory, pieces
        )
        counts[i], tails[i] = compiled.response_extrema(
            head, knots_s, pieces, found, window_s, state, rate, series, stack, times[i], peaks[i], no_knots
        )
        if counts[i] == compiled_edges.OVERFLOW:
            return False
    return True


@_jit
def costs_of_readings(readings, counts, tails, A, B, effective, threshold, target_height_V, costs):
    """Fill ``costs`` with the peak cost in volts of the first ``counts`` entries of each row of readings (n, k)."""
    for i in range(readings.shape[0]):
        costs[i], _ = compiled.peak_cost(readings[i], counts[i], tails[i], A, B, effective, threshold, target_height_V)
