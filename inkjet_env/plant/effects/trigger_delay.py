"""Drive and sensor that are not aligned in time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

PERIODS = (0.02, 0.1, 0.3)
"""Delays of the starts, in periods of the head."""
SAMPLES = (0.5, 2.0)
"""Further delays of the starts, in samples."""


class TriggerDelay(Effect):
    """The ceramic sees the commanded drive late, or early, by a constant time."""

    id = "trigger_delay"
    stage = "drive"
    sentence = "Drive and sensor are not aligned in time."
    equation = "u(t) = u_asked(t - delay)"
    source = "Ljung, System Identification: Theory for the User, 2nd edition, 1999: the input's delay"
    parameters = (Parameter("delay_s", "s", -1.0, 1.0, meaning="delay of the drive at the ceramic"),)
    strengths = ("delay_s",)
    signature = "every response is late or early by the same time, its shape unchanged"
    confusable_with = ("amplifier_bandwidth", "sensor_bandwidth", "generator_steps", "nonlinear_capacitance")
    shown_by = "a steep step, sampled as finely as the instrument allows"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        step_s = min(
            (excitation.step_s for excitation in excitations if excitation.fast),
            default=excitations[0].step_s if excitations else 0.0,
        )
        period_s = 1 / printhead.frequency_Hz
        sizes = {periods * period_s for periods in PERIODS} | {samples * step_s for samples in SAMPLES}
        return [{"delay_s": sign * size} for size in sorted(sizes - {0.0}) for sign in (1, -1)]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"delay_s": 0.03 * (1 / printhead.frequency_Hz)}

    def description(self, values: Values, unit: str = "V") -> str:
        delay_s = values["delay_s"]
        when = "later" if delay_s > 0 else "earlier"
        return f"The drive reaches the ceramic {with_prefix(abs(delay_s), 's')} {when} than recorded."

    def advance_s(self, values: Values) -> float:
        return max(-values["delay_s"], 0.0)

    def drive(self, values: Values, drive_V: Real, excitation: Excitation) -> Real:
        if values["delay_s"] == 0:
            return drive_V
        return late(drive_V, values["delay_s"] / excitation.node_step_s, excitation.periodic)


def late(signal: Real, nodes: float, periodic: bool) -> Real:
    """Delay a signal that is linear between its values, shape (n,).

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Signal at the nodes.
    nodes : float
        Delay in nodes; may be negative and fractional.
    periodic : bool
        Whether the value after the last is the first; otherwise the signal is held before its first value and after
        its last.
    """
    whole = math.floor(nodes)
    term = nodes - whole
    index = np.arange(-1, signal.size) - whole
    moved = signal[index % signal.size if periodic else np.clip(index, 0, signal.size - 1)]
    result: Real = moved[1:] + term * (moved[:-1] - moved[1:])
    return result
