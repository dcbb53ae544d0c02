"""A sensing amplifier that low-passes the signal."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.shot import Shot
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead

Real = NDArray[np.float64]

CUBIC = np.array([[0, -1 / 3, 1 / 2, -1 / 6], [1, -1 / 2, -1, 1 / 2], [0, 1, 1 / 2, -1 / 2], [0, -1 / 6, 0, 1 / 6]])
"""Powers of s, lowest first, of Lagrange's cubics through the samples -1, 0, 1, 2 between the samples 0 and 1."""


class SensorBandwidth(Effect):
    """First-order low-pass of what a fast sensor shows."""

    id = "sensor_bandwidth"
    stage = "sensing"
    sentence = "The sensing amplifier low-passes the signal."
    equation = "y' / (2π f) + y = y₀"
    source = "Horowitz & Hill, The Art of Electronics, 3rd edition, 2015, chapter 1: the RC low-pass"
    parameters = (Parameter("bandwidth_Hz", "Hz", 0.1, math.inf, "reciprocal", "where it passes half the power"),)
    strengths = ("bandwidth_Hz",)
    signature = "the sensor lags and is smoother, the same for every drive, amplitude and record"
    confusable_with = ("amplifier_bandwidth", "trigger_delay")
    shown_by = "the voltage at the head, recorded along (column drive_monitor_V)"

    def starts(self, printhead: Printhead, shots: Sequence[Shot]) -> list[dict[str, float]]:
        return [{"bandwidth_Hz": ratio * printhead.frequency_Hz} for ratio in (20.0, 6.0, 2.0)]

    def untestable(self, shots: Sequence[Shot]) -> str | None:
        return None if any(shot.fast for shot in shots) else "no recording is fast enough to show the resonance"

    def told(self, values: Values, unit: str = "V") -> str:
        return f"The sensing amplifier passes only up to {with_prefix(values['bandwidth_Hz'], 'Hz', 3)}."

    def sensing(self, values: Values, signal: Real, drive_V: Real, printhead: Printhead, shot: Shot) -> Real:
        if not shot.fast or math.isinf(values["bandwidth_Hz"]):
            return signal
        return low_passed(signal, 1 / (2 * math.pi * values["bandwidth_Hz"]), shot.step_s, shot.periodic)


def low_passed(signal: Real, time_constant_s: float, step_s: float, periodic: bool) -> Real:
    """The signal behind ``1 / (τ s + 1)``, shape (n,).

    Exact for the cubics through four samples. Of a tone it is wrong by less than 0.4 % of it at 9 samples a period,
    falling with the fourth power of the step. A drive that does not repeat begins at rest at the signal's first value.
    """
    from inkjet_env.plant import compiled

    z = step_s / time_constant_s
    weights = CUBIC @ moments(z)
    if periodic:
        ends = np.concatenate([signal[-1:], signal, signal[:2]])
    else:
        before = 3 * signal[0] - 3 * signal[1] + signal[2]
        after = 3 * signal[-1] - 3 * signal[-2] + signal[-3]
        ends = np.concatenate([[before], signal, [after]])
    gained = np.empty(ends.size - 2)  # what each step adds; of the first nothing
    gained[0] = 0.0
    gained[1:] = np.convolve(ends, weights[::-1], mode="valid")
    result = np.empty(gained.size)
    keep = math.exp(-z)
    start = float(signal[0])
    if periodic:
        start = compiled.lagged(gained, keep, 0.0, 1.0, 0.0, result) / -math.expm1(-z * signal.size)
    compiled.lagged(gained, keep, 0.0, 1.0, start, result)
    return result[: signal.size]


def moments(z: float) -> Real:
    """``∫₀¹ z e^{-(1-s) z} sʲ ds`` for j = 0 … 3, shape (4,)."""
    if z < 1:  # the recurrence would cancel
        terms = [(-z) ** k * z for k in range(20)]
        return np.array(
            [
                math.fsum(term * math.factorial(j) / math.factorial(j + k + 1) for k, term in enumerate(terms))
                for j in range(4)
            ]
        )
    result = [-math.expm1(-z)]
    for j in range(1, 4):
        result.append(1 - j / z * result[-1])
    return np.array(result)
