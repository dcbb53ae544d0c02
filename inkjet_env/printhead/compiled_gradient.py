"""Exact gradient of the peak cost with respect to the seven waveform parameters, compiled.

A peak is stationary in time, so its value changes with a parameter as the response does at a fixed time (envelope
theorem). On a branch piece that starts at ``s`` and lasts ``T``, the drive adds ``c ∫ e^{λ(t - s - Tσ)} q(σ) dσ`` to
the complex amplitude (Eq. (8b) of `resonator`). Its derivative is again a sum of moments:

    c ∫ e^{λ(t - s - Tσ)} (∂q - λ (∂s + σ ∂T) q) dσ.                                                (8c)

With the fraction of an edge held fixed, ``q = scale · Δx · Q'(x₀ + Δx σ)`` depends on U1 and U2 through the drive and
the origin of the branch. Where two pieces meet inside an edge, Q' is continuous, so the boundary contributes nothing.
The peaks of a ring-down share one amplitude. A drive with the period T rings at its start with
``e^{λ(T - D)} A(D) / (1 - e^{λT})``, where A(D) is the amplitude at its end D after a start at rest; the derivative
follows the same formula.
"""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.printhead.compiled import branch_pieces, peak_cost, response_extrema, start_in_train, waveform_knots
from inkjet_env.printhead.compiled_edges import (
    FAST,
    HEAD_A0,
    HEAD_A1,
    HEAD_B1,
    HEAD_FULL_SCALE,
    MAX_DEGREE,
    OVERFLOW,
    SERIES_TERMS,
    piece_rate,
)
from inkjet_env.printhead.kernel_cache import kernel_jit

_jit = kernel_jit(__file__, fastmath=FAST)


@_jit
def moments(z, count, result):
    """Fill ``result`` with ``m_k(z) = ∫₀¹ e^{z(1-s)} s^k ds`` for k = 0 … count - 1; see `resonator.moments`."""
    forward = 0 if abs(z) < 1.0 else min(int(abs(z)) + 1, count)
    if forward > 0:
        total = (np.exp(z) - 1.0) / z
        result[0] = total
        for k in range(1, forward):
            total = (k * total - 1.0) / z
            result[k] = total
    if forward < count:
        term = 1.0 / count + 0j
        total = term
        j = 0
        while abs(term) * count > 1e-18:
            j += 1
            term = term * z / (count + j)
            total += term
        result[count - 1] = total
        for k in range(count - 1, forward, -1):
            total = (z * total + 1.0) / k
            result[k - 1] = total


@_jit
def _forced_sensitivity(head, pole, gain, duration, rate, n, rate_by, start_by, duration_by, tau, moment, result):
    """Fill ``result`` (7,) with the derivatives of the amplitude, Eq. (8c), at fraction ``tau`` of a piece."""
    moments(pole * duration * tau, n + 1, moment)
    plain, weighted = 0j, 0j
    power = 1.0
    for k in range(n):
        power *= tau
        plain += rate[k] * power * moment[k]
        weighted += rate[k] * power * tau * moment[k + 1]
    for p in range(7):
        result[p] = -gain * pole * (start_by[p] * plain + duration_by[p] * weighted)  # Eq. (8c), ∂s and ∂T
    for p in range(2):
        power = 1.0
        total = 0j
        for k in range(n):
            power *= tau
            total += rate_by[p, k] * power * moment[k]
        result[p] += gain * total  # Eq. (8c), ∂q


