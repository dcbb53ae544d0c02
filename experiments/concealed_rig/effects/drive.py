"""Drive stage: what happens to the voltage between generator and ceramic."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.linear import filtered

LOW_PASSES = ("first_order", "second_order", "two_poles", "lossy_line")


def low_pass_denominator(kind: str, bandwidth_Hz: float) -> list[float]:
    """Polynomial in s, highest power first, of a low-pass 1/D(s).

    "first_order"; "second_order" of damping 0.7; "two_poles", the second one 2.5 times as high; "lossy_line", four
    sections of resistance and capacitance, whose delay is that of one pole at the bandwidth.

    Source: A. V. Oppenheim, A. S. Willsky, Signals and Systems (1997), chapter 6; W. C. Elmore, J. Appl. Phys. 19
    (1948) 55 (delay of a chain of resistances and capacitances).
    """
    w = 2 * np.pi * bandwidth_Hz
    if kind == "first_order":
        return [1 / w, 1.0]
    if kind == "second_order":
        return [1 / w**2, 1.4 / w, 1.0]
    if kind == "two_poles":
        return [1 / (2.5 * w**2), 1.4 / w, 1.0]
    if kind != "lossy_line":
        raise ValueError(f"kind must be one of {', '.join(LOW_PASSES)}; got {kind!r}.")
    # Elmore's delay of n sections of τ each is τn(n + 1)/2: with n = 4, ten of them.
    section = 1 / (10 * w)
    voltage, current = np.array([1.0]), np.array([0.0])
    for _ in range(4):  # from the open end: i += s c v, v += r i
        current = np.polyadd(current, np.polymul([section, 0.0], voltage))
        voltage = np.polyadd(voltage, current)
    return [float(c) for c in voltage]


def low_passed(signal: np.ndarray, bandwidth_Hz: float, kind: str, interval_s: float, periodic: bool) -> np.ndarray:
    """A low-pass of `LOW_PASSES`; the signal itself where its pole is beyond what the points show."""
    if 2 * np.pi * bandwidth_Hz * interval_s > 300:
        return signal
    start = signal[0]
    return start + filtered([1.0], low_pass_denominator(kind, bandwidth_Hz), signal - start, interval_s, periodic)


@dataclass(frozen=True)
class AmplifierBandwidth(Effect):
    """The amplifier is a low-pass; its strength is f₀ over its bandwidth.

    Variants: see `low_pass_denominator`.
    """

    id = "amplifier_bandwidth"
    stage = "drive"
    start = 0.05
    weakest = 1e-4
    strongest = 2.0

    resonance_Hz: float = field(default=5e4, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "AmplifierBandwidth":
        """One of four low-passes."""
        return cls(variant=str(rng.choice(LOW_PASSES)), resonance_Hz=situation.head.resonance_Hz)

    @property
    def fastest_Hz(self) -> float:
        """A third of the bandwidth: what is late bends, and hardly rings."""
        return self.resonance_Hz / self.strength / 3 if self.strength else 0.0

    def on_drive(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Low-pass."""
        if not self.strength:
            return drive_V
        bandwidth = self.resonance_Hz / self.strength
        return low_passed(drive_V, bandwidth, self.variant, grid.half_s, grid.periodic)

    def parameters(self) -> dict[str, Any]:
        """Bandwidth (−3 dB of first order; natural frequency of second order; lower pole; of the line's delay)."""
        return {"bandwidth_Hz": self.resonance_Hz / self.strength}


@njit(cache=True)
def _slewed(u, most, least, v, out):
    for k in range(u.size):
        v += max(-least, min(most, u[k] - v))
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

    Variants: "hard"; "unequal", another limit down than up (push-pull stages of unlike transistors); "soft",
    dU/dt = S·tanh(error/range), an input stage of finite linear range.

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
    fall_ratio: float = field(default=1.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "SlewLimit":
        """One of three; falls are limited to 0.45 … 0.85 of the rises' limit or to its inverse."""
        variant, steepest = str(rng.choice(["hard", "unequal", "soft"])), situation.steepest_V_per_s
        ratio = rng.uniform(0.45, 0.85) ** rng.choice([-1.0, 1.0]) if variant == "unequal" else 1.0
        linear = float(rng.uniform(1.0, 4.0))
        return cls(variant=variant, steepest_V_per_s=steepest, linear_V=linear, fall_ratio=float(ratio))

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
                else (_slewed(drive_V, most, most * self.fall_ratio, v, out))
            )
        return out

    def parameters(self) -> dict[str, Any]:
        """The limit."""
        rate = self.steepest_V_per_s / self.strength
        named = {"slew_rate_V_per_s": rate, "fall_V_per_s": self.fall_ratio * rate}
        return {**named, "linear_V": self.linear_V} if self.variant == "soft" else named


@dataclass(frozen=True)
class TriggerDelay(Effect):
    """Drive and sensor are not aligned; its strength is the delay in periods of the resonance.

    Variants: "late"; "early", the trigger of the digitiser comes after the drive has begun.

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
        """A constant delay, early in one case of four."""
        variant = "early" if rng.random() < 0.25 else "late"
        return cls(variant=variant, period_s=1 / situation.head.resonance_Hz)

    @property
    def delay_s(self) -> float:
        """By how much the drive is late; negative where it is early."""
        return (-1 if self.variant == "early" else 1) * self.strength * self.period_s

    def on_drive(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """The drive a delay ago, linear between the half steps."""
        if not self.strength:
            return drive_V
        late = np.arange(drive_V.size) - self.delay_s / grid.half_s
        if grid.periodic:
            return np.interp(late % (drive_V.size - 1), np.arange(drive_V.size), drive_V)
        return np.interp(late, np.arange(drive_V.size), drive_V, left=drive_V[0])

    def parameters(self) -> dict[str, Any]:
        """The delay."""
        return {"delay_s": self.delay_s}
