"""Outside the catalogue, for development, in the resonator: voltage in the spring, joints with a gap, cavitation."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.resonator import Resonator


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


@dataclass(frozen=True)
class SpringGap(Effect):
    """A joint with play: within a gap the spring is softer; its strength is the share that is lost there.

    Source: S. W. Shaw, P. J. Holmes, J. Sound Vib. 90 (1983) 129 (piecewise linear oscillator).
    """

    id = "spring_gap"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-6
    strongest = 0.9

    gap_V: float = field(default=10.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "SpringGap":
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
