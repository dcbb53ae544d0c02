"""Exact gradients of the response and of the peak cost, compiled: in the waveform's parameters and in the head's.

`pull_back` differentiates a weighted sum of the response at given times. A peak is stationary in time, so its value
changes with a parameter as the response does at a fixed time (envelope theorem), and the same function differentiates
the peak cost.

On a branch piece that starts at ``s`` and lasts ``T``, the drive adds ``c ∫ e^{λ(t - s - Tσ)} q(σ) dσ`` to the complex
amplitude (Eq. (8b) of `resonator`). Its derivative is again a sum of moments:

    c ∫ e^{λ(t - s - Tσ)} (∂q - λ (∂s + σ ∂T) q) dσ.                                                (8c)

With the fraction of an edge held fixed, ``q = scale · Δx · Q'(x₀ + Δx σ)`` depends on U1 and U2 through the drive and
the origin of the branch. Where two pieces meet inside an edge, Q' is continuous, so the boundary contributes nothing.
A drive with the period T rings at its start with ``e^{λ(T - D)} A(D) / (1 - e^{λT})``, where A(D) is the amplitude at
its end D after a start at rest; the derivative follows the same formula.

The amplitude is ``c S`` with ``c = b1 / Im λ``, and S is linear in the coefficients of Q. The derivatives in the
resonator's coefficients follow from S and ``∂S/∂λ``, on a piece

    ∂S/∂λ = T Σ q_k τ^{k+2} (m_k - m_{k+1})(λTτ),                                                  (8d)

after a time t ``e^{λt} (∂S/∂λ + t S)``.
"""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.printhead.compiled_edges import (
    FAST,
    HEAD_A0,
    HEAD_A1,
    HEAD_B1,
    HEAD_DEGREE,
    HEAD_FULL_SCALE,
    MAX_DEGREE,
    piece_rate,
)
from inkjet_env.printhead.kernel_cache import kernel_jit

WAVEFORM = 7
"""Number of waveform parameters, ``U1 U2 t1 … t5``."""
HEAD_PARAMETERS = 3 + MAX_DEGREE
"""Columns of a gradient in the head's parameters: ``a0 a1 b1``, then the coefficients of Q, lowest power first, from 1.
Those above the law's degree are zero."""

_jit = kernel_jit(__file__, fastmath=FAST)


@_jit
def pole_of(head):
    """The pole λ of a row of a head table, in 1/s."""
    pole_re = -0.5 * head[HEAD_A1]
    omega0 = math.sqrt(head[HEAD_A0])
    return complex(pole_re, math.sqrt((omega0 + pole_re) * (omega0 - pole_re)))


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
def _forced_sensitivity(pole, gain, duration, rate, n, rate_by, start_by, duration_by, tau, moment, result):
    """Fill ``result`` (7,) with the derivatives of the amplitude, Eq. (8c), at fraction ``tau`` of a piece.

    ``moment`` holds the moments of ``λ duration tau``, one more than ``rate`` has coefficients.
    """
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
def _forced_by_head(duration, rate, n, rate_by_law, degree, tau, moment, result):
    """Fill ``result`` with S, ∂S/∂λ, Eq. (8d), and the derivatives of S in the coefficients of Q at ``tau``."""
    plain, delayed = 0j, 0j
    power = 1.0
    for k in range(n):
        power *= tau
        plain += rate[k] * power * moment[k]
        delayed += rate[k] * power * tau * (moment[k] - moment[k + 1])
    result[0] = plain
    result[1] = duration * delayed  # ∂S/∂λ, Eq. (8d)
    for m in range(degree):
        total = 0j
        power = 1.0
        for k in range(min(m + 1, n)):
            power *= tau
            total += rate_by_law[m, k] * power * moment[k]
        result[2 + m] = total


