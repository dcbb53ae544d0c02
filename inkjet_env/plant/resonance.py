"""Resonance of the head: one resonator, its nonlinear forces, further modes and echoes, driven at the nodes.

Equation (11) of docs/explanation/model.md, for any forces ``F`` and a relative change of stiffness ``m``, is

    x'' + a1 x' + a0 (1 + m(t)) x = a0 (v - Σ F(x, x'/ω0)),                                         (11)

with the deflection ``x`` in hysteretic volts (at rest it is ``v``). Displacement shows ``x``, self-sensing ``x'``. With
the pole ``λ = -a1/2 + i ω_d`` the deflection is the imaginary part of an amplitude,

    A' = λ A + (a0 / ω_d) f,   x = Im A,   x' = Im λA.                                              (11a)

``f`` is quadratic between every second node, and a step integrates it exactly. Forces are taken as quadratic in time
(exponential Adams method, Cox & Matthews 2002), which is of third order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.plant.errors import SimulationError
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.lag import lag_weights, lap_loss
from inkjet_env.printhead import Printhead
from inkjet_env.printhead.resonator import pole
from inkjet_env.typing import Real

MOST_LAPS = 40
"""Largest number of iterations for the steady state of a repeated drive."""
REST_STEPS, MOST_REST_STEPS = 30, 300
"""Smallest number of iterations for the deflection at rest, unless it is stationary, and the largest."""
AT_REST = 1e-6
"""Relative change per iteration below which the deflection at rest is found; the steps of the motion are no more
accurate than that."""
FLOW_V = 100.0
"""Scaled speed, in hysteretic volts, that is one unit of flow."""
STEADY = 1e-8
"""Relative change over a period below which a periodic state is steady."""
FAINT = 1e-4
"""Relative strength below which a wave is no longer followed."""


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


@dataclass(frozen=True)
class Echo:
    """Returning part of a wave that travels both ways in a channel with two ends.

    Attributes
    ----------
    delay_s, strength : float
        Time in seconds until the wave is back from the first end, and its amplitude then, relative to the outgoing one.
    second_delay_s : float
        The same delay for the other end, in seconds.
    reflection, second_reflection : float
        Reflection coefficients r1, r2 of the ends; with ``r2 = 0`` the other end reflects nothing and the wave returns
        once.
    loss_s : float
        Time constant, in seconds, of a first-order lag at each reflection.
    """

    delay_s: float
    strength: float
    second_delay_s: float = 0.0
    reflection: float = 1.0
    second_reflection: float = 0.0
    loss_s: float = 0.0

    def of(self, signal: Real, step_s: float, periodic: bool) -> Real:
        """Echo of a signal, ``α (z1 + r2/r1 z2 + 2 r2 z1 z2) / (1 - r1 r2 z1 z2)`` with lossy delays z, shape (n,)."""

        def heard(wave: Real, delay_s: float, ends: int) -> Real:
            return returned(wave, delay_s / step_s, periodic, ends, self.loss_s / step_s)

        first = heard(signal, self.delay_s, 1)
        r1, r2 = self.reflection, self.second_reflection
        if r2 == 0:
            return self.strength * first
        if r1 == 0:
            raise SimulationError("a wave returns from an end that reflects nothing.")
        lap_s = self.delay_s + self.second_delay_s
        around = heard(signal, lap_s, 2)
        total = wave = first + r2 / r1 * heard(signal, self.second_delay_s, 1) + 2 * r2 * around
        warm_up_periods = math.ceil(math.log(FAINT) / math.log(max(abs(r1 * r2), FAINT)))
        if not periodic:
            warm_up_periods = min(warm_up_periods, int(signal.size * step_s / lap_s))
        for _ in range(warm_up_periods):
            wave = r1 * r2 * heard(wave, lap_s, 2)
            total = total + wave
        return self.strength * total


@dataclass(frozen=True)
class Refill:
    """A stiffness that depends on the preceding flow.

    Attributes
    ----------
    change : float
        Relative change of stiffness per unit of the state, ``(|p| / 100 V)^power`` behind a low-pass, where
        ``p = x' / ω0`` is the scaled speed of the head without it.
    power : float
        Exponent of the flow, dimensionless.
    recovery_s, second_order : float
        τ in seconds and q, dimensionless, of the low-pass ``1 / (1 + τ s + q τ² s²)``.
    """

    change: float
    power: float
    recovery_s: float
    second_order: float


@dataclass(frozen=True, eq=False)
class Force:
    """A restoring force in addition to those of spring and damper: one ``F`` of Eq. (11).

    Attributes
    ----------
    law : compiled law
        ``law(x_V, speed_V, values)`` in hysteretic volts, from the deflection, the scaled speed ``x' / ω0``, and an
        array of numbers; compiled by `compiled_force`.
    values : ndarray, shape (k,)
        Parameters of the law, followed by its memory of the motion, if it has one, which is 0 before all motion. The
        law is called once per step, in time order, and may change its memory.
    """

    law: Any
    values: Real


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
    def linear(self) -> bool:
        """Whether superposition holds."""
        return not self.forces and self.softening is None

    def with_softening(self, change: Real) -> Resonance:
        """The same with a further relative change of stiffness, shape (nodes,)."""
        return replace(self, softening=change if self.softening is None else self.softening + change)

    def refilled(self, hysteretic_V: Real, excitation: Excitation) -> Resonance:
        """The same with the refills replaced by the change of stiffness that they cause under this hysteretic drive."""
        if not self.refills:
            return self
        from inkjet_env.plant import compiled
        from inkjet_env.plant.low_pass import low_passed

        self._check_that_it_rings()
        ends = np.ascontiguousarray(np.append(hysteretic_V, hysteretic_V[0]) if excitation.periodic else hysteretic_V)
        lam, omega0 = pole(self.a0, self.a1), math.sqrt(self.a0)
        h = 2 * excitation.node_step_s
        deflection, speed = np.empty(ends.size // 2 + 1), np.empty(ends.size // 2 + 1)
        state = amplitude(lam, float(ends[0]) * self.drive_a0 / self.a0, 0.0)
        for lap in range(1 + excitation.periodic):
            end = compiled.linear_motion(ends, lam, self.drive_a0 / lam.imag, h, 1, state, deflection, speed)
            if lap == 0 and excitation.periodic:
                state += (end - state) / complex(-np.expm1(lam * excitation.step_s * excitation.samples))
        flow = np.interp(np.arange(hysteretic_V.size), 2 * np.arange(speed.size), np.abs(speed)) / (FLOW_V * omega0)
        changed = replace(self, refills=())
        for refill in self.refills:
            pushed = flow**refill.power
            drawn = low_passed(
                pushed, refill.recovery_s, refill.second_order, excitation.node_step_s, excitation.periodic
            )
            changed = changed.with_softening(refill.change * drawn)
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
        own = replace(self, modes=(), echoes=()).refilled(hysteretic_V, excitation)
        first = own._one_mode(hysteretic_V, excitation)
        total = first[shown]
        for mode in self.modes:
            other = Resonance(mode.a0, mode.a1, mode.a0)
            second = other._one_mode(hysteretic_V, replace(excitation, start=(0.0, 0.0)))
            total = total + mode.strength * second[shown]
            if mode.exchange:
                turned = other._turned(second)[shown] - own._turned(first)[shown]
                total = total + mode.exchange * math.sqrt(self.a0) * turned
        if shown == 1:
            total = total / self.drive_a0
        moved = total
        for echo in self.echoes:
            total = total + echo.of(moved, excitation.step_s, excitation.periodic)
        return total

    def _check_that_it_rings(self) -> None:
        if not (self.a0 > 0 and self.a1 > 0 and self.a1**2 < 4 * self.a0):
            raise SimulationError("the resonator does not ring.")

    def _one_mode(self, hysteretic_V: Real, excitation: Excitation) -> tuple[Real, Real]:
        """Deflection in volts and its speed in V/s at the samples."""
        from inkjet_env.plant import compiled

        self._check_that_it_rings()
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
        if self.linear:

            def run(start: complex) -> complex:
                return complex(compiled.linear_motion(ends, lam, gain, h, pairs_a_sample, start, deflection, speed))

        else:
            softening = np.zeros(0) if self.softening is None else np.append(self.softening, self.softening[:1])
            values = [np.array(force.values, dtype=np.float64) for force in self.forces]
            addresses = [(f.law.address, v.ctypes.data) for f, v in zip(self.forces, values, strict=True)]
            forces = np.array(addresses, dtype=np.int64).reshape(-1, 2)
            before = rest + (state - rest) * np.exp(-lam * h)  # a step earlier, had the drive been constant
            past = np.array([self._pushed_V(place, lam, forces) for place in (rest, before, state)][1:])

            def run(start: complex) -> complex:
                return complex(
                    compiled.forced_motion(
                        ends, lam, gain, math.sqrt(self.a0), h, pairs_a_sample, start, forces, softening,
                        self.a0 / self.drive_a0, past, deflection, speed,
                    )
                )  # fmt: skip

        end = run(state)
        if excitation.periodic:
            lap = complex(
                -np.expm1(lam * excitation.step_s * excitation.samples)
            )  # share of a change that decays over one period, in linear motion
            for _ in range(MOST_LAPS):
                state += (end - state) / lap
                end = run(state)
                if self.linear or abs(end - state) <= STEADY * max(abs(state), 1e-12):
                    break
            else:
                raise SimulationError("there is no steady state under the repeated drive.")
        if not np.isfinite(end):
            raise SimulationError("the motion grows without bound.")
        return deflection[: excitation.samples], speed[: excitation.samples]

    def _turned(self, motion: tuple[Real, Real]) -> tuple[Real, Real]:
        """Speed of a mode over ``drive_a0``, and its derivative less the drive, from its deflection and speed."""
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
        for step in range(1, MOST_REST_STEPS + 1):
            with np.errstate(over="ignore", invalid="ignore"):
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


def compiled_force(law: Callable[..., float]) -> Any:
    """Decorator that compiles a force law ``law(x_V, speed_V, values) -> float`` so that the kernels can call it."""
    from numba import cfunc, types

    signature = types.float64(types.float64, types.float64, types.CPointer(types.float64))
    try:
        return cfunc(signature, cache=True, error_model="numpy")(law)
    except RuntimeError:  # a function typed into a console has no file, so its code cannot be cached
        return cfunc(signature, error_model="numpy")(law)


def returned(signal: Real, samples: float, periodic: bool, ends: int = 0, loss_samples: float = 0.0) -> Real:
    """A signal delayed by some samples, with cubic interpolation, behind a first-order lag for each reflection.

    Before the first sample the signal is held at its value there.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Signal at the samples.
    samples : float
        Delay in samples; may be negative and fractional.
    periodic : bool
        Whether the sample after the last is the first.
    ends : int
        Number of reflections, each with its lag.
    loss_samples : float
        Time constant of the lag, in samples.

    Returns
    -------
    ndarray, shape (n,)
        The delayed signal, in the unit of ``signal``.
    """
    from inkjet_env.plant import compiled

    whole = math.floor(samples)
    t = 1 - (samples - whole)
    weights = np.array(  # Lagrange's cubic through the two samples on either side
        [
            -t * (t - 1) * (t - 2) / 6,
            (t + 1) * (t - 1) * (t - 2) / 2,
            -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6,
        ]
    )
    if loss_samples <= 0:
        ends = 0
    lag, lap = lag_weights(loss_samples, 1.0), lap_loss(loss_samples, signal.size)
    result = np.empty(signal.size)
    compiled.returned(np.ascontiguousarray(signal), whole, weights, ends, lag, lap, periodic, result)
    return result


def too_slow(excitations: Sequence[Excitation]) -> str | None:
    """Why recordings do not show the resonator, as the end of a sentence after "because"; None if they do."""
    if any(excitation.fast for excitation in excitations):
        return None
    return "every recording is from the strain gauge, which is too slow to show the resonance"


def reach_V(printhead: Printhead, excitations: Sequence[Excitation]) -> float:
    """Largest deflection of the head in these recordings, in hysteretic volts; 1 V if none moves it.

    The width of the hysteresis is neglected.
    """
    law = printhead.branch_law
    reach = 0.0
    for excitation in excitations:
        drive_V = excitation.drive_at_nodes_V
        swing = float(np.ptp(drive_V))
        if excitation.fast and swing > 0:
            slope = float(law.Q(swing / law.full_scale_V)) * law.full_scale_V / swing
            rings = Resonance(printhead.a0, printhead.a1, printhead.a0)
            deflection = rings.motion(slope * drive_V, replace(excitation, channel="displacement"))
            reach = max(reach, float(np.abs(deflection).max()))
    return reach or 1.0
