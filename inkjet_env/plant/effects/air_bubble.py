"""Air drawn in at the nozzle: from one recording on, the head is detuned and rings in a further mode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.effects.second_mode import resolved_Hz
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.recorded_motion import too_slow
from inkjet_env.plant.resonance import Mode, Resonance
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead

FEWEST_ORDERS = 4
"""Smallest number of fast recordings of different order that can show an onset."""
MOST_ONSETS = 12
"""Largest number of onsets among the starts; a fit moves an onset by a recording or two, so starts must be as near."""
COUPLED = (0.6, 0.8, 1.3)
"""Frequencies of the bubble of the starts with a mass, in frequencies of the head."""
GROWTH = 4.0
"""Number of recordings in which it grows, of further starts."""
LEAST_VOLUME = 0.01
"""Share of its final volume below which a bubble's frequency rises no more."""


class AirBubble(Effect):
    """A shift of the resonance and a further mode, both from ``onset_order`` on, at once or growing to their full size.

    Over the last order before the onset the bubble's volume grows linearly, so that a fit can find the onset; orders
    are whole numbers, so at most one recording falls within. It may grow for further ``growth_orders``; the frequency
    of a bubble falls with the cube root of its volume. The shift and the mode are given one by one, or both follow from
    an oscillator of some mass on the head: as its frequency crosses that of the head, they grow and turn round.
    """

    id = "air_bubble"
    stage = "resonator"
    sentence = "From one recording on, an air bubble detunes the head and adds a mode of its own."
    equation = (
        "ω0 (1 + p d), ζ (1 + p e), and x + p xb with xb'' + 2 ζb ωb xb' + ωb² xb = ωb² g v; p from 0 "
        "to 1 between one order before the onset and growth_orders after it, ωb ∝ p^(-1/3); or x'' + a1 x' + a0 x = "
        "a0 v - m p (xb'' + x'') with xb'' + x'' + 2 ζb ωb xb' + ωb² xb = 0"
    )
    source = (
        "J. de Jong et al., Air entrapment in piezo-driven inkjet printheads, Journal of the Acoustical Society of "
        "America 120, 2006; M. Minnaert, On musical air-bubbles and the sounds of running water, Philosophical "
        "Magazine 16, 1933: a bubble's frequency; J. P. Den Hartog, Mechanical Vibrations, 4th edition, McGraw-Hill, "
        "1956, chapter 3: an oscillator on another"
    )
    parameters = (
        Parameter(
            "onset_order", "1", 1.0, 1e5, meaning="order of the first recording with the bubble", open_ended=True
        ),
        Parameter("frequency_change", "1", -0.5, 0.5, meaning="relative change of the head's frequency"),
        Parameter("damping_change", "1", -0.9, 5.0, meaning="relative change of the head's damping ratio"),
        Parameter("bubble_frequency_Hz", "Hz", 1e-2, 1e8, "log", "frequency of the bubble's mode"),
        Parameter("bubble_damping_ratio", "1", 0.002, 0.7, "log", "damping ratio of the bubble's mode"),
        Parameter("bubble_strength", "1", -2.0, 2.0, meaning="static deflection of the bubble's mode over the head's"),
        Parameter("static_change", "1", -0.5, 0.5, meaning="relative change of the static deflection", plain=0.0),
        Parameter("exchange", "1", -0.5, 0.5, meaning="coupling of the modes by damping, see `Mode`", plain=0.0),
        Parameter("growth_orders", "1", 0.0, 1e4, meaning="recordings in which the bubble grows", plain=0.0),
        Parameter("mass_ratio", "1", 0.0, 1.0, meaning="m: mass of the bubble's oscillator over the head's"),
    )
    strengths = ("frequency_change", "damping_change", "bubble_strength", "mass_ratio")
    terms = (("frequency_change", "bubble_strength"), ("damping_change",), ("mass_ratio",))
    signature = (
        "recordings before the onset fit the base model; those after it all show the same change of the resonance"
    )
    confusable_with = ("thermal_drift", "second_mode")
    shown_by = "the same drive repeatedly throughout the session"
    depends_on_order = True

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        orders = sorted({excitation.order for excitation in excitations if excitation.fast})
        onsets = orders[1 :: max(1, len(orders) // MOST_ONSETS)] or orders
        change = 0.1 * printhead.damping_ratio
        plain = complete(self, onset_order=1.0, bubble_frequency_Hz=1.0, bubble_damping_ratio=0.1)
        apart = [
            {
                "onset_order": float(onset),
                "frequency_change": change * detuned,
                "bubble_frequency_Hz": guess * printhead.frequency_Hz,
                "bubble_strength": 0.02 * (1 - detuned) / guess,
            }
            for onset in onsets
            for detuned, guess in ((1.0, 0.5), (0.0, 0.5), (0.0, 1.7))
        ]
        coupled = [
            {
                "onset_order": float(onset),
                "bubble_frequency_Hz": guess * printhead.frequency_Hz,
                "growth_orders": growth,
                "mass_ratio": 0.2 * printhead.damping_ratio * abs(1 - guess**2),
            }
            for onset in onsets[::2]
            for guess in COUPLED
            for growth in (0.0, GROWTH)
        ]
        return [plain | start for start in (*apart, *coupled)]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {
            "onset_order": 14.5,
            "frequency_change": -0.01,
            "bubble_frequency_Hz": 0.6 * printhead.frequency_Hz,
            "bubble_damping_ratio": 0.1,
            "bubble_strength": 0.05,
        }

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        orders = sorted({excitation.order for excitation in excitations if excitation.fast})
        return {
            "onset_order": (orders[0], orders[-1] + 1),
            "bubble_frequency_Hz": resolved_Hz(excitations),
            "growth_orders": (0.0, orders[-1] - orders[0]),
        }

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        if len({excitation.order for excitation in excitations if excitation.fast}) < FEWEST_ORDERS:
            return too_slow(excitations) or f"the fast recordings have fewer than {FEWEST_ORDERS} different orders"
        return None

    def description(self, values: Values, unit: str = "V") -> str:
        change = values["frequency_change"]
        does = []
        if change:
            does.append(f"{'raises' if change > 0 else 'lowers'} the head's frequency by {percent(abs(change))}")
        if values["damping_change"]:
            raises = "raises" if values["damping_change"] > 0 else "lowers"
            does.append(f"{raises} the damping ratio by {percent(abs(values['damping_change']))}")
        if values["bubble_strength"]:
            does.append(f"adds a mode at {with_prefix(values['bubble_frequency_Hz'], 'Hz', 3)}")
        if values["mass_ratio"]:
            does.append(
                f"swings at {with_prefix(values['bubble_frequency_Hz'], 'Hz', 3)} with "
                f"{percent(values['mass_ratio'])} of the head's mass"
            )
        listed = " and ".join(filter(None, [", ".join(does[:-1]), *does[-1:]]))
        grows = f", growing within {values['growth_orders']:.2g} recordings" if values["growth_orders"] else ""
        return f"From recording {math.ceil(values['onset_order'])} on, an air bubble {listed}{grows}."

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        grown = (excitation.order - values["onset_order"] + 1) / (1 + values["growth_orders"])
        present = min(max(grown, 0.0), 1.0)
        detuned = 1 + present * values["frequency_change"]
        a0, a1 = resonance.a0 * detuned**2, resonance.a1 * detuned * (1 + present * values["damping_change"])
        modes = resonance.modes
        omega = 2 * math.pi * values["bubble_frequency_Hz"] / math.cbrt(max(present, LEAST_VOLUME))
        rate = 2 * values["bubble_damping_ratio"] * omega
        if strength := present * values["bubble_strength"]:
            modes = (*modes, Mode(omega * omega, rate, strength, present * values["exchange"]))
        if change := present * values["static_change"]:
            modes = (*modes, Mode(a0, a1, change))
        changed = replace(resonance, a0=a0, a1=a1, modes=modes)
        mass = present * values["mass_ratio"]
        return changed.with_oscillator(mass, omega * omega, rate) if mass else changed
