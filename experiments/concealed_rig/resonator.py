"""The resonator with whatever acts inside it: one equation of motion, integrated by classical Runge–Kutta.

In the dimensionless time ω₀t, with the deflection x in volts of static drive::

    x' = v
    v' = h − (1 + e u + m q − s A) x − k₂x² − k₃x³/(1 + bx²) + g clip(x, ±d) + Σ wⱼ playⱼ(x) + r R(x)
           − k_s (x − x_s)⁺(1 + d v) − 2ζ [1 + c_v H(−v − p) + c_q q − c_w(1 − x²/x_w²)] v − c_A A v − c₂|v|ⁿv
           − F [1 + f exp(−v²/v_f²)] tanh(v/δ) − Σ cⱼ zⱼ + μ[ρ²(x₂ − x) + 2ζ₂ρ(v₂ − v)]

h is the hysteretic drive, u the voltage, q a slow state (meniscus, temperature), A = √(x² + v²) the ring's envelope, R
Rayleigh's hysteretic law with the memory of its turning points, zⱼ the diffusive states of a fractional derivative, x₂
a second mass on its own spring. With an inertance that depends on the volume the mass is 1 + m x; with an
autoparametric mode a second oscillator is driven by x² and pulls back with 2xq₂.
"""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.motion import integrate

MOST_LAPS = 60


@dataclass(frozen=True)
class Resonator:
    """Parameters of the equation of motion; all but the first two are zero in the base plant.

    Parameters
    ----------
    angular_rad_per_s, damping_ratio : float
        ω₀ and ζ.
    cubic_per_V2 : float
        Duffing's k₃, against the linear spring.
    quadratic_damping_per_V : float
        c₂, drag that grows with the square of the speed.
    rayleigh_per_V : float
        Rayleigh's law: a branch from a turning point is Δ − r Δ|Δ|/2.
    added_stiffness : float
        A spring beside the linear one (the elastic part of elements that slip).
    friction_V, friction_speed_V : float
        Coulomb friction, and the speed within which it reverses.
    electro_per_V : float
        Change of stiffness a volt of applied drive.
    gap_V, gap_softening : float
        Inside ±gap the spring is softer by this share.
    cavitation_gain, cavitation_speed_V : float
        Damping is larger by this share where the pressure, −v, exceeds the threshold.
    mass_ratio, second_ratio, second_damping : float
        A second mass on the first: its share, its frequency over f₀, its damping ratio.
    meniscus_gain, meniscus_kind, meniscus_s, meniscus_damping, meniscus_V, meniscus_loss : float
        Stiffness for each unit of the slow state; 1 relaxes after the speed, 2 oscillates, 3 relaxes after the outflow
        alone, 4 after the speed's square; its time; its damping ratio; the speed that drives it to 1; relative change
        of the damping for each unit.
    cubic_bound_per_V2 : float
        The cubic spring is x³/(1 + bound·x²).
    drag_power : float
        0: the drag is c₂|v|v; else (c₂|v|)ⁿv.
    stribeck, stribeck_speed_V : float
        By how much dry friction is larger at rest, and the speed within which that fades.
    envelope_softening_per_V, envelope_loss_per_V : float
        Of stiffness and damping a volt of the ring's envelope √(x² + v²).
    quadratic_per_V : float
        Spring force in x².
    inertance_per_V : float
        Relative change of the mass a volt of deflection.
    van_der_pol, van_der_pol_V : float
        Share of the damping that is missing at rest, and the deflection at which it is there again.
    stop_V, stop_stiffness, stop_loss_per_V : float
        A stop on one side: where it is, its stiffness, and its damping a volt of penetration.
    auto_per_V, auto_ratio, auto_damping : float
        Coupling of an autoparametric mode, its frequency over f₀, and its damping ratio.
    slip_V, slip_weight : tuple of float
        Plays on the deflection (Iwan's or Jenkins' elements).
    diffusive_rate, diffusive_weight : tuple of float
        Of the states z' = v − λz.
    """

    angular_rad_per_s: float
    damping_ratio: float
    cubic_per_V2: float = 0.0
    quadratic_damping_per_V: float = 0.0
    rayleigh_per_V: float = 0.0
    added_stiffness: float = 0.0
    friction_V: float = 0.0
    friction_speed_V: float = 1.0
    electro_per_V: float = 0.0
    gap_V: float = 0.0
    gap_softening: float = 0.0
    cavitation_gain: float = 0.0
    cavitation_speed_V: float = 1e9
    mass_ratio: float = 0.0
    second_ratio: float = 1.0
    second_damping: float = 0.0
    meniscus_gain: float = 0.0
    meniscus_kind: float = 0.0
    meniscus_s: float = 1.0
    meniscus_damping: float = 0.5
    meniscus_V: float = 1.0
    meniscus_loss: float = 0.0
    cubic_bound_per_V2: float = 0.0
    drag_power: float = 0.0
    stribeck: float = 0.0
    stribeck_speed_V: float = 1.0
    envelope_softening_per_V: float = 0.0
    envelope_loss_per_V: float = 0.0
    quadratic_per_V: float = 0.0
    inertance_per_V: float = 0.0
    van_der_pol: float = 0.0
    van_der_pol_V: float = 1.0
    stop_V: float = 0.0
    stop_stiffness: float = 0.0
    stop_loss_per_V: float = 0.0
    auto_per_V: float = 0.0
    auto_ratio: float = 2.0
    auto_damping: float = 0.0
    slip_V: tuple[float, ...] = field(default=())
    slip_weight: tuple[float, ...] = field(default=())
    diffusive_rate: tuple[float, ...] = field(default=())
    diffusive_weight: tuple[float, ...] = field(default=())

    @property
    def fastest_Hz(self) -> float:
        """The highest frequency that the integrator has to follow, with room for the second mass."""
        second = self.second_ratio / 2 if self.mass_ratio else self.auto_ratio / 2 if self.auto_per_V else 0.0
        return self.angular_rad_per_s / (2 * np.pi) * max(1.0, second)

    def numbers(self) -> np.ndarray:
        """Scalars in the order in which they stand above; the meniscus' time in units of 1/ω₀."""
        scalars = [getattr(self, f.name) for f in fields(self) if f.type in (float, "float")]
        values = np.array(scalars, dtype=float)
        values[SCALARS.index("meniscus_s")] *= self.angular_rad_per_s
        return values


