"""Noise of an analogue chain: white through a bandwidth, plus 1/f."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from inkjet_env.typing import Real

BOLTZMANN_J_per_K = 1.380649e-23


def thermal_density(resistance_ohm: float, temperature_K: float) -> float:
    """Johnson–Nyquist noise of a resistor, ``√(4 k T R)``, in V/√Hz (Nyquist 1928)."""
    return math.sqrt(4 * BOLTZMANN_J_per_K * temperature_K * resistance_ohm)


@dataclass(frozen=True)
class Noise:
    """Samples of stationary Gaussian noise with one-sided power density ``density² (1 + corner / f)``.

    The white part is limited by a bandwidth. If that exceeds half the sampling rate the noise aliases, so that each
    sample has its whole power. The 1/f part covers the frequencies that a recording resolves, from the inverse of its
    length to half the sampling rate; slower drift is left out, since the rig has one offset per channel.

    Parameters
    ----------
    density : float
        White level in the recorded unit per √Hz, at least 0.
    bandwidth_Hz : float
        Noise bandwidth of the white part; for a single pole, π/2 times the −3 dB frequency.
    corner_Hz : float
        Frequency at which the 1/f part equals ``density``; 0 is no 1/f part.
    """

    density: float
    bandwidth_Hz: float
    corner_Hz: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"noise {field.name} must be finite and at least 0; got {value!r}.")

    @classmethod
    def white(cls, rms: float) -> Noise:
        """White noise with a given RMS per sample, in the recorded unit."""
        return cls(rms, 1.0)

    def power_per_bin(self, samples: int, sample_rate_Hz: float) -> Real:
        """One-sided power density in unit²/Hz at ``rfftfreq(samples, 1 / sample_rate_Hz)``, (samples // 2 + 1,)."""
        frequency_Hz = np.fft.rfftfreq(samples, 1 / sample_rate_Hz)
        flicker = np.divide(self.corner_Hz, frequency_Hz, out=np.zeros_like(frequency_Hz), where=frequency_Hz > 0)
        return self.density**2 * (self.bandwidth_Hz / (sample_rate_Hz / 2) + flicker)

    def rms(self, samples: int, sample_rate_Hz: float) -> float:
        """Expected RMS of `draw`, in the recorded unit."""
        power = self.power_per_bin(samples, sample_rate_Hz)
        twice = power[1 : (samples + 1) // 2].sum() + power.sum()  # these bins also occur at negative frequency
        return math.sqrt(twice * sample_rate_Hz / (2 * samples))

    def draw(self, rng: np.random.Generator, samples: int, sample_rate_Hz: float) -> Real:
        """Draw noise, shape (samples,), in the recorded unit."""
        white = np.fft.rfft(rng.standard_normal(samples))
        gain = np.sqrt(self.power_per_bin(samples, sample_rate_Hz) * (sample_rate_Hz / 2))
        return np.fft.irfft(gain * white, samples)

    def scaled_to(self, rms: float, samples: int, sample_rate_Hz: float) -> Noise:
        """The same spectrum scaled to an RMS over ``samples`` samples; zero noise becomes white noise of that RMS."""
        now = self.rms(samples, sample_rate_Hz)
        if now == 0:
            return Noise.white(rms)
        return Noise(self.density * rms / now, self.bandwidth_Hz, self.corner_Hz)
