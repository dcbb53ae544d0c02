"""A sensor that is coupled through a capacitor: slow parts of its signal fade away."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.lag import lagged
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

PERIODS = (0.1, 0.03, 0.01, 0.003)
"""Corner frequencies of the starts, relative to the head's."""


class SensorHighpass(Effect):
    """High-pass of first order on the signal of a fast sensor.

    Its constant part cannot be distinguished from the offset behind the capacitor, so it stays: the capacitor is
    charged to the first value of a recording that starts at rest, and to the mean of any other.
    """

    id = "sensor_highpass"
    stage = "sensing"
    sentence = "The sensor is AC-coupled: slow parts of its signal fade away."
    equation = "y + τ y' = τ y₀', τ = 1 / (2π corner_Hz), up to a constant"
    source = "P. Horowitz, W. Hill, The Art of Electronics, 3rd edition, 2015, chapter 1: RC high-pass filters"
    parameters = (Parameter("corner_Hz", "Hz", 0.0, 1e8, meaning="half-power (-3 dB) frequency of the high-pass"),)
    strengths = ("corner_Hz",)
    signature = "held levels sag exponentially and the signal undershoots after them; fast oscillations are unaffected"
    confusable_with = ("baseline_drift", "slew_limit", "trigger_delay", "structural_damping")
    shown_by = "a step that is held for many periods of the resonance, seen by a displacement sensor"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        return [{"corner_Hz": min(part * printhead.frequency_Hz, 1e8)} for part in PERIODS]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"corner_Hz": 0.03 * printhead.frequency_Hz}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        return {"corner_Hz": (0.0, min(printhead.frequency_Hz, 1e8))}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return None if any(excitation.fast for excitation in excitations) else "no recording is from a fast sensor"

    def description(self, values: Values, unit: str = "V") -> str:
        return f"The sensor is AC-coupled: below {with_prefix(values['corner_Hz'], 'Hz', 3)} its signal fades away."

    def sensing(
        self, values: Values, signal: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        if not excitation.fast or values["corner_Hz"] == 0:
            return signal
        time_s, step_s = 1 / (2 * math.pi * values["corner_Hz"]), excitation.step_s
        if excitation.initial_state == "demagnetised":
            return signal - lagged(signal - signal[0], time_s, step_s, periodic=False)
        moved = signal - signal.mean()
        slow = lagged(moved, time_s, step_s, excitation.periodic)
        if not excitation.periodic:  # a lag that starts at 0 rather than at the first value
            slow = slow - moved[0] * np.exp(-step_s / time_s * np.arange(signal.size))
        result: Real = signal - slow
        return result
