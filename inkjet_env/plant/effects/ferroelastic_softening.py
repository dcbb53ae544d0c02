"""The ceramic itself: softer and more lossy in proportion to how far it swings."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.resonance import Force, Resonance, compiled_force, reach_V, too_slow
from inkjet_env.plant.shot import Shot
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead


class FerroelasticSoftening(Effect):
    """Frequency and damping both shift in proportion to the amplitude ``A = √(x² + p²)``."""

    id = "ferroelastic_softening"
    stage = "resonator"
    sentence = (
        "The ceramic softens and loses more in proportion to its swing, so pitch falls and damping rises with it."
    )
    equation = "F = -2 s A x + 2 l A p, A = √(x² + p²), p = x'/ω0; in ring-down Δf/f = -s A, Δζ = l A"
    source = (
        "S. Leadenham, A. Erturk, Unified nonlinear electroelastic dynamics of a bimorph piezoelectric cantilever for "
        "energy harvesting, sensing, and actuation, Nonlinear Dynamics 79, 2015"
    )
    parameters = (
        Parameter("softening_per_V", "1/V", -0.001, 10.0, meaning="relative fall of frequency, per amplitude"),
        Parameter("loss_ratio", "1", 0.1, 10.0, "log", "rise of the damping ratio over the relative fall of frequency"),
    )
    strengths = ("softening_per_V",)
    signature = "frequency and damping both shift linearly with the amplitude, from the smallest swings on"
    confusable_with = ("cubic_stiffness", "quadratic_damping")
    shown_by = "the same pulse at three amplitudes or more, each with its ring-down"

    def starts(self, printhead: Printhead, shots: Sequence[Shot]) -> list[dict[str, float]]:
        shift = 0.1 * printhead.damping_ratio / reach_V(printhead, shots)
        return [{"softening_per_V": shift / max(1.0, ratio), "loss_ratio": ratio} for ratio in (0.3, 1.0, 3.0)]

    def untestable(self, shots: Sequence[Shot]) -> str | None:
        return too_slow(shots)

    def told(self, values: Values, unit: str = "V") -> str:
        softening = values["softening_per_V"]
        size_V = 100.0 if abs(softening) * 100 < 1 else 1.0 if abs(softening) < 1 else 0.01
        shift = softening * size_V
        return (
            f"Swinging as far as a steady drive of about {with_prefix(size_V, 'V')} would deflect it, the head rings "
            f"{percent(abs(shift))} {'lower' if shift > 0 else 'higher'}, and its damping ratio "
            f"{'rises' if shift > 0 else 'falls'} by {abs(shift) * values['loss_ratio']:.2g}."
        )

    def resonator(self, values: Values, resonance: Resonance, shot: Shot) -> Resonance:
        softening = values["softening_per_V"]
        if softening == 0:
            return resonance
        numbers = np.array([2 * softening, 2 * softening * values["loss_ratio"]])
        return replace(resonance, forces=(*resonance.forces, Force(_compiled(), numbers)))


def _law(x_V: float, speed_V: float, values: NDArray[np.float64]) -> float:
    size = math.sqrt(x_V * x_V + speed_V * speed_V)
    force: float = size * (values[1] * speed_V - values[0] * x_V)
    return force


@functools.cache
def _compiled() -> Any:
    return compiled_force(_law)
