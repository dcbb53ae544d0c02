"""Drive stage: what happens to the voltage between generator and ceramic."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.linear import filtered


def low_passed(signal: np.ndarray, bandwidth_Hz: float, second: bool, interval_s: float, periodic: bool) -> np.ndarray:
    """First- or second-order (damping 0.7) low-pass; the signal itself where its pole is beyond what the points show.

    Source: A. V. Oppenheim, A. S. Willsky, Signals and Systems (1997), chapter 6.
    """
    w = 2 * np.pi * bandwidth_Hz
    if w * interval_s > 300:
        return signal
    denominator = [1 / w**2, 1.4 / w, 1.0] if second else [1 / w, 1.0]
    start = signal[0]
    return start + filtered([1.0], denominator, signal - start, interval_s, periodic)


@dataclass(frozen=True)
class AmplifierBandwidth(Effect):
    """The amplifier is a low-pass; its strength is f₀ over its bandwidth.

    Source: see `low_passed`.
    """

    id = "amplifier_bandwidth"
    stage = "drive"
    start = 0.05
    weakest = 1e-4
    strongest = 2.0

    resonance_Hz: float = field(default=5e4, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "AmplifierBandwidth":
        """First or second order."""
        variant = str(rng.choice(["first_order", "second_order"]))
        return cls(variant=variant, resonance_Hz=situation.head.resonance_Hz)

    def on_drive(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Low-pass."""
        if not self.strength:
            return drive_V
        bandwidth = self.resonance_Hz / self.strength
        return low_passed(drive_V, bandwidth, self.variant == "second_order", grid.half_s, grid.periodic)

    def parameters(self) -> dict[str, Any]:
        """Bandwidth (−3 dB of first order; natural frequency of second order)."""
        return {"bandwidth_Hz": self.resonance_Hz / self.strength, "order": 1 + (self.variant == "second_order")}


@njit(cache=True)
def _slewed(u, most, v, out):
    for k in range(u.size):
        v += max(-most, min(most, u[k] - v))
        out[k] = v
    return v


@njit(cache=True)
def _slewed_softly(u, most, linear, v, out):
    """v' = S tanh((u − v)/linear) by Runge–Kutta, with `most` = S times the interval, in steps that follow it."""
    pieces = int(2.0 * most / linear) + 1
    s = most / pieces
    for k in range(u.size):
        rise = (u[k] - u[k - 1]) / pieces if k > 0 else 0.0
        if rise == 0.0 and abs(u[k] - v) < 1e-10:
            out[k] = v
            continue
        for i in range(pieces if k > 0 else 0):
            a = u[k - 1] + i * rise
            k1 = s * np.tanh((a - v) / linear)
            k2 = s * np.tanh((a + 0.5 * rise - v - 0.5 * k1) / linear)
            k3 = s * np.tanh((a + 0.5 * rise - v - 0.5 * k2) / linear)
            k4 = s * np.tanh((a + rise - v - k3) / linear)
            v += (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
        out[k] = v
    return v


@dataclass(frozen=True)
class SlewLimit(Effect):
    """|dU/dt| ≤ S; its strength is the steepest edge over S.

    Variants: "hard"; "soft", dU/dt = S·tanh(error/range), an input stage of finite linear range.

    Source: J. E. Solomon, IEEE J. Solid-State Circuits 9 (1974) 314 (slewing and the input stage's range);
    P. Horowitz, W. Hill, The Art of Electronics (2015): slew rate.
    """

    id = "slew_limit"
    stage = "drive"
    start = 1.2
    weakest = 1e-2
    strongest = 20.0

    steepest_V_per_s: float = field(default=1e8, kw_only=True)
    linear_V: float = field(default=5.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "SlewLimit":
        """Hard or soft."""
        variant, steepest = str(rng.choice(["hard", "soft"])), situation.steepest_V_per_s
        return cls(variant=variant, steepest_V_per_s=steepest, linear_V=float(rng.uniform(1.0, 4.0)))

    def on_drive(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Follow the drive no faster than S."""
        if not self.strength:
            return drive_V
        most = self.steepest_V_per_s / self.strength * grid.half_s
        # Rounding in the drive's own differences must not be taken for an edge that is too steep.
        most *= 1 + 1e-9
        out, v = np.empty(drive_V.size), float(drive_V[0])
        if self.variant == "soft" and most > 100 * self.linear_V:
            return drive_V  # it settles within a hundredth of the interval
        for _ in range(2 if grid.periodic else 1):
            v = (
                _slewed_softly(drive_V, most, self.linear_V, v, out)
                if self.variant == "soft"
                else (_slewed(drive_V, most, v, out))
            )
        return out

    def parameters(self) -> dict[str, Any]:
        """The limit."""
        named = {"slew_rate_V_per_s": self.steepest_V_per_s / self.strength}
        return {**named, "linear_V": self.linear_V} if self.variant == "soft" else named


@dataclass(frozen=True)
class TriggerDelay(Effect):
    """The drive is late; its strength is the delay in periods of the resonance.

    Source: A. V. Oppenheim, A. S. Willsky, Signals and Systems (1997), chapter 1 (time shift).
    """

    id = "trigger_delay"
    stage = "drive"
    start = 1e-2
    weakest = 1e-6
    strongest = 0.25

    period_s: float = field(default=2e-5, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "TriggerDelay":
        """One variant: a constant delay."""
        return cls(variant="constant", period_s=1 / situation.head.resonance_Hz)

    def on_drive(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """The drive a delay ago, linear between the half steps."""
        if not self.strength:
            return drive_V
        late = np.arange(drive_V.size) - self.strength * self.period_s / grid.half_s
        if grid.periodic:
            return np.interp(late % (drive_V.size - 1), np.arange(drive_V.size), drive_V)
        return np.interp(late, np.arange(drive_V.size), drive_V, left=drive_V[0])

    def parameters(self) -> dict[str, Any]:
        """The delay."""
        return {"delay_s": self.strength * self.period_s}
