"""What a waveform is worth at the press: what is left ringing, when it has settled, how fast drops may follow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from inkjet_env.printhead import PeakCost

SETTLED = 0.05
"""Of the effective peak: ringing below this does not disturb the next drop."""


@dataclass(frozen=True)
class Jetting:
    """Figures of one response; NaN where there is no effective peak.

    Attributes
    ----------
    effective_V : float
        Height of the effective peak, in volts.
    residual_V : float
        The largest peak after it, in volts.
    settling_s : float
        When the last peak of 5 % of the effective one or more is over, from the waveform's start, in seconds; infinite
        where the window ends before.
    highest_Hz : float
        Drops a second at which the next waveform starts when this one has settled and ended; 0 where it never does.
    """

    effective_V: float
    residual_V: float
    settling_s: float
    highest_Hz: float

    @property
    def residual(self) -> float:
        """Of the effective peak."""
        return self.residual_V / self.effective_V


def jetting(response: Any, cost: PeakCost) -> Jetting:
    """Figures of a response.

    Parameters
    ----------
    response : Response or AugmentedResponse
        From rest, to one waveform.
    cost : PeakCost
        Says which peak is effective.
    """
    peaks_V = np.abs(response.peaks_V)
    e = cost.effective_index(response.peaks_V)
    if e is None or peaks_V[e] == 0:
        return Jetting(*[math.nan] * 4)
    later = peaks_V[e + 1 :]
    large = np.flatnonzero(peaks_V >= SETTLED * peaks_V[e])
    settling_s = float(response.peak_times_s[large[-1]])
    # the last peak of the window is still large: nobody saw it settle
    if large[-1] == peaks_V.size - 1 and peaks_V.size > 1:
        settling_s = math.inf
    period_s = max(settling_s, float(response.knot_times_s[-1]))
    return Jetting(float(peaks_V[e]), float(later.max(initial=0.0)), settling_s, 1 / period_s)
