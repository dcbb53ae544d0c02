"""Noise of a channel from what recordings of the same drive do not share: variance, spectrum, whitening filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Real = NDArray[np.float64]

LONGEST_FILTER = 24
CORNERS = 40
CORNER_MARGIN = 10.0
"""The lowest corner frequency considered lies so far below the lowest line."""
SAMPLES_A_COEFFICIENT = 50
"""A noise model has at most one coefficient for so many samples of noise, and one for a twentieth of a recording."""


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Stationary Gaussian noise as an autoregression: ``Σ_k a_k n_{t-k} = e_t``, ``a_0 = 1``, ``e`` white.

    Parameters
    ----------
    coefficients : ndarray, shape (p + 1,)
        ``a_0 … a_p``; ``[1]`` is white noise.
    innovation : float
        Standard deviation of ``e``, in the channel's unit.
    rms : float
        Standard deviation of the noise itself.
    source : str
        Where it was seen, in words.
    colour : tuple of float
        ``s0, s1, s2``: the power of the whitened noise is ``s0 + s1/ν + s2/ν²`` at ν cycles a sample; ``(1, 0, 0)``
        where the autoregression says it all. 1/f noise is strongest at the lowest frequencies, which no short filter
        sees and a slow loop depends on.
    """

    coefficients: Real
    innovation: float
    rms: float
    source: str
    colour: tuple[float, float, float] = (1.0, 0.0, 0.0)

    @property
    def lost(self) -> int:
        """Samples at the start of a recording that whitening leaves out."""
        return self.coefficients.size - 1

    def whitened(self, columns: Real) -> Real:
        """Columns of shape (n, k) filtered so that the noise in them is white with unit variance: (n - lost, k).

        None are left of columns shorter than the filter.
        """
        n = max(columns.shape[0] - self.lost, 0)
        result = columns[self.lost :] * self.coefficients[0]
        for lag, a in enumerate(self.coefficients[1:], start=1):
            result = result + a * columns[self.lost - lag : self.lost - lag + n]
        whitened: Real = result / self.innovation
        return whitened

    def levels(self, samples: int) -> Real:
        """Power of whitened noise at each line of a discrete Fourier transform, shape (samples,).

        The mean counts like the first line.
        """
        return self._level(np.maximum(np.abs(np.fft.fftfreq(samples)), 1 / samples))

    def _level(self, cycles_a_sample: Real) -> Real:
        white, flicker, wander = self.colour
        return white + flicker / cycles_a_sample + wander / cycles_a_sample**2

    def spectrum(self, frequency_Hz: ArrayLike, step_s: float) -> Real:
        """One-sided power spectral density in unit² / Hz, at frequencies above 0, up to half the sampling rate."""
        phase = np.exp(-2j * np.pi * step_s * np.outer(np.asarray(frequency_Hz), np.arange(self.coefficients.size)))
        level = self._level(step_s * np.asarray(frequency_Hz))
        return level * 2 * step_s * self.innovation**2 / np.abs(phase @ self.coefficients) ** 2


def noise_model(samples: Sequence[Real], source: str, least: float) -> NoiseModel:
    """Autoregressive model of some stretches of noise, its order by the Bayesian information criterion.

    Yule–Walker from the pooled autocovariance (which keeps the model stable), by Levinson's recursion.

    Parameters
    ----------
    samples : sequence of ndarray
        Stretches of noise around zero, of one sampling step. Their mean is kept: wandering from recording to recording
        is noise too.
    source : str
    least : float
        Noise below this RMS is taken for white and this large: rounding of numbers, not noise.
    """
    total = sum(stretch.size for stretch in samples)
    shortest = min(stretch.size for stretch in samples)
    orders = min(LONGEST_FILTER, total // SAMPLES_A_COEFFICIENT, shortest // 20)
    covariance = np.array(
        [sum(float(s[lag:] @ s[: s.size - lag]) for s in samples) / total for lag in range(orders + 1)]
    )
    variance = covariance[0]
    if variance <= least**2:
        return NoiseModel(np.ones(1), least, least, f"{source}, which show none")
    filters, innovations = [np.ones(1)], [variance]
    for order in range(1, orders + 1):
        previous = filters[-1]
        reflection = -float(previous @ covariance[order:0:-1]) / innovations[-1]
        extended = np.append(previous, 0.0)
        filters.append(extended + reflection * extended[::-1])
        innovations.append(innovations[-1] * max(1 - reflection**2, 1e-12))
    criteria = [total * np.log(v) + p * np.log(total) for p, v in enumerate(innovations)]
    best = int(np.argmin(criteria))
    return NoiseModel(filters[best], float(np.sqrt(innovations[best])), float(np.sqrt(variance)), source)


def colour_of(whitened: Sequence[Real], exponents: tuple[int, ...] = (1, 2)) -> tuple[float, float, float]:
    """Power of whitened noise as ``s0 + s1/ν + s2/ν²``: white, 1/f and a random walk's.

    Corner frequencies of ``a (1 + ν_c/ν)`` and ``a (1 + (ν_c/ν)²)`` are weighed by Whittle's likelihood of the
    periodograms; the mean white level and the geometric means of the others count. A short record can hardly tell a
    little 1/f noise from none, and so some is kept.

    Parameters
    ----------
    whitened : sequence of ndarray
        Stretches of noise, whitened; of several sampling steps perhaps, for the same amplifier's 1/f noise in the same
        white noise looks the same in cycles a sample.
    """
    lines = np.concatenate([np.fft.rfftfreq(stretch.size)[1:] for stretch in whitened])
    power = np.concatenate([np.abs(np.fft.rfft(stretch)[1:]) ** 2 / stretch.size for stretch in whitened])
    corners = np.geomspace(lines.min() / CORNER_MARGIN, 0.5, CORNERS)
    likelihoods, levels = np.full((2, CORNERS), -np.inf), np.ones((2, CORNERS))
    for i, exponent in ((exponent - 1, exponent) for exponent in exponents):
        for j, corner in enumerate(corners):
            shape = 1 + (corner / lines) ** exponent
            levels[i, j] = level = float(np.mean(power / shape))
            likelihoods[i, j] = -float(np.sum(np.log(level * shape)))
    weights = np.exp(likelihoods - likelihoods.max())
    weights /= weights.sum()
    white = float(np.sum(weights * levels))
    share = weights.sum(axis=1)
    strength = np.log(levels * corners ** np.array([[1], [2]]))
    flicker, wander = share * np.exp(np.sum(weights * strength, axis=1) / np.maximum(share, 1e-300))
    return white, float(flicker), float(wander)


def repeat_deviations(repeats: Sequence[Real]) -> list[Real]:
    """Deviations of repeats from their mean, scaled to the variance of one recording; none where there is one."""
    if len(repeats) < 2:
        return []
    mean = np.mean(repeats, axis=0)
    scale = np.sqrt(len(repeats) / (len(repeats) - 1))
    return [scale * (repeat - mean) for repeat in repeats]