@_jit
def _rate_by_law(x, dx, scale, degree, rate_by_law):
    """Fill row m of ``rate_by_law`` with ∂(dv/dτ)/∂q on a branch piece, q that of x^(m + 1) in ``Q``, Eq. (5).

    It is ``scale dx (m + 1) (x + dx τ)^m``, lowest power of τ first; beyond x = 1 the law is its tangent there.
    """
    for m in range(degree):
        if x >= 1.0:
            rate_by_law[m, 0] = scale * dx * (m + 1.0)
            continue
        term = scale * dx * (m + 1.0)
        for j in range(m, -1, -1):  # binomial: m! / (j! (m - j)!) x^(m - j) dx^j
            choose = 1.0
            for i in range(m - j):
                choose *= (m - i) / (i + 1.0)
            rate_by_law[m, j] = term * choose * x ** (m - j) * dx**j


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
def scratch_of_pull_back():
    """Arrays that `pull_back` overwrites."""
    return (
        np.empty(MAX_DEGREE),
        np.empty(MAX_DEGREE),
        np.empty((2, MAX_DEGREE)),
        np.empty((MAX_DEGREE, MAX_DEGREE)),
        np.empty(MAX_DEGREE + 1, dtype=np.complex128),
        np.empty((2, WAVEFORM), dtype=np.complex128),
        np.empty((3, 2 + MAX_DEGREE), dtype=np.complex128),
        np.empty((2, WAVEFORM)),
    )


