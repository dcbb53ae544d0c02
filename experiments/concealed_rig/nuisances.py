"""What every recording carries, whatever is concealed: noise, the converter, a monitor of the drive."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter


@dataclass(frozen=True)
class Noise:
    """Stationary noise of one channel.

    Parameters
    ----------
    sigma : float
        Standard deviation in the sensor's unit.
    poles : tuple of float
        Coefficients of an autoregression, x_k = Σ p_j x_(k−j) + white; none: white noise.
    flicker : float
        Share of the variance that is 1/f noise.
    """

    sigma: float
    poles: tuple[float, ...] = ()
    flicker: float = 0.0


@dataclass(frozen=True)
class Converter:
    """Analogue-to-digital converter: range ± and number of bits."""

    range: float
    bits: int

    @property
    def step(self) -> float:
        """Quantisation step."""
        return 2 * self.range / 2**self.bits


def drawn_noise(largest_rms: float, channel: str, rng: np.random.Generator) -> Noise:
    """Noise 40 … 60 dB below the channel's largest recording, white or coloured; the gauge's with a 1/f part."""
    sigma = largest_rms * 10 ** (-rng.uniform(40, 60) / 20)
    kind = rng.choice(["white", "first", "second"])
    poles: tuple[float, ...] = ()
    if kind == "first":
        poles = (float(rng.uniform(0.2, 0.7)),)
    elif kind == "second":
        radius, angle = rng.uniform(0.3, 0.7), rng.uniform(0.2, 0.8) * np.pi
        poles = (float(2 * radius * np.cos(angle)), float(-(radius**2)))
    return Noise(float(sigma), poles, float(rng.uniform(0.1, 0.4)) if channel == "strain_gauge" else 0.0)


def _unit_autoregression(poles: tuple[float, ...], samples: int, rng: np.random.Generator) -> np.ndarray:
    if not poles:
        return rng.standard_normal(samples)
    if len(poles) == 1:
        variance = 1 / (1 - poles[0] ** 2)
    else:
        # Yule–Walker of the second-order autoregression.
        p, q = poles
        variance = (1 - q) / ((1 + q) * ((1 - q) ** 2 - p**2))
    lead = 400
    row = lfilter([1.0], np.concatenate(([1.0], -np.array(poles))), rng.standard_normal(samples + lead))[lead:]
    return row / np.sqrt(variance)


def _unit_flicker(samples: int, rng: np.random.Generator) -> np.ndarray:
    """1/f noise of unit expected variance, by its spectrum over four times the length."""
    long = 4 * samples
    share = 1 / np.arange(1, long // 2 + 1)
    amplitude = np.sqrt(share / np.sum(share)) * long / 2
    spectrum = amplitude * (rng.standard_normal(share.size) + 1j * rng.standard_normal(share.size))
    return np.fft.irfft(np.concatenate(([0.0], spectrum)), long)[:samples]


def noise_row(noise: Noise, samples: int, rng: np.random.Generator) -> np.ndarray:
    """One recording's noise, shape (samples,)."""
    row = np.sqrt(1 - noise.flicker) * _unit_autoregression(noise.poles, samples, rng)
    if noise.flicker:
        row = row + np.sqrt(noise.flicker) * _unit_flicker(samples, rng)
    return noise.sigma * row


def drawn_converter(largest: float, sigma: float, rng: np.random.Generator) -> Converter:
    """Converter of 12 … 16 bits with the next range 1-2-5 above the signal, and a step no coarser than the noise."""
    reach = 1.15 * largest + 5 * sigma
    decade = 10.0 ** np.floor(np.log10(reach))
    span = float(next(decade * m for m in (1, 2, 5, 10) if decade * m >= reach))
    bits = int(rng.integers(12, 17))
    while bits < 16 and Converter(span, bits).step > sigma:
        bits += 1
    return Converter(span, bits)


def converted(signal: np.ndarray, converter: Converter) -> np.ndarray:
    """Samples as the converter gives them, in the signal's unit."""
    code = np.clip(np.round(signal / converter.step), -(2 ** (converter.bits - 1)), 2 ** (converter.bits - 1) - 1)
    return code * converter.step
