"""Ferroelastic softening: the ceramic becomes softer and more lossy in proportion to its amplitude."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.force import Force, compiled_force
from inkjet_env.plant.lag import lag_weights
from inkjet_env.plant.recorded_motion import reach_V, too_slow
from inkjet_env.plant.resonance import Resonance
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

ELEMENTS = 40
"""Number of slipping elements; the error falls with its square."""
REACH = 3.0
"""Bound of the deflection, in units of the largest drive."""
LEAST_V = 1e-9
"""Smallest bound of the deflection, in hysteretic volts."""
ENERGY = 5
"""Place of w among the values of the law of the envelope."""
REFERENCE_V = 100.0
"""Threshold at which the density of the elements is ``rayleigh_per_V``, in hysteretic volts."""


class FerroelasticSoftening(Effect):
    """Frequency and damping both shift in proportion to the amplitude, instantaneously or by elements that slip."""

    id = "ferroelastic_softening"
    stage = "resonator"
    sentence = (
        "The ceramic becomes softer and more lossy in proportion to its amplitude: frequency falls, damping rises."
    )
    equation = (
        "F = -2 s A x + 2 l A p - ∫ 2 rayleigh_per_V (r / 100 V)^power E_r[x] dr, A = √(x² + p²), p = x'/ω0, E_r the "
        "play of threshold r; in ring-down the first two terms give Δf/f = -s A, Δζ = l A; envelope_per_V: the same as "
        "s with A = √(2 w), w + τ w' = p², τ memory_periods of the head"
    )
    source = (
        "S. Leadenham, A. Erturk, Unified nonlinear electroelastic dynamics of a bimorph piezoelectric cantilever for "
        "energy harvesting, sensing, and actuation, Nonlinear Dynamics 79, 2015; elements that slip: Lord Rayleigh, "
        "Philosophical Magazine 23, 1887; W. D. Iwan, A distributed-element model for hysteresis and its steady-state "
        "dynamic response, Journal of Applied Mechanics 33, 1966; D. Damjanovic, Rep. Prog. Phys. 61, 1998"
    )
    parameters = (
        Parameter("softening_per_V", "1/V", -0.001, 10.0, meaning="relative fall of the frequency per amplitude"),
        Parameter("loss_ratio", "1", 0.1, 10.0, "log", "rise of the damping ratio over relative fall of frequency"),
        Parameter("rayleigh_per_V", "1/V", -0.001, 10.0, meaning="relative fall of the stiffness per amplitude"),
        Parameter(
            "power", "1", -0.8, 4.0, meaning="exponent of the slipping elements' density", open_ended=True, plain=0.0
        ),
        Parameter(
            "envelope_per_V",
            "1/V",
            -0.001,
            10.0,
            meaning="the same, of the ring's envelope",
            plain=0.0,
            later=True,
        ),
        Parameter(
            "memory_periods",
            "1",
            0.2,
            30.0,
            "log",
            "τ: memory of the envelope, in periods",
            open_ended=True,
            plain=1.0,
            later=True,
        ),
    )
    strengths = ("softening_per_V", "rayleigh_per_V", "envelope_per_V")
    signature = "frequency and damping both shift linearly with the amplitude, from the smallest amplitudes on"
    confusable_with = ("cubic_stiffness", "quadratic_damping", "coulomb_friction")
    shown_by = "the same pulse at three amplitudes or more, each with its ring-down"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        shift = 0.1 * printhead.damping_ratio / reach_V(printhead, excitations)
        slips = complete(self, loss_ratio=1.0, rayleigh_per_V=2 * shift)
        ratios = (0.3, 1.0, 3.0)
        at_once = [complete(self, softening_per_V=shift / max(1.0, q), loss_ratio=q) for q in ratios]
        return [slips, *at_once]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"softening_per_V": 1.5e-4, "loss_ratio": 0.5}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        softening, slipping = values["softening_per_V"] + values["envelope_per_V"], values["rayleigh_per_V"]
        largest = max(abs(softening), abs(slipping))
        size_V = 100.0 if largest * 100 < 1 else 1.0 if largest < 1 else 0.01
        softer = slipping * size_V * _share(size_V, values["power"])
        shift = softening * size_V + softer / 2
        loss = softening * size_V * values["loss_ratio"] + softer * 2 / (3 * math.pi)
        return (
            f"At an amplitude equal to the deflection under a steady drive of about {with_prefix(size_V, 'V')}, the "
            f"head's frequency is {percent(abs(shift))} {'lower' if shift > 0 else 'higher'} and its damping ratio is "
            f"{abs(loss):.2g} {'higher' if loss > 0 else 'lower'}."
        )

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        softening = values["softening_per_V"]
        forces = resonance.forces
        if softening:
            numbers = np.array([2 * softening, 2 * softening * values["loss_ratio"]])
            forces = (*forces, Force(_compiled(_law), numbers))
        if values["rayleigh_per_V"]:
            reach_V = (
                REACH * float(np.abs(excitation.drive_V).max()) + abs(excitation.start[0]) + abs(excitation.start[1])
            )
            width_V = max(reach_V, LEAST_V) / ELEMENTS
            slips_V = (np.arange(ELEMENTS) + 0.5) * width_V
            weights = 2 * values["rayleigh_per_V"] * width_V * (slips_V / REFERENCE_V) ** values["power"]
            numbers = np.concatenate([[ELEMENTS], slips_V, weights, np.zeros(ELEMENTS)])
            forces = (*forces, Force(_compiled(_slipping), numbers))
        if values["envelope_per_V"]:
            envelope = 2 * values["envelope_per_V"]
            time_s = values["memory_periods"] * 2 * math.pi / math.sqrt(resonance.a0)
            lag = lag_weights(time_s, 2 * excitation.node_step_s)
            numbers = np.array([envelope, envelope * values["loss_ratio"], *lag, 0.0, 0.0, 0.0])
            forces = (*forces, Force(_compiled(_softened), numbers, ((ENERGY, time_s),)))
        return replace(resonance, forces=forces)


def _share(size_V: float, power: float) -> float:
    """Fall of the secant stiffness at an amplitude in volts, over that of elements with a constant density."""
    return 2 * (size_V / REFERENCE_V) ** power / ((1 + power) * (2 + power))


def _slipping(x_V: float, speed_V: float, values: Real) -> float:
    count, force = int(values[0]), 0.0
    for k in range(1, count + 1):
        state = max(x_V - values[k], min(x_V + values[k], values[k + 2 * count]))
        values[k + 2 * count] = state
        force -= values[k + count] * state
    return force


def _softened(x_V: float, speed_V: float, values: Real) -> float:
    begun, power = values[7], speed_V * speed_V
    if begun:
        values[5] = values[2] * values[5] + values[3] * values[6] + values[4] * power
    values[6] = power
    values[7] = 1.0
    force: float = math.sqrt(2.0 * max(values[5], 0.0)) * (values[1] * speed_V - values[0] * x_V)
    return force


def _law(x_V: float, speed_V: float, values: Real) -> float:
    size = math.sqrt(x_V * x_V + speed_V * speed_V)
    force: float = size * (values[1] * speed_V - values[0] * x_V)
    return force


@functools.cache
def _compiled(law: Callable[..., float]) -> Any:
    return compiled_force(law)
