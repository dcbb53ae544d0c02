"""Resonator stage: what changes in the course of the campaign, or with the pulses just before."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.effects.wave import coupled_modes_Hz, with_parallel_mode
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.resonator import Motion, Resonator, changed


@dataclass(frozen=True)
class AirBubble(Effect):
    """From some recording on, a bubble takes part; its strength is its coupling.

    Variants: "attached", a second oscillator coupled to the first; "compliant", a lower resonance (the bubble's
    compliance beside the channel's) and the bubble's own mode in the sum; "growing", an attached bubble that grows by
    rectified diffusion from recording to recording, so that its coupling rises and its frequency falls.

    Source: R. Jeurissen et al., J. Acoust. Soc. Am. 126 (2009) 2184 and J. de Jong et al., J. Acoust. Soc. Am. 120
    (2006) 1257 (air bubbles in piezo printheads: shift of the resonance and a mode of their own).
    """

    id = "air_bubble"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.8

    resonance_Hz: float = field(default=5e4, kw_only=True)
    frequency_Hz: float = field(default=3e4, kw_only=True)
    damping_ratio: float = field(default=0.05, kw_only=True)
    shift: float = field(default=0.2, kw_only=True)
    onset: int = field(default=1, kw_only=True)
    growth: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "AirBubble":
        """Onset in the middle of the campaign."""
        variant = str(rng.choice(["attached", "compliant", "growing"]))
        return cls(
            variant=variant,
            growth=float(rng.uniform(2, 6)) if variant == "growing" else 0.0,
            resonance_Hz=situation.head.resonance_Hz,
            frequency_Hz=float(situation.head.resonance_Hz * rng.uniform(0.45, 0.85)),
            damping_ratio=float(rng.uniform(0.03, 0.1)),
            shift=float(rng.uniform(0.1, 0.4)),
            onset=int(rng.integers(max(2, round(0.3 * situation.last_order)), round(0.7 * situation.last_order) + 1)),
        )

    def _there(self, order: int) -> bool:
        return bool(self.strength) and order >= self.onset

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Coupled, or softer."""
        if not self._there(order):
            return resonator
        if self.variant == "compliant":
            return changed(resonator, frequency=1 / np.sqrt(1 + self.shift * self.strength))
        ratio, coupling = self.frequency_Hz / self.resonance_Hz, self.strength
        if self.growth:
            # Share of its final volume; the frequency goes with the inverse radius.
            volume = 1 - np.exp(-(order - self.onset + 1) / self.growth)
            coupling, ratio = coupling * volume, ratio / volume ** (1 / 3)
        return replace(resonator, mass_ratio=coupling, second_ratio=ratio, second_damping=self.damping_ratio)

    def on_motion(
        self, motion: Motion, hysteretic_V: np.ndarray, resonator: Resonator, grid: Grid, order: int
    ) -> Motion:
        """The bubble's own mode in the sum."""
        if self.variant != "compliant" or not self._there(order):
            return motion
        return with_parallel_mode(
            motion, hysteretic_V, resonator, grid, self.strength, self.frequency_Hz, self.damping_ratio
        )

    def parameters(self) -> dict[str, Any]:
        """Onset, the bubble's frequency and damping, and what becomes of the first resonance."""
        named = {"onset_order": self.onset, "frequency_Hz": self.frequency_Hz, "damping_ratio": self.damping_ratio}
        if self.variant in ("attached", "growing"):
            modes = coupled_modes_Hz(self.resonance_Hz, self.strength, self.frequency_Hz / self.resonance_Hz)
            return {**named, "mass_ratio": self.strength, "modes_Hz": modes, "growth_recordings": self.growth}
        lower = self.resonance_Hz / np.sqrt(1 + self.shift * self.strength)
        return {**named, "share": self.strength, "resonance_Hz": float(lower)}


@dataclass(frozen=True)
class MeniscusRefill(Effect):
    """A slow state, driven by the flow just before, shifts the stiffness and recovers; strength is the shift a unit.

    Variants: "relaxing", a first-order recovery after |flow|; "oscillating", a second-order refill after its square;
    "outflow", a first-order recovery after the outward flow alone.

    Source: H. Wijshoff, Physics Reports 491 (2010) 77 (refill and overfill of the meniscus).
    """

    id = "meniscus_refill"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.5

    time_s: float = field(default=1e-4, kw_only=True)
    damping_ratio: float = field(default=0.4, kw_only=True)
    speed_V: float = field(default=50.0, kw_only=True)
    sign: float = field(default=1.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "MeniscusRefill":
        """Times of 50 … 400 µs; refills of 2 … 8 kHz."""
        variant = str(rng.choice(["relaxing", "oscillating", "outflow"]))
        time = 1 / (2 * np.pi * rng.uniform(2e3, 8e3)) if variant == "oscillating" else rng.uniform(5e-5, 4e-4)
        return cls(
            variant=variant,
            time_s=float(time),
            damping_ratio=float(rng.uniform(0.25, 0.7)),
            speed_V=0.4 * situation.largest_speed_V,
            sign=float(rng.choice([-1.0, 1.0])),
        )

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Let the state shift the stiffness."""
        if not self.strength:
            return resonator
        return replace(
            resonator,
            meniscus_gain=self.sign * self.strength,
            meniscus_kind={"relaxing": 1.0, "oscillating": 2.0, "outflow": 3.0}[self.variant],
            meniscus_s=self.time_s,
            meniscus_damping=self.damping_ratio,
            meniscus_V=self.speed_V,
        )

    def parameters(self) -> dict[str, Any]:
        """Recovery time, or the refill's frequency; stiffness a unit of the state."""
        named = {"stiffness_shift": self.sign * self.strength, "speed_V": self.speed_V}
        if self.variant != "oscillating":
            return {**named, "recovery_s": self.time_s}
        return {**named, "frequency_Hz": 1 / (2 * np.pi * self.time_s), "damping_ratio": self.damping_ratio}


@dataclass(frozen=True)
class ThermalDrift(Effect):
    """Frequency and damping wander with the order of the recordings; strength is the largest change of frequency.

    Variants: "warm_up", exponential; "sinusoid", the room's own rhythm; "random_walk"; "thermostat", a heater that is
    switched on and off between two temperatures, so that the head warms and cools in a sawtooth.

    Source: viscosity falls with temperature by some per cent a kelvin and the speed of sound by some tenths:
    H. Wijshoff, Physics Reports 491 (2010) 77.
    """

    id = "thermal_drift"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.1

    course: tuple[float, ...] = field(default=(0.0,), kw_only=True)
    damping_factor: float = field(default=4.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "ThermalDrift":
        """A course over the campaign, its mean zero and its largest value one."""
        variant = str(rng.choice(["warm_up", "sinusoid", "random_walk", "thermostat"]))
        k = np.arange(situation.last_order + 1)
        if variant == "warm_up":
            course = np.exp(-k / (rng.uniform(0.2, 0.6) * k.size))
        elif variant == "sinusoid":
            course = np.sin(2 * np.pi * k * rng.uniform(0.7, 2.0) / k.size + rng.uniform(0, 2 * np.pi))
        elif variant == "thermostat":
            heating = rng.uniform(0.2, 0.5)  # share of a cycle
            phase = (k * rng.uniform(1.2, 2.5) / k.size + rng.random()) % 1.0
            course = np.where(phase < heating, phase / heating, (1 - phase) / (1 - heating))
        else:
            course = np.cumsum(rng.standard_normal(k.size))
            course[-1] = course[-2]
        course = course - np.mean(course[:-1])
        course /= np.max(np.abs(course[:-1]))
        factor = float(rng.uniform(2, 8) * rng.choice([-1.0, 1.0]))
        return cls(variant=variant, course=tuple((float(rng.choice([-1, 1])) * course).tolist()), damping_factor=factor)

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """The resonator at this point of the campaign; after its end, as right after it."""
        if not self.strength:
            return resonator
        now = self.strength * self.course[min(max(order, 1), len(self.course)) - 1]
        return changed(resonator, frequency=1 + now, damping=max(0.2, 1 + self.damping_factor * now))

    def parameters(self) -> dict[str, Any]:
        """Relative changes of frequency and decay rate by order."""
        frequency = [self.strength * c for c in self.course]
        return {"frequency_change": frequency, "damping_change": [self.damping_factor * f for f in frequency]}