@_jit
def _rate_by_voltage(head, piece, from_by, to_by, origin_by, rate_by, scratch):
    """Fill ``rate_by`` (2, degree) with ∂(dv/dτ)/∂(U1, U2) on a branch piece; return its number of coefficients.

    ``from_by`` and ``to_by`` (2,) are the derivatives of the drive at the ends of the edge, ``origin_by`` (2,) those of
    the branch's turning point.
    """
    at, length, x, dx, scale = piece[1], piece[2], piece[3], piece[4], piece[5]
    full_scale = head[HEAD_FULL_SCALE]
    heading = 1.0 if scale > 0.0 else -1.0
    stretch = abs(full_scale / scale) * heading / full_scale  # dx/du; twice as large on the virgin curve
    n = piece_rate(head, x, 1.0, 1.0, scratch)  # Q' about x
    curved = n > 1
    count = n if curved else 1
    for p in range(2):
        x_by = stretch * (from_by[p] * (1.0 - at) + to_by[p] * at - origin_by[p])
        dx_by = stretch * (to_by[p] - from_by[p]) * length
        power = 1.0
        for k in range(count):
            # scale (Q'' · (x_by + dx_by σ) Δx + Q' dx_by), coefficient of σ^k
            term = scratch[k] * power * dx_by * (k + 1.0)
            if k + 1 < n:
                term += (k + 1.0) * scratch[k + 1] * power * dx * x_by
            rate_by[p, k] = scale * term
            power *= dx
    return count


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
    target_height_V, capacity, costs, gradients,
):  # fmt: skip
    """Peak cost and its gradient (n, 7) with respect to the waveform parameters; False if capacity was too small."""
    knots_s, knots_V = np.empty(6), np.empty(6)
    memory, pieces = np.empty(32), np.empty((40, 6))
    rate, series, stack = np.empty(MAX_DEGREE), np.empty(SERIES_TERMS + 2), np.empty((64, 4))
    rate_by, scratch = np.empty((2, MAX_DEGREE)), np.empty(MAX_DEGREE)
    times, peaks = np.empty(capacity), np.empty(capacity)
    moment = np.empty(MAX_DEGREE + 1, dtype=np.complex128)
    forced_by, amplitude_by = np.empty(7, dtype=np.complex128), np.empty(7, dtype=np.complex128)
    start_by, duration_by = np.empty(7), np.empty(7)
    knot_by = np.zeros((6, 2))  # derivatives of the drive at each knot with respect to U1, U2
    knot_by[1, 0] = knot_by[2, 0] = knot_by[3, 1] = knot_by[4, 1] = 1.0
    fixed_origin = np.zeros(2)
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
        pole_re = -0.5 * head[HEAD_A1]
        omega0 = math.sqrt(head[HEAD_A0])
        pole = complex(pole_re, math.sqrt((omega0 + pole_re) * (omega0 - pole_re)))
        gain = head[HEAD_B1] / pole.imag
        gradients[i, :] = 0.0
        amplitude_by[:] = 0.0
        peak = 0
        index = 0
        for segment in range(6):  # the last one is the final ring-down
            whole = knots_s[segment + 1] - knots_s[segment] if segment < 5 else math.inf
            more = True
            while more:
                forced = segment < 5 and index < found and int(pieces[index, 0]) == segment
                start, duration, n = knots_s[segment], whole, 0
                if forced:
                    piece = pieces[index]
                    start += piece[1] * whole
                    duration = piece[2] * whole
                    if (segment == 0 and warm_up_periods == 0) or abs(piece[5]) < head[HEAD_FULL_SCALE]:
                        origin_by = fixed_origin  # origin at 0 V: the first sample, or the virgin curve
                    elif piece[5] > 0.0:
                        origin_by = knot_by[3]
                    else:
                        origin_by = knot_by[1]
                    n = _rate_by_voltage(
                        head, piece, knot_by[segment], knot_by[segment + 1], origin_by, rate_by, scratch
                    )
                    piece_rate(head, piece[3], piece[4], piece[5], rate)
                    for p in range(7):
                        earlier = 1.0 if 2 <= p < 2 + segment else 0.0
                        mine = 1.0 if p == 2 + segment else 0.0
                        start_by[p] = earlier + piece[1] * mine
                        duration_by[p] = piece[2] * mine
                while peak < count and times[peak] < start + duration:
                    since = times[peak] - start
                    step = np.exp(pole * since)
                    if forced:
                        _forced_sensitivity(
                            head, pole, gain, duration, rate, n, rate_by, start_by, duration_by,
                            since / duration, moment, forced_by,
                        )  # fmt: skip
                    weight = _slope_of_cost(peaks, peak, e, A, B, target_height_V)
                    for p in range(7):
                        change = (amplitude_by[p] * step).imag
                        if forced:
                            change += forced_by[p].imag
                        gradients[i, p] += weight * change
                    peak += 1
                if segment < 5:
                    step = np.exp(pole * duration)
                    for p in range(7):
                        amplitude_by[p] *= step
                    if forced:
                        _forced_sensitivity(
                            head, pole, gain, duration, rate, n, rate_by, start_by, duration_by, 1.0, moment, forced_by
                        )
                        for p in range(7):
                            amplitude_by[p] += forced_by[p]
                        index += 1
                more = segment < 5 and index < found and int(pieces[index, 0]) == segment
        if period_s < math.inf:
            left = np.exp(pole * (period_s - knots_s[5])) / (1.0 - np.exp(pole * period_s))
            if earlier_drops < math.inf:
                left *= 1.0 - np.exp(pole * (earlier_drops * period_s))
            for k in range(count):
                weight = _slope_of_cost(peaks, k, e, A, B, target_height_V)
                step = left * np.exp(pole * times[k])
                for p in range(7):
                    gradients[i, p] += weight * (amplitude_by[p] * step).imag
    return True
