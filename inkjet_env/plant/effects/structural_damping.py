"""Structural damping: a loss factor that does not depend on the frequency, as of material rather than of ink.

In Eq. (11) of docs/explanation/model.md it is a force of relaxing elements, ``F = η (Σ w z - κ x)``, ``z' = x' - r z``.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.errors import SimulationError
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.force import Force, compiled_force
from inkjet_env.plant.recorded_motion import too_slow
from inkjet_env.plant.resonance import Resonance
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

ELEMENTS = 10
"""Number of relaxing elements. The loss factor is even to 5 % within a factor of 3 of the head's frequency."""
DECADES = 1.7
"""Their rates reach from so many decades below the head's frequency to as many above it."""
FIRST = 4
"""Place of the first element among the values of the law, each with four numbers."""
SOFTEST = 0.9
"""Largest share of the static stiffness that the elements may take."""


class StructuralDamping(Effect):
    """Elements of spring and dashpot whose rates are spread evenly over the logarithm (Biot's law), or as a power.

    Their stiffness at the head's own frequency is taken off the spring, so that the frequency stays; a held deflection
    creeps on by that much.
    """

    id = "structural_damping"
    stage = "resonator"
    sentence = "Part of the damping is of the structure: its loss factor is the same at every frequency."
    equation = (
        "F = η (Σ w_k z_k - κ x), z_k' = x' - r_k z_k, ln r_k evenly within ±1.7 decades of ω0, w_k ~ r_k^power; "
        "Σ w r ω0 / (r² + ω0²) = 1, κ = Σ w ω0² / (r² + ω0²); power 0: η at any frequency"
    )
    source = (
        "M. A. Biot, Linear thermodynamics and the mechanics of solids, Proc. Third US National Congress of Applied "
        "Mechanics, 1958; fractional powers: R. L. Bagley, P. J. Torvik, A theoretical basis for the application of "
        "fractional calculus to viscoelasticity, Journal of Rheology 27, 1983"
    )
    parameters = (
        Parameter("loss_factor", "1", -0.02, 0.4, meaning="η: loss factor at the head's frequency"),
        Parameter(
            "power", "1", -0.5, 0.9, meaning="the loss factor goes with this power of the frequency", plain=0.0,
            open_ended=True,
        ),
    )  # fmt: skip
    strengths = ("loss_factor",)
    signature = "linear; slow motions are damped, and held deflections creep, more than a viscous damper lets them"
    confusable_with = ("trigger_delay", "wave_echo", "sensor_highpass")
    shown_by = "a multisine from well below to well above the resonance"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        return [complete(self, loss_factor=0.3 * printhead.damping_ratio)]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"loss_factor": 0.03}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        loss = values["loss_factor"]
        return (
            f"The structure has a loss factor of {loss:.2g}{_course(values['power'])}; at the resonance that adds "
            f"{loss / 2:.2g} to the damping ratio."
        )

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        loss = values["loss_factor"]
        if loss == 0:
            return resonance
        stiffness = resonance.a0 / resonance.drive_a0
        rates, weights, kept = elements(math.sqrt(resonance.a0), values["power"])
        if loss * kept > SOFTEST:
            raise SimulationError("the relaxing elements take all of the static stiffness.")
        z = rates * 2 * excitation.node_step_s
        numbers = np.zeros(FIRST + 4 * ELEMENTS)
        numbers[0], numbers[1] = ELEMENTS, loss * kept * stiffness
        numbers[FIRST::4], numbers[FIRST + 1 :: 4] = np.exp(-z), -np.expm1(-z) / z
        numbers[FIRST + 2 :: 4] = loss * stiffness * weights
        relaxations = tuple((FIRST + 4 * k + 3, float(1 / rate)) for k, rate in enumerate(rates))
        return replace(resonance, forces=(*resonance.forces, Force(_compiled(), numbers, relaxations)))


def _course(power: float) -> str:
    if power == 0:
        return " at every frequency"
    return f", which {'rises' if power > 0 else 'falls'} with the power {abs(power):.2g} of the frequency"


def elements(omega0: float, power: float) -> tuple[Real, Real, float]:
    """Rates of the elements in 1/s and their weights, shape (k,) each, and κ, their stiffness at ``omega0``, in 1/s."""
    logs = DECADES * math.log(10) * (2 * (np.arange(ELEMENTS) + 0.5) / ELEMENTS - 1)
    ratios = np.exp(logs)
    weights = ratios**power
    weights /= float(weights @ (ratios / (1 + ratios**2)))
    return omega0 * ratios, weights, float(weights @ (1 / (1 + ratios**2)))


def _law(x_V: float, speed_V: float, values: Real) -> float:
    moved = x_V - values[3] if values[2] else 0.0
    values[2] = 1.0
    values[3] = x_V
    force: float = -values[1] * x_V
    for k in range(int(values[0])):
        at = 4 + 4 * k
        values[at + 3] = values[at] * values[at + 3] + values[at + 1] * moved
        force += values[at + 2] * values[at + 3]
    return force


@functools.cache
def _compiled() -> Any:
    return compiled_force(_law)
