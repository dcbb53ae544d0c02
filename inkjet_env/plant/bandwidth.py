"""Parameters and starting values of a low-pass, for the effects that consist of one."""

from __future__ import annotations

import math

from inkjet_env.plant.effect import Parameter
from inkjet_env.printhead import Printhead

BANDWIDTH = Parameter("bandwidth_Hz", "Hz", 0.1, math.inf, "reciprocal", "half-power (-3 dB) bandwidth")
"""Half-power bandwidth; infinite when the effect is off."""


SECOND_ORDER = Parameter(
    "second_order",
    "1",
    0.0,
    1.0,
    meaning="q: 0 for one pole, 0.5 for a Butterworth filter of two poles",
    open_ended=True,
    plain=0.0,
)
"""q of the low-pass ``1 / (1 + τ s + q τ² s²)``."""


def low_pass_starts(printhead: Printhead) -> list[dict[str, float]]:
    """Starting values with one pole and with two, with bandwidths from twice to 20 times the resonance."""
    shapes = ((20.0, 0.0), (6.0, 0.0), (2.0, 0.0), (20.0, 0.5), (6.0, 0.5))
    return [{"bandwidth_Hz": ratio * printhead.frequency_Hz, "second_order": q} for ratio, q in shapes]
