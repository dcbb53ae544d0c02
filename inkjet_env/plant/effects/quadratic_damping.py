"""Damping that grows with speed, as where the ink separates at an edge.

In Eq. (11) of docs/explanation/model.md it is the force ``F = c |p| p`` with ``p = x' / ω0``.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.force import Force, compiled_force
from inkjet_env.plant.recorded_motion import reach_V, too_slow
from inkjet_env.plant.resonance import Resonance
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real


class QuadraticDamping(Effect):
    """A drag proportional to the square of the speed and opposed to it."""

    id = "quadratic_damping"
    stage = "resonator"
    sentence = "Damping grows with speed, so large oscillations decay faster at first than small ones."
    equation = "x'' + a1 x' + a0 (x + c |p| p) = a0 v, p = x'/ω0; in ring-down Δζ = 4 c A / (3 π)"
    source = "A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley 1979, chapter 3"
    parameters = (
        Parameter("damping_per_V", "1/V", -0.01, 100.0, meaning="drag over spring force, per scaled speed x'/ω0"),
    )
    strengths = ("damping_per_V",)
    signature = "the logarithmic decrement grows in proportion to the amplitude; the frequency does not change"
    confusable_with = ("ferroelastic_softening", "cubic_stiffness", "coulomb_friction")
    shown_by = "the same pulse at three amplitudes or more, each with its ring-down"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        damping = 0.1 * printhead.damping_ratio * 3 * math.pi / 4 / reach_V(printhead, excitations)
        return [{"damping_per_V": damping}]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"damping_per_V": 2e-4}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        c = values["damping_per_V"]
        size_V = 100.0 if abs(c) * 100 < 1 else 1.0 if abs(c) < 1 else 0.01
        rise = 4 * c * size_V / (3 * math.pi)
        return (
            "Damping grows with amplitude: at the deflection under a steady drive of about "
            f"{with_prefix(size_V, 'V')}, {rise:.2g} is added to the damping ratio."
        )

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        c = values["damping_per_V"]
        if c == 0:
            return resonance
        return replace(resonance, forces=(*resonance.forces, Force(_compiled(), np.array([c]))))


def _law(x_V: float, speed_V: float, values: Real) -> float:
    force: float = values[0] * abs(speed_V) * speed_V  # Eq. (11), c |p| p
    return force


@functools.cache
def _compiled() -> Any:
    return compiled_force(_law)
