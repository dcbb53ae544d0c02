"""Duffing's spring: the head becomes stiffer, or softer, with the square of its deflection.

In Eq. (11) of docs/explanation/model.md it is the force ``F = k x³``.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.force import Force, compiled_force
from inkjet_env.plant.recorded_motion import reach_V, too_slow
from inkjet_env.plant.resonance import Resonance
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real


class CubicStiffness(Effect):
    """A restoring force in proportion to the cube of the deflection."""

    id = "cubic_stiffness"
    stage = "resonator"
    sentence = (
        "The stiffness changes with the square of the deflection, so the ringing frequency depends on the amplitude."
    )
    equation = "x'' + a1 x' + a0 (x + k x³) = a0 v; in ring-down Δf/f = 3/8 k A²"
    source = "A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley 1979, chapter 4"
    parameters = (
        Parameter(
            "stiffening_per_V2", "1/V²", -1e3, 1e3, meaning="k: relative increase of stiffness per squared deflection"
        ),
    )
    strengths = ("stiffening_per_V2",)
    signature = "the frequency shifts with the square of the amplitude; constant damping; only odd harmonics of a sine"
    confusable_with = ("ferroelastic_softening", "quadratic_damping")
    shown_by = "the same pulse at three amplitudes or more, each with its ring-down"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        shift = 0.1 * printhead.damping_ratio
        stiffening = shift * 8 / 3 / reach_V(printhead, excitations) ** 2
        return [{"stiffening_per_V2": sign * stiffening} for sign in (1.0, -1.0)]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"stiffening_per_V2": 1.2e-6}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        k = values["stiffening_per_V2"]
        size_V = next((size_V for size_V in (100.0, 10.0, 1.0, 0.1) if abs(k) * size_V**2 < 0.1), 0.01)
        change = "stiffer" if k > 0 else "softer"
        return (
            f"Deflected as far as a steady drive of about {with_prefix(size_V, 'V')} would, the head is "
            f"{percent(abs(k) * size_V**2)} {change} than at rest."
        )

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        k = values["stiffening_per_V2"]
        if k == 0:
            return resonance
        return replace(resonance, forces=(*resonance.forces, Force(_compiled(), np.array([k]))))


def _law(x_V: float, speed_V: float, values: Real) -> float:
    force: float = values[0] * x_V * x_V * x_V  # Eq. (11), k x³
    return force


@functools.cache
def _compiled() -> Any:
    return compiled_force(_law)
