"""Kinds of measurement noise that are met in laboratories, for campaigns in which nothing else is wrong.

A kind is drawn once for each channel of a campaign, with its own random constants, and then gives one row of noise for
each recording. Stationary kinds have unit variance; those that change with the signal or from recording to recording
have it on average. 1/f² noise, a random walk, is not among them: it is a drift.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from inkjet_env.typing import Real

Row = Callable[[np.random.Generator, Real, float], Real]
"""Noise of one recording, shape (n,): of a generator, the signal relative to the channel's largest, and the sampling
step relative to the channel's shortest."""
LEAD = 4000
"""Number of samples that are dropped before a recording, so that the noise is stationary."""


@dataclass(frozen=True)
class NoiseLaw:
    """Noise of one channel of a campaign.

    Attributes
    ----------
    row : callable
        Noise of one recording; see `Row`.
    converter_step : float
        Step of the converter, in standard deviations of the noise; 0 if nothing is rounded.
    """

    row: Row
    converter_step: float = 0.0

    def recorded(self, signal: Real, sigma: float, largest: float, step: float, rng: np.random.Generator) -> Real:
        """A recording of a signal, shape (n,), with this noise.

        Parameters
        ----------
        signal : ndarray, shape (n,)
            Signal without noise, in the sensor's unit.
        sigma : float
            Standard deviation of the noise, in the sensor's unit.
        largest : float
            Largest magnitude of the channel's signals, in the sensor's unit.
        step : float
            Sampling step relative to the channel's shortest.
        rng : Generator
            Generator of this recording's noise.
        """
        noisy = signal + sigma * self.row(rng, signal / largest, step)
        if not self.converter_step:
            return np.asarray(noisy, dtype=np.float64)
        code = self.converter_step * sigma
        return np.asarray(code * np.round(noisy / code), dtype=np.float64)


def _white(rng: np.random.Generator, signal: Real, step: float) -> Real:
    return np.asarray(rng.standard_normal(signal.size), dtype=np.float64)


def _memory(rng: np.random.Generator, samples: int, time: float) -> Real:
    """Noise of unit variance whose correlation falls as exp(-t / time), shape (samples,)."""
    keep = np.exp(-1 / time)
    first = rng.standard_normal()
    driven = np.sqrt(1 - keep**2) * rng.standard_normal(samples)
    driven[0] = first
    row: Real = lfilter([1.0], [1.0, -keep], driven)
    return row


def _sum_of(parts: list[tuple[float, float]]) -> Row:
    """White noise and memories: shares of the rms and times in samples at the shortest step."""

    def row(rng: np.random.Generator, signal: Real, step: float) -> Real:
        share = sum(part**2 for part, _ in parts)
        total = np.sqrt(max(1 - share, 0.0)) * rng.standard_normal(signal.size)
        for part, time in parts:
            total = total + part * _memory(rng, signal.size, time / step)
        return np.asarray(total, dtype=np.float64)

    return row


def _filtered(numerator: Real, denominator: Real) -> Row:
    """White noise through a filter, scaled to unit variance; the same in samples at every step."""
    response = lfilter(numerator, denominator, np.r_[1.0, np.zeros(LEAD)])
    scale = 1 / np.sqrt(float(response @ response))

    def row(rng: np.random.Generator, signal: Real, step: float) -> Real:
        driven = rng.standard_normal(signal.size + LEAD)
        return np.asarray(scale * lfilter(numerator, denominator, driven)[LEAD:], dtype=np.float64)

    return row


def white(rng: np.random.Generator) -> NoiseLaw:
    """White Gaussian noise."""
    return NoiseLaw(_white)


def autoregression(rng: np.random.Generator) -> NoiseLaw:
    """An autoregression of order 1 to 6 with random stable poles."""
    order = int(rng.integers(1, 7))
    poles: list[complex] = []
    while len(poles) < order:
        if order - len(poles) > 1 and rng.random() < 0.7:
            pole = rng.uniform(0.2, 0.9) * np.exp(1j * np.pi * rng.uniform(0.05, 0.95))
            poles += [pole, pole.conjugate()]
        else:
            poles.append(complex(rng.uniform(-0.5, 0.9)))
    return NoiseLaw(_filtered(np.ones(1), np.asarray(np.poly(poles).real, dtype=np.float64)))


def exponential_memory(rng: np.random.Generator) -> NoiseLaw:
    """White noise plus one part, 30 to 70 % of the rms, with a memory of 3 to 200 samples."""
    return NoiseLaw(_sum_of([(float(rng.uniform(0.3, 0.7)), float(np.exp(rng.uniform(np.log(3), np.log(200)))))]))


def slow_memories(rng: np.random.Generator) -> NoiseLaw:
    """White noise plus three parts with memories of 3 to 300 samples."""
    times = np.exp(rng.uniform(np.log(3), np.log(300), 3))
    shares = np.sqrt(rng.uniform(0.2, 0.6) * rng.dirichlet(np.ones(3)))
    return NoiseLaw(_sum_of([(float(a), float(t)) for a, t in zip(shares, times, strict=True)]))


