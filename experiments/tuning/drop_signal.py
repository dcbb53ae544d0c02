"""The signal of one drop: as a head predicts it, and what a recording shows beyond that."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d
from scipy.signal import savgol_filter

from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.extrema import extrema
from inkjet_env.printhead import Printhead, Waveform, batch, sensitivity
from inkjet_env.recordings import Recording
from inkjet_env.typing import Real

SAMPLES_A_PERIOD = 100
"""Samples of a signal per period of the head's resonance."""
AVERAGED = 0.1
"""Part of a period over which a residual is smoothed, by a parabola."""
REST_PERIODS, QUIET_PERIODS = 20.0, 10.0
"""Time after the window in which the head comes to rest before the next waveform, and the last part of it, which shows
the noise alone, in periods of the resonance."""
ERRORS = 3.0
"""Standard errors within which a signal may differ from what was predicted or recorded."""
CLEAR = 2.0
"""Power of a smoothed residual over that of its noise, from which on it is taken for more than noise."""


@dataclass(frozen=True, eq=False)
class Signal:
    """A densely sampled signal of one drop, from the start of the waveform.

    Attributes
    ----------
    signal_V : ndarray, shape (n,)
        The self-sensed signal at the samples, in volts.
    step_s : float
        Sampling step, in seconds.
    error_V : float
        Size of the wiggles in it that may be noise, in volts.
    fewest : int
        Number of its peaks that are there at any rate: wiggles that may be noise are left out while there are more.
    """

    signal_V: Real = field(repr=False)
    step_s: float
    error_V: float = 0.0
    fewest: int = 0

    def peaks(self, window_s: float) -> tuple[Real, Real]:
        """Times in seconds and heights in volts of its local extrema within a window: two arrays of shape (k,)."""
        times_s, peaks_V = extrema(self.signal_V, self.step_s)
        kept = without_wiggles(peaks_V, self.error_V, self.fewest)
        kept = kept[times_s[kept] <= window_s]
        return times_s[kept], peaks_V[kept]


def without_wiggles(peaks_V: Real, margin_V: float, fewest: int = 0) -> np.ndarray:
    """Indices of extrema in time order without pairs of neighbours that differ by less than a margin, smallest first.

    Pairs are left out while more than one above ``fewest``, and more than two, are left.
    """
    kept = np.arange(peaks_V.size)
    while kept.size > max(fewest + 1, 2):
        steps = np.abs(np.diff(peaks_V[kept]))
        k = int(np.argmin(steps))
        if steps[k] >= margin_V:
            break
        kept = np.delete(kept, [k, k + 1])
    return kept


def predicted_signals(
    rows: Real,
    head: Printhead | AugmentedPrinthead,
    initial_state: str,
    window_s: float,
    period_s: float = math.inf,
) -> Iterator[Signal]:
    """Signals of waveforms on a head, to the end of the window at least.

    Where no steady state is found of a waveform that is repeated after long rests, it is that of the head at rest.

    Parameters
    ----------
    rows : ndarray, shape (n, 7)
        Waveforms, in volts and seconds.
    head : Printhead or AugmentedPrinthead
        The head.
    initial_state, window_s, period_s
        As in `Printhead.respond`.
    """
    if isinstance(head, AugmentedPrinthead):
        for row in rows:
            waveform = Waveform.from_array(row)
            try:
                response = head.respond(waveform, initial_state, window_s, period_s=period_s)
            except ValueError as error:
                if math.isinf(period_s) or not isinstance(error.__cause__, FloatingPointError):
                    raise
                response = head.respond(waveform, initial_state, window_s)
            yield Signal(response.sensor_at_steps_V, response.step_s)
        return
    step_s = 1 / (SAMPLES_A_PERIOD * head.frequency_Hz)
    time_s = step_s * np.arange(math.ceil(window_s / step_s) + 3)
    for signal_V in sensitivity.responses(rows, batch.head_table(head), time_s, initial_state, period_s=period_s):
        yield Signal(signal_V, step_s)


