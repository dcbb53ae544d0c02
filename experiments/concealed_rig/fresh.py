"""Drives that no campaign holds, for judging a model on what nobody saw."""

import numpy as np

from experiments.concealed_rig.battery import SAMPLES, fast_step_s
from experiments.concealed_rig.head import Head
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.shapes import fast, times_s, trapezoid_V


def _raised_cosines(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    drive = np.zeros(t.size)
    for start in 1e-5 + t[-1] * np.array([0.0, 0.06, 0.15]):
        width = rng.uniform(8e-6, 3e-5)
        phase = np.clip((t - start) / width, 0, 1)
        drive += rng.uniform(-70, 70) * 0.5 * (1 - np.cos(2 * np.pi * phase))
    return drive


def _chirp(t: np.ndarray, resonance_Hz: float, rng: np.random.Generator) -> np.ndarray:
    low, high = 0.3 * resonance_Hz, rng.uniform(1.5, 2.0) * resonance_Hz
    phase = 2 * np.pi * (low * t + (high - low) * t**2 / (2 * t[-1]))
    return rng.uniform(20, 35) * np.sin(np.pi * t / t[-1]) ** 2 * np.sin(phase)


def _steps_up_and_down(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    corners = np.sort(rng.uniform(1e-5, 0.5 * t[-1], 8))
    levels = np.repeat(np.append(0.0, rng.uniform(-80, 95, 8)), 2)
    times = np.concatenate(([0.0], np.repeat(corners, 2), [t[-1]]))
    times[2::2] += rng.uniform(1.2e-6, 6e-6, times[2::2].size)
    times = np.maximum.accumulate(times)
    drive = np.interp(t, times, levels)
    # Back to 0 V in the second half, so that the recording may repeat.
    return drive * np.clip((0.75 * t[-1] - t) / (0.05 * t[-1]), 0, 1)


def _slow_wander(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    lines = np.arange(1, 7)
    phase = rng.uniform(0, 2 * np.pi, lines.size)
    wave = np.sum(np.sin(2 * np.pi * np.outer(lines, t) / (t[1] * t.size) + phase[:, None]) / lines[:, None], axis=0)
    return rng.uniform(70, 95) * wave / np.max(np.abs(wave))


def fresh_drives(head: Head, order: int, rng: np.random.Generator, displacement: bool = False) -> list[Measurement]:
    """Raised cosines, bursts, a chirp, random steps and slow wandering: shapes and amplitudes of no campaign.

    Parameters
    ----------
    head : Head
    order : int
        When they would be taken.
    rng : numpy.random.Generator
    displacement : bool
        One of them on the vibrometer as well.

    Returns
    -------
    list of Measurement
    """
    step = fast_step_s(head, rng)
    t = times_s(SAMPLES, step)
    burst = np.zeros(SAMPLES)
    for start in np.cumsum(rng.uniform(1.1, 2.7, 4)) / head.resonance_Hz:
        burst += trapezoid_V(t, float(start), float(rng.uniform(25, 50)), 2e-6, 7e-6, 4e-6)
    rows = [
        fast("arbitrary", "periodic", step, _raised_cosines(t, rng)),
        fast("arbitrary", "periodic", step, np.clip(burst, -100, 100)),
        fast("arbitrary", "demagnetised", step, _chirp(t, head.resonance_Hz, rng)),
        fast("arbitrary", "periodic", step, _steps_up_and_down(t, rng)),
    ]
    slow = times_s(SAMPLES, 1.5e-3)
    rows.append(Measurement("strain_gauge", "arbitrary", "periodic", 1.5e-3, _slow_wander(slow, rng)))
    if displacement:
        rows.append(fast("arbitrary", "periodic", step, _raised_cosines(t, rng), "displacement"))
    return [Measurement(r.channel, r.excitation, r.initial_state, r.step_s, r.drive_V, order=order) for r in rows]
