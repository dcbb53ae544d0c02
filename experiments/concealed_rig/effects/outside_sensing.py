"""Outside the catalogue, for development, in sensing: gains that follow the voltage or the recording, a clock."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.measurement import Measurement


@dataclass(frozen=True)
class SensitivityByVoltage(Effect):
    """Self-sensing whose gain follows the voltage, C(u); its strength is the change at 100 V.

    Source: D. Damjanovic, Rep. Prog. Phys. 61 (1998) 1267 (permittivity under bias).
    """

    id = "sensitivity_by_voltage"
    stage = "sensing"
    start = 1e-2
    weakest = 1e-7
    strongest = 1.0

    sign: float = field(default=1.0, kw_only=True)
    offset_V: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "SensitivityByVoltage":
        """Proportional to the voltage, or to its square."""
        return cls(
            variant=str(rng.choice(["linear", "quadratic"])),
            sign=float(rng.choice([-1.0, 1.0])),
            offset_V=situation.head.self_sensing_offset_V,
        )

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """Change the gain from instant to instant."""
        if not self.strength or measurement.channel != "self_sensing":
            return signal
        share = applied_V[::2] / 100.0
        change = self.sign * self.strength * (share if self.variant == "linear" else share**2)
        return self.offset_V + (signal - self.offset_V) * (1 + change)

    def parameters(self) -> dict[str, Any]:
        """Relative change at 100 V."""
        return {"gain_change_at_100_V": self.sign * self.strength}


@dataclass(frozen=True)
class ClockJitter(Effect):
    """Samples are taken early or late; its strength is the RMS over the sampling interval.

    Variants: "white"; "wandering", a phase that relaxes within 200 samples.

    Source: M. Shinagawa, Y. Akazawa, T. Wakimoto, IEEE J. Solid-State Circuits 25 (1990) 220.
    """

    id = "clock_jitter"
    stage = "sensing"
    by_chance = True
    start = 0.1
    weakest = 1e-6
    strongest = 5.0

    memory: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "ClockJitter":
        """White or wandering."""
        variant = str(rng.choice(["white", "wandering"]))
        return cls(variant=variant, memory=0.995 if variant == "wandering" else 0.0)

    def added(
        self, signal: np.ndarray, slope: np.ndarray, measurement: Measurement, rng: np.random.Generator
    ) -> np.ndarray:
        """The signal a jitter later, less the signal, by its slope."""
        late = rng.standard_normal(signal.size)
        if self.memory:
            late *= np.sqrt(1 - self.memory**2)
            for k in range(1, late.size):
                late[k] += self.memory * late[k - 1]
        return self.strength * measurement.step_s * late * slope

    def parameters(self) -> dict[str, Any]:
        """RMS of the jitter in sampling intervals."""
        return {"jitter_samples": self.strength, "memory": self.memory}


@dataclass(frozen=True)
class GainWander(Effect):
    """Self-sensing whose gain changes from recording to recording; its strength is the RMS change.

    Source: J. S. Bendat, A. G. Piersol, Random Data (2010) (calibration between recordings).
    """

    id = "gain_wander"
    stage = "sensing"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.5

    course: tuple[float, ...] = field(default=(0.0,), kw_only=True)
    offset_V: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "GainWander":
        """One value a recording."""
        course = rng.standard_normal(situation.last_order)
        offset = situation.head.self_sensing_offset_V
        return cls(variant="per_recording", course=tuple(course.tolist()), offset_V=offset)

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """This recording's gain."""
        if not self.strength or measurement.channel != "self_sensing":
            return signal
        gain = self.course[min(max(measurement.order, 1), len(self.course)) - 1]
        return self.offset_V + (signal - self.offset_V) * (1 + self.strength * gain)

    def parameters(self) -> dict[str, Any]:
        """Relative change by order."""
        return {"gain_change": [self.strength * c for c in self.course]}
