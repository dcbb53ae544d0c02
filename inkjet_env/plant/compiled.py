"""Compiled kernels of the plant, over signals at nodes."""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from inkjet_env.printhead.compiled import branch_pieces
from inkjet_env.printhead.compiled_gradient import moments as fill_moments
from inkjet_env.printhead.kernel_cache import kernel_jit

_jit = kernel_jit(__file__)


@_jit
def hysteretic_levels(drive_V, full_scale_V, laws, periodic, memory, pieces, levels):
    """Hysteretic drive at every node, for several branch laws.

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
        Drive in volts, linear between nodes; if periodic, the first node again at its end.
    full_scale_V : float
        Change of drive at ``x = 1``, in volts.
    laws : ndarray, shape (k, d + 1)
        Coefficients of each law, lowest power first.
    periodic : bool
        Whether the drive has been repeated; otherwise it starts from the demagnetised state.
    memory, pieces : ndarray, shapes (≥ 2 n + 2,), (≥ 4 n + 32, 6)
        Scratch for `branch_pieces`.
    levels : ndarray, shape (n, k)
        Filled with the hysteretic drive, in volts.
    """
    x = 2.0 * abs(drive_V[0]) / full_scale_V
    for j in range(laws.shape[0]):
        virgin = _branch(laws[j], x) * 0.5 * full_scale_V
        levels[0, j] = virgin if drive_V[0] >= 0.0 else -virgin
    last = drive_V.shape[0] - 1
    for period in range(2 if periodic else 1):
        if period > 0:
            levels[0] = levels[last]
        count = branch_pieces(drive_V, full_scale_V, period, False, memory, pieces)
        at = 0
        for node in range(1, last + 1):
            levels[node] = levels[node - 1]
            while at < count and pieces[at, 0] == node - 1:
                x, dx, scale = pieces[at, 3], pieces[at, 4], pieces[at, 5]
                for j in range(laws.shape[0]):
                    levels[node, j] += scale * (_branch(laws[j], x + dx) - _branch(laws[j], x))
                at += 1


@_jit
def _branch(law, x):
    inside = min(x, 1.0)
    value, slope = 0.0, 0.0
    for k in range(law.shape[0] - 1, -1, -1):
        slope = slope * inside + value
        value = value * inside + law[k]
    return value + slope * (x - inside)


@_jit
def linear_motion(forcing_V, pole, gain, step_s, pairs, start, deflection, speed):
    """Motion under a forcing that is quadratic between every second node; returns the last amplitude.

    Parameters
    ----------
    forcing_V : ndarray, shape ((m - 1) · 2 · pairs + 1,)
        Forcing at the nodes, in hysteretic volts.
    pole, gain : complex, float
        λ and ``a0 / ω_d`` of Eq. (11a) of `inkjet_env.plant.oscillator`, in 1/s.
    step_s : float
        Step of the motion, from a node to the second next, in seconds.
    pairs : int
        Number of such steps per sample.
    start : complex
        Amplitude at the first node, in hysteretic volts.
    deflection, speed : ndarray, shape (m,)
        Filled with the deflection in volts and its speed in V/s at the samples.

    Returns
    -------
    complex
        Amplitude at the last node, in hysteretic volts.
    """
    decay = np.exp(pole * step_s)
    m = np.empty(3, dtype=np.complex128)
    fill_moments(pole * step_s, 3, m)
    scale = gain * step_s
    # Weights of the three nodes of a step.
    first = scale * (m[0] - 3.0 * m[1] + 2.0 * m[2])
    middle = scale * (4.0 * m[1] - 4.0 * m[2])
    last = scale * (2.0 * m[2] - m[1])
    state = start
    deflection[0], speed[0] = state.imag, (pole * state).imag
    at = 0
    for i in range(1, deflection.shape[0]):
        for _ in range(pairs):
            # Eq. (11a), integrated over a step.
            state = state * decay + (first * forcing_V[at] + middle * forcing_V[at + 1] + last * forcing_V[at + 2])
            at += 2
        deflection[i], speed[i] = state.imag, (pole * state).imag
    return state


