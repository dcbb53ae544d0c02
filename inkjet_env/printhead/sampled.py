"""Response to any sampled drive, linear between its samples: exact at every sample, compiled, O(1) per sample."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.naming import check_name
from inkjet_env.printhead.cost import PeakCost
from inkjet_env.printhead.hysteresis import periods_before_recording
from inkjet_env.printhead.printhead import Printhead
from inkjet_env.printhead.resonator import pole
from inkjet_env.printhead.waveform import LARGEST_DRIVE_V
from inkjet_env.printhead.window import check_period, check_window
from inkjet_env.typing import Real

RINGING = ("rest", "steady")
"""``rest``: the resonator rests at the first sample. ``steady``: it rings as in the steady state of the repeated
drive."""

SAME_TIME = 1e-9
"""Difference of two times, relative to them, below which they are one."""

LONGEST_STEP_S = 1.0
"""Longest sampling step accepted, in seconds."""


@dataclass(frozen=True)
class SampledResponse:
    """Response of a head to a sampled drive.

    Attributes
    ----------
    time_s, drive_V, sensor_V : ndarray, shape (n,)
        Times in seconds; drive and self-sensed signal in volts. Sensor values are exact for a drive that is linear
        between its samples; none depends on the sampling rate.
    peak_times_s, peaks_V : ndarray, shape (k,)
        Times in seconds and signed values in volts of every local extremum of the self-sensed signal, including those
        between samples.
    tail_V : float
        Summed magnitude of the extrema beyond those listed, in volts (infinite window only).
    """

    time_s: Real
    drive_V: Real
    sensor_V: Real
    peak_times_s: Real
    peaks_V: Real
    tail_V: float = 0.0

    def cost(self, peak_cost: PeakCost | None = None) -> float:
        """Peak cost in volts; the default is `PeakCost()`."""
        return (peak_cost or PeakCost())(self.peaks_V, self.tail_V)


def check_samples(time_s: ArrayLike, drive_V: ArrayLike) -> tuple[Real, Real]:
    """Return both as arrays of shape (n,); ``ValueError`` unless finite, of equal length and increasing in time."""
    try:
        time = np.ascontiguousarray(time_s, dtype=np.float64)
        drive = np.ascontiguousarray(drive_V, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError("time_s and drive_V must be numbers, two columns of the same length.") from None
    if time.ndim != 1 or time.shape != drive.shape or time.size < 2:
        raise ValueError(
            f"time_s and drive_V must be two columns of at least 2 samples; got shapes {time.shape} and {drive.shape}."
        )
    for name, values in (("time_s", time), ("drive_V", drive)):
        bad = ~np.isfinite(values)
        if bad.any():
            at = int(np.argmax(bad))
            raise ValueError(
                f"{name} must be finite; got {values[at]} at sample {at + 1} of {values.size}. Trim the recording."
            )
    if np.abs(drive).max() > LARGEST_DRIVE_V:
        at = int(np.argmax(np.abs(drive)))
        raise ValueError(
            f"drive_V must be within ±{LARGEST_DRIVE_V:g} V; got {drive[at]:g} V at sample {at + 1} of {drive.size}. "
            "Check the unit, volts."
        )
    steps = np.diff(time)
    if not (steps > 0).all():
        at = int(np.argmax(steps <= 0)) + 1
        raise ValueError(
            "time_s must increase from sample to sample; "
            f"sample {at + 1} is at {time[at]:g} s after {time[at - 1]:g} s. Sort the rows or remove the repeated one."
        )
    if steps.max() > LONGEST_STEP_S:
        at = int(np.argmax(steps > LONGEST_STEP_S)) + 1
        raise ValueError(
            f"time_s must not step by more than {LONGEST_STEP_S:g} s; "
            f"it does by {steps[at - 1]:g} s before sample {at + 1}. Times are in seconds."
        )
    return time, drive


def shortest_period_s(time_s: Real, drive_V: Real) -> float:
    """Shortest firing period in seconds of a sampled drive.

    That is the time from its first sample until it no longer changes; a drive that ends at another voltage than it
    starts at returns in one more sampling step after its last sample.
    """
    if drive_V[-1] != drive_V[0]:
        return float(2 * time_s[-1] - time_s[-2] - time_s[0])
    changes = np.flatnonzero(np.diff(drive_V))
    return float(time_s[changes[-1] + 1] - time_s[0]) if changes.size else float(time_s[1] - time_s[0])


def one_period(time_s: Real, drive_V: Real, period_s: float) -> tuple[Real, Real]:
    """One period of a repeated drive, from its first sample to that of the next repetition.

    Parameters
    ----------
    time_s, drive_V : ndarray, shape (n,)
        Times in seconds, increasing, and drive in volts.
    period_s : float
        Firing period in seconds, at least `shortest_period_s`.

    Returns
    -------
    since_s, drive_V : ndarray, shape (m,)
        Times in seconds from 0 to the period, and drive: the samples, the last voltage held, and the return to the
        first voltage in one sampling step.
    """
    since = time_s - time_s[0]
    back_s = float(since[-1] - since[-2]) if drive_V[-1] != drive_V[0] else 0.0
    step_s = float(np.median(np.diff(since)))
    within = since < period_s * (1 - SAME_TIME)
    knots_s, knots_V = since[within], drive_V[within]
    leaves_s = period_s - back_s
    if back_s or knots_V[-1] == drive_V[0]:
        held_s = np.append(np.arange(knots_s[-1], leaves_s, step_s)[1:], leaves_s if back_s else [])
        held_s = held_s[(held_s > knots_s[-1] * (1 + SAME_TIME)) & (held_s < period_s * (1 - SAME_TIME))]
        held_s = held_s[np.diff(held_s, append=period_s) > SAME_TIME * period_s]
        knots_s, knots_V = np.append(knots_s, held_s), np.append(knots_V, np.full(held_s.size, knots_V[-1]))
    return np.append(knots_s, period_s), np.append(knots_V, drive_V[0])


def respond_sampled(
    printhead: Printhead,
    time_s: ArrayLike,
    drive_V: ArrayLike,
    initial_state: str = "periodic",
    hysteresis: str = "full_memory",
    ringing: str = "rest",
    window_s: float | None = None,
    period_s: float = math.inf,
) -> SampledResponse:
    """Response of a head to a sampled drive.

    Parameters
    ----------
    printhead : Printhead
        The head.
    time_s, drive_V : array_like, shape (n,)
        Increasing times in seconds; drive in volts, linear between samples.
    initial_state : {"periodic", "demagnetised"}
        State of the hysteresis. A periodic drive goes from its last sample back to its first in one more sampling step.
    hysteresis : {"full_memory", "one_point"}
        Memory of the branch law; see `inkjet_env.printhead.hysteresis.HYSTERESIS_MODELS`.
    ringing : {"rest", "steady"}
        State of the resonator at the first sample; ``steady`` needs ``initial_state="periodic"``.
    window_s : float, optional
        Peaks are followed up to this time after the first sample, in seconds, with the drive held at its last value.
        The window ends no earlier than the last sample, which is also the default. May be infinite.
    period_s : float
        Firing period in seconds: the drive has been repeated for ever at this period, as in `Printhead.respond`, and
        the response is that of one period in the steady state, in which alone peaks count. Between its last sample and
        the next repetition the drive is held, see `one_period`. Infinite, the default: it is not repeated.

    Returns
    -------
    SampledResponse
        Response at the samples, and its extrema.

    Raises
    ------
    ValueError
        Samples that are not finite, not increasing in time, or fewer than two; unknown names; a period that does not
        hold the drive.
    """
    from inkjet_env.printhead import batch, compiled, compiled_edges

    time, drive = check_samples(time_s, drive_V)
    check_name("hysteresis", hysteresis, ("full_memory", "one_point"))
    check_name("ringing", ringing, RINGING)
    warm_up_periods = periods_before_recording(initial_state)
    if ringing == "steady" and warm_up_periods == 0:
        raise ValueError('ringing="steady" needs initial_state="periodic": only a repeated drive has a steady state.')
    head = batch.head_table(printhead)[0]
    scratch = (
        np.empty(compiled_edges.MAX_DEGREE),
        np.empty(compiled_edges.SERIES_TERMS + 2),
        np.empty((64, 4)),
    )

    def run(knots_s: Real, knots_V: Real, state: Real, window: float) -> tuple[Real, Real, Real, float]:
        pieces = np.empty((4 * knots_V.size + 32, 6))
        memory = np.empty((warm_up_periods + 1) * knots_V.size + 2)
        found = compiled.branch_pieces(
            knots_V, printhead.full_scale_V, warm_up_periods, hysteresis == "one_point", memory, pieces
        )
        sensor, capacity, start = np.empty(knots_s.size), 2 * knots_V.size + 1024, state.copy()
        while True:
            state[:] = start
            times, peaks = np.empty(capacity), np.empty(capacity)
            count, tail = compiled.response_extrema(
                head, knots_s, pieces, found, window, state, *scratch, times, peaks, sensor
            )
            if count != compiled_edges.OVERFLOW:
                return sensor, times[:count].copy(), peaks[:count].copy(), tail
            capacity *= 2

    def steady(knots_s: Real, knots_V: Real) -> Real:
        """The state at the first knot of a period that the period maps to itself."""
        state = np.zeros(2)
        period_s = float(knots_s[-1])
        run(knots_s, knots_V, state, period_s)
        # s = e^{FT} s + r, with r the response at the end of the period from rest.
        free = np.exp(pole(printhead.a0, printhead.a1) * period_s)
        damping, frequency = -printhead.a1 / 2, pole(printhead.a0, printhead.a1).imag
        c, s = free.real, free.imag / frequency
        transition = np.array([[c - damping * s, s], [-printhead.a0 * s, c + damping * s]])
        return np.linalg.solve(np.eye(2) - transition, state)

    if not math.isinf(period_s):
        period_s = check_period(period_s, shortest_period_s(time, drive), initial_state)
        knots_s, knots_V = one_period(time, drive, period_s)
        end_s = period_s if window_s is None else min(check_window(window_s), period_s)
        sensor, times, peaks, _ = run(knots_s, knots_V, steady(knots_s, knots_V), end_s)
        return SampledResponse(knots_s[:-1] + time[0], knots_V[:-1], sensor[:-1], times + time[0], peaks)
    since = time - time[0]
    state = np.zeros(2)
    if ringing == "steady":
        state = steady(np.append(since, 2 * since[-1] - since[-2]), np.append(drive, drive[0]))
    end = float(since[-1]) if window_s is None else max(check_window(window_s), float(since[-1]))
    sensor, times, peaks, tail = run(since, drive, state, end)
    return SampledResponse(time, drive, sensor, times + time[0], peaks, tail)
