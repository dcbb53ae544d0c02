"""Peaks of the residual vibration after a bipolar waveform in periodic firing, and their cost."""

from math import ceil

import numpy as np

from experiments.concealed_rig.measurement import Measurement

WINDOW_S = 350e-6
PER_PERIOD = 500


def averaged_polyline_V(corners_s: np.ndarray, corners_V: np.ndarray, samples: int, step_s: float) -> np.ndarray:
    """A polyline averaged over a sampling interval to either side with a triangular weight, shape (samples,).

    Its corners need not be on samples then: straight lines stay as they are, the area is kept, and what is left is a
    low-pass of (ω·step)²/12. A corner whose slope bends by b adds b(step − |t − corner|)³/(6·step²) around it.
    """
    t = step_s * np.arange(samples)
    slope = np.concatenate(([0.0], np.diff(corners_V) / np.diff(corners_s), [0.0]))
    rounding = np.maximum(step_s - np.abs(t - corners_s[:, None]), 0.0) ** 3 / (6 * step_s**2)
    return np.interp(t, corners_s, corners_V) + np.diff(slope) @ rounding


def firing(
    waveform: np.ndarray, resonance_Hz: float, damping_ratio: float, order: int, per_period: int = PER_PERIOD
) -> Measurement:
    """The seven-parameter waveform in periodic firing, with rest until the ring-down is over.

    Parameters
    ----------
    waveform : array_like, shape (7,)
        U1 in volts ≥ 0, U2 ≤ 0, five positive durations in seconds.
    resonance_Hz, damping_ratio : float
        Set the step, and the rest: to 1e-4 of the vibration, and the window at least.
    order : int
    per_period : int
        Samples in a period of the resonance.

    Raises
    ------
    ValueError
    """
    values = np.asarray(waveform, dtype=float)
    if values.shape != (7,) or not np.all(np.isfinite(values)):
        raise ValueError(f"waveform must be seven finite numbers U1, U2, t1 … t5; got shape {values.shape}.")
    if values[0] < 0 or values[1] > 0 or np.any(values[2:] <= 0):
        raise ValueError("waveform needs U1 ≥ 0 V, U2 ≤ 0 V and five durations above 0 s.")
    step = 1 / resonance_Hz / per_period
    rest = 9.2 / (damping_ratio * 2 * np.pi * resonance_Hz)
    # One step of lead: the average begins before the first corner.
    corners = 2 * step + np.concatenate(([0.0], np.cumsum(values[2:])))
    levels = np.array([0.0, values[0], values[0], values[1], values[1], 0.0])
    samples = ceil(max(WINDOW_S + 2 * step, corners[-1] + rest) / step)
    drive = averaged_polyline_V(corners, levels, samples, step)
    return Measurement("self_sensing", "bipolar", "periodic", step, drive, order=order)


def peaks_V(signal: np.ndarray, step_s: float, start_s: float, window_s: float = WINDOW_S) -> np.ndarray:
    """Local extrema of a sampled signal within a window, in time order, each by a parabola through three samples."""
    change = np.diff(signal)
    k = np.flatnonzero(change[:-1] * change[1:] < 0) + 1
    left, middle, right = signal[k - 1], signal[k], signal[k + 1]
    curvature = left - 2 * middle + right
    offset = 0.5 * (left - right) / curvature
    time = (k + offset) * step_s - start_s
    return (middle - 0.25 * (left - right) * offset)[(time > 0) & (time <= window_s)]


def peak_cost(peaks: np.ndarray, a: float = -5.0, b: float = 5.0) -> float:
    """A|y_e| + B|y_(e+1)| + Σ|y_i| over all others, e the largest peak; 0 where there is none."""
    size = np.abs(peaks)
    if size.size == 0:
        return 0.0
    weight = np.ones(size.size)
    e = int(np.argmax(size))
    weight[e] = a
    weight[e + 1 : e + 2] = b
    return float(weight @ size)
