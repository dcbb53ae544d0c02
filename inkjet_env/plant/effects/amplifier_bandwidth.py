"""A drive amplifier that low-passes the commanded drive."""

from __future__ import annotations

import math
from collections.abc import Sequence

from inkjet_env.plant.bandwidth import BANDWIDTH, SECOND_ORDER, low_pass_starts
from inkjet_env.plant.effect import Effect, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.low_pass import low_passed, time_constant_s
from inkjet_env.plant.recorded_motion import too_slow
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real


class AmplifierBandwidth(Effect):
    """Low-pass with one pole or two on the drive before it reaches the ceramic."""

    id = "amplifier_bandwidth"
    stage = "drive"
    sentence = "The amplifier low-passes the drive before it reaches the ceramic."
    equation = "u + τ u' + q τ² u'' = u_requested"
    source = "Horowitz & Hill, The Art of Electronics, 3rd edition, 2015, chapters 1 and 6: low-passes"
    parameters = (BANDWIDTH, SECOND_ORDER)
    strengths = ("bandwidth_Hz",)
    signature = "edges of the drive are rounded and delayed, whatever their slope and level"
    confusable_with = (
        "sensor_bandwidth",
        "trigger_delay",
        "slew_limit",
        "drive_resonance",
        "generator_steps",
        "nonlinear_capacitance",
    )
    shown_by = "the voltage at the head as well (column drive_monitor_V)"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        return low_pass_starts(printhead)

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"bandwidth_Hz": 6 * printhead.frequency_Hz}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        return f"The amplifier has a bandwidth of only {with_prefix(values['bandwidth_Hz'], 'Hz', 3)}."

    def drive(self, values: Values, drive_V: Real, excitation: Excitation) -> Real:
        if math.isinf(values["bandwidth_Hz"]):
            return drive_V
        time_s = time_constant_s(values["bandwidth_Hz"], values["second_order"])
        return low_passed(drive_V, time_s, values["second_order"], excitation.node_step_s, excitation.periodic)
