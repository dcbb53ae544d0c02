"""First-order lag ``1 / (τ s + 1)`` of a signal that is linear between its values: exact at them, for any τ."""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.typing import Real


def lagged(signal: Real, time_constant_s: float, step_s: float, periodic: bool) -> Real:
    """The signal behind a first-order low-pass, shape (n,).

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Values at equal steps; the signal is linear between them.
    time_constant_s : float
        τ in seconds, at least 0; 0 is no lag.
    step_s : float
        Time between the values, in seconds.
    periodic : bool
        Whether the result is the steady state of the repeated signal, in which the value after the last is the first;
        otherwise the lag starts at rest at the first value.
    """
    from inkjet_env.plant import compiled

    if time_constant_s <= 0:
        return signal
    keep, old, new = lag_weights(time_constant_s, step_s)
    values = np.append(signal, signal[0]) if periodic else np.ascontiguousarray(signal)
    result = np.empty(values.size)
    start = float(values[0])
    if periodic:
        end = compiled.lagged(values, keep, old, new, 0.0, result)
        start = end / decay_per_period(time_constant_s, signal.size * step_s)
    compiled.lagged(values, keep, old, new, start, result)
    return result[: signal.size]


def lag_weights(time_constant_s: float, step_s: float) -> tuple[float, float, float]:
    """Weights of the lagged value, the signal and its next value in the next lagged value.

    Without a lag that is the next value of the signal.
    """
    if time_constant_s <= 0:
        return 0.0, 0.0, 1.0
    z = step_s / time_constant_s
    # The weights are ∫ e^{-(1-s) z} z {1 - s, s} ds over the step.
    new = 1 + math.expm1(-z) / z if z > 1e-4 else z / 2 - z * z / 6
    return math.exp(-z), -math.expm1(-z) - new, new


def decay_per_period(time_constant_s: float, period_s: float) -> float:
    """Share of a change of the lagged value that decays over one period of ``period_s`` seconds."""
    return -math.expm1(-period_s / time_constant_s) if time_constant_s > 0 else 1.0