@dataclass(frozen=True, eq=False)
class Shown:
    """What the recording of a repeated waveform shows beyond the prediction.

    Attributes
    ----------
    waveform : Waveform
        The waveform.
    time_s : ndarray, shape (n,)
        Times of the samples after its start, in seconds.
    beyond_V : ndarray, shape (n,)
        What the recording shows beyond the prediction in volts, smoothed; zero where it is not clear of the noise.
    clear : ndarray, shape (n,)
        How clear it is of the noise, from 0 to 1.
    noise_V : ndarray, shape (m,)
        The smoothed noise of samples in a row, in volts: what is left after the head has come to rest.
    residual_V, noise_rms_V : float
        RMS of the whole residual, and of its noise, in volts.
    """

    waveform: Waveform
    time_s: Real = field(repr=False)
    beyond_V: Real = field(repr=False)
    clear: Real = field(repr=False)
    noise_V: Real = field(repr=False)
    residual_V: float
    noise_rms_V: float

    @classmethod
    def by(cls, recording: Recording, waveform: Waveform, expected_V: Real, frequency_Hz: float) -> Shown:
        """What a recording of one repetition shows beyond what was expected.

        Parameters
        ----------
        recording : Recording
            One repetition of the waveform with its rest, as `check.averaged` gives it.
        waveform : Waveform
            The waveform.
        expected_V : ndarray, shape (n,)
            Signal that is predicted at its samples, in volts, but for the channel's offset.
        frequency_Hz : float
            Resonance frequency of the head, in hertz.
        """
        time_s = recording.time_s - recording.time_s[0]
        residual_V = recording.sensor - expected_V
        residual_V = residual_V - np.median(residual_V)  # the channel's offset
        period = max(3, round(1 / (frequency_Hz * recording.step_s)))
        smooth_V = savgol_filter(residual_V, max(5, 2 * round(AVERAGED / 2 * period) + 1), 2, mode="wrap")
        at_rest = slice(-round(QUIET_PERIODS * period), None)
        noise_V = smooth_V[at_rest] - smooth_V[at_rest].mean()
        power_V2 = uniform_filter1d(smooth_V**2, period, mode="wrap")
        clear = np.clip(1.0 - CLEAR * np.mean(noise_V**2) / np.maximum(power_V2, 1e-300), 0.0, 1.0)
        clear = uniform_filter1d(clear, max(period // 2, 1), mode="wrap")
        rms_V = float(np.sqrt(np.mean(residual_V**2)))
        return cls(waveform, time_s, clear * smooth_V, clear, noise_V, rms_V, float(np.std(residual_V[at_rest])))

    @property
    def period_s(self) -> float:
        """Time of one repetition, in seconds."""
        return float(self.time_s.size * (self.time_s[1] - self.time_s[0]))

    @property
    def error_V(self) -> float:
        """Standard error of what is shown, in volts."""
        return float(np.std(self.noise_V))

    @property
    def rms_V(self) -> float:
        """RMS of what is shown beyond the prediction, in volts."""
        return float(np.sqrt(np.mean(self.beyond_V**2)))

    def added_to(self, predicted: Signal) -> Signal:
        """A predicted signal with what is shown beyond it; wiggles that only its noise has made are left out."""
        time_s = predicted.step_s * np.arange(predicted.signal_V.size)
        signal_V = predicted.signal_V + np.interp(time_s, self.time_s, self.beyond_V)
        _, peaks_V = extrema(predicted.signal_V, predicted.step_s)
        return Signal(signal_V, predicted.step_s, ERRORS * self.error_V, peaks_V.size)


def mean_repetition(recording: Recording, period_s: float) -> Recording:
    """The mean of all whole repetitions in a recording of a repeated drive, whatever its sampling step.

    Parameters
    ----------
    recording : Recording
        The recording, from the start of a repetition on.
    period_s : float
        Time of one repetition, in seconds.

    Raises
    ------
    ValueError
        It is shorter than one repetition.
    """
    since_s = recording.time_s - recording.time_s[0]
    repetitions = math.floor((since_s[-1] + recording.step_s) / period_s + 1e-6)
    if repetitions < 1:
        raise ValueError(
            f"{recording.name} takes {since_s[-1]:.4g} s, and one repetition of its drive {period_s:.4g} s. Record it "
            "again, as long as it is asked for."
        )
    length = round(period_s / recording.step_s)
    time_s: Real = np.asarray(period_s / length * np.arange(length), dtype=np.float64)
    sensor = CubicSpline(since_s, recording.sensor)
    every = [sensor(time_s + k * period_s) for k in range(repetitions)]
    return replace(
        recording, time_s=time_s, drive_V=np.interp(time_s, since_s, recording.drive_V), sensor=np.mean(every, axis=0),
        drive_monitor_V=None, neighbour_V=None,
    )  # fmt: skip
