"""Peak cost of a waveform as it was recorded on the head.

Small peaks drown in the noise, and the cost adds up their magnitudes, so reading them off a recording would overrate
it; and whether there is a small peak just after the largest one, which weighs most, no recording with noise can tell.
The recorded signal is therefore compared with the predicted one of the same repeated drive, and each peak that is
predicted for a single drop is moved by what the recording shows beyond the prediction there, averaged over a part of
the resonance's period. This holds as far as the prediction does: `Measured` tells by how much the recording exceeds it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import PeakCost, Printhead, Waveform
from inkjet_env.recordings import Recording
from inkjet_env.rig import Request
from inkjet_env.typing import Real

SAMPLES_A_PERIOD = 100
"""Samples of a check per period of the head's resonance; the sampling step is rounded to two digits."""
AVERAGED = 0.15
"""Part of a period over which a residual is smoothed, by a parabola."""
REST_PERIODS = 20.0
"""Time after the window in which the head comes to rest before the next waveform, in periods of its resonance."""
DRAWS = 200
"""Number of draws of the noise."""


@dataclass(frozen=True)
class Measured:
    """Cost of a waveform on the head.

    Attributes
    ----------
    cost_V, error_V : float
        Peak cost and its standard error, in volts. Where two peaks are so nearly of the same height that the noise
        decides which is the effective one, it is the mean of what the cost may be.
    residual_V, noise_V : float
        RMS of what the recording shows beyond the prediction, and of its part that is noise, in volts. Where the former
        is much larger, the prediction is wrong, and the cost is no better than a guess.
    """

    cost_V: float
    error_V: float
    residual_V: float
    noise_V: float


def check_request(name: str, waveform: Waveform, frequency_Hz: float, window_s: float) -> Request:
    """Request for a recording of one drop: the waveform, repeated with enough rest for its ringing to die away.

    Parameters
    ----------
    name : str
        Name of the recording.
    waveform : Waveform
        The waveform.
    frequency_Hz : float
        Resonance frequency of the head, in hertz.
    window_s : float
        Time after the start within which peaks count, in seconds.
    """
    step_s = 1 / float(f"{SAMPLES_A_PERIOD * frequency_Hz:.1e}")
    length_s = max(window_s, waveform.duration_s) + REST_PERIODS / frequency_Hz
    time_s = step_s * np.arange(math.ceil(length_s / step_s))
    words = f"the waveform {name} once every {time_s.size * step_s:.4g} s, to see what it costs on the head"
    return Request(name, "self_sensing", "periodic", step_s, waveform.drive_V(time_s), False, "bipolar", None, words)


def predicted_V(
    recording: Recording, waveform: Waveform, head: Printhead | AugmentedPrinthead, window_s: float
) -> Real:
    """Signal in volts that a head predicts at the samples of a check, shape (n,), but for the channel's offset.

    The parameters are those of `measured`.
    """
    time_s = recording.time_s - recording.time_s[0]
    repeated = head.respond(waveform, window_s=window_s, period_s=time_s.size * recording.step_s)
    return np.asarray(repeated.sensor_V(time_s), dtype=np.float64)


def measured(
    recording: Recording,
    waveform: Waveform,
    head: Printhead | AugmentedPrinthead,
    cost: PeakCost,
    window_s: float,
) -> Measured:
    """Cost of a recorded waveform.

    Parameters
    ----------
    recording : Recording
        Answer to its `check_request`.
    waveform : Waveform
        The waveform.
    head : Printhead or AugmentedPrinthead
        Head that predicts the signal.
    cost : PeakCost
        The cost of a response.
    window_s : float
        Time after the start within which peaks count, in seconds.
    """
    time_s = recording.time_s - recording.time_s[0]
    residual_V = recording.sensor - predicted_V(recording, waveform, head, window_s)
    residual_V = residual_V - np.median(residual_V)  # the channel's offset
    width = max(5, 2 * round(AVERAGED / (2 * head.frequency_Hz * recording.step_s)) + 1)
    smooth_V = savgol_filter(residual_V, width, 2, mode="wrap")
    noise_V = float(np.std(residual_V - smooth_V)) * math.sqrt(width / max(width - 2.25, 1.0))
    alone = head.respond(waveform, window_s=window_s)
    heights_V = alone.peaks_V + np.interp(alone.peak_times_s, time_s, smooth_V)
    rng = np.random.default_rng(0)
    errors_V = savgol_filter(noise_V * rng.standard_normal((DRAWS, time_s.size)), width, 2, mode="wrap")
    at_peaks = np.minimum(np.rint(alone.peak_times_s / recording.step_s).astype(int), time_s.size - 1)
    drawn_V = heights_V + errors_V[:, at_peaks]
    costs_V = np.array([cost(row) for row in drawn_V])
    effective = cost.effective_index(heights_V)
    alike = np.array([cost.effective_index(row) == effective for row in drawn_V])
    # Errors raise a sum of magnitudes: once in the recording, and once more in the draws.
    adds_V = float(costs_V[alike].mean()) - cost(heights_V) if alike.any() else 0.0
    rms_V = float(np.sqrt(np.mean(residual_V**2)))
    return Measured(float(costs_V.mean()) - 2 * adds_V, float(costs_V.std()), rms_V, noise_V)
