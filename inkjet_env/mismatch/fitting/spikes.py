"""Noise with heavy tails: single samples that stand out must not pass for a mismatch."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

from inkjet_env.typing import Real


def without_spikes(residuals: Real, most: float = 3.0, window: int = 15) -> Real:
    """Residuals, shape (n,), with single samples that stand out from their neighbours cut down.

    A sample is cut to ``most`` times the noise, or the neighbours' level (median within ``window`` samples) if that is
    larger: a mismatch that lasts stays as it is.
    """
    level = np.maximum(median_filter(np.abs(residuals), min(window, residuals.size), mode="nearest") / 0.6745, 1.0)
    return np.clip(residuals, -most * level, most * level)
