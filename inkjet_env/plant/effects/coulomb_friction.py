"""Dry friction: a force of constant size against the motion.

In Eq. (11) of docs/explanation/model.md it is the force ``F = f tanh(p / p0)`` with ``p = x' / ω0``.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.errors import SimulationError
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.force import Force, compiled_force
from inkjet_env.plant.recorded_motion import reach_V, too_slow
from inkjet_env.plant.resonance import Resonance
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

SHARES = (0.03, 0.15)
"""Speeds of full friction in the starts, as shares of the largest deflection."""
STIFFEST = 0.5
"""Largest slope of the friction per step of the motion that is stable."""


class CoulombFriction(Effect):
    """A force opposed to the speed and, but for the slowest motion, independent of it.

    Below the speed ``p0`` it is a viscous drag, so that the head creeps rather than sticks.
    """

    id = "coulomb_friction"
    stage = "resonator"
    sentence = "Dry friction brakes the head, so small oscillations decay faster than large ones and stop."
    equation = "x'' + a1 x' + a0 (x + f tanh(p/p0)) = a0 v, p = x'/ω0; in ring-down, per half period ΔA = -2 f"
    source = (
        "J. P. Den Hartog, Forced vibrations with combined Coulomb and viscous friction, Transactions of the ASME 53, "
        "1931; A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley 1979, chapter 3"
    )
    parameters = (
        Parameter("friction_V", "V", -0.1, 1e3, meaning="f: friction, as the drive that balances it"),
        Parameter("speed_V", "V", 1e-6, 1e3, "log", "p0: scaled speed of full friction", open_ended=True),
    )
    strengths = ("friction_V",)
    signature = "the ring-down's envelope is a straight line and ends; the decrement grows as the amplitude falls"
    confusable_with = ("quadratic_damping", "ferroelastic_softening")
    shown_by = "the same pulse at three amplitudes or more, each with its ring-down"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        reach = reach_V(printhead, excitations)
        friction_V = min(0.05 * printhead.damping_ratio * math.pi / 2 * reach, 1e3)
        return [{"friction_V": friction_V, "speed_V": min(share * reach, 1e3)} for share in SHARES]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"friction_V": 1.0, "speed_V": 2.0}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        return (
            f"Dry friction balances {with_prefix(abs(values['friction_V']), 'V')} of the drive: an oscillation of the "
            f"head loses {with_prefix(4 * abs(values['friction_V']), 'V')} of amplitude per period."
        )

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        friction_V, speed_V = values["friction_V"], values["speed_V"]
        if friction_V == 0:
            return resonance
        step = 2 * excitation.node_step_s * resonance.drive_a0 / math.sqrt(resonance.a0)
        if abs(friction_V) / speed_V * step > STIFFEST:
            raise SimulationError("the friction changes sign too abruptly for the step of the simulation.")
        law = Force(_compiled(), np.array([friction_V, 1 / speed_V]))
        return replace(resonance, forces=(*resonance.forces, law))


def _law(x_V: float, speed_V: float, values: Real) -> float:
    force: float = values[0] * math.tanh(values[1] * speed_V)  # Eq. (11), f tanh(p / p0)
    return force


@functools.cache
def _compiled() -> Any:
    return compiled_force(_law)
