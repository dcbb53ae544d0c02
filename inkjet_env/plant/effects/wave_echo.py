"""A travelling wave that is reflected at the end of the channel and returns."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array, vstack

from inkjet_env.plant.echo import Echo
from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.recorded_motion import too_slow
from inkjet_env.plant.resonance import Resonance
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead

GUESSES = tuple(0.25 * quarter for quarter in range(1, 49))
"""Delays of the starts, in periods of the head. A fit finds the delay from within an eighth of a period and seldom from
farther, since a ringing head looks much the same a period later."""

GRID = 0.125
"""Step of the delays of two ends in the starts, in periods of the head."""
FIRST = 2
"""Shortest of these delays, in steps."""
LATEST = 64
"""Longest of these delays, in steps."""
REFLECTIONS = (-0.7, -0.35, 0.35, 0.7)
"""Reflection coefficients in the starts."""
ROUND_TRIPS = 6
"""Number of returns from each end that the starts include."""
SHORTEST = 0.15
"""Shortest delay, in periods of the head; a wave that returns sooner is indistinguishable from a bandwidth."""


class WaveEcho(Effect):
    """A delayed, weaker copy of the motion; if the channel's other end reflects it too, a series of copies."""

    id = "wave_echo"
    stage = "resonator"
    sentence = "A pressure wave is reflected within the head and returns after a delay."
    equation = (
        "y + strength E y, E = (z1 + r2/r1 z2 + 2 r2 z1 z2) / (1 - r1 r2 z1 z2): a wave between two ends with "
        "reflections r1, r2; z1, z2 delays after a lag of loss_s; r2 = 0: one return"
    )
    source = (
        "D. B. Bogy, F. E. Talke, Experimental and theoretical study of wave propagation phenomena in drop-on-demand "
        "ink jet devices, IBM Journal of Research and Development 28, 1984"
    )
    parameters = (
        Parameter("delay_s", "s", 1e-9, 1e3, "log", "time until the wave returns"),
        Parameter("strength", "1", -0.9, 0.9, meaning="amplitude of the returned wave over the emitted one"),
        Parameter("second_delay_s", "s", 1e-9, 1e3, "log", "time until it returns from the other end", plain=1e-9),
        Parameter(
            "reflection", "1", -0.98, 0.98, meaning="r1: reflection at the first end", open_ended=True, plain=0.98
        ),
        Parameter("second_reflection", "1", -0.98, 0.98, meaning="r2: reflection at the other end", plain=0.0),
        Parameter("loss_s", "s", 0.0, 1.0, meaning="lag at each reflection", open_ended=True, plain=0.0),
    )
    strengths = ("strength",)
    terms = (("strength",), ("second_reflection", "second_delay_s", "reflection"))
    signature = "every feature of a response returns after the same delay; the spectrum has ripples 1/delay apart"
    confusable_with = ("second_mode", "trigger_delay")
    shown_by = "one short steep pulse followed by a long rest"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        longest_s = max(
            (excitation.samples * excitation.step_s for excitation in excitations if excitation.fast), default=0.0
        )
        period_s = 1 / printhead.frequency_Hz
        delays_s = [guess * period_s for guess in GUESSES if guess * period_s < longest_s] or [longest_s / 2]
        return [complete(self, delay_s=delay_s, strength=0.03) for delay_s in delays_s]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"delay_s": 2.6 * (1 / printhead.frequency_Hz), "strength": 0.06}

    def superposed(
        self, printhead: Printhead, excitations: Sequence[Excitation]
    ) -> tuple[list[dict[str, float]], list[dict[str, float]], csr_array]:
        """Waves between two ends, with the delays of each end on a grid and both signs of each reflection."""
        longest_s = max(
            (excitation.samples * excitation.step_s for excitation in excitations if excitation.fast), default=0.0
        )
        step_s = GRID / printhead.frequency_Hz
        latest = min(LATEST, max(FIRST, int(longest_s / 2 / step_s)))
        copies = 3 * latest
        elements = [complete(self, delay_s=k * step_s, strength=0.03) for k in range(1, copies + 1)]
        sooner, later = np.meshgrid(*[np.arange(FIRST, latest + 1)] * 2, indexing="ij")
        pairs = np.column_stack([sooner.ravel(), later.ravel()])
        pairs = pairs[pairs[:, 0] <= pairs[:, 1]]
        starts: list[dict[str, float]] = []
        weights = []
        for r1, r2 in itertools.product(REFLECTIONS, repeat=2):
            rows, places, values = [], [], []
            for j, k in itertools.product(range(ROUND_TRIPS), repeat=2):
                if abs(j - k) <= 1 and j + k:
                    at = pairs @ (j, k)
                    heard = at <= copies
                    rows.append(np.flatnonzero(heard))
                    places.append(at[heard] - 1)
                    values.append(np.full(rows[-1].size, (2 if j == k else 1) * r1**j * r2**k / r1))
            index = (np.concatenate(rows), np.concatenate(places))
            weights.append(csr_array((np.concatenate(values), index), shape=(len(pairs), copies)))
            starts.extend(
                complete(
                    self,
                    delay_s=a * step_s,
                    second_delay_s=b * step_s,
                    strength=0.03,
                    reflection=r1,
                    second_reflection=r2,
                )
                for a, b in pairs
            )
        return elements, starts, vstack(weights, format="csr")

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        longest_s = max(
            (excitation.samples * excitation.step_s for excitation in excitations if excitation.fast), default=1.0
        )
        shortest_s = SHORTEST / printhead.frequency_Hz
        delays_s = (shortest_s, max(longest_s / 2, 2 * shortest_s))
        return {"delay_s": delays_s, "second_delay_s": delays_s, "loss_s": (0.0, 1 / printhead.frequency_Hz)}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        turned = ", inverted," if values["strength"] < 0 else ""
        text = (
            f"A wave returns {with_prefix(values['delay_s'], 's')} later{turned} "
            f"with {percent(abs(values['strength']))} of its strength."
        )
        if values["second_reflection"]:
            round_s, kept = (
                values["delay_s"] + values["second_delay_s"],
                values["reflection"] * values["second_reflection"],
            )
            text += (
                f" From the channel's other end it returns after {with_prefix(values['second_delay_s'], 's')}; a wave "
                f"reflected at both ends keeps {percent(abs(kept))} of its strength every {with_prefix(round_s, 's')}."
            )
        return text

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        if values["strength"] == 0:
            return resonance
        echo = Echo(*(values[parameter.name] for parameter in self.parameters))
        return replace(resonance, echoes=(*resonance.echoes, echo))
