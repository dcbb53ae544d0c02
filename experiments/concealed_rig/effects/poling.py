"""Hysteresis stage: backlash in the transmission, electrostriction, and poling that is lost and comes back."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.grid import Grid


@dataclass(frozen=True)
class Backlash(Effect):
    """A dead zone between ceramic and channel; its strength is half its width, or the share that is lost in it.

    Variants: "gap", h − clip(h, ±g), nothing is passed on within the gap; "glue", a soft layer of given width within
    which a share of the motion is lost, h − s·g·tanh(h/g).

    Source: M. Nordin, P.-O. Gutman, Automatica 38 (2002) 1633 (dead zone models of backlash); G. Tao, P. V. Kokotović,
    Adaptive Control of Systems with Actuator and Sensor Nonlinearities (1996), chapter 2.
    """

    id = "backlash"
    stage = "hysteresis"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.8

    half_width_V: float = field(default=5.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "Backlash":
        """A soft layer of 4 … 25 V of motion."""
        return cls(variant=str(rng.choice(["gap", "glue"])), half_width_V=float(rng.uniform(4.0, 25.0)))

    def on_hysteretic(self, hysteretic_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Lose what the gap takes."""
        if not self.strength:
            return hysteretic_V
        if self.variant == "gap":
            half = 20.0 * self.strength
            return hysteretic_V - np.clip(hysteretic_V, -half, half)
        return hysteretic_V - self.strength * self.half_width_V * np.tanh(hysteretic_V / self.half_width_V)

    def parameters(self) -> dict[str, Any]:
        """Half width in volts of hysteretic drive, and the share that is lost within."""
        if self.variant == "gap":
            return {"half_width_V": 20.0 * self.strength, "lost": 1.0}
        return {"half_width_V": self.half_width_V, "lost": self.strength}


@dataclass(frozen=True)
class VoltageDependentGain(Effect):
    """The gain of the ceramic depends on the voltage; its strength is the change at 100 V.

    Variants: "bias", 1 + s u/100 V, the electrostrictive part of a poled ceramic; "even", 1 + s(u/100 V)²;
    "saturating", 1/(1 + s|u|/100 V).

    Source: D. Damjanovic, Rep. Prog. Phys. 61 (1998) 1267; R. E. Newnham et al., J. Phys. Chem. B 101 (1997) 10141
    (electrostriction: d = 2QP, with P of remanent and induced polarisation).
    """

    id = "voltage_dependent_gain"
    stage = "hysteresis"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.6

    sign: float = field(default=1.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "VoltageDependentGain":
        """Of either sign, but for the saturation."""
        return cls(variant=str(rng.choice(["bias", "even", "saturating"])), sign=float(rng.choice([-1.0, 1.0])))

    def on_poled(self, hysteretic_V: np.ndarray, applied_V: np.ndarray, grid: Grid, order: int) -> np.ndarray:
        """Change the gain from instant to instant."""
        if not self.strength:
            return hysteretic_V
        share = applied_V / 100.0
        if self.variant == "saturating":
            return hysteretic_V / (1 + self.strength * np.abs(share))
        return hysteretic_V * (1 + self.sign * self.strength * (share if self.variant == "bias" else share**2))

    def parameters(self) -> dict[str, Any]:
        """Relative change at 100 V."""
        if self.variant == "saturating":
            return {"gain_change_at_100_V": 1 / (1 + self.strength) - 1}
        return {"gain_change_at_100_V": self.sign * self.strength}


@njit(cache=True)
def _switched(rate, towards, step, state, out):
    """d' = rate (towards − d) at the points, exact for constants between them; the last state."""
    d = state
    for k in range(rate.size):
        if k > 0:
            keep = np.exp(-0.5 * (rate[k] + rate[k - 1]) * step)
            d = keep * d + (1.0 - keep) * 0.5 * (towards[k] + towards[k - 1])
        out[k] = d
    return d


@dataclass(frozen=True)
class Depolarisation(Effect):
    """Poling is lost under reverse field or with use; its strength is the share of the gain that is lost.

    Variants: "reverse_field", a state that reverse voltage beyond a threshold drives to 1 and forward voltage back to
    0, within milliseconds to seconds; "ratchet", lost in each recording that goes beyond the threshold, and not
    recovered; "cycles", lost with the logarithm of the number of recordings.

    Source: D. C. Lupascu, J. Rödel, Adv. Eng. Mater. 7 (2005) 882 (fatigue with cycles); Q. Zhang et al., J. Appl.
    Phys. 86 (1999) 3352 (depoling under reverse field, relaxation).
    """

    id = "depolarisation"
    stage = "hysteresis"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.6

    threshold_V: float = field(default=30.0, kw_only=True)
    time_s: float = field(default=1e-2, kw_only=True)
    course: tuple[float, ...] = field(default=(0.0,), kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "Depolarisation":
        """Thresholds of 15 … 45 V."""
        variant = str(rng.choice(["reverse_field", "ratchet", "cycles"]))
        threshold = float(rng.uniform(15, 45))
        beyond = np.maximum(-np.array(situation.lowest_V) - threshold, 0.0)
        if variant == "ratchet":
            course = -np.expm1(-np.cumsum(beyond) / rng.uniform(80, 200))
        else:
            course = np.log1p(np.arange(beyond.size)) / np.log1p(beyond.size)
        return cls(
            variant=variant,
            threshold_V=threshold,
            time_s=float(10 ** rng.uniform(-3.5, 0)),
            course=(*(float(c) for c in course), float(course[-1])),
        )

    def on_poled(self, hysteretic_V: np.ndarray, applied_V: np.ndarray, grid: Grid, order: int) -> np.ndarray:
        """Lower the gain."""
        if not self.strength:
            return hysteretic_V
        if self.variant != "reverse_field":
            lost = self.course[min(max(order, 1), len(self.course)) - 1]
            return hysteretic_V * (1 - self.strength * lost)
        # Switching rates grow in proportion to the voltage beyond the threshold, and to the forward voltage.
        down = np.maximum(-applied_V - self.threshold_V, 0.0) / 30.0
        up = np.maximum(applied_V, 0.0) / 100.0
        rate = (down + up) / self.time_s
        towards = down / np.maximum(down + up, 1e-12)
        out = np.empty(applied_V.size)
        end = _switched(rate, towards, grid.half_s, 0.0, out)
        if grid.periodic:
            # The state after a lap is linear in the state before.
            slope = _switched(rate, towards, grid.half_s, 1.0, out) - end
            if 1 - slope > 1e-12:
                end = end / (1 - slope)
            _switched(rate, towards, grid.half_s, end, out)
        return hysteretic_V * (1 - self.strength * out)

    def parameters(self) -> dict[str, Any]:
        """Share that can be lost, threshold, and time constant or course by order."""
        if self.variant == "reverse_field":
            return {"lost": self.strength, "threshold_V": self.threshold_V, "time_s": self.time_s}
        named: dict[str, Any] = {"gain_change": [-self.strength * c for c in self.course]}
        return {**named, "threshold_V": self.threshold_V} if self.variant == "ratchet" else named
