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
"""Degrees of the starts: a parabola and rougher drifts."""
STEPS = 12
"""Terms of a random walk, by Karhunen and Loève; they hold 98 % of its variance."""


class BaselineDrift(Effect):
    """A polynomial in time under every recording, or a random walk, different in each. No simulation predicts it."""

    id = "baseline_drift"
    stage = "sensing"
    sentence = "The sensor's baseline differs between recordings and drifts slowly, whatever the drive."
    equation = (
        "y = y₀ + c₀ + c₁ t + … + cₙ tⁿ, or y₀ + c₀ + Σ c_k sin((k - 1/2) π t) / (k - 1/2), with separate c for each "
        "recording"
    )
    source = (
        "Bendat & Piersol, Random Data, 4th edition, Wiley, 2010: trends and their removal; M. Loève, Probability "
        "Theory II, 4th edition, Springer, 1978: expansion of Brownian motion"
    )
    parameters = (
        Parameter("amplitude", SENSOR_UNIT, 0.0, 1e6, "linear", "size of the drift over a recording; 0 is none"),
        Parameter("degree", "1", 1.0, 20.0, "linear", "n: degree of the polynomial", True, plain=2.0),
        Parameter(
            "walk", "1", 0.0, 1.0, "linear", "1: a random walk, whatever the degree; 0: a polynomial", True, plain=0.0
        ),
    )
    strengths = ("amplitude",)
    signature = "present with zero drive; much slower than the resonance; repeats differ by it"
    confusable_with = ("mains_hum", "creep")
    shown_by = "zero drive, both at the start and at the end of the session"
    random = True

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        smooth = [{"amplitude": 1.0, "degree": float(degree), "walk": 0.0} for degree in DEGREES]
        return [*smooth, {"amplitude": 1.0, "degree": float(DEGREES[0]), "walk": 1.0}]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"amplitude": 2.0 * noise_rms}

    def description(self, values: Values, unit: str = "V") -> str:
        how = "wanders as a random walk does" if values["walk"] >= 0.5 else "drifts slowly"
        return (
            f"The sensor's baseline differs between recordings and {how}, whatever the drive, "
            f"by about {with_prefix(values['amplitude'], unit)}."
        )

    def random_effect_basis(self, values: Values, excitation: Excitation) -> Real | None:
        if values["amplitude"] == 0 or excitation.channel == "drive_monitor":
            return None
        degree = round(values["degree"])
        walk = values["walk"] >= 0.5
        key = f"{self.id} {'walk' if walk else degree}"
        if key not in excitation.cache:
            if walk:
                rate = np.arange(1, STEPS + 1) - 0.5
                terms = np.sin(np.pi * rate * np.linspace(0, 1, excitation.samples)[:, None]) / rate
                excitation.cache[key] = np.column_stack([np.ones(excitation.samples), terms])
            else:
                excitation.cache[key] = legendre.legvander(np.linspace(-1, 1, excitation.samples), degree)
        columns: Real = excitation.cache[key]
        return columns
