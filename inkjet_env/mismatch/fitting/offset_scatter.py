"""Scatter of a sensor's offset from recording to recording, beyond what the noise's spectrum tells.

The mean of a recording follows all noise that is slower than the recording. Neither a recording at rest nor repeats
within one show it, and 1/f noise has most of its power there. So the offset of each recording is normally distributed
with a variance that maximises the likelihood of the whitened residuals' components ``z`` along a constant of whitened
size ``u``: each has the variance ``1 + σ² u²``. A mismatch that changes the means counts as scatter too until it is
explained; what it does within a recording is not touched.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.settings import FittingSettings
from inkjet_env.typing import Real

NODES = 200
"""Number of variances that are compared."""


def offset_scatter(
    observed: Sequence[ObservedRecording], white: Mapping[str, Real], settings: FittingSettings
) -> dict[str, float]:
    """By channel, the standard deviation of recordings' offsets, in the channel's unit; none where noise explains them.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        Recordings.
    white : mapping of str to ndarray, shape (n, 2)
        By recording: an offset of one unit and the residual, whitened by a noise without scatter of offsets.
    settings : FittingSettings
        Gain from which the scatter counts.
    """
    found: dict[str, float] = {}
    for channel in sorted({o.channel for o in observed}):
        lengths: list[float] = []
        components: list[float] = []
        for o in (o for o in observed if o.channel == channel):
            constant, residual = white[o.name].T
            length = float(constant @ constant)
            if length > 0:
                lengths.append(length)
                components.append(float(constant @ residual) / math.sqrt(length))
        if len(lengths) < 2:
            continue
        size, square = np.array(lengths), np.array(components) ** 2
        variances = np.geomspace(1e-3 / size.max(), max(float(square.max()), 1.0) / size.min(), NODES)
        spread = 1 + np.outer(variances, size)
        gains = 0.5 * np.sum(square * (1 - 1 / spread) - np.log(spread), axis=1)
        best = int(np.argmax(gains))
        if gains[best] > settings.offset_gain:
            found[channel] = math.sqrt(variances[best])
    return found
