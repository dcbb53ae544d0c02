"""Inductance of the cable and capacitance of the head: the voltage at the ceramic overshoots and rings."""

from __future__ import annotations

import math
from collections.abc import Sequence

from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.effects.second_mode import resolved_Hz
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.low_pass import low_passed
from inkjet_env.plant.recorded_motion import too_slow
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

LOWEST = 1.5
"""Lowest frequency of the starts, relative to that of the head."""
RATIOS = {0.3: 1.6, 0.1: 1.25}
"""Ratio of the frequencies of neighbouring starts, by damping ratio: a lighter damped ring needs a closer start."""
MOST_PERIODS_A_NODE = 1e6
"""Periods per node from which the voltage follows at once, to rounding."""


class DriveResonance(Effect):
    """Under-damped low-pass of second order between amplifier and ceramic.

    Above a damping ratio of 0.5 it is an amplifier of limited bandwidth. An inductance L with losses in its core, a
    resistance R parallel to it, in series with a resistance r and a capacitance C has
    κ 2 ζ/ω = L/R, 2 ζ/ω = L/R + r C and 1/ω² = L C (1 + r/R).
    """

    id = "drive_resonance"
    stage = "drive"
    sentence = "The cable's inductance and the head's capacitance resonate, so the drive rings after its edges."
    equation = "u + 2 ζ/ω u' + u''/ω² = u_requested + κ 2 ζ/ω u_requested', ω = 2π frequency_Hz"
    source = (
        "A. J. Fleming, K. K. Leang, Design, Modeling and Control of Nanopositioning Systems, Springer, 2014, chapter "
        "on electrical considerations: cable and capacitive load"
    )
    parameters = (
        Parameter("frequency_Hz", "Hz", 0.1, math.inf, "reciprocal", "undamped frequency of cable and head"),
        Parameter("damping_ratio", "1", 0.01, 0.5, "log", "ζ: damping ratio of cable and head"),
        Parameter(
            "core_loss_share",
            "1",
            0.0,
            1.0,
            meaning="κ: share of the damping by losses in a core (ferrite)",
            open_ended=True,
            plain=0.0,
        ),
    )
    strengths = ("frequency_Hz",)
    tuned = ("frequency_Hz",)
    signature = (
        "the drive itself rings at one frequency after each of its corners, in proportion to its change of slope"
    )
    confusable_with = ("amplifier_bandwidth", "sensor_bandwidth", "trigger_delay", "second_mode")
    shown_by = "the voltage at the head as well (column drive_monitor_V)"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        lowest_Hz, highest_Hz = LOWEST * printhead.frequency_Hz, self._range_Hz(excitations)[1]
        found = []
        for damping, ratio in RATIOS.items():
            count = int(math.log(max(highest_Hz / lowest_Hz, 1.0)) / math.log(ratio)) + 1
            found += [complete(self, frequency_Hz=lowest_Hz * ratio**k, damping_ratio=damping) for k in range(count)]
        return found

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return complete(self, frequency_Hz=6 * printhead.frequency_Hz, damping_ratio=0.15)

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        return {"frequency_Hz": self._range_Hz(excitations)}

    @staticmethod
    def _range_Hz(excitations: Sequence[Excitation]) -> tuple[float, float]:
        """Frequencies that fast recordings show: above the sampling rate as well, by the delay and the extremes."""
        fast = [excitation.step_s for excitation in excitations if excitation.fast]
        lowest_Hz, highest_Hz = resolved_Hz(excitations)
        return lowest_Hz, 2 / min(fast) if fast else highest_Hz

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        overshoot = overshoot_of_a_jump(values["damping_ratio"], values["core_loss_share"])
        return (
            f"Cable and head resonate at {with_prefix(values['frequency_Hz'], 'Hz', 3)}: after a jump the voltage "
            f"at the ceramic overshoots by {100 * overshoot:.2g} %."
        )

    def drive(self, values: Values, drive_V: Real, excitation: Excitation) -> Real:
        if values["frequency_Hz"] * excitation.node_step_s > MOST_PERIODS_A_NODE:
            return drive_V
        damping = values["damping_ratio"]
        time_s = 2 * damping / (2 * math.pi * values["frequency_Hz"])
        q = 1 / (4 * damping * damping)  # 1 + τ s + q τ² s² = 1 + 2 ζ s/ω + s²/ω²
        lead = values["core_loss_share"]
        return low_passed(drive_V, time_s, q, excitation.node_step_s, excitation.periodic, lead=lead)


def overshoot_of_a_jump(damping_ratio: float, core_loss_share: float) -> float:
    """Overshoot of the voltage after a jump, as a share of the jump: its response is 1 + e^(-ζ t) times a sinusoid."""
    damping, turns = damping_ratio, math.sqrt(1 - damping_ratio**2)
    lead = 2 * core_loss_share * damping  # slope of the voltage at the jump, in units of ω
    angle = math.pi - math.atan2(lead * turns, 1 - lead * damping)  # where the slope is zero first
    sinusoid = -math.cos(angle) + (lead - damping) / turns * math.sin(angle)
    return math.exp(-damping * angle / turns) * sinusoid
