"""A sensor that clips or compresses."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.limiter import limited
from inkjet_env.plant.stages import Plant
from inkjet_env.plant.wording import SENSOR_UNIT, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

GUESSES = (
    (1.0, 100.0), (0.98, 30.0), (0.8, 30.0), (0.6, 30.0), (0.98, 6.0), (0.7, 6.0), (3.0, 2.0), (1.2, 2.0), (10.0, 1.0)
)  # fmt: skip
"""Limit relative to the largest signal on its side, and hardness, of each start."""
BOTH_RAILS = (100.0, 30.0)
"""Hardness of each start at which both rails are where the measured signal ends."""
OUT_OF_REACH = 100.0
"""Ratio of the two rails' distances from 0 at which the farther one no longer matters."""


class SensorSaturation(Effect):
    """Rails of an amplifier, on both sides of 0 or on one: equal for every fast recording, in its channel's unit.

    A campaign that mixes self-sensing with a displacement in small units has two amplifiers; this effect is only one.
    """

    id = "sensor_saturation"
    stage = "sensing"
    sentence = "The sensor clips or compresses large signals."
    equation = (
        "y = y₀ / (1 + |y₀ / L±|^h)^(1/h), 1/L± = (1 ± skew) / ((1 + |skew|) limit) above and below 0: the nearer rail "
        "is at limit"
    )
    source = (
        "Rapp, Effects of HPA-nonlinearity on a 4-DPSK/OFDM-signal, Proc. 2nd European Conference on Satellite "
        "Communications, 1991: the amplifier's limiter"
    )
    parameters = (
        Parameter("limit", SENSOR_UNIT, 1e-9, math.inf, "reciprocal", "nearer rail, which the signal never exceeds"),
        Parameter("hardness", "1", 1.0, 1e4, "log", "1: gradual compression; 20 and more: clipping", open_ended=True),
        Parameter("skew", "1", -1.0, 1.0, meaning="1: only above 0; -1: only below 0", open_ended=True, plain=0.0),
    )
    strengths = ("limit",)
    signature = "flat tops at one level whatever the drive; small signals are unaffected"
    confusable_with = ("quadratic_damping", "asymmetric_hysteresis")
    shown_by = "the same waveform at a third of the voltage and at full voltage"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        ranges = [_signal_range(printhead, excitation) for excitation in excitations if excitation.fast]
        below = max((-low for low, _ in ranges), default=0.0)
        above = max((high for _, high in ranges), default=0.0)
        largest = max(below, above) or 1.0
        rails = {0.0: largest, 1.0: above if above > 0 else largest, -1.0: below if below > 0 else largest}
        found = [
            {"limit": ratio * rail, "hardness": hardness, "skew": skew}
            for skew, rail in rails.items()
            for ratio, hardness in GUESSES
        ]
        if min(below, above) > 0:  # both rails reached, each where the signal ends
            skew = (below - above) / (below + above)
            found += [{"limit": min(below, above), "hardness": hardness, "skew": skew} for hardness in BOTH_RAILS]
        return found

    def scaled(self, values: Values, factor: float) -> dict[str, float]:
        # what is cut off a signal well below the limit is as (signal / limit)^hardness
        return {**values, "limit": values["limit"] / abs(factor) ** (1 / values["hardness"])}

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"limit": 0.75 * largest, "hardness": 6.0}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return None if any(excitation.fast for excitation in excitations) else "no recording is from a fast sensor"

    def description(self, values: Values, unit: str = "V") -> str:
        does = "clips" if values["hardness"] > 10 else "compresses"
        nearness = _nearness(values["skew"], np.array([1.0, -1.0]))
        rails = [values["limit"] / near if OUT_OF_REACH * near > 1.0 else 0.0 for near in nearness]
        if values["skew"] == 0:
            return f"The sensor {does}: its signal stays within ±{with_prefix(rails[0], unit, 3)}."
        above, below = (with_prefix(rail, unit, 3) for rail in rails)
        within = [f"below {above}"] * bool(rails[0]) + [f"above -{below}"] * bool(rails[1])
        return f"The sensor {does}: its signal stays {' and '.join(within)}."

    def sensing(
        self, values: Values, signal: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        limit, hardness = values["limit"], values["hardness"]
        if not excitation.fast or math.isinf(limit):
            return signal
        return limited(signal, np.abs(signal) * _nearness(values["skew"], np.sign(signal)) / limit, hardness)


def _nearness(skew: float, side: Real) -> Real:
    """The nearer rail's distance from 0 over that of the rail on each side: above (1) or below (-1)."""
    nearness: Real = (1 + skew * side) / (1 + abs(skew))
    return nearness


def _signal_range(printhead: Printhead, excitation: Excitation) -> tuple[float, float]:
    """Lowest and highest signal: as measured, if they are known, otherwise as the base model shows them."""
    if excitation.signal_range is not None:
        return excitation.signal_range
    signal = Plant(printhead).signal(excitation)
    return float(signal.min()), float(signal.max())
