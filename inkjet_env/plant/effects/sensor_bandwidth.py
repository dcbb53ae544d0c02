"""A sensing amplifier that low-passes the signal."""

from __future__ import annotations

import math
from collections.abc import Sequence

from inkjet_env.plant.bandwidth import BANDWIDTH, SECOND_ORDER, low_pass_starts
from inkjet_env.plant.effect import Effect, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.low_pass import low_passed, time_constant_s
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real


class SensorBandwidth(Effect):
    """Low-pass with one pole or two on the signal of a fast sensor."""

    id = "sensor_bandwidth"
    stage = "sensing"
    sentence = "The sensing amplifier low-passes the signal."
    equation = "y + τ y' + q τ² y'' = y₀"
    source = "Horowitz & Hill, The Art of Electronics, 3rd edition, 2015, chapters 1 and 6: low-passes"
    parameters = (BANDWIDTH, SECOND_ORDER)
    strengths = ("bandwidth_Hz",)
    signature = "the signal is delayed and smoothed, equally for every drive, amplitude and recording"
    confusable_with = ("amplifier_bandwidth", "trigger_delay", "generator_steps", "nonlinear_capacitance")
    shown_by = "the voltage at the head as well (column drive_monitor_V)"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        return low_pass_starts(printhead)

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"bandwidth_Hz": 6 * printhead.frequency_Hz}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return (
            None
            if any(excitation.fast for excitation in excitations)
            else "no recording is fast enough to show the resonance"
        )

    def description(self, values: Values, unit: str = "V") -> str:
        return f"The sensing amplifier has a bandwidth of only {with_prefix(values['bandwidth_Hz'], 'Hz', 3)}."

    def sensing(
        self, values: Values, signal: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        if not excitation.fast or math.isinf(values["bandwidth_Hz"]):
            return signal
        time_s = time_constant_s(values["bandwidth_Hz"], values["second_order"])
        return low_passed(signal, time_s, values["second_order"], excitation.step_s, excitation.periodic, cubic=True)
