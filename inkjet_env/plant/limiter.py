"""A limiter whose corners are sharp or soft (Rapp's)."""

from __future__ import annotations

import numpy as np

from inkjet_env.typing import Real


def limited(signal: Real, ratio: Real, hardness: float) -> Real:
    """The signal y₀ behind a limiter, ``y₀ / (1 + ratio^h)^(1/h)``, shape (n,).

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Values before the limiter.
    ratio : ndarray, shape (n,)
        Magnitude of each value relative to its limit, at least 0.
    hardness : float
        h, at least 1: gradual compression at 1, clipping, nearly, from 20 on.
    """
    above = np.maximum(ratio, 1.0)
    below = np.minimum(ratio, 1.0) / above  # the smaller of ratio and 1 / ratio, so that no power overflows
    return signal / above * (1 + below**hardness) ** (-1 / hardness)
