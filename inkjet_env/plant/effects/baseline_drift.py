"""An offset that differs from recording to recording and drifts within one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import legendre

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.wording import SENSOR_UNIT, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

DEGREES = (2, 4, 8)
"""Degrees of the starts: a parabola and rougher drifts; the eighth degree explains 97 % of a random walk's variance."""


class BaselineDrift(Effect):
    """A polynomial in time under every recording, different in each. No simulation predicts it."""

    id = "baseline_drift"
    stage = "sensing"
    sentence = (
        "The sensor's baseline differs from recording to recording and drifts slowly, independently of the drive."
    )
    equation = "y = y₀ + c₀ + c₁ t + … + cₙ tⁿ, with its own coefficients c in every recording"
    source = "Bendat & Piersol, Random Data, 4th edition, Wiley, 2010: trends and their removal"
    parameters = (
        Parameter("amplitude", SENSOR_UNIT, 0.0, 1e6, "linear", "amplitude of the drift over a recording; 0 is none"),
        Parameter("degree", "1", 1.0, 20.0, "linear", "n: higher for a rougher drift", True, plain=2.0),
    )
    strengths = ("amplitude",)
    signature = "present with zero drive; much slower than the resonance; differs between repeats"
    confusable_with = ("mains_hum", "creep")
    shown_by = "recordings of zero drive at the start and at the end of the session"
    random = True

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        return [{"amplitude": 1.0, "degree": float(degree)} for degree in DEGREES]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"amplitude": 2.0 * noise_rms}

    def description(self, values: Values, unit: str = "V") -> str:
        return (
            "The sensor's baseline is another in every recording and drifts slowly, whatever the drive, "
            f"by about {with_prefix(values['amplitude'], unit)}."
        )

    def random_effect_basis(self, values: Values, excitation: Excitation) -> Real | None:
        if values["amplitude"] == 0 or excitation.channel == "drive_monitor":
            return None
        degree = round(values["degree"])
        key = f"{self.id} {degree}"
        if key not in excitation.cache:
            excitation.cache[key] = legendre.legvander(np.linspace(-1, 1, excitation.samples), degree)
        columns: Real = excitation.cache[key]
        return columns
