"""Resonance of the head: a resonator with its forces, modes, echoes and refills, and what a channel shows of it.

Displacement shows the deflection ``x``, self-sensing its speed ``x'``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from inkjet_env.plant.echo import Echo
from inkjet_env.plant.errors import SimulationError
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.force import Force
from inkjet_env.plant.oscillator import Oscillator
from inkjet_env.plant.refill import FLOW_V, Refill
from inkjet_env.typing import Real


@dataclass(frozen=True)
class Mode:
    """A further mode in parallel to the first.

    Attributes
    ----------
    a0, a1 : float
        Coefficients of its resonator, in 1/s² and 1/s.
    strength : float
        Static compliance relative to that of the first mode.
    exchange : float
        Coefficient e of the coupling of the modes by damping, ``e ω1 (s / D2 - s / D1)`` on the hysteretic drive, with
        ``D = s² + a1 s + a0`` of each mode; dimensionless. With it the two modes can be those of any two masses that
        springs and dampers couple.
    """

    a0: float
    a1: float
    strength: float
    exchange: float = 0.0


@dataclass(frozen=True, eq=False)
class Resonance:
    """A resonator with the forces, modes and echoes that accompany it.

    Attributes
    ----------
    a0, a1 : float
        The resonator, in 1/s² and 1/s; ``a0`` may differ from the stiffness that the drive acts against, ``drive_a0``.
    drive_a0 : float
        ``a0`` of the base model, in 1/s²: the force of the drive is ``drive_a0 · v``.
    forces : tuple of Force
        Restoring forces that depend on the motion, nonlinear or with memory.
    softening : ndarray, shape (nodes,), or None
        ``m``: relative change of stiffness in time.
    modes : tuple of Mode
        Further modes in parallel.
    echoes : tuple of Echo
        Waves that return after a delay.
    refills : tuple of Refill
        Changes of stiffness that depend on the preceding flow.
    """

    a0: float
    a1: float
    drive_a0: float
    forces: tuple[Force, ...] = ()
    softening: Real | None = None
    modes: tuple[Mode, ...] = ()
    echoes: tuple[Echo, ...] = ()
    refills: tuple[Refill, ...] = ()

    @property
    def oscillator(self) -> Oscillator:
        """The first mode alone, with its forces; `SimulationError` if it does not ring."""
        return Oscillator(self.a0, self.a1, self.drive_a0, self.forces, self.softening)

    def with_softening(self, change: Real) -> Resonance:
        """The same with a further relative change of stiffness, shape (nodes,)."""
        return replace(self, softening=change if self.softening is None else self.softening + change)

    def with_oscillator(self, mass_ratio: float, b0: float, b1: float) -> Resonance:
        """The same with an oscillator on the resonator: its two modes instead of the one.

        Parameters
        ----------
        mass_ratio : float
            Mass of the oscillator over that of the resonator.
        b0, b1 : float
            Coefficients of the oscillator on a support at rest, in 1/s² and 1/s.

        Raises
        ------
        SimulationError
            One of the two modes does not ring.
        """
        # x / v = drive_a0 (s² + b1 s + b0) / D(s), in partial fractions
        own = np.array([1.0, self.a1, self.a0])
        together = np.polyadd(np.polymul(own, [1.0, b1, b0]), [mass_ratio * b1, mass_ratio * b0, 0.0, 0.0])
        poles = np.roots(together)
        poles = poles[poles.imag > 0]
        if poles.size < 2:
            raise SimulationError("a mode of two coupled oscillators must ring; got one that is overdamped.")
        poles = poles[np.argsort(np.abs(np.abs(poles) - math.sqrt(self.a0)))]
        residues = self.drive_a0 * np.polyval([1.0, b1, b0], poles) / np.polyval(np.polyder(together), poles)
        stiffness, damping = np.abs(poles) ** 2, -2 * poles.real
        force = -2 * (residues * poles.conj()).real
        exchange = 2 * float(residues[1].real) / math.sqrt(float(stiffness[0]))
        first = Mode(float(stiffness[0]), float(damping[0]), float((force[0] - self.drive_a0) / stiffness[0]))
        second = Mode(float(stiffness[1]), float(damping[1]), float(force[1] / stiffness[1]), exchange)
        return replace(self, a0=first.a0, a1=first.a1, modes=(*self.modes, first, second))

    def refilled(self, hysteretic_V: Real, excitation: Excitation) -> Resonance:
        """The same with the refills replaced by the change of stiffness that they cause under this hysteretic drive."""
        if not self.refills:
            return self
        flow = self.oscillator.linear_speed(hysteretic_V, excitation) / (FLOW_V * math.sqrt(self.a0))
        changed = replace(self, refills=())
        for refill in self.refills:
            changed = changed.with_softening(refill.softening(flow, excitation))
        return changed

    def motion(self, hysteretic_V: Real, excitation: Excitation) -> Real:
        """Motion as the channel shows it, at the samples, shape (n,).

        Displacement shows the deflection, in hysteretic volts. Self-sensing shows the speed over ``drive_a0``, in volt
        seconds, so that the gain is ``b1``.

        Raises
        ------
        SimulationError
            The motion grows without bound, never settles under a repeated drive, or has no rest position under the
            drive at the start.
        """
        shown = 1 if excitation.channel == "self_sensing" else 0
        own = self.refilled(hysteretic_V, excitation).oscillator
        first = own.motion(hysteretic_V, excitation)
        total = first[shown]
        for mode in self.modes:
            other = Oscillator(mode.a0, mode.a1, mode.a0)
            second = other.motion(hysteretic_V, replace(excitation, start=(0.0, 0.0)))
            total = total + mode.strength * second[shown]
            if mode.exchange:
                turned = other.turned(second)[shown] - own.turned(first)[shown]
                total = total + mode.exchange * math.sqrt(self.a0) * turned
        if shown == 1:
            total = total / self.drive_a0
        moved = total
        for echo in self.echoes:
            total = total + echo.of(moved, excitation.step_s, excitation.periodic)
        return total
