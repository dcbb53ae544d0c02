"""Compiled kernels of the drive stage, over signals at nodes."""

from __future__ import annotations

import numpy as np

from inkjet_env.printhead.kernel_cache import kernel_jit

_jit = kernel_jit(__file__)

LEAST_CAPACITANCE = 0.02
"""Capacitance, as a share of that at 0 V, below which there is no solution."""


@_jit
def slew_limited(signal, rise, fall, start, result):
    """Follow a signal that is linear between nodes; returns the last value.

    Per node the value rises by at most ``rise`` and falls by at most ``fall``. Exact at the nodes, even if it catches
    up with the signal, or an edge meets it, between them.
    """
    value = start
    result[0] = value
    for i in range(1, signal.shape[0]):
        before, edge = signal[i - 1], signal[i] - signal[i - 1]
        behind = before - value
        met = 0.0  # fraction of the step after which the signal is met
        if behind > 0.0:
            met = behind / (rise - edge) if behind < rise - edge else 1.0
            value += rise * met
        elif behind < 0.0:
            met = -behind / (fall + edge) if -behind < fall + edge else 1.0
            value -= fall * met
        if met < 1.0:
            value = signal[i] if -fall <= edge <= rise else value + (rise if edge > 0.0 else -fall) * (1.0 - met)
        result[i] = value
    return value


@_jit
def softly_slewed(signal, rise, fall, lag, start, result):
    """Follow a signal, linear between nodes, as ``u' = S tanh((signal - u) / (S lag))``; returns the last value.

    S, the largest change per node, is ``rise`` below the signal and ``fall`` above it; ``lag`` is in nodes. Solved by
    quadrature, accurate to rounding.
    """
    value = start
    result[0] = value
    for i in range(1, signal.shape[0]):
        behind, edge = signal[i - 1] - value, signal[i] - signal[i - 1]
        if behind != 0.0 or edge != 0.0:
            most = rise if behind > 0.0 or (behind == 0.0 and edge > 0.0) else fall
            reach = most * lag
            x, slope, time = behind / reach, edge / most, most / reach
            if rise != fall and x * slope < 0.0:
                met = _time_to_meet(x, slope)
                if met < time:  # the signal crosses the value, whose limit changes there
                    x, time = 0.0, time - met
                    most = fall if most == rise else rise
                    reach, slope = most * lag, edge / most
            value = signal[i] - reach * _behind(x, slope, time)
        result[i] = value
    return value


@_jit
def _time_to_meet(x, edge):
    """Time at which the solution of ``x' = edge - tanh x`` is 0, for an edge of the opposite sign to x."""
    if abs(abs(edge) - 1.0) < 1e-7:
        edge += 2e-7
    return (_primitive(0.0, edge) - _primitive(x, edge)) / (edge * edge - 1.0)


@_jit
def _behind(x, edge, time):
    """Solution x of ``x' = edge - tanh x`` after a time: where ``∫ dx / (edge - tanh x)`` equals that time."""
    if abs(abs(edge) - 1.0) < 1e-7:
        edge += 2e-7  # two terms of the primitive grow without bound there and cancel
    rate = edge - np.tanh(x)
    goal = np.arctanh(edge) if abs(edge) < 1.0 else np.copysign(np.inf, edge)
    if rate == 0.0 or abs(goal - x) < 1e-13 * (1.0 + abs(goal)):
        return goal if abs(edge) < 1.0 else x + rate * time
    begun = _primitive(x, edge)
    slope = 1.0 - np.tanh(x) ** 2
    last, now = x, x + rate * (-np.expm1(-slope * time) / slope if slope * time > 1e-9 else time)
    for _ in range(60):
        if (goal - now) * rate <= 0.0:  # beyond the rest position
            now = 0.5 * (last + goal)
        if abs(goal - now) < 1e-13 * (1.0 + abs(goal)):
            return goal
        step = ((_primitive(now, edge) - begun) / (edge * edge - 1.0) - time) * (edge - np.tanh(now))
        last = now
        now -= step
        if abs(step) < 1e-13 * (1.0 + abs(now)):
            break
    return now


@_jit
def _primitive(x, edge):
    """Primitive of ``(edge² - 1) / (edge - tanh x)`` with respect to x."""
    s = 1.0 if x > 0.0 else -1.0
    return edge * x + abs(x) + np.log(0.5 * abs(edge - s + (edge + s) * np.exp(-2.0 * abs(x))))


@_jit
def charged(signal, lag, slope, branch, curvature, start, result):
    """Voltage of a nonlinear capacitance behind a resistance; returns the last value, NaN if a capacitance is negative.

    ``lag c(u) u' = signal - u`` with ``c = 1 + slope u ± branch u + curvature u²``, + while u rises. A step is that of
    a constant capacitance, the one in the middle of the step: exact for a constant one, otherwise of second order.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Voltage of the source at the nodes, in volts, linear between them.
    lag : float
        Time constant at 0 V, in nodes; above 0.
    slope, branch, curvature : float
        Relative change of the capacitance, in 1/V, 1/V and 1/V².
    start : float
        Voltage at the first node, in volts.
    result : ndarray, shape (n,)
        Filled with the voltage at the nodes, in volts.
    """
    value = start
    result[0] = value
    for i in range(1, signal.shape[0]):
        before, after = signal[i - 1], signal[i]
        middle = value
        end = value
        for _ in range(2):
            c = 1.0 + (slope + (branch if after > middle else -branch) + curvature * middle) * middle
            if c <= LEAST_CAPACITANCE:
                return np.nan
            z = 1.0 / (lag * c)
            kept = np.exp(-z)
            new = 1.0 - (1.0 - kept) / z if z > 1e-4 else z / 2.0 - z * z / 6.0
            end = kept * value + (1.0 - kept - new) * before + new * after
            middle = 0.5 * (value + end)
        value = end
        result[i] = value
    return value
