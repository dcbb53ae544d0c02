"""Resonator stage: losses that are not viscous, of the structure and of dry friction."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.resonator import Resonator


def diffusive_states(power: float, count: int = 18) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Rates λ and weights c with Dᵅx ≈ Σ cⱼzⱼ + k x + d x', z' = x' − λz, about the resonance (ω = 1).

    λ^(α−1) sin(πα)/π over 0 … ∞, by the trapezoidal rule in ln λ; slower states are a spring, faster ones a damper.

    Source: L. Yuan, O. P. Agrawal, J. Vib. Acoust. 124 (2002) 321; G. Montseny, ESAIM Proc. 5 (1998) 159.
    """
    rate = np.geomspace(1e-3, 50.0, count)
    scale = np.sin(np.pi * power) / np.pi
    weight = scale * rate**power * np.log(rate[1] / rate[0])
    weight[[0, -1]] /= 2
    spring, damper = scale * rate[0] ** power / power, scale * rate[-1] ** (power - 1) / (1 - power)
    return rate, weight, float(spring), float(damper)


def constant_loss_states(slowest: float, fastest: float, count: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Rates λ and weights c of Maxwell elements whose loss factor is 1 between two rates: Σ c iω/(iω + λ).

    ∫ ωλ/(ω² + λ²) d ln λ = π/2 over all rates, so equal weights of 2/π a unit of ln λ lose alike at any frequency.

    Source: M. A. Biot, Proc. 3rd U.S. Nat. Congr. Appl. Mech. (1958) 1 (linear hysteretic damping).
    """
    rate = np.geomspace(slowest, fastest, count)
    weight = np.full(count, 2 / np.pi * np.log(rate[1] / rate[0]))
    weight[[0, -1]] /= 2
    return rate, weight


@dataclass(frozen=True)
class StructuralDamping(Effect):
    """Loss that grows slower than viscous with frequency; its strength is its coefficient against the stiffness.

    Variants: "springpot", a force cDᵅx of order 0.1 … 0.6, time in units of 1/ω₀; "constant_loss", Maxwell elements of
    one loss factor over three decades of frequency.

    Source: P. J. Torvik, R. L. Bagley, J. Appl. Mech. 51 (1984) 294; R. C. Koeller, J. Appl. Mech. 51 (1984) 299; see
    `constant_loss_states`.
    """

    id = "structural_damping"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-6
    strongest = 0.8

    power: float = field(default=0.5, kw_only=True)
    slowest: float = field(default=0.02, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "StructuralDamping":
        """Any order between a spring and a damper, or one loss factor down to 0.01 … 0.05 f₀."""
        variant = str(rng.choice(["springpot", "constant_loss"]))
        return cls(variant=variant, power=float(rng.uniform(0.1, 0.6)), slowest=float(10 ** rng.uniform(-2, -1.3)))

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Add its states."""
        if not self.strength:
            return resonator
        spring = damper = 0.0
        if self.variant == "springpot":
            rate, weight, spring, damper = diffusive_states(self.power)
        else:
            rate, weight = constant_loss_states(self.slowest, 30.0)
        return replace(
            resonator,
            added_stiffness=resonator.added_stiffness + self.strength * spring,
            damping_ratio=resonator.damping_ratio + self.strength * damper / 2,
            diffusive_rate=(*resonator.diffusive_rate, *rate.tolist()),
            diffusive_weight=(*resonator.diffusive_weight, *(self.strength * weight).tolist()),
        )

    def parameters(self) -> dict[str, Any]:
        """Order and coefficient, or the loss factor; the loss at the resonance, as a damping ratio."""
        if self.variant == "springpot":
            loss = self.strength * np.sin(np.pi * self.power / 2) / 2
            return {"order": self.power, "coefficient": self.strength, "damping_ratio_at_resonance": float(loss)}
        return {"loss_factor": self.strength, "damping_ratio_at_resonance": self.strength / 2}


@dataclass(frozen=True)
class CoulombFriction(Effect):
    """Dry friction on the resonator; its strength is its force over the linear damping's at the largest speed.

    Variants: "smooth", F·tanh(v/δ); "stribeck", larger at rest by F[1 + f·exp(−v²/v_f²)]; "stick_slip", a spring that
    slips (Jenkins' element).

    Source: H. Olsson et al., Eur. J. Control 4 (1998) 176 (Coulomb's, Stribeck's and Dahl's models).
    """

    id = "coulomb_friction"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-6
    strongest = 2.0

    damping_V: float = field(default=5.0, kw_only=True)
    sharpness_V: float = field(default=2.0, kw_only=True)
    at_rest: float = field(default=0.0, kw_only=True)
    fading_V: float = field(default=10.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "CoulombFriction":
        """Smooth, larger at rest, or sticking."""
        variant = str(rng.choice(["smooth", "stribeck", "stick_slip"]))
        return cls(
            variant=variant,
            damping_V=2 * situation.head.damping_ratio * situation.largest_speed_V,
            sharpness_V=float(rng.uniform(0.02, 0.06)) * situation.largest_speed_V,
            at_rest=float(rng.uniform(0.3, 1.0)) if variant == "stribeck" else 0.0,
            fading_V=float(rng.uniform(0.1, 0.3)) * situation.largest_speed_V,
        )

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Add the friction."""
        if not self.strength:
            return resonator
        force = self.strength * self.damping_V
        if self.variant != "stick_slip":
            dry = replace(resonator, friction_V=force, friction_speed_V=self.sharpness_V)
            return replace(dry, stribeck=self.at_rest, stribeck_speed_V=self.fading_V)
        spring = force / self.sharpness_V
        return replace(
            resonator,
            added_stiffness=resonator.added_stiffness + spring,
            slip_V=(*resonator.slip_V, self.sharpness_V),
            slip_weight=(*resonator.slip_weight, spring),
        )

    def parameters(self) -> dict[str, Any]:
        """Force in volts of static drive, and the speed or deflection within which it turns."""
        named = {"friction_V": self.strength * self.damping_V, "sharpness_V": self.sharpness_V}
        return {**named, "excess_at_rest": self.at_rest, "fading_V": self.fading_V}


@dataclass(frozen=True)
class SelfHeating(Effect):
    """The head warms by its own losses and its resonance and damping shift; strength is the shift of stiffness a unit.

    Variants: "slow", a temperature that follows the mean loss, 2ζv², within 2 … 50 ms, far longer than a recording;
    "burst", within 0.4 … 2 ms, as a thin layer of ink does; "session", one that is carried on from recording to
    recording: T' = (P − T)/τ with P the mean loss of each recording.

    Source: H. Wijshoff, Physics Reports 491 (2010) 77 (dissipation of the actuator; viscosity and speed of sound
    against temperature); K. Uchino, J. Zheng et al., J. Electroceramics 2 (1998) 33 (heat generation of driven
    actuators).
    """

    id = "self_heating"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.5

    time_s: float = field(default=1e-2, kw_only=True)
    speed_V: float = field(default=30.0, kw_only=True)
    thinning: float = field(default=3.0, kw_only=True)
    course: tuple[float, ...] = field(default=(0.0,), kw_only=True)
    recordings: float = field(default=4.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "SelfHeating":
        """The stiffness falls, and the damping falls with the viscosity by 2 … 6 times as much."""
        variant = str(rng.choice(["slow", "burst", "session"]))
        time = 10 ** (rng.uniform(-2.7, -1.3) if variant == "slow" else rng.uniform(-3.4, -2.7))
        loss = np.array(situation.mean_square_speed_V2)
        memory = float(rng.uniform(2, 6))
        course, now = [], 0.0
        for one in loss / max(float(np.max(loss)), 1e-12):
            now += (one - now) * -np.expm1(-1 / memory)
            course.append(now)
        course.append(now * np.exp(-1 / memory))  # after the last recording it cools
        return cls(
            variant=variant,
            time_s=float(time),
            speed_V=float(np.sqrt(np.max(loss))) if variant == "slow" else 0.4 * situation.largest_speed_V,
            thinning=float(rng.uniform(2, 6)),
            course=tuple(float(c) for c in course),
            recordings=memory,
        )

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Let the temperature shift stiffness and damping."""
        if not self.strength:
            return resonator
        if self.variant == "session":
            warm = self.strength * self.course[min(max(order, 1), len(self.course)) - 1]
            frequency = np.sqrt(max(1 - warm, 0.1))
            loss = max(0.2, 1 - self.thinning * warm)
            return replace(
                resonator,
                angular_rad_per_s=resonator.angular_rad_per_s * frequency,
                damping_ratio=resonator.damping_ratio * loss / frequency,
            )
        return replace(
            resonator,
            meniscus_gain=-self.strength,
            meniscus_kind=4.0,
            meniscus_s=self.time_s,
            meniscus_V=self.speed_V,
            meniscus_loss=-self.thinning * self.strength,
        )

    def parameters(self) -> dict[str, Any]:
        """Shift of stiffness and damping for a unit of temperature, its time, or its course by order."""
        named = {"stiffness_shift": -self.strength, "damping_shift": -self.thinning * self.strength}
        if self.variant == "session":
            return {**named, "temperature": list(self.course), "memory_recordings": self.recordings}
        return {**named, "time_s": self.time_s, "speed_V": self.speed_V}
