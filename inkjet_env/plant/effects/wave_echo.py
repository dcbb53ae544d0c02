"""A travelling wave that is thrown back at the end of the channel and returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.resonance import Echo, Resonance, too_slow
from inkjet_env.plant.shot import Shot
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead

GUESSES = tuple(0.25 * quarter for quarter in range(1, 49))
"""Delays in periods of the head. A fit finds the delay from within an eighth of a period and seldom from farther, as a
ringing head looks much the same a period later."""

SHORTEST = 0.15
"""Delay in periods: a wave that is back sooner is a matter of bandwidth."""


class WaveEcho(Effect):
    """A copy of the motion, delayed and weaker."""

    id = "wave_echo"
    stage = "resonator"
    sentence = "A pressure wave is thrown back within the head and returns after a delay."
    equation = "y(t) + r y(t - τ)"
    source = (
        "D. B. Bogy, F. E. Talke, Experimental and theoretical study of wave propagation phenomena in drop-on-demand "
        "ink jet devices, IBM Journal of Research and Development 28, 1984"
    )
    parameters = (
        Parameter("delay_s", "s", 1e-9, 1e3, "log", "until the wave is back"),
        Parameter("strength", "1", -0.9, 0.9, meaning="of the wave that is back, over the one that left"),
    )
    strengths = ("strength",)
    signature = "every feature of a response comes back after the same delay; the spectrum is rippled at 1/delay"
    confusable_with = ("second_mode", "trigger_delay")
    shown_by = "one short steep pulse with a long quiet time after it"

    def starts(self, printhead: Printhead, shots: Sequence[Shot]) -> list[dict[str, float]]:
        longest_s = max((shot.samples * shot.step_s for shot in shots if shot.fast), default=0.0)
        period_s = 1 / printhead.frequency_Hz
        delays_s = [guess * period_s for guess in GUESSES if guess * period_s < longest_s] or [longest_s / 2]
        return [{"delay_s": delay_s, "strength": 0.03} for delay_s in delays_s]

    def bounds(self, printhead: Printhead, shots: Sequence[Shot]) -> dict[str, tuple[float, float]]:
        longest_s = max((shot.samples * shot.step_s for shot in shots if shot.fast), default=1.0)
        shortest_s = SHORTEST / printhead.frequency_Hz
        return {"delay_s": (shortest_s, max(longest_s / 2, 2 * shortest_s))}

    def untestable(self, shots: Sequence[Shot]) -> str | None:
        return too_slow(shots)

    def told(self, values: Values, unit: str = "V") -> str:
        turned = ", turned over," if values["strength"] < 0 else ""
        return (
            f"A wave returns {with_prefix(values['delay_s'], 's')} later{turned} "
            f"with {percent(abs(values['strength']))} of its strength."
        )

    def resonator(self, values: Values, resonance: Resonance, shot: Shot) -> Resonance:
        if values["strength"] == 0:
            return resonance
        return replace(resonance, echoes=(*resonance.echoes, Echo(values["delay_s"], values["strength"])))