@intrinsic
def _force(typing_context, law, x_V, speed_V, values):
    """Call a law compiled by `compiled_force` at its address, with values at theirs: addresses are numbers and cost
    nothing to pass, whereas a function as an argument costs 70 µs per call of the kernel."""

    def call(context, builder, signature, arguments):
        number = ir.DoubleType()
        law_type = ir.FunctionType(number, [number, number, number.as_pointer()])
        law = builder.inttoptr(arguments[0], law_type.as_pointer())
        values = builder.inttoptr(arguments[3], number.as_pointer())
        return builder.call(law, [arguments[1], arguments[2], values])

    return types.float64(types.int64, types.float64, types.float64, types.int64), call


@_jit
def pushed(forces, x_V, speed_V):
    """Sum in hysteretic volts of all forces that depend on the motion; ``forces`` as in `forced_motion`."""
    total = 0.0
    for k in range(forces.shape[0]):
        total += _force(forces[k, 0], x_V, speed_V, forces[k, 1])  # type: ignore[call-arg]
    return total


@_jit
def forced_motion(
    forcing_V, pole, gain, omega0, step_s, pairs, start, forces, softening, stiffness, past, deflection, speed
):
    """`linear_motion` with forces that depend on the motion and a stiffness that depends on time.

    The forces are taken as quadratic in time through three points: the previous step, the start of the step, and its
    end, where the motion is predicted with the line through the two former. One evaluation per step gives third order.

    Parameters
    ----------
    forcing_V, pole, gain, step_s, pairs, start, deflection, speed
        As in `linear_motion`.
    omega0 : float
        ``√a0``, in 1/s.
    forces : ndarray of int64, shape (k, 2)
        Addresses of each law and of its values.
    softening : ndarray, shape (nodes,) or (0,)
        Relative change of stiffness at the nodes.
    stiffness : float
        Stiffness of the spring that softens over the one that the forcing acts against.
    past : ndarray, shape (2,)
        Sum of the forces in hysteretic volts one step before the start and at the start; on return, at the end.

    Returns
    -------
    complex
        Amplitude at the last node, in hysteretic volts; NaN if the motion grows without bound.
    """
    decay = np.exp(pole * step_s)
    m = np.empty(3, dtype=np.complex128)
    fill_moments(pole * step_s, 3, m)
    scale = gain * step_s
    first = scale * (m[0] - 3.0 * m[1] + 2.0 * m[2])
    middle = scale * (4.0 * m[1] - 4.0 * m[2])
    last = scale * (2.0 * m[2] - m[1])
    whole, ramp, bend = scale * m[0], scale * m[1], 0.5 * scale * (m[1] + m[2])
    soft = softening.shape[0] > 0
    state = start
    deflection[0], speed[0] = state.imag, (pole * state).imag
    inverse = 1.0 / omega0
    earlier, now = past[0], past[1]
    at = 0
    for i in range(1, deflection.shape[0]):
        for _ in range(pairs):
            # Eq. (11a), integrated over a step.
            state = state * decay + (first * forcing_V[at] + middle * forcing_V[at + 1] + last * forcing_V[at + 2])
            state -= whole * now + ramp * (now - earlier)
            at += 2
            x, p = state.imag, (pole * state).imag * inverse
            after = pushed(forces, x, p)
            if soft:
                after += stiffness * softening[at] * x
            state -= bend * (after - 2.0 * now + earlier)
            earlier, now = now, after
        deflection[i], speed[i] = state.imag, (pole * state).imag
        if not abs(state.imag) < 1e9:
            return complex(np.nan, np.nan)
    past[0], past[1] = earlier, now
    return state


@_jit
def lagged(signal, keep, old, new, start, result):
    """First-order lag of a signal that is linear between nodes; returns the last value."""
    value = start
    result[0] = value
    for i in range(1, signal.shape[0]):
        value = keep * value + old * signal[i - 1] + new * signal[i]
        result[i] = value
    return value


