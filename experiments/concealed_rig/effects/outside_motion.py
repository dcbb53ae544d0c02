"""Outside the catalogue, in the resonator: friction, voltage in the spring, fractional damping, joints, cavitation."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.resonator import Resonator


@dataclass(frozen=True)
class CoulombFriction(Effect):
    """Dry friction on the resonator; its strength is its force over the linear damping's at the largest speed.

    Variants: "smooth", F·tanh(v/δ); "stick_slip", a spring that slips (Jenkins' element).

    Source: H. Olsson et al., Eur. J. Control 4 (1998) 176 (Coulomb's and Dahl's models).
    """

    id = "coulomb_friction"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-6
    strongest = 2.0

    damping_V: float = field(default=5.0, kw_only=True)
    sharpness_V: float = field(default=2.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "CoulombFriction":
        """Smooth, or sticking."""
        return cls(
            variant=str(rng.choice(["smooth", "stick_slip"])),
            damping_V=2 * situation.head.damping_ratio * situation.largest_speed_V,
            sharpness_V=float(rng.uniform(0.02, 0.06)) * situation.largest_speed_V,
        )

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Add the friction."""
        if not self.strength:
            return resonator
        force = self.strength * self.damping_V
        if self.variant == "smooth":
            return replace(resonator, friction_V=force, friction_speed_V=self.sharpness_V)
        spring = force / self.sharpness_V
        return replace(
            resonator,
            added_stiffness=resonator.added_stiffness + spring,
            slip_V=(*resonator.slip_V, self.sharpness_V),
            slip_weight=(*resonator.slip_weight, spring),
        )

    def parameters(self) -> dict[str, Any]:
        """Force in volts of static drive."""
        return {"friction_V": self.strength * self.damping_V, "sharpness_V": self.sharpness_V}


@dataclass(frozen=True)
class ElectroSoftening(Effect):
    """Stiffness that follows the applied voltage, a parametric excitation; strength is the change at 100 V.

    Source: A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations (1979), chapter 5 (parametric excitation); IEEE Std
    176-1987 (stiffness of a piezoelectric depends on the electric boundary condition).
    """

    id = "electro_softening"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.5

    sign: float = field(default=1.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "ElectroSoftening":
        """Of either sign."""
        return cls(variant="linear", sign=float(rng.choice([-1.0, 1.0])))

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Let the voltage change the spring."""
        return replace(resonator, electro_per_V=self.sign * self.strength / 100.0)

    def parameters(self) -> dict[str, Any]:
        """Relative change a volt."""
        return {"stiffness_per_V": self.sign * self.strength / 100.0}


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


@dataclass(frozen=True)
class FractionalDamping(Effect):
    """A springpot beside the damper, force cDᵅx; its strength is c against the stiffness, time in units of 1/ω₀.

    Source: P. J. Torvik, R. L. Bagley, J. Appl. Mech. 51 (1984) 294; R. C. Koeller, J. Appl. Mech. 51 (1984) 299.
    """

    id = "fractional_damping"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-6
    strongest = 0.5

    power: float = field(default=0.5, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "FractionalDamping":
        """Any order between a spring and a damper."""
        return cls(variant="springpot", power=float(rng.uniform(0.25, 0.6)))

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Add its states."""
        if not self.strength:
            return resonator
        rate, weight, spring, damper = diffusive_states(self.power)
        return replace(
            resonator,
            added_stiffness=resonator.added_stiffness + self.strength * spring,
            damping_ratio=resonator.damping_ratio + self.strength * damper / 2,
            diffusive_rate=tuple(rate.tolist()),
            diffusive_weight=tuple((self.strength * weight).tolist()),
        )

    def parameters(self) -> dict[str, Any]:
        """Order and coefficient."""
        return {"order": self.power, "coefficient": self.strength}


@dataclass(frozen=True)
class Backlash(Effect):
    """A joint with play: within a gap the spring is softer; its strength is the share that is lost there.

    Source: S. W. Shaw, P. J. Holmes, J. Sound Vib. 90 (1983) 129 (piecewise linear oscillator).
    """

    id = "backlash"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-6
    strongest = 0.9

    gap_V: float = field(default=10.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "Backlash":
        """A gap of 5 … 30 % of the largest deflection."""
        return cls(variant="dead_zone", gap_V=float(rng.uniform(0.05, 0.3)) * situation.largest_deflection_V)

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Soften the spring in the gap."""
        return replace(resonator, gap_V=self.gap_V, gap_softening=self.strength)

    def parameters(self) -> dict[str, Any]:
        """Half the gap, and what is lost in it."""
        return {"gap_V": self.gap_V, "softening": self.strength}


@dataclass(frozen=True)
class Cavitation(Effect):
    """Below a pressure, vapour opens and damps; its strength is the added damping over the linear one.

    Source: C. E. Brennen, Cavitation and Bubble Dynamics (1995).
    """

    id = "cavitation"
    stage = "resonator"
    start = 5e-2
    weakest = 1e-6
    strongest = 30.0

    threshold_V: float = field(default=30.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "Cavitation":
        """From 25 … 60 % of the largest speed on."""
        return cls(variant="damping", threshold_V=float(rng.uniform(0.25, 0.6)) * situation.largest_speed_V)

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """More damping beyond the threshold."""
        return replace(resonator, cavitation_gain=self.strength, cavitation_speed_V=self.threshold_V)

    def parameters(self) -> dict[str, Any]:
        """Threshold, and the factor by which damping jumps."""
        return {"threshold_V": self.threshold_V, "damping_jump": self.strength}