SCALARS = [f.name for f in fields(Resonator) if f.type in (float, "float")]


@dataclass(frozen=True)
class Motion:
    """Deflection and speed at the steps, shape (steps + 1,) each, both in volts (the speed divided by ω₀)."""

    deflection_V: np.ndarray
    speed_V: np.ndarray


def motion(resonator: Resonator, hysteretic_V: np.ndarray, applied_V: np.ndarray, grid: Grid) -> Motion:
    """Integrate the equation of motion over a recording.

    Parameters
    ----------
    resonator : Resonator
    hysteretic_V, applied_V : ndarray, shape (2·steps + 1,)
        Forcing and voltage at every half step.
    grid : Grid
        Periodic: laps are gone through until two of them differ by less than 1e-7 of the largest speed.

    Raises
    ------
    FloatingPointError
        Where the motion diverges or does not settle: such parameters are no printhead.
    """
    x, v = np.empty(grid.steps + 1), np.empty(grid.steps + 1)
    status = integrate(
        np.ascontiguousarray(hysteretic_V),
        np.ascontiguousarray(applied_V),
        grid.step_s * resonator.angular_rad_per_s,
        resonator.numbers(),
        np.array(resonator.slip_V, dtype=float),
        np.array(resonator.slip_weight, dtype=float),
        np.array(resonator.diffusive_rate, dtype=float),
        np.array(resonator.diffusive_weight, dtype=float),
        MOST_LAPS if grid.periodic else 1,
        1e-7,
        x,
        v,
    )
    if status == 1:
        raise FloatingPointError("the motion of the resonator diverges")
    if status == 2:
        raise FloatingPointError(f"the motion of the resonator does not settle within {MOST_LAPS} periods")
    return Motion(x, v)


def changed(resonator: Resonator, frequency: float = 1.0, damping: float = 1.0) -> Resonator:
    """A resonator whose frequency and decay rate are multiplied by two factors."""
    return replace(
        resonator,
        angular_rad_per_s=resonator.angular_rad_per_s * frequency,
        damping_ratio=resonator.damping_ratio * damping / frequency,
    )
