"""Sensing stage: what the sensor adds to, or takes from, what the head does."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from experiments.concealed_rig.effects.digitiser import retimed
from experiments.concealed_rig.effects.drive import LOW_PASSES, low_passed
from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.linear import filtered, linear_motion, relaxations
from experiments.concealed_rig.measurement import Measurement

FINER = 8  # points of a smooth signal in a step, where straight lines between them are to pass for it


def slope_V_per_s(drive_V: np.ndarray, grid: Grid) -> np.ndarray:
    """dU/dt at the steps, shape (steps + 1,), from the half steps: at a corner, the mean of both sides."""
    slopes = np.diff(drive_V) / grid.half_s
    first = (slopes[0] + slopes[-1]) / 2 if grid.periodic else slopes[0]
    last = first if grid.periodic else slopes[-1]
    return np.concatenate(([first], (slopes[1:-1:2] + slopes[2::2]) / 2, [last]))


@dataclass(frozen=True)
class Feedthrough(Effect):
    """A part of C dU/dt reaches the sensor; its strength is its largest value over the largest signal.

    Variants: "capacitive"; "with_loss", tan δ makes the current lead less than 90°; "high_pass", the residual
    capacitance with a series resistance; "relaxing", a part of the residual capacitance charges late, as in Debye's
    law.

    Source: J. J. Dosch, D. J. Inman, E. Garcia, J. Intell. Mater. Syst. Struct. 3 (1992) 166 (bridge of self-sensing
    out of balance); IEEE Std 176-1987 (tan δ); A. K. Jonscher, Dielectric Relaxation in Solids (1983).
    """

    id = "feedthrough"
    stage = "sensing"
    start = 1e-2
    weakest = 1e-7
    strongest = 3.0

    largest_V: float = field(default=5.0, kw_only=True)
    steepest_V_per_s: float = field(default=1e8, kw_only=True)
    loss: float = field(default=0.0, kw_only=True)
    time_s: float = field(default=0.0, kw_only=True)
    late: float = field(default=0.0, kw_only=True)
    late_s: float = field(default=1e-5, kw_only=True)
    angular_rad_per_s: float = field(default=3e5, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "Feedthrough":
        """Of either sign of the imbalance."""
        variant = str(rng.choice(["capacitive", "with_loss", "high_pass", "relaxing"]))
        return cls(
            variant=variant,
            largest_V=float(rng.choice([-1.0, 1.0])) * situation.largest_V,
            steepest_V_per_s=situation.steepest_V_per_s,
            loss=float(rng.uniform(0.01, 0.05)) if variant == "with_loss" else 0.0,
            time_s=float(rng.uniform(2e-7, 1e-6)) if variant == "high_pass" else 0.0,
            late=float(rng.uniform(0.2, 0.6)) if variant == "relaxing" else 0.0,
            late_s=float(rng.uniform(3e-6, 3e-5)),
            angular_rad_per_s=situation.head.angular_rad_per_s,
        )

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """Add the current of the residual capacitance."""
        if not self.strength or measurement.channel != "self_sensing":
            return signal
        if self.time_s:
            current = filtered([1.0, 0.0], [self.time_s, 1.0], applied_V, grid.half_s, grid.periodic)[::2]
        else:
            current = slope_V_per_s(applied_V, grid) + self.loss * self.angular_rad_per_s * applied_V[::2]
        if self.late:
            after = relaxations(applied_V, np.array([self.late_s]), grid.half_s, grid.periodic)[0]
            current = (1 - self.late) * current + self.late * (applied_V - after)[::2] / self.late_s
        return signal + self._gain_s() * current

    def _gain_s(self) -> float:
        return self.strength * self.largest_V / self.steepest_V_per_s

    def parameters(self) -> dict[str, Any]:
        """Sensor volts for each V/s, tan δ at the resonance, time of the series resistance."""
        return {"feedthrough_s": self._gain_s(), "loss_tangent": self.loss, "time_s": self.time_s} | (
            {"late_share": self.late, "late_s": self.late_s} if self.late else {}
        )


@dataclass(frozen=True)
class SensorBandwidth(Effect):
    """The sensing amplifier is a low-pass; its strength is f₀ over its bandwidth.

    Variants: see `drive.low_pass_denominator`.
    """

    id = "sensor_bandwidth"
    stage = "sensing"
    start = 0.05
    weakest = 1e-4
    strongest = 2.0

    resonance_Hz: float = field(default=5e4, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "SensorBandwidth":
        """One of four low-passes."""
        return cls(variant=str(rng.choice(LOW_PASSES)), resonance_Hz=situation.head.resonance_Hz)

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """Low-pass of the fast channels."""
        if not self.strength or measurement.channel == "strain_gauge":
            return signal
        bandwidth = self.resonance_Hz / self.strength
        # Straight lines are a low-pass of their own, 1 − (ω·step)²/12: a spline goes through points close enough.
        smooth = retimed(signal, np.arange((signal.size - 1) * FINER + 1) / FINER, grid, smooth=True)
        return low_passed(smooth, bandwidth, self.variant, grid.step_s / FINER, grid.periodic)[::FINER]

    def parameters(self) -> dict[str, Any]:
        """Bandwidth (−3 dB of first order; natural frequency of second order; lower pole; of the line's delay)."""
        return {"bandwidth_Hz": self.resonance_Hz / self.strength}


@dataclass(frozen=True)
class SensorSaturation(Effect):
    """The sensor clips or compresses; its strength is the largest signal over the level.

    Variants: "clip"; "clip_one_side", one rail only; "unequal_rails", the other rail 1.2 … 2 times as far; "tanh";
    "one_sided", y/(1 + y/level) on one polarity.

    Source: P. Horowitz, W. Hill, The Art of Electronics (2015): output range of an operational amplifier; tanh is the
    transfer of a differential pair.
    """

    id = "sensor_saturation"
    stage = "sensing"
    start = 1.05
    weakest = 1e-4
    strongest = 4.0

    largest_V: float = field(default=5.0, kw_only=True)
    side: float = field(default=1.0, kw_only=True)
    other_rail: float = field(default=1.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "SensorSaturation":
        """One of five."""
        variant = str(rng.choice(["clip", "clip_one_side", "unequal_rails", "tanh", "one_sided"]))
        other = {"clip_one_side": 1e3, "unequal_rails": float(rng.uniform(1.2, 2.0))}.get(variant, 1.0)
        side = float(rng.choice([-1.0, 1.0]))
        return cls(variant=variant, largest_V=situation.largest_V, side=side, other_rail=other)

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """Compress self-sensing."""
        if not self.strength or measurement.channel != "self_sensing":
            return signal
        level = self.largest_V / self.strength
        if self.variant in ("clip", "clip_one_side", "unequal_rails"):
            low, high = sorted((self.side * level, -self.side * self.other_rail * level))
            return np.clip(signal, low, high)
        if self.variant == "tanh":
            return level * np.tanh(signal / level)
        return signal / (1 + np.maximum(self.side * signal, 0.0) / level)

    def parameters(self) -> dict[str, Any]:
        """The level, or the nearer rail and its side, and the other rail where there is one."""
        level = self.largest_V / self.strength
        named = {"level_V": level, "side": 0.0 if self.variant in ("clip", "tanh") else self.side}
        return {**named, "other_level_V": self.other_rail * level} if self.variant == "unequal_rails" else named


@dataclass(frozen=True)
class Crosstalk(Effect):
    """The neighbouring channel's drive is heard; its strength is its share.

    Variants: "resonant", through the neighbour's own resonance; "acoustic", the same, 2 … 12 µs later through the wall;
    "direct", through a stray capacitance and resistance; "capacitive", through a capacitance alone.

    Source: H. Wijshoff, Physics Reports 491 (2010) 77 (direct, acoustic and electric crosstalk).
    """

    id = "crosstalk"
    stage = "sensing"
    start = 1e-2
    weakest = 1e-7
    strongest = 2.0

    frequency_Hz: float = field(default=5e4, kw_only=True)
    damping_ratio: float = field(default=0.05, kw_only=True)
    gain_V_per_V: float = field(default=0.06, kw_only=True)
    capacitive_s: float = field(default=0.0, kw_only=True)
    resistive: float = field(default=0.0, kw_only=True)
    delay_s: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "Crosstalk":
        """The neighbour is a head of nearly the same frequency."""
        variant = str(rng.choice(["resonant", "acoustic", "direct", "capacitive"]))
        head, mix = situation.head, 1.0 if variant == "capacitive" else rng.uniform(0.2, 0.8)
        return cls(
            variant=variant,
            delay_s=float(rng.uniform(2e-6, 12e-6)) if variant == "acoustic" else 0.0,
            frequency_Hz=float(head.resonance_Hz * rng.uniform(0.88, 1.15)),
            damping_ratio=float(head.damping_ratio * rng.uniform(0.7, 1.4)),
            gain_V_per_V=head.b1_per_s / head.angular_rad_per_s,
            capacitive_s=float(mix * situation.largest_V / situation.steepest_V_per_s),
            resistive=float((1 - mix) * situation.largest_V / 100.0),
        )

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """Add what is heard of the neighbour."""
        if not self.strength or measurement.neighbour_V is None or measurement.channel != "self_sensing":
            return signal
        drive = grid.halves(measurement.neighbour_V)
        if self.delay_s:
            late = np.arange(drive.size) - self.delay_s / grid.half_s
            late = late % (drive.size - 1) if grid.periodic else np.maximum(late, 0.0)
            drive = np.interp(late, np.arange(drive.size), drive)
        if self.variant in ("resonant", "acoustic"):
            heard = self.gain_V_per_V * linear_motion(2 * np.pi * self.frequency_Hz, self.damping_ratio, drive, grid)[1]
        else:
            heard = self.capacitive_s * slope_V_per_s(drive, grid) + self.resistive * drive[::2]
        return signal + self.strength * heard

    def parameters(self) -> dict[str, Any]:
        """Share and resonance, or the stray gains."""
        if self.variant in ("resonant", "acoustic"):
            named = {"frequency_Hz": self.frequency_Hz, "damping_ratio": self.damping_ratio, "delay_s": self.delay_s}
            return {"share": self.strength, **named}
        gains = {"capacitive_s": self.capacitive_s, "resistive_V_per_V": self.resistive}
        return {name: self.strength * value for name, value in gains.items()}