def flicker(rng: np.random.Generator) -> NoiseLaw:
    """White noise plus 1/f noise, 30 to 90 % of the rms."""
    share = float(rng.uniform(0.3, 0.9))

    def row(rng: np.random.Generator, signal: Real, step: float) -> Real:
        long = 8 * signal.size
        lines = np.arange(1, long // 2 + 1)
        size = np.sqrt(1 / lines / np.sum(1 / lines)) * long / 2
        spectrum = np.r_[0, size * (rng.standard_normal(lines.size) + 1j * rng.standard_normal(lines.size))]
        slow = np.fft.irfft(spectrum, long)[: signal.size]
        return np.asarray(np.sqrt(1 - share**2) * rng.standard_normal(signal.size) + share * slow, dtype=np.float64)

    return NoiseLaw(row)


def rounded(rng: np.random.Generator) -> NoiseLaw:
    """White noise, rounded to a converter's step of 0.7 to 5 times its standard deviation: with and without dither."""
    return NoiseLaw(_white, float(np.exp(rng.uniform(np.log(0.7), np.log(5)))))


def heavy_tails(rng: np.random.Generator) -> NoiseLaw:
    """Student's t with 3 to 6 degrees of freedom, or Laplace's distribution."""
    if rng.random() < 0.3:
        return NoiseLaw(lambda rng, signal, step: rng.laplace(scale=np.sqrt(0.5), size=signal.size))
    degrees = float(rng.uniform(3, 6))
    scale = np.sqrt((degrees - 2) / degrees)
    return NoiseLaw(lambda rng, signal, step: scale * rng.standard_t(degrees, signal.size))


def impulses(rng: np.random.Generator) -> NoiseLaw:
    """White noise in which 0.3 to 1 % of the samples are 5 to 12 times as large."""
    often, factor = float(rng.uniform(0.003, 0.01)), float(rng.uniform(5, 12))
    scale = 1 / np.sqrt(1 + often * (factor**2 - 1))

    def row(rng: np.random.Generator, signal: Real, step: float) -> Real:
        size = np.where(rng.random(signal.size) < often, factor, 1.0)
        return np.asarray(scale * size * rng.standard_normal(signal.size), dtype=np.float64)

    return NoiseLaw(row)


def grows_with_signal(rng: np.random.Generator) -> NoiseLaw:
    """White noise plus a white part in proportion to the signal, at the largest signal 0.7 to 4 times as loud."""
    most = float(rng.uniform(0.7, 4))

    def row(rng: np.random.Generator, signal: Real, step: float) -> Real:
        return np.asarray(
            rng.standard_normal(signal.size) + most * signal * rng.standard_normal(signal.size), dtype=np.float64
        )

    return NoiseLaw(row)


def level_by_recording(rng: np.random.Generator) -> NoiseLaw:
    """White noise of another level in every recording, log-normal with a spread of 20 to 50 %."""
    spread = float(rng.uniform(0.2, 0.5))

    def row(rng: np.random.Generator, signal: Real, step: float) -> Real:
        return np.asarray(np.exp(spread * rng.standard_normal()) * rng.standard_normal(signal.size), dtype=np.float64)

    return NoiseLaw(row)


def spectral_bump(rng: np.random.Generator) -> NoiseLaw:
    """White noise plus a band of 20 to 80 % of the rms around a frequency, with a quality of 5 to 50; not a line.

    The band is at least 0.002 cycles per sample wide: in 2,000 samples, four lines.
    """
    frequency = float(np.exp(rng.uniform(np.log(0.01), np.log(0.4))))
    quality = min(float(rng.uniform(5, 50)), frequency / 0.002)
    share = float(rng.uniform(0.2, 0.8))
    pole = np.exp(2j * np.pi * frequency - np.pi * frequency / quality)
    band = _filtered(np.ones(1), np.asarray(np.poly([pole, pole.conjugate()]).real, dtype=np.float64))

    def row(rng: np.random.Generator, signal: Real, step: float) -> Real:
        return np.asarray(np.sqrt(1 - share**2) * _white(rng, signal, step) + share * band(rng, signal, step))

    return NoiseLaw(row)


def mixture(rng: np.random.Generator) -> NoiseLaw:
    """Two of the other kinds, half the power each, rounded if one of them is."""
    kinds = [kind for name, kind in ZOO.items() if name not in ("white", "mixture")]
    one, other = (kinds[k](rng) for k in rng.choice(len(kinds), 2, replace=False))

    def row(rng: np.random.Generator, signal: Real, step: float) -> Real:
        return np.asarray(np.sqrt(0.5) * (one.row(rng, signal, step) + other.row(rng, signal, step)))

    return NoiseLaw(row, max(one.converter_step, other.converter_step))


ZOO: dict[str, Callable[[np.random.Generator], NoiseLaw]] = {
    "white": white,
    "autoregression": autoregression,
    "exponential_memory": exponential_memory,
    "slow_memories": slow_memories,
    "flicker": flicker,
    "rounded": rounded,
    "heavy_tails": heavy_tails,
    "impulses": impulses,
    "grows_with_signal": grows_with_signal,
    "level_by_recording": level_by_recording,
    "spectral_bump": spectral_bump,
    "mixture": mixture,
}
"""Kinds of noise by name; each is a function of a generator."""
