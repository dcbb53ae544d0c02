"""Sensing stage: what chance adds to a recording, so that only its strength is the same in a repeat."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.measurement import Measurement


def _sigmas(situation: Situation) -> tuple[tuple[str, float], ...]:
    return tuple(sorted(situation.sigma.items()))


@dataclass(frozen=True)
class MainsHum(Effect):
    """A tone and a harmonic, their phases free of the trigger; its strength is its amplitude over the noise.

    Variants: "mains", 50 or 60 Hz on every channel; "switching", a supply's tone on the fast channels.

    Source: H. W. Ott, Electromagnetic Compatibility Engineering (2009).
    """

    id = "mains_hum"
    stage = "sensing"
    by_chance = True
    start = 1.0
    weakest = 1e-4
    strongest = 300.0

    frequency_Hz: float = field(default=50.0, kw_only=True)
    harmonic: int = field(default=2, kw_only=True)
    harmonic_share: float = field(default=0.3, kw_only=True)
    sigma: tuple[tuple[str, float], ...] = field(default=(), kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "MainsHum":
        """Recordings of a millisecond alone can only show a supply's tone."""
        variant = "switching" if situation.meagre else str(rng.choice(["mains", "switching"]))
        frequency = rng.choice([50.0, 60.0]) if variant == "mains" else rng.uniform(15e3, 95e3)
        return cls(
            variant=variant,
            frequency_Hz=float(frequency),
            harmonic=int(rng.integers(2, 4)),
            harmonic_share=float(rng.uniform(0.1, 0.5)),
            sigma=_sigmas(situation),
        )

    def added(
        self, signal: np.ndarray, slope: np.ndarray, measurement: Measurement, rng: np.random.Generator
    ) -> np.ndarray:
        """The tone with this recording's phases."""
        phases = rng.uniform(0, 2 * np.pi, 2)
        if self.variant == "switching" and measurement.channel == "strain_gauge":
            return np.zeros_like(signal)
        t = 2 * np.pi * self.frequency_Hz * measurement.step_s * np.arange(signal.size)
        tone = np.sin(t + phases[0]) + self.harmonic_share * np.sin(self.harmonic * t + phases[1])
        return self.strength * dict(self.sigma)[measurement.channel] * tone

    def parameters(self) -> dict[str, Any]:
        """Frequency and amplitudes."""
        amplitude = {channel: self.strength * sigma for channel, sigma in self.sigma}
        named = {"frequency_Hz": self.frequency_Hz, "harmonic": self.harmonic, "harmonic_share": self.harmonic_share}
        return {**named, "amplitude": amplitude}


@dataclass(frozen=True)
class BaselineDrift(Effect):
    """An offset that moves in the course of each recording; its strength is its RMS over the noise.

    Variants: "polynomial", of third degree at most with its own coefficients in each recording; "random_walk".

    Source: J. S. Bendat, A. G. Piersol, Random Data (2010) (trends in recordings).
    """

    id = "baseline_drift"
    stage = "sensing"
    by_chance = True
    start = 1.0
    weakest = 1e-4
    strongest = 300.0

    degree: int = field(default=1, kw_only=True)
    sigma: tuple[tuple[str, float], ...] = field(default=(), kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "BaselineDrift":
        """Polynomial or random walk."""
        variant = str(rng.choice(["polynomial", "random_walk"]))
        return cls(variant=variant, degree=int(rng.integers(1, 4)), sigma=_sigmas(situation))

    def added(
        self, signal: np.ndarray, slope: np.ndarray, measurement: Measurement, rng: np.random.Generator
    ) -> np.ndarray:
        """This recording's drift."""
        n = signal.size
        if self.variant == "polynomial":
            coefficients = rng.standard_normal(self.degree + 1) / np.sqrt(self.degree + 1)
            # Legendre polynomials times √(2k + 1) are of unit RMS.
            drift = np.polynomial.legendre.legval(
                np.linspace(-1, 1, n), coefficients * np.sqrt(2 * np.arange(self.degree + 1) + 1)
            )
        else:
            drift = np.cumsum(rng.standard_normal(n)) * np.sqrt(2 / n)
        return self.strength * dict(self.sigma)[measurement.channel] * drift

    def parameters(self) -> dict[str, Any]:
        """RMS in the sensor's unit."""
        rms = {channel: self.strength * sigma for channel, sigma in self.sigma}
        return {"rms": rms, "degree": self.degree if self.variant == "polynomial" else None}
