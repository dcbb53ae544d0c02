"""One resonator with restoring forces and a changing stiffness: its motion under a hysteretic drive.

Equation (11) of docs/explanation/model.md, for any forces ``F`` and a relative change of stiffness ``m``, is

    x'' + a1 x' + a0 (1 + m(t)) x = a0 (v - Σ F(x, x'/ω0)),                                         (11)

with the deflection ``x`` in hysteretic volts (at rest it is ``v``). With the pole ``λ = -a1/2 + i ω_d`` the deflection
is the imaginary part of an amplitude,

    A' = λ A + (a0 / ω_d) f,   x = Im A,   x' = Im λA.                                              (11a)

``f`` is quadratic between every second node, and a step integrates it exactly. Forces are taken as quadratic in time
(exponential Adams method, Cox & Matthews 2002), which is of third order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkjet_env.plant.errors import SimulationError
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.force import Force, Memory
from inkjet_env.plant.steady_state import settle
from inkjet_env.printhead.resonator import pole
from inkjet_env.typing import Real

MOST_PERIODS = 40
"""Largest number of iterations for the steady state of a repeated drive."""
REST_STEPS, MOST_REST_STEPS = 30, 300
"""Smallest number of iterations for the deflection at rest, unless it is stationary, and the largest."""
AT_REST = 1e-6
"""Relative change per iteration below which the deflection at rest is found; the steps of the motion are no more
accurate than that."""
STEADY = 1e-8
"""Relative change over a period below which a periodic state is steady."""


@dataclass(frozen=True, eq=False)
class Oscillator:
    """A resonator with restoring forces, driven at the nodes.

    Attributes
    ----------
    a0, a1 : float
        The resonator, in 1/s² and 1/s; ``a0`` may differ from the stiffness that the drive acts against, ``drive_a0``.
    drive_a0 : float
        ``a0`` of the base model, in 1/s²: the force of the drive is ``drive_a0 · v``.
    forces : tuple of Force
        Restoring forces that depend on the motion, nonlinear or with memory: the ``F`` of Eq. (11).
    softening : ndarray, shape (nodes,), or None
        ``m`` of Eq. (11): relative change of stiffness in time.

    Raises
    ------
    SimulationError
        The resonator does not ring.
    """

    a0: float
    a1: float
    drive_a0: float
    forces: tuple[Force, ...] = ()
    softening: Real | None = None

    def __post_init__(self) -> None:
        if not (self.a0 > 0 and self.a1 > 0 and self.a1**2 < 4 * self.a0):
            raise SimulationError("the resonator does not ring.")

    @property
    def linear(self) -> bool:
        """Whether superposition holds."""
        return not self.forces and self.softening is None

    def motion(self, hysteretic_V: Real, excitation: Excitation) -> tuple[Real, Real]:
        """Deflection in volts and its speed in V/s at the samples, each of shape (n,).

        Parameters
        ----------
        hysteretic_V : ndarray, shape (nodes,)
            Hysteretic drive at the nodes, in volts.
        excitation : Excitation
            Nodes, initial state and repetition of the drive.

        Raises
        ------
        SimulationError
            The motion grows without bound, never settles under a repeated drive, or has no rest position under the
            drive at the start.
        """
        from inkjet_env.plant import compiled

        ends = np.append(hysteretic_V, hysteretic_V[0]) if excitation.periodic else hysteretic_V
        n = excitation.samples + excitation.periodic
        deflection, speed = np.empty(n), np.empty(n)
        lam = pole(self.a0, self.a1)
        gain = self.drive_a0 / lam.imag
        h = 2 * excitation.node_step_s
        ends = np.ascontiguousarray(ends)
        pairs_a_sample = excitation.substeps // 2

        rest = amplitude(lam, self._rest_V(float(ends[0]), excitation.periodic), 0.0)
        state = rest
        if excitation.initial_state == "free":
            state += amplitude(lam, excitation.start[0], excitation.start[1] * math.sqrt(self.a0))
        period_s = excitation.step_s * excitation.samples
        memories: list[Memory] = []
        if self.linear:

            def run(start: complex) -> complex:
                return complex(compiled.linear_motion(ends, lam, gain, h, pairs_a_sample, start, deflection, speed))

        else:
            softening = np.zeros(0) if self.softening is None else np.append(self.softening, self.softening[:1])
            values = [np.array(force.values, dtype=np.float64) for force in self.forces]
            addresses = [(f.law.address, v.ctypes.data) for f, v in zip(self.forces, values, strict=True)]
            forces = np.array(addresses, dtype=np.int64).reshape(-1, 2)
            memories = [Memory.of(f, v, period_s) for f, v in zip(self.forces, values, strict=True) if f.relaxations]
            back = complex(min(-lam.real * h, 1.0), -lam.imag * h)  # at longer steps, the start decays within the first
            before = rest + (state - rest) * np.exp(back)  # a step earlier, had the drive been constant

            def pushed_V(place: complex) -> float:
                for memory in memories:
                    memory.values[:] = memory.first
                return self._pushed_V(place, lam, forces)

            past = np.array([pushed_V(place) for place in (rest, before, state)][1:])

            def run(start: complex) -> complex:
                return complex(
                    compiled.forced_motion(
                        ends, lam, gain, math.sqrt(self.a0), h, pairs_a_sample, start, forces, softening,
                        self.a0 / self.drive_a0, past, deflection, speed,
                    )
                )  # fmt: skip

        # Share of a change that decays over one period, in linear motion.
        decay = complex(-np.expm1(lam * period_s))
        if excitation.periodic and memories:
            end = settle(run, state, decay, memories, STEADY)
        else:
            end = run(state)
            for _ in range(MOST_PERIODS if excitation.periodic else 0):
                state += (end - state) / decay
                end = run(state)
                if self.linear or abs(end - state) <= STEADY * max(abs(state), 1e-12):
                    break
            else:
                if excitation.periodic:
                    raise SimulationError("there is no steady state under the repeated drive.")
        if not np.isfinite(end):
            raise SimulationError("the motion grows without bound.")
        return deflection[: excitation.samples], speed[: excitation.samples]

    def linear_speed(self, hysteretic_V: Real, excitation: Excitation) -> Real:
        """Magnitude of the speed in V/s at the nodes, shape (nodes,), without forces and changes of stiffness."""
        from inkjet_env.plant import compiled

        ends = np.ascontiguousarray(np.append(hysteretic_V, hysteretic_V[0]) if excitation.periodic else hysteretic_V)
        lam = pole(self.a0, self.a1)
        h = 2 * excitation.node_step_s
        deflection, speed = np.empty(ends.size // 2 + 1), np.empty(ends.size // 2 + 1)
        state = amplitude(lam, float(ends[0]) * self.drive_a0 / self.a0, 0.0)
        for decay in range(1 + excitation.periodic):
            end = compiled.linear_motion(ends, lam, self.drive_a0 / lam.imag, h, 1, state, deflection, speed)
            if decay == 0 and excitation.periodic:
                state += (end - state) / complex(-np.expm1(lam * excitation.step_s * excitation.samples))
        between: Real = np.interp(np.arange(hysteretic_V.size), 2 * np.arange(speed.size), np.abs(speed))
        return between

    def turned(self, motion: tuple[Real, Real]) -> tuple[Real, Real]:
        """Speed over ``drive_a0``, and its derivative less the drive, from deflection and speed, each of shape (n,)."""
        deflection, speed = motion
        return speed / self.drive_a0, -(self.a0 * deflection + self.a1 * speed) / self.drive_a0

    def _pushed_V(self, state: complex, pole_: complex, forces: NDArray[np.int64]) -> float:
        """Sum of all forces in a state of the resonator at the first sample, in hysteretic volts."""
        from inkjet_env.plant import compiled

        x_V, speed_V = state.imag, (pole_ * state).imag / math.sqrt(self.a0)
        pushed_V = float(compiled.pushed(forces, x_V, speed_V))
        if self.softening is not None:
            pushed_V += self.a0 / self.drive_a0 * float(self.softening[0]) * x_V
        return pushed_V

    def _rest_V(self, hysteretic_V: float, repeated: bool) -> float:
        """Rest position under the first hysteretic drive: ``x = (v - F(x, 0)) / s``, with s the spring's stiffness.

        Each iteration multiplies the error by ``F'/s``, so it converges if the slope of the forces is below that of the
        spring. If the drive is repeated, the position is only the start of the search for the steady state, and a
        guess suffices.

        Raises
        ------
        SimulationError
            No rest position was found.
        """
        stiffness = self.a0 / self.drive_a0
        if self.softening is not None:
            stiffness *= 1 + float(self.softening[0])
        rest_V = hysteretic_V / stiffness
        if not self.forces:
            return rest_V
        with np.errstate(over="ignore", invalid="ignore"):
            for step in range(1, MOST_REST_STEPS + 1):
                pushed_V = sum(force.law(rest_V, 0.0, np.array(force.values)) for force in self.forces)
                before_V, rest_V = rest_V, (hysteretic_V - pushed_V) / stiffness
                change_V = abs(rest_V - before_V)
                if change_V == 0 or (step >= REST_STEPS and (repeated or change_V <= AT_REST * abs(rest_V))):
                    return rest_V
                if not math.isfinite(rest_V):
                    break
        raise SimulationError("no rest was found under the first drive: forces grow faster than the spring's.")


def amplitude(pole_: complex, deflection: float, speed: float) -> complex:
    """Amplitude ``A`` of Eq. (11a): ``Im A`` is the deflection and ``Im λA`` its speed."""
    return complex((speed - pole_.real * deflection) / pole_.imag, deflection)
