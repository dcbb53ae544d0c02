"""Resonator stage: springs and dampers that depend on the motion."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.resonator import Resonator


@dataclass(frozen=True)
class CubicStiffness(Effect):
    """Duffing's k₃x³, of either sign; its strength is the cubic over the linear force at the largest deflection.

    Variants: "hardening" and "softening"; "bounded", k₃x³/(1 + (x/x_b)²), which is a cubic for small deflections only.

    Source: A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations (1979), chapter 2; for the bounded spring R. E. Mickens,
    J. Sound Vib. 246 (2001) 375 (Duffing harmonic oscillator).
    """

    id = "cubic_stiffness"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.35

    sign: float = field(default=1.0, kw_only=True)
    largest_V: float = field(default=100.0, kw_only=True)
    bound: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "CubicStiffness":
        """Hardening or softening, bounded in one case of three."""
        sign = float(rng.choice([-1.0, 1.0]))
        bounded = bool(rng.random() < 1 / 3)
        variant = "bounded" if bounded else "hardening" if sign > 0 else "softening"
        bound = float(rng.uniform(0.2, 1.0)) if bounded else 0.0
        return cls(variant=variant, sign=sign, largest_V=situation.largest_deflection_V, bound=bound)

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Add the cubic spring."""
        if not self.strength:
            return resonator
        return replace(
            resonator,
            cubic_per_V2=self.sign * self.strength * (1 + self.bound) / self.largest_V**2,
            cubic_bound_per_V2=self.bound / self.largest_V**2,
        )

    def parameters(self) -> dict[str, Any]:
        """k₃ over the linear stiffness, the deflection in volts of static drive."""
        share = self.sign * self.strength
        cubic = share * (1 + self.bound) / self.largest_V**2
        named = {"cubic_per_V2": cubic, "share_at_largest": share, "largest_V": self.largest_V}
        return {**named, "bound_per_V2": self.bound / self.largest_V**2}


@dataclass(frozen=True)
class QuadraticDamping(Effect):
    """Drag that grows with speed; its strength is the drag over the linear damping at the largest speed.

    Variants: "drag", c₂|v|v; "turbulent", a drag in |v|ⁿv with n of 0.7 … 0.85, of Blasius' law of friction;
    "orifice", drag with a laminar start, n of 1.15 … 1.4.

    Source: A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations (1979), chapter 3; H. Schlichting, Boundary-Layer Theory
    (1979), chapter 20 (Blasius' law).
    """

    id = "quadratic_damping"
    stage = "resonator"
    start = 5e-2
    weakest = 1e-6
    strongest = 5.0

    damping_ratio: float = field(default=0.05, kw_only=True)
    largest_V: float = field(default=100.0, kw_only=True)
    power: float = field(default=1.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "QuadraticDamping":
        """One of three powers."""
        variant = str(rng.choice(["drag", "turbulent", "orifice"]))
        power = {"drag": 1.0, "turbulent": rng.uniform(0.7, 0.85), "orifice": rng.uniform(1.15, 1.4)}[variant]
        return cls(
            variant=variant,
            damping_ratio=situation.head.damping_ratio,
            largest_V=situation.largest_speed_V,
            power=float(power),
        )

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Add the drag."""
        if not self.strength:
            return resonator
        share = self.strength * 2 * self.damping_ratio
        if self.variant == "drag":
            return replace(resonator, quadratic_damping_per_V=share / self.largest_V)
        # The integrator's drag is (c|v|)ⁿv.
        per_V = share ** (1 / self.power) / self.largest_V
        return replace(resonator, quadratic_damping_per_V=per_V, drag_power=self.power)

    def parameters(self) -> dict[str, Any]:
        """c₂ in the dimensionless equation (of the same force at the largest speed), its share there, and the power."""
        drag = self.strength * 2 * self.damping_ratio / self.largest_V
        named = {"quadratic_damping_per_V": drag, "share_at_largest": self.strength, "largest_V": self.largest_V}
        return {**named, "power": self.power}


@dataclass(frozen=True)
class FerroelasticSoftening(Effect):
    """Stiffness falls and loss grows in proportion to the amplitude; strength is the softening at the largest one.

    Variants: "rayleigh", branches Δ − rΔ|Δ|/2 with the memory of all turning points; "iwan", Jenkins' elements that
    slip one after the other, their density a power of the threshold close to constant; "envelope", stiffness and
    damping that follow the ring's envelope √(x² + v²).

    Source: Lord Rayleigh, Phil. Mag. 23 (1887) 225; W. D. Iwan, J. Appl. Mech. 33 (1966) 893; D. Damjanovic,
    M. Demartin, J. Phys. D 29 (1996) 2057 (Rayleigh's law in piezoelectric ceramics); K. Uchino, J. Zheng et al., J.
    Electroceramics 2 (1998) 33 (resonators whose frequency and loss follow the level of vibration).
    """

    id = "ferroelastic_softening"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.3

    largest_V: float = field(default=100.0, kw_only=True)
    power: float = field(default=0.0, kw_only=True)
    loss: float = field(default=0.42, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "FerroelasticSoftening":
        """Rayleigh's law, Iwan's elements or the envelope; its loss is 0.7 … 1.3 of what Rayleigh's law gives."""
        variant = str(rng.choice(["rayleigh", "iwan", "envelope"]))
        power = float(rng.uniform(-0.2, 0.2)) if variant == "iwan" else 0.0
        loss = 4 / (3 * np.pi) * float(rng.uniform(0.7, 1.3))
        return cls(variant=variant, largest_V=situation.largest_deflection_V, power=power, loss=loss)

    def elements(self, count: int = 48) -> tuple[np.ndarray, np.ndarray]:
        """Thresholds in volts and weights of Iwan's elements, shape (count,) each."""
        width = 1.3 * self.largest_V / count
        slip = (np.arange(count) + 0.5) * width
        density = (slip / self.largest_V) ** self.power
        # Σ w (A − d) over A, the softening at the amplitude A, is the strength at the largest one.
        reach = np.sum(density * np.maximum(self.largest_V - slip, 0.0)) / self.largest_V
        return slip, density * self.strength / reach

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Add the law."""
        if not self.strength:
            return resonator
        if self.variant == "rayleigh":
            return replace(resonator, rayleigh_per_V=self.strength / self.largest_V)
        if self.variant == "envelope":
            softening = self.strength / self.largest_V
            return replace(resonator, envelope_softening_per_V=softening, envelope_loss_per_V=self.loss * softening)
        slip, weight = self.elements()
        return replace(
            resonator,
            slip_V=(*resonator.slip_V, *slip.tolist()),
            slip_weight=(*resonator.slip_weight, *weight.tolist()),
        )

    def parameters(self) -> dict[str, Any]:
        """Softening a volt of deflection."""
        return {"softening_per_V": self.strength / self.largest_V, "largest_V": self.largest_V, "power": self.power}
