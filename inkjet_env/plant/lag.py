"""First-order lag ``1 / (τ s + 1)`` of a signal that is linear between its values: exact there, at any τ."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]


def lagged(signal: Real, time_constant_s: float, step_s: float, periodic: bool) -> Real:
    """The signal behind a first-order low-pass, shape (n,).

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Linear between its values, ``step_s`` apart.
    time_constant_s : float
        At least 0; 0 is no lag.
    step_s : float
    periodic : bool
        In the steady state of the repeated signal, the value after the last being the first; else at rest at the first
        value.
    """
    from inkjet_env.plant import compiled

    if time_constant_s <= 0:
        return signal
    z = step_s / time_constant_s
    keep = math.exp(-z)
    # ∫ e^{-(1-s) z} z {1 - s, s} ds over the step
    new = 1 + math.expm1(-z) / z if z > 1e-4 else z / 2 - z * z / 6
    old = -math.expm1(-z) - new
    values = np.append(signal, signal[0]) if periodic else np.ascontiguousarray(signal)
    result = np.empty(values.size)
    start = float(values[0])
    if periodic:
        end = compiled.lagged(values, keep, old, new, 0.0, result)
        start = end / -math.expm1(-z * signal.size)
    compiled.lagged(values, keep, old, new, start, result)
    return result[: signal.size]
