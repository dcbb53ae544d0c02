"""Outside the catalogue: springs, masses and dampers of the resonator, and drives, that no id stands for."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numba import njit

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.resonator import Resonator


@dataclass(frozen=True)
class OneSidedStop(Effect):
    """The membrane touches a stop on one side: a spring and a damper beyond a deflection; strength is its stiffness.

    Source: S. W. Shaw, P. J. Holmes, J. Sound Vib. 90 (1983) 129 (oscillator with a one-sided elastic constraint);
    K. H. Hunt, F. R. E. Crossley, J. Appl. Mech. 42 (1975) 440 (damping that grows with the penetration).
    """

    id = "one_sided_stop"
    stage = "resonator"
    start = 5e-2
    weakest = 1e-6
    strongest = 20.0

    stop_V: float = field(default=50.0, kw_only=True)
    loss: float = field(default=0.1, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "OneSidedStop":
        """At 30 … 65 % of the largest deflection."""
        stop = float(rng.uniform(0.3, 0.65)) * situation.largest_deflection_V
        return cls(variant="elastic", stop_V=stop, loss=float(rng.uniform(0.0, 0.3)))

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Add the stop."""
        if not self.strength:
            return resonator
        loss = self.loss * self.strength / self.stop_V
        return replace(resonator, stop_V=self.stop_V, stop_stiffness=self.strength, stop_loss_per_V=loss)

    def parameters(self) -> dict[str, Any]:
        """Where it is, its stiffness over the spring's, its damping a volt of penetration."""
        loss = self.loss * self.strength / self.stop_V
        return {"stop_V": self.stop_V, "stiffness": self.strength, "damping_per_V": loss}


