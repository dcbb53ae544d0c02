"""What a waveform is worth at the press: what is left ringing, when it has settled, how fast drops may follow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from inkjet_env.printhead import PeakCost
from inkjet_env.typing import Real

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
        From when on the response stays below 5 % of the effective peak, counted from the waveform's start, in seconds;
        infinite where the window ends before.
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
    settling_s = _settling_s(response, peaks_V, SETTLED * peaks_V[e])
    period_s = max(settling_s, float(response.knot_times_s[-1]))
    return Jetting(float(peaks_V[e]), float(later.max(initial=0.0)), settling_s, 1 / period_s)


def _settling_s(response: Any, peaks_V: Real, level_V: float) -> float:
    """When a response falls below a level for good; between one peak and the next it only falls or only rises."""
    last = int(np.flatnonzero(peaks_V >= level_V)[-1])
    if last == peaks_V.size - 1:
        return math.inf  # the last peak of the window is still large: nobody saw it settle
    sign = math.copysign(1.0, response.peaks_V[last])

    def above_V(time_s: float) -> float:
        return sign * float(response.sensor_V(time_s)) - level_V

    begin_s, end_s = (float(time_s) for time_s in response.peak_times_s[last : last + 2])
    return begin_s if above_V(begin_s) <= 0 else float(brentq(above_V, begin_s, end_s, xtol=1e-12))