@_jit
def returned(signal, whole, weights, ends, lag, period, periodic, result):
    """Delay a signal by a weighted sum of four consecutive samples, then apply the lag once for each end.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Signal at the samples.
    whole : int
        Whole part of the delay, in samples: the first of the four is ``whole + 2`` before.
    weights : ndarray, shape (4,)
        Weights of the four samples.
    ends : int
        Number of reflections, each with its lag.
    lag : tuple of float
        Weights of the lag, from `inkjet_env.plant.lag.lag_weights`.
    period : float
        Share of a change of the lagged value that decays over one period, from `inkjet_env.plant.lag.lap_loss`.
    periodic : bool
        Whether the sample after the last is the first; otherwise the signal is held at both ends.
    result : ndarray, shape (n,)
        Filled with the delayed signal.
    """
    n = signal.shape[0]
    for i in range(n):
        first = i - whole - 2
        if periodic:
            first %= n
        total = 0.0
        for k in range(4):
            at = first + k
            if periodic:
                at -= n if at >= n else 0
            else:
                at = min(max(at, 0), n - 1)
            total += weights[k] * signal[at]
        result[i] = total
    keep, old, new = lag
    for _ in range(ends):
        value = result[0]
        if periodic:
            value = 0.0
            for i in range(1, n + 1):
                value = keep * value + old * result[i - 1] + new * result[i if i < n else 0]
            value /= period
        before, result[0] = result[0], value
        for i in range(1, n):
            value = keep * value + old * before + new * result[i]
            before, result[i] = result[i], value


@_jit
def extrema(signal, flat, times, values):
    """Find the local extrema of a signal, see `inkjet_env.plant.extrema`; returns their number.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Signal at the samples.
    flat : float
        Smallest change from sample to sample that counts, as a share of the largest magnitude.
    times, values : ndarray, shape (≥ n,)
        Filled with times in samples and values in the unit of the signal.
    """
    n = signal.shape[0]
    largest = 0.0
    for i in range(n):
        largest = max(largest, abs(signal[i]))
    count, before, rose = 0, -1, False
    for i in range(n - 1):
        rise = signal[i + 1] - signal[i]
        if not abs(rise) > flat * largest:
            continue
        rises = rise > 0.0
        if before >= 0 and rises != rose:
            first, last = before + 1, i  # samples between which the signal is flat
            at = (first + last) // 2
            slope, bend, shift = 0.5 * (signal[at + 1] - signal[at - 1]), _bend(signal, at), 0.0
            if first == last and bend != 0.0:
                shift = -slope / bend
            gentlest = min(abs(_bend(signal, at - 1)), abs(bend), abs(_bend(signal, at + 1))) / 8.0
            times[count] = 0.5 * (first + last) + shift
            values[count] = signal[at] + min(max(slope * shift / 2.0, -gentlest), gentlest)
            count += 1
        before, rose = i, rises
    return count


@_jit
def _bend(signal, at):
    """Second difference at a sample; at either end, that of its neighbour."""
    at = min(max(at, 1), signal.shape[0] - 2)
    return (signal[at + 1] - signal[at]) - (signal[at] - signal[at - 1])


@_jit
def stepped(keep, gained, lead, state, result):
    """Iterate the states ``x ← keep x + gained`` and record the first of them, and ``lead`` times the second.

    Parameters
    ----------
    keep : ndarray, shape (k, k), k 1 or 2
        Transition matrix of a step.
    gained : ndarray, shape (n, k)
        Input of each step.
    lead : float
        Weight of the second state in the record, where there is one.
    state : ndarray, shape (k,)
        State at the start; on return, at the end.
    result : ndarray, shape (n + 1,)
        Filled from the start to the end.
    """
    if state.shape[0] == 1:
        result[0] = state[0]
        y = state[0]
        for i in range(gained.shape[0]):
            y = keep[0, 0] * y + gained[i, 0]
            result[i + 1] = y
        state[0] = y
        return
    y, w = state[0], state[1]
    result[0] = y + lead * w
    for i in range(gained.shape[0]):
        y, w = keep[0, 0] * y + keep[0, 1] * w + gained[i, 0], keep[1, 0] * y + keep[1, 1] * w + gained[i, 1]
        result[i + 1] = y + lead * w
    state[0], state[1] = y, w
