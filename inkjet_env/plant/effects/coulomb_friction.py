"""Dry friction: a force of constant size against the motion.

In Eq. (11) of docs/explanation/model.md it is the force ``F = f tanh(p / p0)`` with ``p = x' / ω0``. Surfaces that
stick are springs until they slip (P. R. Dahl 1968): ``F = f z`` with ``dz = (tanh(p / p0) - z) |dx| / z0``, of which
the former is the limit ``z0 = 0``. Over a step of the motion ``z`` is exact for a ``tanh`` that changes in proportion
to ``x``.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.errors import SimulationError
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.force import Force, compiled_force
from inkjet_env.plant.recorded_motion import reach_V, too_slow
from inkjet_env.plant.resonance import Resonance
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

SHARES = (0.03, 0.15)
"""Speeds of full friction in the starts, as shares of the largest deflection."""
SLIPS = (0.01, 0.1)
"""Distances over which sticking surfaces begin to slip in the starts, as shares of the largest deflection."""
LEAST_SLIP_V = 1e-6
"""Distance that stands for surfaces that never stick."""
STIFFEST = 0.5
"""Largest slope of the friction per step of the motion that is stable."""


class CoulombFriction(Effect):
    """A force opposed to the speed and, but for the slowest motion, independent of it.

    Below the speed ``p0`` it is a viscous drag, so that the head creeps rather than sticks. If surfaces stick, they are
    a spring of stiffness ``f / z0`` for motions much smaller than ``z0``.
    """

    id = "coulomb_friction"
    stage = "resonator"
    sentence = "Dry friction brakes the head, so small oscillations decay faster than large ones and stop."
    equation = (
        "x'' + a1 x' + a0 (x + f z) = a0 v, dz = (tanh(p/p0) - z) |dx|/z0, p = x'/ω0; z0 = 0: z = tanh(p/p0); in "
        "ring-down, per half period ΔA = -2 f"
    )
    source = (
        "J. P. Den Hartog, Forced vibrations with combined Coulomb and viscous friction, Transactions of the ASME 53, "
        "1931; A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley 1979, chapter 3; surfaces that stick: "
        "P. R. Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, 1968"
    )
    parameters = (
        Parameter("friction_V", "V", -0.1, 1e3, meaning="f: friction, as the drive that balances it"),
        Parameter("speed_V", "V", 1e-6, 1e3, "log", "p0: scaled speed of full friction", open_ended=True),
        Parameter(
            "slip_V",
            "V",
            LEAST_SLIP_V,
            1e3,
            "log",
            "z0: deflection over which sticking surfaces begin to slip",
            open_ended=True,
            plain=LEAST_SLIP_V,
            later=True,
        ),
    )
    strengths = ("friction_V",)
    signature = "the ring-down's envelope is a straight line and ends; the decrement grows as the amplitude falls"
    confusable_with = ("quadratic_damping", "ferroelastic_softening")
    shown_by = "the same pulse at three amplitudes or more, each with its ring-down"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        reach = reach_V(printhead, excitations)
        friction_V = min(0.05 * printhead.damping_ratio * math.pi / 2 * reach, 1e3)
        rubs = [complete(self, friction_V=friction_V, speed_V=min(share * reach, 1e3)) for share in SHARES]
        slow_V = min(min(SHARES) * reach, 1e3)
        sticks = [
            complete(self, friction_V=friction_V, speed_V=slow_V, slip_V=max(share * reach, 2 * LEAST_SLIP_V))
            for share in SLIPS
        ]
        return rubs + sticks

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"friction_V": 1.0, "speed_V": 2.0}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        friction_V, slip_V = values["friction_V"], values["slip_V"]
        said = (
            f"Dry friction balances {with_prefix(abs(friction_V), 'V')} of the drive: an oscillation of the head loses "
            f"{with_prefix(4 * abs(friction_V), 'V')} of amplitude per period."
        )
        if slip_V <= LEAST_SLIP_V:
            return said
        return (
            f"{said} The surfaces stick over {with_prefix(slip_V, 'V')} of deflection, where they make the head "
            f"{percent(friction_V / slip_V)} stiffer, before they slip."
        )

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        friction_V, speed_V, slip_V = values["friction_V"], values["speed_V"], values["slip_V"]
        if friction_V == 0:
            return resonance
        step = 2 * excitation.node_step_s * resonance.drive_a0 / math.sqrt(resonance.a0)
        sticks = slip_V > LEAST_SLIP_V
        if abs(friction_V) * step > STIFFEST * (speed_V + (slip_V / step if sticks else 0.0)):
            raise SimulationError("the friction changes sign too abruptly for the step of the simulation.")
        if sticks:
            law = Force(_compiled(_sticking), np.array([friction_V, 1 / speed_V, 1 / slip_V, 0.0, 0.0, 0.0, 0.0]))
        else:
            law = Force(_compiled(_law), np.array([friction_V, 1 / speed_V]))
        return replace(resonance, forces=(*resonance.forces, law))


def _law(x_V: float, speed_V: float, values: Real) -> float:
    force: float = values[0] * math.tanh(values[1] * speed_V)  # Eq. (11), f tanh(p / p0)
    return force


def _sticking(x_V: float, speed_V: float, values: Real) -> float:
    direction = math.tanh(values[1] * speed_V)
    if values[6]:  # z, the last deflection and direction, and whether there are any
        slipped = abs(x_V - values[4]) * values[2]
        kept = math.exp(-slipped)
        late = 1.0 - (1.0 - kept) / slipped if slipped > 1e-4 else 0.5 * slipped
        values[3] = kept * values[3] + (1.0 - kept - late) * values[5] + late * direction
    values[4] = x_V
    values[5] = direction
    values[6] = 1.0
    force: float = values[0] * values[3]
    return force


@functools.cache
def _compiled(law: Callable[..., float]) -> Any:
    return compiled_force(law)
