"""Resonator stage: springs and dampers that depend on the motion."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.resonator import Resonator


@dataclass(frozen=True)
class CubicStiffness(Effect):
    """Duffing's k₃x³, of either sign; its strength is the cubic over the linear force at the largest deflection.

    Source: A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations (1979), chapter 2.
    """

    id = "cubic_stiffness"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.35

    sign: float = field(default=1.0, kw_only=True)
    largest_V: float = field(default=100.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "CubicStiffness":
        """Hardening or softening."""
        sign = float(rng.choice([-1.0, 1.0]))
        variant = "hardening" if sign > 0 else "softening"
        return cls(variant=variant, sign=sign, largest_V=situation.largest_deflection_V)

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Add the cubic spring."""
        return replace(resonator, cubic_per_V2=self.sign * self.strength / self.largest_V**2)

    def parameters(self) -> dict[str, Any]:
        """k₃ over the linear stiffness, the deflection in volts of static drive."""
        share = self.sign * self.strength
        return {"cubic_per_V2": share / self.largest_V**2, "share_at_largest": share, "largest_V": self.largest_V}


@dataclass(frozen=True)
class QuadraticDamping(Effect):
    """Drag c₂|v|v; its strength is the drag over the linear damping at the largest speed.

    Source: A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations (1979), chapter 3.
    """

    id = "quadratic_damping"
    stage = "resonator"
    start = 5e-2
    weakest = 1e-6
    strongest = 5.0

    damping_ratio: float = field(default=0.05, kw_only=True)
    largest_V: float = field(default=100.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "QuadraticDamping":
        """One variant."""
        head = situation.head
        return cls(variant="drag", damping_ratio=head.damping_ratio, largest_V=situation.largest_speed_V)

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Add the drag."""
        return replace(resonator, quadratic_damping_per_V=self.strength * 2 * self.damping_ratio / self.largest_V)

    def parameters(self) -> dict[str, Any]:
        """c₂ in the dimensionless equation, and its share at the largest speed."""
        drag = self.strength * 2 * self.damping_ratio / self.largest_V
        return {"quadratic_damping_per_V": drag, "share_at_largest": self.strength, "largest_V": self.largest_V}


@dataclass(frozen=True)
class FerroelasticSoftening(Effect):
    """Stiffness falls and loss grows in proportion to the amplitude; strength is the softening at the largest one.

    Variants: "rayleigh", branches Δ − rΔ|Δ|/2 with the memory of all turning points; "iwan", Jenkins' elements that
    slip one after the other, their density a power of the threshold close to constant.

    Source: Lord Rayleigh, Phil. Mag. 23 (1887) 225; W. D. Iwan, J. Appl. Mech. 33 (1966) 893; D. Damjanovic,
    M. Demartin, J. Phys. D 29 (1996) 2057 (Rayleigh's law in piezoelectric ceramics).
    """

    id = "ferroelastic_softening"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.3

    largest_V: float = field(default=100.0, kw_only=True)
    power: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "FerroelasticSoftening":
        """Rayleigh's law or Iwan's elements."""
        variant = str(rng.choice(["rayleigh", "iwan"]))
        power = float(rng.uniform(-0.2, 0.2)) if variant == "iwan" else 0.0
        return cls(variant=variant, largest_V=situation.largest_deflection_V, power=power)

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
        slip, weight = self.elements()
        return replace(
            resonator,
            slip_V=(*resonator.slip_V, *slip.tolist()),
            slip_weight=(*resonator.slip_weight, *weight.tolist()),
        )

    def parameters(self) -> dict[str, Any]:
        """Softening a volt of deflection."""
        return {"softening_per_V": self.strength / self.largest_V, "largest_V": self.largest_V, "power": self.power}
