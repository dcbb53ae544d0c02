"""Shapes of drives: pulses, multisines, loops and staircases as sampled rows."""

import numpy as np

from experiments.concealed_rig.measurement import Measurement


def polyline_V(times_s: np.ndarray, corners_s: list[float], corners_V: list[float]) -> np.ndarray:
    """A drive through corners, 0 V before the first and the last value after the last one, at `times_s`, shape (n,)."""
    return np.interp(times_s, corners_s, corners_V, left=0.0)


def trapezoid_V(
    times_s: np.ndarray, start_s: float, top_V: float, rise_s: float, dwell_s: float, fall_s: float
) -> np.ndarray:
    """0 → top → 0, shape (n,)."""
    corners = np.cumsum([start_s, rise_s, dwell_s, fall_s])
    return polyline_V(times_s, list(corners), [0.0, top_V, top_V, 0.0])


def bipolar_V(times_s: np.ndarray, start_s: float, waveform: np.ndarray) -> np.ndarray:
    """The seven-parameter waveform U1, U2, t1 … t5 of section 3 of the contract, shape (n,)."""
    first, second = float(waveform[0]), float(waveform[1])
    corners = np.cumsum([start_s, *waveform[2:]])
    return polyline_V(times_s, list(corners), [0.0, first, first, second, second, 0.0])


def multisine_V(times_s: np.ndarray, lines: np.ndarray, amplitude_V: float, rng: np.random.Generator) -> np.ndarray:
    """Harmonics `lines` of the recording's own period with random phases, its largest value `amplitude_V`."""
    period = times_s[1] * times_s.size
    phase = rng.uniform(0, 2 * np.pi, lines.size)
    wave = np.sum(np.cos(2 * np.pi * np.outer(lines, times_s) / period + phase[:, None]), axis=0)
    return wave * amplitude_V / np.max(np.abs(wave))


def triangle_V(times_s: np.ndarray, frequency_Hz: float, low_V: float, high_V: float) -> np.ndarray:
    """From the mean up: a triangle between two voltages."""
    phase = (times_s * frequency_Hz + 0.25) % 1.0
    return low_V + (high_V - low_V) * (1 - np.abs(2 * phase - 1))


def minor_loops_V(times_s: np.ndarray, turning_V: list[float]) -> np.ndarray:
    """Straight lines of equal speed through turning points, from 0 V and back to it, over the recording."""
    corners = np.array([0.0, *turning_V, 0.0])
    way = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(corners)))))
    return np.interp(times_s, way / way[-1] * times_s[1] * times_s.size, corners)


def staircase_V(times_s: np.ndarray, levels_V: list[float], edge_s: float) -> np.ndarray:
    """Steps to `levels_V`, each held for an equal share of the recording."""
    hold = times_s[1] * times_s.size / len(levels_V)
    corners_s: list[float] = []
    corners_V: list[float] = []
    before = 0.0
    for k, level in enumerate(levels_V):
        corners_s += [k * hold + 0.02 * hold, k * hold + 0.02 * hold + edge_s]
        corners_V += [before, level]
        before = level
    return np.interp(times_s, corners_s, corners_V)


def times_s(samples: int, step_s: float) -> np.ndarray:
    """Times of the samples, shape (n,)."""
    return np.arange(samples) * step_s


def fast(
    excitation: str, initial_state: str, step_s: float, drive_V: np.ndarray, channel: str = "self_sensing"
) -> Measurement:
    """A measurement of the fast channels."""
    return Measurement(channel, excitation, initial_state, step_s, np.round(drive_V, 4))
