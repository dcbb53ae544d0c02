"""Sensing stage: what chance adds to a recording, so that only its strength is the same in a repeat."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.measurement import Measurement

SAWTOOTH_HARMONICS = 6


def _sigmas(situation: Situation) -> tuple[tuple[str, float], ...]:
    return tuple(sorted(situation.sigma.items()))


@dataclass(frozen=True)
class MainsHum(Effect):
    """A tone and a harmonic, their phases free of the trigger; its strength is its amplitude over the noise.

    Variants: "mains", 50 or 60 Hz on every channel; "rectified", the ripple of a rectifier, 100 or 120 Hz, as |sin|;
    "switching", a supply's tone on the fast channels; "sawtooth", its ripple, whose n-th harmonic is 1/n of the first.

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
        fast = ["switching", "sawtooth"]
        variant = str(rng.choice(fast if situation.meagre else [*fast, "mains", "rectified"]))
        frequency = rng.uniform(15e3, 95e3) if variant in fast else rng.choice([50.0, 60.0])
        frequency *= 2 if variant == "rectified" else 1
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
        if self.variant in ("switching", "sawtooth") and measurement.channel == "strain_gauge":
            return np.zeros_like(signal)
        t = 2 * np.pi * self.frequency_Hz * measurement.step_s * np.arange(signal.size)
        if self.variant == "rectified":
            # |sin| at half the frequency, less its mean 2/π, times 1.5 for a first harmonic of about 0.64
            tone = 1.5 * (np.abs(np.sin(t / 2 + phases[0])) - 2 / np.pi)
        elif self.variant == "sawtooth":
            orders = np.arange(1, SAWTOOTH_HARMONICS + 1)[:, None]
            tone = np.sum(np.sin(orders * (t + phases[0])) / orders, axis=0)
        else:
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

    Variants: "polynomial", of third degree at most with its own coefficients in each recording; "settling", an
    exponential of its own height in each recording, as after an overload or a change of range; "random_walk".

    Source: J. S. Bendat, A. G. Piersol, Random Data (2010) (trends in recordings); P. Horowitz, W. Hill, The Art of
    Electronics (2015) (settling after an overload; dielectric absorption).
    """

    id = "baseline_drift"
    stage = "sensing"
    by_chance = True
    start = 1.0
    weakest = 1e-4
    strongest = 300.0

    degree: int = field(default=1, kw_only=True)
    time: float = field(default=0.3, kw_only=True)  # of settling, as a share of the recording
    sigma: tuple[tuple[str, float], ...] = field(default=(), kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "BaselineDrift":
        """Polynomial, exponential or random walk."""
        variant = str(rng.choice(["polynomial", "settling", "random_walk"]))
        time = float(rng.uniform(0.15, 0.7))
        return cls(variant=variant, degree=int(rng.integers(1, 4)), time=time, sigma=_sigmas(situation))

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
        elif self.variant == "settling":
            shape = np.exp(-np.arange(n) / (self.time * n))
            shape -= np.mean(shape)
            drift = rng.standard_normal(1)[0] * shape / np.sqrt(np.mean(shape**2))
        else:
            drift = np.cumsum(rng.standard_normal(n)) * np.sqrt(2 / n)
        return self.strength * dict(self.sigma)[measurement.channel] * drift

    def parameters(self) -> dict[str, Any]:
        """RMS in the sensor's unit."""
        rms = {channel: self.strength * sigma for channel, sigma in self.sigma}
        degree, time = (value if self.variant == kind else None for kind, value in self._shapes())
        return {"rms": rms, "degree": degree, "time_share": time}

    def _shapes(self) -> tuple[tuple[str, float], ...]:
        return ("polynomial", self.degree), ("settling", self.time)