@_jit
def pull_back(
    head, knots_s, pieces, found, warm_up_periods, period_s, earlier_drops, times, weights, count, scratch,
    gradient, head_gradient,
):  # fmt: skip
    """Derivatives of ``Σ weights[k] y(times[k])``, the response at fixed times.

    Parameters
    ----------
    head : ndarray, shape (HEAD_COLUMNS,)
        One row of `batch.head_table`.
    knots_s, pieces, found, warm_up_periods
        Knots of the waveform, in seconds, and its branch pieces, from `hysteresis.branch_pieces`.
    period_s, earlier_drops : float
        As in `compiled.batch_costs`.
    times, weights : ndarray, shape (≥ count,)
        Times in seconds, in ascending order and none before the first knot, and their weights.
    count : int
        Number of times in use.
    scratch : tuple
        From `scratch_of_pull_back`.
    gradient : ndarray, shape (7,)
        Filled with the derivatives in the waveform's parameters.
    head_gradient : ndarray, shape (HEAD_PARAMETERS,) or (0,)
        Filled with the derivatives in the head's parameters, unless empty.
    """
    rate, shifted, rate_by, rate_by_law, moment, waveform_by, head_by, times_by = scratch
    amplitude_by, forced_by = waveform_by[0], waveform_by[1]
    state, forced, total = head_by[0], head_by[1], head_by[2]
    start_by, duration_by = times_by[0], times_by[1]
    knot_by = np.zeros((6, 2))  # derivatives of the drive at each knot with respect to U1, U2
    knot_by[1, 0] = knot_by[2, 0] = knot_by[3, 1] = knot_by[4, 1] = 1.0
    fixed_origin = np.zeros(2)
    with_head = head_gradient.shape[0] > 0
    degree = int(head[HEAD_DEGREE])
    pole = pole_of(head)
    gain = head[HEAD_B1] / pole.imag
    gradient[:] = 0.0
    amplitude_by[:] = 0.0
    state[:] = 0.0
    total[:] = 0.0
    done = 0
    index = 0
    for segment in range(6):  # the last one is the final ring-down
        whole = knots_s[segment + 1] - knots_s[segment] if segment < 5 else math.inf
        more = True
        while more:
            is_forced = segment < 5 and index < found and int(pieces[index, 0]) == segment
            start, duration, n = knots_s[segment], whole, 0
            if is_forced:
                piece = pieces[index]
                start += piece[1] * whole
                duration = piece[2] * whole
                if (segment == 0 and warm_up_periods == 0) or abs(piece[5]) < head[HEAD_FULL_SCALE]:
                    origin_by = fixed_origin  # origin at 0 V: the first sample, or the virgin curve
                elif piece[5] > 0.0:
                    origin_by = knot_by[3]
                else:
                    origin_by = knot_by[1]
                n = _rate_by_voltage(head, piece, knot_by[segment], knot_by[segment + 1], origin_by, rate_by, shifted)
                piece_rate(head, piece[3], piece[4], piece[5], rate)
                if with_head:
                    _rate_by_law(piece[3], piece[4], piece[5], degree, rate_by_law)
                for p in range(7):
                    earlier = 1.0 if 2 <= p < 2 + segment else 0.0
                    mine = 1.0 if p == 2 + segment else 0.0
                    start_by[p] = earlier + piece[1] * mine
                    duration_by[p] = piece[2] * mine
            while done < count and times[done] < start + duration:
                since = times[done] - start
                weight = weights[done]
                step = np.exp(pole * since)
                for p in range(7):
                    gradient[p] += weight * (amplitude_by[p] * step).imag
                if with_head:
                    total[1] += weight * step * (state[1] + since * state[0])
                    total[0] += weight * step * state[0]
                    for m in range(degree):
                        total[2 + m] += weight * step * state[2 + m]
                if is_forced:
                    tau = since / duration
                    moments(pole * since, n + 1, moment)
                    _forced_sensitivity(
                        pole, gain, duration, rate, n, rate_by, start_by, duration_by, tau, moment, forced_by
                    )
                    for p in range(7):
                        gradient[p] += weight * forced_by[p].imag
                    if with_head:
                        _forced_by_head(duration, rate, n, rate_by_law, degree, tau, moment, forced)
                        for m in range(2 + degree):
                            total[m] += weight * forced[m]
                done += 1
            if segment < 5:
                step = np.exp(pole * duration)
                for p in range(7):
                    amplitude_by[p] *= step
                if with_head:
                    state[1] = step * (state[1] + duration * state[0])
                    state[0] *= step
                    for m in range(degree):
                        state[2 + m] *= step
                if is_forced:
                    moments(pole * duration, n + 1, moment)
                    _forced_sensitivity(
                        pole, gain, duration, rate, n, rate_by, start_by, duration_by, 1.0, moment, forced_by
                    )
                    for p in range(7):
                        amplitude_by[p] += forced_by[p]
                    if with_head:
                        _forced_by_head(duration, rate, n, rate_by_law, degree, 1.0, moment, forced)
                        for m in range(2 + degree):
                            state[m] += forced[m]
                    index += 1
            more = segment < 5 and index < found and int(pieces[index, 0]) == segment
    if period_s < math.inf and earlier_drops > 0:
        turn = np.exp(pole * period_s)
        left = np.exp(pole * (period_s - knots_s[5])) / (1.0 - turn)
        delay = period_s - knots_s[5] + period_s * turn / (1.0 - turn)  # ∂ ln(left) / ∂λ
        if earlier_drops < math.inf:
            turns = np.exp(pole * (earlier_drops * period_s))
            left *= 1.0 - turns
            delay -= earlier_drops * period_s * turns / (1.0 - turns)
        for k in range(count):
            step = weights[k] * left * np.exp(pole * times[k])
            for p in range(7):
                gradient[p] += (amplitude_by[p] * step).imag
            if with_head:
                total[0] += step * state[0]
                total[1] += step * (state[1] + (delay + times[k]) * state[0])
                for m in range(degree):
                    total[2 + m] += step * state[2 + m]
    if with_head:
        head_gradient[:] = 0.0
        by_a0, by_a1 = 0.5 / pole.imag, -0.25 * head[HEAD_A1] / pole.imag  # ∂ Im λ
        signal = gain * total[0].imag
        head_gradient[0] = gain * (total[1] * 1j * by_a0).imag - signal * by_a0 / pole.imag
        head_gradient[1] = gain * (total[1] * complex(-0.5, by_a1)).imag - signal * by_a1 / pole.imag
        head_gradient[2] = signal / head[HEAD_B1]
        for m in range(degree):
            head_gradient[3 + m] = gain * total[2 + m].imag