@dataclass(frozen=True)
class SelfExcitation(Effect):
    """Van der Pol's damping, 2ζ[1 − s(1 − x²/x_w²)]v, which flow feeds at small amplitudes; strength is s.

    Below s = 1 the head rests; damping grows with the square of the deflection and not with the speed.

    Source: B. van der Pol, Phil. Mag. 2 (1926) 978; A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations (1979), chapter 3.
    """

    id = "self_excitation"
    stage = "resonator"
    start = 5e-2
    weakest = 1e-6
    strongest = 0.9

    scale_V: float = field(default=50.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "SelfExcitation":
        """Fed below 20 … 50 % of the largest deflection."""
        return cls(variant="van_der_pol", scale_V=float(rng.uniform(0.2, 0.5)) * situation.largest_deflection_V)

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Feed small motions."""
        return replace(resonator, van_der_pol=self.strength, van_der_pol_V=self.scale_V)

    def parameters(self) -> dict[str, Any]:
        """Share of the damping that is fed back at rest, and the deflection at which it is none."""
        return {"share": self.strength, "scale_V": self.scale_V}


@dataclass(frozen=True)
class VolumeInertance(Effect):
    """Mass that depends on the displaced volume, (1 + m x)x'' + m x'²/2; its strength is m x at the largest deflection.

    A membrane that opens a gap moves more, or less, ink: the kinetic energy is (1 + m x)v²/2.

    Source: H. Lamb, Hydrodynamics (1932), chapter 6 (Lagrange's equations of a solid in a fluid, inertia that depends
    on the position).
    """

    id = "volume_inertance"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.5

    sign: float = field(default=1.0, kw_only=True)
    largest_V: float = field(default=100.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "VolumeInertance":
        """Of either sign."""
        sign = float(rng.choice([-1.0, 1.0]))
        return cls(variant="lagrange", sign=sign, largest_V=situation.largest_deflection_V)

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Let the mass follow the deflection."""
        return replace(resonator, inertance_per_V=self.sign * self.strength / self.largest_V)

    def parameters(self) -> dict[str, Any]:
        """Relative change of the mass a volt of deflection."""
        return {"inertance_per_V": self.sign * self.strength / self.largest_V}


@dataclass(frozen=True)
class QuadraticSpring(Effect):
    """A spring with a term in x², as of a gas that is compressed; its strength is it at the largest deflection.

    Source: H. von Helmholtz, On the Sensations of Tone (1885), appendix 12 (asymmetric spring); A. H. Nayfeh, D. T.
    Mook, Nonlinear Oscillations (1979), chapter 2.
    """

    id = "quadratic_spring"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.35

    sign: float = field(default=1.0, kw_only=True)
    largest_V: float = field(default=100.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "QuadraticSpring":
        """Of either sign."""
        sign = float(rng.choice([-1.0, 1.0]))
        return cls(variant="quadratic", sign=sign, largest_V=situation.largest_deflection_V)

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Add the term."""
        return replace(resonator, quadratic_per_V=self.sign * self.strength / self.largest_V)

    def parameters(self) -> dict[str, Any]:
        """Coefficient against the linear stiffness."""
        return {"quadratic_per_V": self.sign * self.strength / self.largest_V}


@dataclass(frozen=True)
class AutoparametricMode(Effect):
    """A mode near twice the frequency is driven by x² and pulls back with x q; its strength is the coupling.

    With the potential a x²q: x'' + x = h − 2a x q, q'' + 2ζρq' + ρ²q = −a x².

    Source: A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations (1979), chapter 6 (two-to-one internal resonance).
    """

    id = "autoparametric_mode"
    stage = "resonator"
    start = 5e-2
    weakest = 1e-6
    strongest = 3.0

    ratio: float = field(default=2.0, kw_only=True)
    damping_ratio: float = field(default=0.03, kw_only=True)
    largest_V: float = field(default=100.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "AutoparametricMode":
        """A mode of 1.85 … 2.15 times the frequency."""
        return cls(
            variant="two_to_one",
            ratio=float(rng.uniform(1.85, 2.15)),
            damping_ratio=float(rng.uniform(0.01, 0.05)),
            largest_V=situation.largest_deflection_V,
        )

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Couple it."""
        coupling = self.strength / self.largest_V
        return replace(resonator, auto_per_V=coupling, auto_ratio=self.ratio, auto_damping=self.damping_ratio)

    def parameters(self) -> dict[str, Any]:
        """Coupling a volt of deflection, frequency over f₀, damping ratio."""
        return {"coupling_per_V": self.strength / self.largest_V, "ratio": self.ratio, "damping": self.damping_ratio}


@njit(cache=True)
def _relay(u, high, low, state, out):
    for k in range(u.size):
        if u[k] >= high:
            state = 1.0
        elif u[k] <= low:
            state = -1.0
        out[k] = state
    return state


@dataclass(frozen=True)
class DomainJumps(Effect):
    """A few large domains switch at once: relays on the voltage; their strength is their height over 100 V.

    Source: I. D. Mayergoyz, Mathematical Models of Hysteresis (1991) (hysteron); G. Bertotti, Hysteresis in Magnetism
    (1998), chapter 9 (Barkhausen jumps).
    """

    id = "domain_jumps"
    stage = "hysteresis"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.3

    up_V: tuple[float, ...] = field(default=(30.0,), kw_only=True)
    down_V: tuple[float, ...] = field(default=(-20.0,), kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "DomainJumps":
        """Two or three relays, unlike each other."""
        count = int(rng.integers(2, 4))
        up, down = rng.uniform(12, 60, count), -rng.uniform(8, 45, count)
        return cls(variant="relays", up_V=tuple(up.tolist()), down_V=tuple(down.tolist()))

    def on_poled(self, hysteretic_V: np.ndarray, applied_V: np.ndarray, grid: Grid, order: int) -> np.ndarray:
        """Add the jumps; a demagnetised domain is down."""
        if not self.strength:
            return hysteretic_V
        total, out = np.zeros(applied_V.size), np.empty(applied_V.size)
        u = np.ascontiguousarray(applied_V)
        for up, down in zip(self.up_V, self.down_V, strict=True):
            state = -1.0
            for _ in range(2 if grid.periodic else 1):
                state = _relay(u, up, down, state, out)
            total += out
        return hysteretic_V + self.strength * 100.0 / len(self.up_V) * (total + len(self.up_V)) / 2

    def parameters(self) -> dict[str, Any]:
        """Height of all of them, and their switching voltages."""
        return {"height_V": 100.0 * self.strength, "up_V": list(self.up_V), "down_V": list(self.down_V)}


@dataclass(frozen=True)
class VolterraProduct(Effect):
    """The drive times itself some time ago, s·u(t)u(t − τ)/100 V; a memory of second order without a resonance.

    Source: M. Schetzen, The Volterra and Wiener Theories of Nonlinear Systems (1980), chapter 3.
    """

    id = "volterra_product"
    stage = "drive"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.5

    sign: float = field(default=1.0, kw_only=True)
    delay_s: float = field(default=1e-5, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "VolterraProduct":
        """Delays of 6 … 30 µs."""
        delay = float(rng.uniform(6e-6, 3e-5))
        return cls(variant="second_order", sign=float(rng.choice([-1.0, 1.0])), delay_s=delay)

    def on_drive(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Add the product."""
        if not self.strength:
            return drive_V
        late = np.arange(drive_V.size) - self.delay_s / grid.half_s
        late = late % (drive_V.size - 1) if grid.periodic else np.maximum(late, 0.0)
        before = np.interp(late, np.arange(drive_V.size), drive_V)
        return drive_V + self.sign * self.strength * drive_V * before / 100.0

    def parameters(self) -> dict[str, Any]:
        """Coefficient a volt and delay."""
        return {"per_V": self.sign * self.strength / 100.0, "delay_s": self.delay_s}
