"""Compiled kernels of the drive stage, over signals at nodes."""

from __future__ import annotations

from inkjet_env.printhead.kernel_cache import kernel_jit

_jit = kernel_jit(__file__)


@_jit
def slew_limited(signal, most, start, result):
    """A signal that is linear between nodes, followed by no more than ``most`` a node; returns the last value.

    Exact at the nodes, also where it catches up or is met by an edge between them.
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
