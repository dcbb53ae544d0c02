"""Peak cost of a waveform as it was recorded on the head.

Small peaks drown in the noise, and the cost adds up their magnitudes, so reading them off a recording would overrate
it; and whether there is a small peak just after the largest one, which weighs most, no recording with noise can tell.
The recorded signal is therefore compared with the predicted one of the same repeated drive, and what it shows clearly
beyond that is added to the prediction for a single drop: `drop_signal.Shown`. This holds as far as the prediction does:
`Measured` tells by how much the recording exceeds it, and what the waveform may cost at worst.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from inkjet_env.experiments.tuning.careful_cost import CarefulCost
from inkjet_env.experiments.tuning.drop_signal import (
    ERRORS,
    REST_PERIODS,
    SAMPLES_A_PERIOD,
    Shown,
    mean_repetition,
    predicted_signals,
)
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import PeakCost, Printhead, Waveform, respond_sampled
from inkjet_env.recordings import Recording
from inkjet_env.rig import Request
from inkjet_env.typing import Real

REPETITIONS = 16
"""Number of repetitions that a check records, and averages."""
CHECKED = 0.2
"""How much of what a waveform may cost beyond its recorded cost counts when waveforms are compared."""
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
    worst_V : float
        The most it may cost, in volts, where small peaks that the noise hides count; see `careful_cost`.
    residual_V, noise_V : float
        RMS of what the recording shows beyond the prediction, and of its part that is noise, in volts. Where the former
        is much larger, the prediction is wrong, and the cost is no better than a guess.
    """

    cost_V: float
    error_V: float
    worst_V: float
    residual_V: float
    noise_V: float

    @property
    def risk_V(self) -> float:
        """By what waveforms are compared, in volts: the cost, and `CHECKED` of what it may cost beyond that."""
        return self.cost_V + CHECKED * (self.worst_V - self.cost_V)


def check_request(name: str, waveform: Waveform, frequency_Hz: float, window_s: float) -> Request:
    """Request for a recording of some drops: the waveform, each time with enough rest for its ringing to die away.

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
    step_s, samples = _repetition(waveform, frequency_Hz, window_s)
    time_s = step_s * np.arange(samples)
    once = f"once every {samples * step_s:.4g} s"
    words = f"the waveform {name} {REPETITIONS} times, {once}, to see what it costs on the head"
    drive_V = np.tile(waveform.drive_V(time_s), REPETITIONS)
    return Request(name, "self_sensing", "periodic", step_s, drive_V, False, "bipolar", None, words)


def _repetition(waveform: Waveform, frequency_Hz: float, window_s: float) -> tuple[float, int]:
    """Sampling step in seconds, and number of samples, of one repetition with its rest."""
    step_s = 1 / float(f"{SAMPLES_A_PERIOD * frequency_Hz:.1e}")
    return step_s, math.ceil((max(window_s, waveform.duration_s) + REST_PERIODS / frequency_Hz) / step_s)


def averaged(recording: Recording, waveform: Waveform, frequency_Hz: float, window_s: float) -> Recording:
    """One repetition of the answer to a `check_request`: the mean of all; the parameters are those of the request."""
    step_s, samples = _repetition(waveform, frequency_Hz, window_s)
    return mean_repetition(recording, samples * step_s)


def expected_V(
    taken: Recording, waveform: Waveform, head: Printhead | AugmentedPrinthead, frequency_Hz: float, window_s: float
) -> Real:
    """Signal in volts that a head predicts at the samples of one repetition, but for the channel's offset.

    It is the mean over all repetitions of the drive as it is sampled, since the clock of a generator whose output is
    a staircase runs on from one to the next.

    Parameters
    ----------
    taken : Recording
        One repetition, from `averaged`.
    waveform : Waveform
        The waveform.
    head : Printhead or AugmentedPrinthead
        The head.
    frequency_Hz, window_s : float
        As the `check_request` was made with.

    Returns
    -------
    ndarray, shape (n,)
    """
    request = check_request(taken.name, waveform, frequency_Hz, window_s)
    time_s = request.step_s * np.arange(request.drive_V.size)
    period_s = time_s.size * request.step_s
    if isinstance(head, AugmentedPrinthead):
        try:
            response = head.respond_sampled(time_s, request.drive_V, period_s=period_s)
        except ValueError as error:
            if not isinstance(error.__cause__, FloatingPointError):
                raise
            # no steady state of so long a drive was found: from rest, to which the head comes each time
            response = head.respond_sampled(time_s, request.drive_V)
    else:
        response = respond_sampled(head, time_s, request.drive_V, period_s=period_s)
    once_V = response.sensor_V.reshape(REPETITIONS, -1).mean(axis=0)
    knots_s = time_s[: once_V.size + 1]
    periodic = CubicSpline(knots_s, np.append(once_V, once_V[0]), bc_type="periodic")
    return np.asarray(periodic(taken.time_s - taken.time_s[0]), dtype=np.float64)


def seen(recording: Recording, waveform: Waveform, head: Printhead | AugmentedPrinthead, window_s: float) -> Shown:
    """What the answer to a `check_request` shows beyond the prediction; see `Shown.by`."""
    frequency_Hz = head.frequency_Hz
    taken = averaged(recording, waveform, frequency_Hz, window_s)
    return Shown.by(taken, waveform, expected_V(taken, waveform, head, frequency_Hz, window_s), frequency_Hz)


def measured(shown: Shown, head: Printhead | AugmentedPrinthead, cost: PeakCost, window_s: float) -> Measured:
    """Cost of a recorded waveform.

    Parameters
    ----------
    shown : Shown
        What the recording that answered its `check_request` shows beyond the prediction.
    head : Printhead or AugmentedPrinthead
        Head that predicts the signal.
    cost : PeakCost
        The cost of a response.
    window_s : float
        Time after the start within which peaks count, in seconds.
    """
    rows = shown.waveform.to_array()[None]
    signal = shown.added_to(next(predicted_signals(rows, head, "periodic", window_s, shown.period_s)))
    times_s, heights_V = signal.peaks(window_s)
    at_peaks = np.minimum(np.rint(times_s / (shown.time_s[1] - shown.time_s[0])).astype(int), shown.time_s.size - 1)
    rng = np.random.default_rng(0)
    begins = rng.integers(shown.noise_V.size, size=(DRAWS, 1))
    errors_V = shown.noise_V[(begins + at_peaks) % shown.noise_V.size]
    costs_V = np.array([cost(heights_V + row) for row in errors_V])
    # Errors raise a sum of magnitudes: once in the draws, and once more in what the recording shows.
    adds_V = _added_V(cost, heights_V, errors_V) + _added_V(cost, heights_V, shown.clear[at_peaks] * errors_V)
    careful = CarefulCost(cost.A, cost.B, cost.effective, cost.target_height_V, ERRORS * shown.error_V)
    worst_V = careful.of_signal(signal, head.frequency_Hz, window_s)
    cost_V = float(costs_V.mean()) - adds_V
    return Measured(cost_V, float(costs_V.std()), max(worst_V, cost_V), shown.residual_V, shown.noise_rms_V)


def _added_V(cost: PeakCost, heights_V: Real, errors_V: Real) -> float:
    """What errors of the peaks, shape (draws, peaks), add to a cost on average while the effective peak stays."""
    effective = cost.effective_index(heights_V)
    costs_V = [cost(row) for row in heights_V + errors_V if cost.effective_index(row) == effective]
    return float(np.mean(costs_V)) - cost(heights_V) if costs_V else 0.0
