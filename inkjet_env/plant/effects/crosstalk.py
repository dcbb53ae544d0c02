"""Crosstalk: the drive of the neighbouring channel in the sensor signal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.effects.feedthrough import rms, slopes
from inkjet_env.plant.effects.timebase_error import resampled
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.stages import Plant
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

MIDDLING = 0.05
"""Strength of the starts, relative to the head's response if the neighbour's drive were its own."""
DELAYS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5)
"""Delays of the starts, in periods of the head."""
MOST_PERIODS = 5.0
"""Longest delay, in periods of the head."""
REFERENCE_S = 1e-6
"""Time, in seconds, by which the slope of the neighbour's drive is multiplied: 1 µs."""


class Crosstalk(Effect):
    """Contribution of the neighbour's drive: a motion nearly like the head's own, its slope, and the drive itself.

    The motion is that of the head without effects under the neighbour's drive, multiplied by ``b1`` in the
    self-sensing channel and in hysteretic volts in the other channels. Through the ink it arrives later.
    """

    id = "crosstalk"
    stage = "sensing"
    sentence = "The neighbouring channel's drive appears in the sensor's signal."
    equation = (
        "y = y₀ + c_m H[u_n](t - delay_s) + c_e (1 µs) du_n/dt + c_d u_n, with H the head's own response at "
        "the frequency f (1 + detuning) and the damping ratio ζ (1 + damping_change) of the neighbour"
    )
    source = (
        "Wijshoff, The dynamics of the piezo inkjet printhead operation, Physics Reports 491(4-5), 2010: "
        "electrical, direct and acoustic cross-talk"
    )
    parameters = (
        Parameter("mechanical", "1", -10.0, 10.0, "linear", "fraction of the head's response to the same drive"),
        Parameter("electrical", "1", -1e6, 1e6, "linear", "signal for a neighbour's drive that rises by 1 V/µs"),
        Parameter("direct", "1", -10.0, 10.0, "linear", "signal for a neighbour's drive of 1 V"),
        Parameter(
            "detuning", "1", -0.5, 0.5, meaning="relative, of the neighbour's frequency", open_ended=True, plain=0.0
        ),
        Parameter(
            "damping_change", "1", -0.9, 5.0, meaning="relative, of its damping ratio", open_ended=True, plain=0.0
        ),
        Parameter("delay_s", "s", 0.0, 1.0, meaning="time that the motion takes to arrive", open_ended=True, plain=0.0),
    )
    strengths = ("mechanical", "electrical", "direct")
    signature = "coherent with the neighbour's drive; present while the head's own drive is at rest"
    confusable_with = ("feedthrough",)
    shown_by = "the neighbouring channel driven alone, and both channels driven (column neighbour_V)"
    needs_neighbour = True

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        heard = [s for s in excitations if s.channel != "drive_monitor" and s.neighbour_V is not None]
        answers, rises, drives = (
            rms([term[k] for term in (_parts(printhead, excitation) for excitation in heard)]) for k in range(3)
        )
        off = complete(self)
        return [
            *(off | {"mechanical": MIDDLING, "delay_s": part / printhead.frequency_Hz} for part in DELAYS),
            off | {"electrical": MIDDLING * answers / rises},
            off | {"direct": MIDDLING * answers / drives},
        ]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"mechanical": 0.03}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        longest_s = max((s.samples * s.step_s for s in excitations if s.fast), default=1.0)
        return {"delay_s": (0.0, min(MOST_PERIODS / printhead.frequency_Hz, longest_s, 1.0))}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        neighbours = [excitation.neighbour_V for excitation in excitations if excitation.neighbour_V is not None]
        if not neighbours:
            return "no recording has the neighbouring channel's drive (column neighbour_V)"
        if not any(np.ptp(neighbour) > 0 for neighbour in neighbours):
            return "the neighbouring channel's drive (column neighbour_V) is constant"
        return None

    def description(self, values: Values, unit: str = "V") -> str:
        mechanical, electrical, direct = (values[name] for name in self.strengths)
        heard = []
        if mechanical:
            late = f", {with_prefix(values['delay_s'], 's')} late" if values["delay_s"] else ""
            heard.append(f"{percent(mechanical)} of the head's response to the same drive{late}")
        if electrical:
            heard.append(f"{with_prefix(10 * electrical, unit)} on an edge of 10 V/µs")
        if direct:
            heard.append(f"{with_prefix(100 * direct, unit)} at a steady 100 V")
        return f"The neighbouring channel's drive appears in the sensor's signal: {', '.join(heard)}."

    def sensing(
        self, values: Values, signal: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        strengths = [values[name] for name in self.strengths]
        if excitation.neighbour_V is None or not any(strengths):
            return signal
        detuned, damped = 1 + values["detuning"], 1 + values["damping_change"]
        a0, a1 = printhead.a0 * detuned**2, printhead.a1 * detuned * damped
        terms = _parts(replace(printhead, a0=a0, a1=a1, b1=printhead.b1 * detuned), excitation)
        if values["delay_s"] and values["mechanical"]:
            places: Real = np.arange(signal.size, dtype=np.float64) - values["delay_s"] / excitation.step_s
            terms = (resampled(terms[0], places, excitation.periodic), *terms[1:])
        return signal + sum(strength * term for strength, term in zip(strengths, terms, strict=True))


def _parts(printhead: Printhead, excitation: Excitation) -> tuple[Real, Real, Real]:
    """Three contributions of the neighbour's drive at strength 1, shape (n,) each; cached for the last head."""
    key = (printhead.a0, printhead.a1, printhead.b1, printhead.coefficients, printhead.full_scale_V)
    kept_key, terms = excitation.cache.get("crosstalk", (None, None))
    if kept_key != key:
        neighbour = _neighbour(excitation)
        scale = printhead.b1 if excitation.channel == "self_sensing" else 1.0
        answer = scale * Plant(printhead).motion(neighbour.drive_at_nodes_V, neighbour)
        rise = REFERENCE_S * slopes(neighbour.drive_at_nodes_V, neighbour)
        terms = (answer, rise, neighbour.drive_V)
        excitation.cache["crosstalk"] = (key, terms)
    found: tuple[Real, Real, Real] = terms
    return found


def _neighbour(excitation: Excitation) -> Excitation:
    """The neighbour's drive as if it were the head's own; cached, together with the results that follow from it."""
    if excitation.neighbour_V is not None and "neighbour" not in excitation.cache:
        initial_state = "periodic" if excitation.periodic else "demagnetised"
        excitation.cache["neighbour"] = replace(
            excitation, drive_V=excitation.neighbour_V, initial_state=initial_state, cache={}
        )
    neighbour: Excitation = excitation.cache["neighbour"]
    return neighbour
