"""Everything that *Waveform* draws, computed from a head and a drive by the compiled simulator."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from inkjet_env.experiments.explore.drives import Corners, Drive
from inkjet_env.jetting import Jetting, jetting
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import PeakCost, Printhead, SampledResponse, Waveform, respond_sampled
from inkjet_env.printhead.window import DEFAULT_WINDOW_S, check_period
from inkjet_env.typing import Real

Head = Printhead | AugmentedPrinthead

SAMPLES = 1200
"""Number of samples of the response."""
LOOP_SAMPLES = 240
"""Number of samples of the hysteresis loop."""
DROPS = 4
"""Number of drops of a train that are overlaid, before the steady state."""
SPECTRUM_LINES = 400
SPECTRUM_PERIODS = 4.0
"""Highest frequency of the spectrum, in resonance frequencies of the head."""


@dataclass(frozen=True)
class Conditions:
    """How a drive is fired and judged.

    Parameters
    ----------
    cost : PeakCost
        The cost.
    window_s : float
        Peaks count up to this time after the start, in seconds; finite.
    drop_frequency_Hz : float
        Drops per second; 0 if they are far apart.
    """

    cost: PeakCost = field(default_factory=PeakCost)
    window_s: float = DEFAULT_WINDOW_S
    drop_frequency_Hz: float = 0.0

    @property
    def period_s(self) -> float:
        """Time between drops in seconds; infinite if they are far apart."""
        return 1 / self.drop_frequency_Hz if self.drop_frequency_Hz else math.inf


@dataclass(frozen=True)
class CostTerms:
    """The terms of Eq. (9), in volts: ``A min(|effective|, target) + B |next| + Σ |others|``.

    Attributes
    ----------
    effective_V, next_V : float or None
        Signed heights of the effective peak and of the one after it; None if there is none.
    effective, next, others : float
        The three terms.
    total : float
        The cost.
    """

    effective_V: float | None
    next_V: float | None
    effective: float
    next: float
    others: float
    total: float


@dataclass(frozen=True, eq=False)
class Curves:
    """What is drawn of one drive on one head.

    Attributes
    ----------
    time_s, drive_V, sensor_V : ndarray, shape (n,)
        Drive and response from the start of the drive to the end of the window, or of the period in a train.
    peak_times_s, peaks_V : ndarray, shape (k,)
        Every extremum that counts.
    effective : int or None
        Index of the effective peak.
    terms : CostTerms
        Terms of the cost.
    loop_drive_V, loop_hysteretic_V : ndarray, shape (m,)
        The hysteresis loop of the repeated drive.
    frequency_Hz, spectrum_Vs : ndarray, shape (l,)
        Magnitude of the Fourier transform of a single drop's response, in volt seconds.
    drops : tuple of ndarray, each of shape (n,)
        Responses of the first, second … drop of a train at ``drop_times_s``; empty if drops are far apart.
    drop_times_s : ndarray, shape (n,)
        Times since each drop's start, in seconds.
    figures : Jetting
        Figures of merit of a single drop.
    """

    time_s: Real
    drive_V: Real
    sensor_V: Real
    peak_times_s: Real
    peaks_V: Real
    effective: int | None
    terms: CostTerms
    loop_drive_V: Real
    loop_hysteretic_V: Real
    frequency_Hz: Real
    spectrum_Vs: Real
    drops: tuple[Real, ...]
    drop_times_s: Real
    figures: Jetting


def curves(head: Head, drive: Drive, conditions: Conditions) -> Curves:
    """Simulate a drive on a head.

    Raises
    ------
    ValueError
        The drive does not fit into the period, or the head cannot be simulated under it.
    """
    cost, window_s = conditions.cost, conditions.window_s
    period_s = check_period(conditions.period_s, drive.duration_s, "periodic")
    end_s = max(window_s, drive.duration_s)
    times_s = _with_corners(np.linspace(0.0, end_s, SAMPLES), drive)
    single = _single(head, drive, times_s, window_s)
    shown = single if math.isinf(period_s) else _steady(head, drive, period_s)
    counts = shown.peak_times_s <= min(window_s if isinstance(drive, Waveform) else end_s, period_s)
    peaks_V, peak_times_s = shown.peaks_V[counts], shown.peak_times_s[counts]
    drops: tuple[Real, ...] = ()
    drop_times_s = np.empty(0)
    if not math.isinf(period_s) and isinstance(head, Printhead):
        drop_times_s, drops = _drops(head, drive, period_s)
    frequency_Hz, spectrum_Vs = _spectrum(single, head.frequency_Hz)
    loop_drive_V, loop_hysteretic_V = _loop(head, drive)
    return Curves(
        shown.time_s, shown.drive_V, shown.sensor_V, peak_times_s, peaks_V, cost.effective_index(peaks_V),
        cost_terms(cost, peaks_V), loop_drive_V, loop_hysteretic_V, frequency_Hz, spectrum_Vs, drops, drop_times_s,
        jetting(_Smooth(single, drive), cost),
    )  # fmt: skip


class _Smooth:
    """A response from rest, sampled finely: a cubic spline between its samples, so that settling is not approximate."""

    def __init__(self, single: SampledResponse, drive: Drive) -> None:
        self.peaks_V, self.peak_times_s = single.peaks_V, single.peak_times_s
        self.knot_times_s = drive.knots()[0]
        self.sensor_V = CubicSpline(single.time_s, single.sensor_V)


def cost_terms(cost: PeakCost, peaks_V: Real) -> CostTerms:
    """The terms of the cost of peaks in volts, shape (k,), in time order."""
    heights_V, e = np.abs(peaks_V), cost.effective_index(peaks_V)
    if e is None:
        return CostTerms(None, None, 0.0, 0.0, float(heights_V.sum()), cost(peaks_V))
    follows = e + 1 < heights_V.size
    others = float(heights_V[:e].sum() + heights_V[e + 2 :].sum())
    return CostTerms(
        float(peaks_V[e]),
        float(peaks_V[e + 1]) if follows else None,
        cost.A * min(float(heights_V[e]), cost.target_height_V),
        cost.B * float(heights_V[e + 1]) if follows else 0.0,
        others,
        cost(peaks_V),
    )


def drive_at(drive: Drive, time_s: Real) -> Real:
    """Drive in volts at times in seconds, same shape."""
    return drive.drive_V_at(time_s) if isinstance(drive, Corners) else drive.drive_V(time_s)


def _with_corners(times_s: Real, drive: Drive) -> Real:
    """Times that include the drive's corners, so that it is linear between neighbours."""
    merged = np.union1d(times_s, drive.knots()[0])
    return merged[np.concatenate([[True], np.diff(merged) > 1e-15])]


