"""Figures of merit of a waveform in printing: residual vibration, settling time, highest jetting frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from inkjet_env.printhead import PeakCost, SampledResponse
from inkjet_env.typing import Real

SETTLED = 0.05
"""Ringing, as a fraction of the effective peak, below which it does not disturb the next drop."""


@dataclass(frozen=True)
class Jetting:
    """Figures of merit of one response; NaN if there is no effective peak.

    Attributes
    ----------
    effective_V : float
        Height of the effective peak in volts.
    residual_V : float
        Height of the largest peak after it in volts.
    settling_s : float
        Time in seconds from the waveform's start after which the response stays below 5 % of the effective peak;
        infinite if the window ends earlier.
    highest_Hz : float
        Highest jetting frequency in hertz at which a waveform starts only when the previous one has ended and settled;
        0 if it never settles.
    """

    effective_V: float
    residual_V: float
    settling_s: float
    highest_Hz: float

    @property
    def residual(self) -> float:
        """Largest later peak as a fraction of the effective peak."""
        return self.residual_V / self.effective_V


def jetting(response: Any, cost: PeakCost) -> Jetting:
    """Figures of merit of a response.

    Parameters
    ----------
    response : Response, AugmentedResponse or SampledResponse
        Response from rest to one waveform, or to a sampled drive; between the peaks of the latter it is taken to follow
        half a period of a cosine.
    cost : PeakCost
        Determines which peak is effective.
    """
    peaks_V = np.abs(response.peaks_V)
    e = cost.effective_index(response.peaks_V)
    if e is None or peaks_V[e] == 0:
        return Jetting(*[math.nan] * 4)
    later = peaks_V[e + 1 :]
    settling_s = _settling_s(response, peaks_V, SETTLED * peaks_V[e])
    period_s = max(settling_s, _ends_s(response))
    return Jetting(float(peaks_V[e]), float(later.max(initial=0.0)), settling_s, 1 / period_s)


def _begins_s(response: Any) -> float:
    """Time in seconds at which the drive starts."""
    return float(response.time_s[0]) if isinstance(response, SampledResponse) else 0.0


def _ends_s(response: Any) -> float:
    """Time in seconds, from the drive's start, after which it does not change."""
    if not isinstance(response, SampledResponse):
        return float(response.knot_times_s[-1])
    changes = np.flatnonzero(np.diff(response.drive_V))
    return float(response.time_s[changes[-1] + 1] - response.time_s[0]) if changes.size else 0.0


def _settling_s(response: Any, peaks_V: Real, level_V: float) -> float:
    """Time in seconds after which a response stays below a level; it is monotonic between neighbouring peaks."""
    last = int(np.flatnonzero(peaks_V >= level_V)[-1])
    if last == peaks_V.size - 1:
        return math.inf  # the last peak in the window is still large, so settling is not observed
    sign = math.copysign(1.0, response.peaks_V[last])

    def above_V(time_s: float) -> float:
        return sign * float(response.sensor_V(time_s)) - level_V

    begin_s, end_s = (float(time_s) - _begins_s(response) for time_s in response.peak_times_s[last : last + 2])
    if isinstance(response, SampledResponse):
        first_V, next_V = sign * response.peaks_V[last : last + 2]
        cosine = (2 * level_V - first_V - next_V) / (first_V - next_V)
        return begin_s + (end_s - begin_s) * math.acos(cosine) / math.pi
    return begin_s if above_V(begin_s) <= 0 else float(brentq(above_V, begin_s, end_s, xtol=1e-12))


def figures_json(figures: Jetting) -> dict[str, float | None]:
    """Settling time and highest drop frequency under the keys of result files; null where there is none."""
    found = {"settling_s": figures.settling_s, "highest_drop_frequency_Hz": figures.highest_Hz}
    return {key: value if math.isfinite(value) else None for key, value in found.items()}
