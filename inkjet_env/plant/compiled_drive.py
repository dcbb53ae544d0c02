"""Compiled kernels of the drive stage, over signals at nodes."""

from __future__ import annotations

import numpy as np

from inkjet_env.printhead.kernel_cache import kernel_jit

_jit = kernel_jit(__file__)


@_jit
def slew_limited(signal, most, start, result):
    """Follow a signal that is linear between nodes at a rate of at most ``most`` per node; returns the last value.

    Exact at the nodes, even if it catches up with the signal, or an edge meets it, between them.
    """
    value = start
    result[0] = value
    for i in range(1, signal.shape[0]):
        before, edge = signal[i - 1], signal[i] - signal[i - 1]
        behind = before - value
        met = 0.0  # fraction of the step after which the signal is met
        if behind > 0.0:
            met = behind / (most - edge) if behind < most - edge else 1.0
            value += most * met
        elif behind < 0.0:
            met = -behind / (most + edge) if -behind < most + edge else 1.0
            value -= most * met
        if met < 1.0:
            value = signal[i] if abs(edge) <= most else value + (most if edge > 0.0 else -most) * (1.0 - met)
        result[i] = value
    return value


@_jit
def softly_slewed(signal, most, reach, start, result):
    """Follow a signal, linear between nodes, as ``u' = most tanh((signal - u) / reach)``; returns the last value.

    ``most`` is the largest change per step. Solved by quadrature, accurate to rounding.
    """
    value = start
    result[0] = value
    for i in range(1, signal.shape[0]):
        behind, edge = (signal[i - 1] - value) / reach, (signal[i] - signal[i - 1]) / most
        if behind != 0.0 or edge != 0.0:
            value = signal[i] - reach * _behind(behind, edge, most / reach)
        result[i] = value
    return value


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
