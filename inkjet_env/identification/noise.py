"""Noise of a channel from the differences between repeats: variance, spectrum, whitening filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.identification.noise_bands import Band, band_powers, band_shape, relaxations
from inkjet_env.typing import Real

LONGEST_FILTER = 24
"""Highest order of the autoregression."""
FILTER_LENGTHS = (LONGEST_FILTER, 6, 2, 0)
"""Highest orders that are tried together with bands."""
ROUNDS = 12
"""Largest number of iterations between autoregression and bands."""
SAME_POWER = 0.02
"""Relative change of a band's power below which it has converged."""
LEAST_WHITE = 0.1
"""Share of its power in one round, below which an autoregression is giving way to the bands."""
SAMPLES_A_COEFFICIENT = 50
"""Smallest number of samples of noise per coefficient; besides, a recording has at least 20 samples per coefficient."""


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Stationary Gaussian noise as an autoregression: ``Σ_k a_k n_{t-k} = e_t``, ``a_0 = 1``, ``e`` white.

    Parameters
    ----------
    coefficients : ndarray, shape (p + 1,)
        Coefficients ``a_0 … a_p``; ``[1]`` is white noise.
    innovation : float
        Standard deviation of ``e``, in the channel's unit.
    rms : float
        Standard deviation of the noise itself, in the channel's unit.
    source : str
        Data it was estimated from, in words.
    bands : tuple of Band
        Noise with a memory, in addition to the autoregression, powers in units of the innovation's variance. It is
        strongest at the lowest frequencies, which a short filter cannot resolve and on which a slow loop depends.
    """

    coefficients: Real
    innovation: float
    rms: float
    source: str
    bands: tuple[Band, ...] = ()
    _levels: dict[int, Real] = field(default_factory=dict, init=False, repr=False)

    @property
    def lost(self) -> int:
        """Number of samples at the start of a recording that whitening drops."""
        return self.coefficients.size - 1

    def whitened(self, columns: Real) -> Real:
        """Columns of shape (n, k) filtered so that their noise is white with unit variance: shape (n - lost, k).

        Columns shorter than the filter become empty.
        """
        n = max(columns.shape[0] - self.lost, 0)
        result = columns[self.lost :] * self.coefficients[0]
        for lag, a in enumerate(self.coefficients[1:], start=1):
            result = result + a * columns[self.lost - lag : self.lost - lag + n]
        whitened: Real = result / self.innovation
        return whitened

    def at_step(self, ratio: float) -> NoiseModel:
        """The model for a sampling step that is ``ratio`` times as long: its memories last as many seconds."""
        bands = tuple(Band(b.frequency * ratio, b.memory / ratio, b.power) for b in self.bands)
        return replace(self, bands=bands)

    def levels(self, samples: int) -> Real:
        """Power of whitened noise at each line of a discrete Fourier transform, shape (samples,).

        The mean has the power of the first line.
        """
        if samples not in self._levels:
            cycles = np.maximum(np.abs(np.fft.fftfreq(samples)), 1 / samples)
            self._levels[samples] = self._level(cycles, self.passed(samples))
        return self._levels[samples]

    def autocovariance(self, samples: int) -> Real:
        """Autocovariance at lags 0 … samples - 1, shape (samples,), in the channel's unit squared."""
        long = 4 * max(samples, self.coefficients.size)
        lags = np.arange(samples)
        found: Real = np.fft.irfft(1 / self.passed(long)[: long // 2 + 1], long)[:samples]
        for band in self.bands:
            turning = np.cos(2 * np.pi * band.frequency * lags)
            found = found + band.power * np.exp(-lags / band.memory) * turning
        return np.asarray(self.innovation**2 * found, dtype=np.float64)

    def passed(self, samples: int) -> Real:
        """Power of the filter's transfer function at each line of a discrete Fourier transform, shape (samples,)."""
        power: Real = np.abs(np.fft.fft(self.coefficients, max(samples, self.coefficients.size))[:samples]) ** 2
        return power

    def _level(self, cycles_a_sample: Real, passed: Real) -> Real:
        level: Real = np.ones(cycles_a_sample.shape)
        for band in self.bands:
            level = level + band.power * passed * band_shape(cycles_a_sample, band)
        return level

    def spectrum(self, frequency_Hz: ArrayLike, step_s: float) -> Real:
        """One-sided power spectral density in unit²/Hz at frequencies above 0 Hz, up to half the sampling rate."""
        cycles = step_s * np.asarray(frequency_Hz, dtype=np.float64)
        phase = np.exp(-2j * np.pi * np.outer(cycles, np.arange(self.coefficients.size)))
        passed: Real = np.abs(phase @ self.coefficients) ** 2
        return self._level(cycles, passed) * 2 * step_s * self.innovation**2 / passed


def noise_model(samples: Sequence[Real], source: str, least: float, longest: int = LONGEST_FILTER) -> NoiseModel:
    """Autoregressive model of stretches of noise, with its order from the Bayesian information criterion.

    The Yule–Walker equations of the pooled autocovariance, which keeps the model stable, are solved by Levinson's
    recursion.

    Parameters
    ----------
    samples : sequence of ndarray
        Stretches of noise about zero, of one sampling step, in the channel's unit. Their mean is not removed, since
        drift from recording to recording is noise too.
    source : str
        Data the stretches come from, in words.
    least : float
        Smallest RMS, in the channel's unit: less is rounding, not noise, and is taken as white noise of this RMS.
    longest : int
        Highest order.

    Returns
    -------
    NoiseModel
        The autoregression, without bands.
    """
    total = sum(stretch.size for stretch in samples)
    shortest = min(stretch.size for stretch in samples)
    orders = min(longest, total // SAMPLES_A_COEFFICIENT, shortest // 20)
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


def channel_noise(
    stretches: Mapping[float, Sequence[Real]],
    sources: Mapping[float, str],
    least: float,
    longest_memory: float = 10.0,
    lines_Hz: Sequence[float] = (),
) -> dict[float, NoiseModel]:
    """Noise models of one channel by sampling step: an autoregression for each, the same noise with memory in all.

    A sufficiently long autoregression imitates noise with a long memory, except at its lowest lines, on which a slow
    loop depends. So filters of several lengths are fitted in alternation with the bands, each to the expected remainder
    of the other (Dempster, Laird & Rubin 1977). The pair with the largest Whittle likelihood, less half the logarithm
    of the number of samples for each coefficient and 1 for each band, is taken; it may have no bands.

    Parameters
    ----------
    stretches : mapping of float to sequence of ndarray
        Stretches of noise about zero by sampling step in seconds, as for `noise_model`.
    sources : mapping of float to str
        Data the stretches come from, in words, by sampling step.
    least : float
        Smallest RMS, in the channel's unit; see `noise_model`.
    longest_memory : float
        Longest memory of the noise, in durations of the longest stretch. With 10, a random walk is noise too; with
        ``1/2π``, the spectrum is flat below the first line, and a random walk is a drift.
    lines_Hz : sequence of float
        Frequencies around which the noise may be stronger, in bands that are wider than a line.

    Returns
    -------
    dict of float to NoiseModel
        Noise model by sampling step in seconds.
    """
    atoms = relaxations(stretches, longest_memory, lines_Hz)
    best = {step: noise_model(mine, sources[step], least) for step, mine in stretches.items()}
    loud = [step for step, model in best.items() if model.rms > least]
    if not loud:
        return best
    best_score = sum(whittle(best[step], stretches[step]) for step in loud)
    reached = LONGEST_FILTER + 1
    for longest in FILTER_LENGTHS:
        if longest >= reached:
            continue  # the same filters as those found with a higher limit
        found = _alternating({step: stretches[step] for step in loud}, sources, longest, atoms)
        if found is None:
            continue
        score = sum(whittle(found[step], stretches[step]) for step in loud)
        score -= len({(b.frequency * step, b.memory * step) for step in loud for b in found[step].bands})
        if score > best_score:
            best, best_score = best | found, score
        reached = max(model.lost for model in found.values())
    return best


def _alternating(
    stretches: Mapping[float, Sequence[Real]],
    sources: Mapping[float, str],
    longest: int,
    atoms: Sequence[tuple[float, float]],
) -> dict[float, NoiseModel] | None:
    """Autoregressions of at most some order with bands beside them; None if the bands would take their place."""
    models: dict[float, NoiseModel] = {}
    powers = np.zeros(len(atoms))
    for _ in range(ROUNDS):
        models = {
            step: noise_model([_without_bands(s, models.get(step)) for s in mine], sources[step], 0.0, longest)
            for step, mine in stretches.items()
        }
        before = powers
        white, powers = band_powers(
            [
                (step, m.whitened(s[:, None])[:, 0], m.innovation, m.passed)
                for step, m in models.items()
                for s in stretches[step]
            ],
            atoms,
            before,
        )
        if min(white.values()) < LEAST_WHITE:
            return None
        models = {step: _banded(model, step, white[step], powers, atoms) for step, model in models.items()}
        if np.allclose(powers, before, rtol=SAME_POWER, atol=SAME_POWER * float(powers.max(initial=0.0))):
            break
    rms = {step: float(np.sqrt(np.mean(np.concatenate(mine) ** 2))) for step, mine in stretches.items()}
    return {step: replace(model, rms=rms[step]) for step, model in models.items()}


def _banded(
    model: NoiseModel, step_s: float, white: float, powers: Real, atoms: Sequence[tuple[float, float]]
) -> NoiseModel:
    """An autoregression of another innovation with bands, their powers in the channel's unit squared."""
    innovation = model.innovation * float(np.sqrt(white))
    bands = tuple(
        Band(frequency_Hz * step_s, memory_s / step_s, float(power) / innovation**2)
        for (frequency_Hz, memory_s), power in zip(atoms, powers, strict=True)
        if power > 0
    )
    return replace(model, innovation=innovation, bands=bands)


def _without_bands(stretch: Real, model: NoiseModel | None) -> Real:
    """A stretch whose power at each line is reduced to the expected share of the autoregression."""
    if model is None or not model.bands:
        return stretch
    lines = np.fft.rfft(stretch)
    passed, level = (table[: lines.size] for table in (model.passed(stretch.size), model.levels(stretch.size)))
    own, share = model.innovation**2 / passed, 1 / level
    power = np.maximum(np.abs(lines) ** 2 / stretch.size, np.maximum(1e-200 * own, 1e-300))  # a line may be empty
    expected = share**2 * power + (1 - share) * own
    rest: Real = np.fft.irfft(lines * np.sqrt(expected / power), stretch.size)
    return rest


def whittle(model: NoiseModel, stretches: Sequence[Real], first: int = 1) -> float:
    """Whittle log-likelihood of a model, less half the logarithm of the number of samples for each coefficient.

    It is that of the lines from ``first`` on, of stretches as for `noise_model`.
    """
    total = -0.5 * model.lost * np.log(sum(stretch.size for stretch in stretches))
    for stretch in stretches:
        lines = slice(first, stretch.size // 2 + 1)
        density = model.innovation**2 * model.levels(stretch.size)[lines] / model.passed(stretch.size)[lines]
        power = np.abs(np.fft.rfft(stretch)[first:]) ** 2 / stretch.size
        total -= float(np.sum(np.log(density) + power / density))
    return float(total)


def repeat_deviations(repeats: Sequence[Real]) -> list[Real]:
    """Deviations of repeats from their mean, scaled to the variance of one recording; empty for a single recording."""
    if len(repeats) < 2:
        return []
    mean = np.mean(repeats, axis=0)
    scale = np.sqrt(len(repeats) / (len(repeats) - 1))
    return [scale * (repeat - mean) for repeat in repeats]
