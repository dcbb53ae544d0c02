"""The head warms up: frequency and damping wander from recording to recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.resonance import Resonance, too_slow
from inkjet_env.plant.shot import Shot
from inkjet_env.plant.wording import percent
from inkjet_env.printhead import Printhead

RECORDINGS = 30
"""How many recordings later the drifts are told for."""
FEWEST_ORDERS = 4


class ThermalDrift(Effect):
    """Frequency and damping ratio as smooth functions of the order, nothing at the first recording."""

    id = "thermal_drift"
    stage = "resonator"
    sentence = "The head's frequency and damping wander in the course of the session."
    equation = (
        "ω0 (1 + f), ζ (1 + z); f, z = drift s + bow 4 s (1 - s) + twist 8 s (1 - s) (1 - 2 s), s = (order - 1) / 30"
    )
    source = "H. Wijshoff, The dynamics of the piezo inkjet printhead operation, Physics Reports 491, 2010"
    parameters = (
        Parameter("frequency_drift", "1", -0.5, 0.5, meaning="relative change of frequency after 30 recordings"),
        Parameter("frequency_bow", "1", -0.5, 0.5, meaning="by how much more it has changed halfway"),
        Parameter("frequency_twist", "1", -0.5, 0.5, meaning="S-shaped part of the change"),
        Parameter("damping_drift", "1", -3.0, 3.0, meaning="relative change of the damping ratio after 30 recordings"),
        Parameter("damping_bow", "1", -3.0, 3.0, meaning="by how much more it has changed halfway"),
        Parameter("damping_twist", "1", -3.0, 3.0, meaning="S-shaped part of the change"),
    )
    strengths = tuple(parameter.name for parameter in parameters)
    signature = "width and pitch of the resonance follow the order of the recordings, whatever their drives"
    confusable_with = ("air_bubble", "meniscus_refill", "quadratic_damping")
    shown_by = "one recording repeated through the whole session, amplitudes in random order"

    def starts(self, printhead: Printhead, shots: Sequence[Shot]) -> list[dict[str, float]]:
        latest = max((shot.order - 1 for shot in shots if shot.fast), default=0) or RECORDINGS
        off = dict.fromkeys(self.strengths, 0.0)
        return [
            off | {"frequency_drift": 0.1 * printhead.damping_ratio * RECORDINGS / latest},
            off | {"damping_drift": 0.1 * RECORDINGS / latest},
        ]

    def untestable(self, shots: Sequence[Shot]) -> str | None:
        if len({shot.order for shot in shots if shot.fast}) < FEWEST_ORDERS:
            return too_slow(shots) or f"fewer than {FEWEST_ORDERS} fast recordings tell when they were taken (order)"
        return None

    def told(self, values: Values, unit: str = "V") -> str:
        frequency, damping = values["frequency_drift"], values["damping_drift"]
        changes = []
        if frequency:
            changes.append(f"rings {percent(abs(frequency))} {'higher' if frequency > 0 else 'lower'}")
        if damping:
            changes.append(f"is damped {percent(abs(damping))} {'more' if damping > 0 else 'less'}")
        if not changes:
            return f"Frequency and damping wander, and are back where they began after {RECORDINGS} recordings."
        return f"After {RECORDINGS} recordings the head {' and '.join(changes)}."

    def resonator(self, values: Values, resonance: Resonance, shot: Shot) -> Resonance:
        s = (shot.order - 1) / RECORDINGS
        frequency = 1 + _wander(s, values, "frequency")
        damping = 1 + _wander(s, values, "damping")
        return replace(resonance, a0=resonance.a0 * frequency**2, a1=resonance.a1 * frequency * damping)


def _wander(s: float, values: Values, what: str) -> float:
    bow = 4 * s * (1 - s)
    return values[f"{what}_drift"] * s + values[f"{what}_bow"] * bow + values[f"{what}_twist"] * 2 * bow * (1 - 2 * s)
