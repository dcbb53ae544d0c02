"""Another mode that the drive excites: refill, Helmholtz, or of the structure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.recorded_motion import too_slow
from inkjet_env.plant.resonance import Mode, Resonance
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead

GUESSES = (0.25, 0.36, 0.5, 0.7, 1.3, 1.7, 2.3, 3.1, 4.3, 6.0)
"""Frequencies of the starts, relative to that of the head."""
WIDE = 0.1
"""Damping ratio of a start: a wide resonance overlaps a true one between two guesses, however narrow that is."""
RESOLVED = 0.4
"""Highest frequency of a mode, as a share of the sampling frequency."""


def resolved_Hz(excitations: Sequence[Excitation]) -> tuple[float, float]:
    """Lowest and highest frequency in hertz that the fast recordings resolve: a whole period, sampled finely enough."""
    fast = [excitation for excitation in excitations if excitation.fast]
    if not fast:
        return 1e-2, 1e8
    return 0.5 / max(excitation.samples * excitation.step_s for excitation in fast), RESOLVED / min(
        excitation.step_s for excitation in fast
    )


class SecondMode(Effect):
    """A second resonator beside the first, under the same hysteretic drive."""

    id = "second_mode"
    stage = "resonator"
    sentence = "The head rings in a second mode besides its main one."
    equation = "x + g x2 + e ω0 (x2' / ω2² - x' / ω0²), x2'' + 2 ζ2 ω2 x2' + ω2² x2 = ω2² v"
    source = (
        "H. Wijshoff, The dynamics of the piezo inkjet printhead operation, Physics Reports 491, 2010; modes coupled "
        "by damping: D. J. Ewins, Modal Testing, 2nd edition, Research Studies Press, 2000"
    )
    parameters = (
        Parameter("frequency_Hz", "Hz", 1e-2, 1e8, "log", "undamped frequency of the second mode"),
        Parameter("damping_ratio", "1", 0.002, 0.5, "log", "damping ratio of the second mode"),
        Parameter("strength", "1", -2.0, 2.0, meaning="g: static deflection of the second mode over the first's"),
        Parameter("exchange", "1", -0.5, 0.5, meaning="e: coupling by damping, which turns the phases", plain=0.0),
    )
    strengths = ("strength",)
    signature = "a second peak in the spectrum, the same at every amplitude; it beats with the main mode"
    confusable_with = ("wave_echo", "air_bubble", "drive_resonance")
    shown_by = "a multisine over many octaves, and a steep step with its whole ring-down"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        fast = [excitation for excitation in excitations if excitation.fast]
        highest_Hz = RESOLVED / min((excitation.step_s for excitation in fast), default=1.0)
        speed = any(excitation.channel == "self_sensing" for excitation in fast)
        return [
            complete(
                self,
                frequency_Hz=guess * printhead.frequency_Hz,
                damping_ratio=WIDE,
                strength=min(0.05 / guess if speed else 0.05, 0.2),
            )
            for guess in GUESSES
            if guess * printhead.frequency_Hz < highest_Hz
        ]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"frequency_Hz": 1.7 * printhead.frequency_Hz, "damping_ratio": 0.04, "strength": 0.02}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        return {"frequency_Hz": resolved_Hz(excitations)}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        coupled = " Damping couples the two modes." if values["exchange"] else ""
        return (
            f"The head rings in a second mode at {with_prefix(values['frequency_Hz'], 'Hz', 3)} with a damping ratio "
            f"of {values['damping_ratio']:.2g}; it adds {percent(values['strength'])} to the static deflection."
            f"{coupled}"
        )

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        if values["strength"] == 0:
            return resonance
        omega = 2 * math.pi * values["frequency_Hz"]
        mode = Mode(omega * omega, 2 * values["damping_ratio"] * omega, values["strength"], values["exchange"])
        return replace(resonance, modes=(*resonance.modes, mode))