def _single(head: Head, drive: Drive, times_s: Real, window_s: float) -> SampledResponse:
    """Response from rest to one drop."""
    if isinstance(head, Printhead):
        return respond_sampled(head, times_s, drive_at(drive, times_s), window_s=window_s)
    if isinstance(drive, Corners):
        return head.respond_sampled(times_s, drive_at(drive, times_s), window_s=window_s)
    found = head.respond(drive, window_s=window_s)
    return SampledResponse(
        times_s, drive_at(drive, times_s), found.sensor_V(times_s), found.peak_times_s, found.peaks_V
    )


def _steady(head: Head, drive: Drive, period_s: float) -> SampledResponse:
    """Response in the steady state of a train, over one period."""
    if isinstance(head, AugmentedPrinthead):
        times_s = np.linspace(0.0, period_s, SAMPLES)
        if isinstance(drive, Corners):
            inside_s = times_s[times_s < min(drive.duration_s, period_s * (1 - 1e-9))]
            knots_s = _with_corners(np.append(inside_s, drive.duration_s), drive)
            return head.respond_sampled(knots_s, drive_at(drive, knots_s), window_s=period_s, period_s=period_s)
        found = head.respond(drive, window_s=period_s, period_s=period_s)
        return SampledResponse(
            times_s, drive_at(drive, times_s), found.sensor_V(times_s), found.peak_times_s, found.peaks_V
        )
    even_s: Real = np.arange(SAMPLES, dtype=np.float64) * np.float64(period_s / SAMPLES)
    times_s = _with_corners(even_s, drive)
    times_s = times_s[times_s < period_s * (1 - 1e-9)]
    times_s = np.append(times_s, (times_s[-1] + period_s) / 2)  # the period is its last step longer
    return respond_sampled(head, times_s, drive_at(drive, times_s), ringing="steady", window_s=period_s)


def _drops(head: Printhead, drive: Drive, period_s: float) -> tuple[Real, tuple[Real, ...]]:
    """Responses of the first drops of a train that starts at rest: each adds the ringing of those before it."""
    steps = SAMPLES // 2
    times_s: Real = np.arange(steps * DROPS, dtype=np.float64) * np.float64(period_s / steps)
    merged_s = _with_corners(times_s, drive)
    single = respond_sampled(head, merged_s, drive_at(drive, merged_s))
    sensor_V = np.interp(times_s, merged_s, single.sensor_V).reshape(DROPS, steps)
    return times_s[:steps], tuple(np.cumsum(sensor_V, axis=0))


def _spectrum(single: SampledResponse, resonance_Hz: float) -> tuple[Real, Real]:
    """Magnitude of the response's Fourier transform, by the trapezoidal rule on its samples."""
    frequency_Hz = np.linspace(0.0, SPECTRUM_PERIODS * resonance_Hz, SPECTRUM_LINES)
    count = 2048
    step_s = (single.time_s[-1] - single.time_s[0]) / (count - 1)
    even_V = np.interp(single.time_s[0] + step_s * np.arange(count), single.time_s, single.sensor_V)
    padded = np.abs(np.fft.rfft(even_V, 8 * count)) * step_s
    return frequency_Hz, np.interp(frequency_Hz, np.fft.rfftfreq(8 * count, step_s), padded)


def _loop(head: Head, drive: Drive) -> tuple[Real, Real]:
    """The hysteresis loop under the repeated drive; of a head with effects, that of its base part."""
    times_s = _with_corners(np.linspace(0.0, drive.duration_s, LOOP_SAMPLES), drive)
    drive_V = drive_at(drive, times_s)
    law = head.branch_law if isinstance(head, Printhead) else head.printhead.branch_law
    return drive_V, law.hysteretic_V(drive_V, "periodic")
