"""Sensing stage: a sensor coupled by a capacitor, and a digitiser whose clock is not the generator's."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.linear import filtered
from experiments.concealed_rig.measurement import Measurement


def retimed(signal: np.ndarray, steps: np.ndarray, grid: Grid, smooth: bool) -> np.ndarray:
    """A signal, shape (steps + 1,), at other instants, counted in steps: by a cubic spline, or by straight lines.

    A periodic signal goes on with its next period; another one keeps its last value.
    """
    at = np.arange(signal.size)
    moment = steps % (signal.size - 1) if grid.periodic else np.clip(steps, 0, signal.size - 1)
    if not smooth:
        return np.interp(moment, at, signal)
    if grid.periodic:
        closed = np.append(signal[:-1], signal[0])
        return np.asarray(CubicSpline(at, closed, bc_type="periodic")(moment))
    return np.asarray(CubicSpline(at, signal)(moment))


@dataclass(frozen=True)
class SensorHighpass(Effect):
    """The sensor is coupled by a capacitor; its strength is its corner frequency over f₀.

    Variants: "first_order", s/(s + w); "two_stages", that squared; "servo", a second-order servo loop of damping 0.5 …
    0.9 that takes the mean out, s²/(s² + 2ζws + w²).

    Source: P. Horowitz, W. Hill, The Art of Electronics (2015), chapters 1 and 5 (coupling capacitors; servo loops).
    """

    id = "sensor_highpass"
    stage = "sensing"
    start = 1e-2
    weakest = 1e-6
    strongest = 0.6

    resonance_Hz: float = field(default=5e4, kw_only=True)
    damping_ratio: float = field(default=1.0, kw_only=True)
    offset_V: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "SensorHighpass":
        """One of three."""
        variant = str(rng.choice(["first_order", "two_stages", "servo"]))
        damping = float(rng.uniform(0.5, 0.9)) if variant == "servo" else 1.0
        offset = situation.head.self_sensing_offset_V
        head = situation.head
        return cls(variant=variant, resonance_Hz=head.resonance_Hz, damping_ratio=damping, offset_V=offset)

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """High-pass of self-sensing; the offset is added behind it."""
        if not self.strength or measurement.channel != "self_sensing":
            return signal
        w = 2 * np.pi * self.resonance_Hz * self.strength
        # What is taken away is a low-pass: exact where the corner is far below what the points show.
        if self.variant == "first_order":
            low, denominator = [w], [1.0, w]
        else:
            low, denominator = [2 * self.damping_ratio * w, w**2], [1.0, 2 * self.damping_ratio * w, w**2]
        return signal - filtered(low, denominator, signal - self.offset_V, grid.step_s, grid.periodic)

    def parameters(self) -> dict[str, Any]:
        """Corner frequency, order, and damping ratio of the second order."""
        named = {"frequency_Hz": self.resonance_Hz * self.strength, "order": 1 + (self.variant != "first_order")}
        return named if self.variant == "first_order" else {**named, "damping_ratio": self.damping_ratio}


@dataclass(frozen=True)
class TimebaseError(Effect):
    """Generator and digitiser count time differently; its strength is the relative difference of their rates.

    Variants: "constant", t(1 + ε); "warming", a clock that is right at the trigger and drifts, t(1 + ε t/T) with T the
    length of the recording; "session", an ε that settles from one recording to the next.

    Source: J. R. Vig, Quartz Crystal Resonators and Oscillators, IEEE UFFC tutorial (2008) (accuracy, warm-up and
    ageing of clocks).
    """

    id = "timebase_error"
    stage = "sensing"
    start = 1e-4
    weakest = 1e-8
    strongest = 0.05

    sign: float = field(default=1.0, kw_only=True)
    recordings: float = field(default=5.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "TimebaseError":
        """Of either sign."""
        return cls(
            variant=str(rng.choice(["constant", "warming", "session"])),
            sign=float(rng.choice([-1.0, 1.0])),
            recordings=float(rng.uniform(0.25, 1.0)) * situation.last_order,
        )

    def error(self, order: int) -> float:
        """ε in a recording; of "warming", at its end."""
        settled = np.exp(-(order - 1) / self.recordings) if self.variant == "session" else 1.0
        return float(self.sign * self.strength * settled)

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """The signal at the digitiser's instants."""
        if not self.strength:
            return signal
        steps = np.arange(signal.size, dtype=float)
        error = self.error(measurement.order)
        late = error * steps * (steps / steps[-1] if self.variant == "warming" else 1.0)
        return retimed(signal, steps + late, grid, measurement.channel != "strain_gauge")

    def parameters(self) -> dict[str, Any]:
        """Relative difference of the rates, and over how many recordings it settles."""
        named = {"rate_error": self.sign * self.strength}
        return {**named, "memory_recordings": self.recordings} if self.variant == "session" else named
