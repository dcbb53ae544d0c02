"""Noise of a channel from the differences between repeats: variance, spectrum, whitening filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.typing import Real

LONGEST_FILTER = 24
"""Highest order of the autoregression."""
FILTER_LENGTHS = (LONGEST_FILTER, 6, 2, 0)
"""Highest orders that are tried together with a colour."""
COLOUR_ROUNDS = 20
"""Largest number of iterations between autoregression and colour."""
SAME_COLOUR = 0.02
"""Relative change below which the colour has converged."""
CORNERS = 40
"""Number of corner frequencies."""
CORNER_MARGIN = 10.0
"""Ratio of the lowest line to the lowest corner frequency."""
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
    colour : tuple of float
        ``s0, s1, s2``: at ν cycles per sample the power of the autoregression is multiplied by ``s0``, and the power
        ``s1/ν + s2/ν²`` of 1/f noise and a random walk, in units of the innovation's, is added; ``(1, 0, 0)`` if the
        autoregression suffices. 1/f noise is strongest at the lowest frequencies, which a short filter cannot resolve
        and on which a slow loop depends.
    """

    coefficients: Real
    innovation: float
    rms: float
    source: str
    colour: tuple[float, float, float] = (1.0, 0.0, 0.0)

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

    def levels(self, samples: int) -> Real:
        """Power of whitened noise at each line of a discrete Fourier transform, shape (samples,).

        The mean has the power of the first line.
        """
        cycles = np.maximum(np.abs(np.fft.fftfreq(samples)), 1 / samples)
        return self._level(cycles, self.passed(samples))

    def passed(self, samples: int) -> Real:
        """Power of the filter's transfer function at each line of a discrete Fourier transform, shape (samples,)."""
        power: Real = np.abs(np.fft.fft(self.coefficients, max(samples, self.coefficients.size))[:samples]) ** 2
        return power

    def _level(self, cycles_a_sample: Real, passed: Real) -> Real:
        white, flicker, wander = self.colour
        return white + passed * (flicker / cycles_a_sample + wander / cycles_a_sample**2)

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
        The model, with no colour beyond the autoregression.
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


def colour_of(
    whitened: Sequence[tuple[Real, NoiseModel]], exponents: tuple[int, ...] = (1, 2)
) -> tuple[float, float, float]:
    """Colour of noise: ``s0`` times an autoregression's power, plus ``s1/ν + s2/ν²`` of 1/f noise and a random walk.

    Corner frequencies of ``a (1 + ν_c/ν)`` and ``a (1 + (ν_c/ν)²)`` are weighted by Whittle's likelihood of the
    periodograms. The white level is the weighted mean, the other two strengths are weighted geometric means. A short
    record can hardly distinguish weak 1/f noise from none, and so some remains.

    Parameters
    ----------
    whitened : sequence of (ndarray, NoiseModel)
        Whitened stretches of noise, each with the model that whitened it. Sampling steps may differ: the 1/f noise of
        one amplifier in the same white noise looks the same in cycles per sample.
    exponents : tuple of int
        Powers of ``1/ν`` that are considered: 1 is 1/f noise, 2 a random walk.

    Returns
    -------
    tuple of float
        ``s0, s1, s2``; see `NoiseModel`.
    """
    lines = np.concatenate([np.fft.rfftfreq(stretch.size)[1:] for stretch, _ in whitened])
    passed = np.concatenate([model.passed(stretch.size)[1 : stretch.size // 2 + 1] for stretch, model in whitened])
    power = np.concatenate([np.abs(np.fft.rfft(stretch)[1:]) ** 2 / stretch.size for stretch, _ in whitened])
    corners = np.geomspace(lines.min() / CORNER_MARGIN, 0.5, CORNERS)
    likelihoods, levels = np.full((2, CORNERS), -np.inf), np.ones((2, CORNERS))
    for i, exponent in ((exponent - 1, exponent) for exponent in exponents):
        for j, corner in enumerate(corners):
            shape = 1 + passed * (corner / lines) ** exponent
            levels[i, j] = level = float(np.mean(power / shape))
            likelihoods[i, j] = -float(np.sum(np.log(level * shape)))
    weights = np.exp(likelihoods - likelihoods.max())
    weights /= weights.sum()
    white = float(np.sum(weights * levels))
    share = weights.sum(axis=1)
    strength = np.log(levels * corners ** np.array([[1], [2]]))
    flicker, wander = share * np.exp(np.sum(weights * strength, axis=1) / np.maximum(share, 1e-300))
    return white, float(flicker), float(wander)


def channel_noise(
    stretches: Mapping[float, Sequence[Real]],
    sources: Mapping[float, str],
    least: float,
    exponents: tuple[int, ...] = (1, 2),
) -> dict[float, NoiseModel]:
    """Noise models of one channel by sampling step: an autoregression for each, one colour for all.

    A sufficiently long autoregression imitates 1/f noise except at its lowest lines, on which a slow loop depends. So
    filters of several lengths are fitted in alternation with the colour, each to the expected remainder of the other
    (Dempster, Laird & Rubin 1977). The pair with the largest Whittle likelihood, penalised for its number of
    coefficients, is taken.

    Parameters
    ----------
    stretches : mapping of float to sequence of ndarray
        Stretches of noise about zero by sampling step in seconds, as for `noise_model`.
    sources : mapping of float to str
        Data the stretches come from, in words, by sampling step.
    least : float
        Smallest RMS, in the channel's unit; see `noise_model`.
    exponents : tuple of int
        Powers of ``1/ν`` that the colour may have; see `colour_of`.

    Returns
    -------
    dict of float to NoiseModel
        Noise model by sampling step in seconds.
    """
    best, best_score = {}, -np.inf
    for longest in FILTER_LENGTHS:
        models: dict[float, NoiseModel] = {}
        colour = (1.0, 0.0, 0.0)
        for _ in range(COLOUR_ROUNDS):
            models = {
                step: noise_model([_without_colour(s, models.get(step)) for s in mine], sources[step], least, longest)
                for step, mine in stretches.items()
            }
            loud = {step: model for step, model in models.items() if model.rms > least}
            if not loud:
                return models
            before = colour
            colour = colour_of(
                [(m.whitened(s[:, None])[:, 0], m) for step, m in loud.items() for s in stretches[step]], exponents
            )
            models |= {step: replace(model, colour=colour) for step, model in loud.items()}
            if np.allclose(colour, before, rtol=SAME_COLOUR, atol=0):
                break
        rms = {step: float(np.sqrt(np.mean(np.concatenate(stretches[step]) ** 2))) for step in loud}
        models |= {step: replace(models[step], rms=rms[step]) for step in loud}
        score = sum(_whittle(models[step], stretches[step]) for step in loud)
        if score > best_score:
            best, best_score = models, score
        if all(model.lost == 0 for model in loud.values()):
            break  # shorter filters give the same model
    return best


def _without_colour(stretch: Real, model: NoiseModel | None) -> Real:
    """A stretch whose power at each line is reduced to the expected share of the autoregression."""
    if model is None or model.colour == (1.0, 0.0, 0.0):
        return stretch
    lines = np.fft.rfft(stretch)
    passed, level = (table[: lines.size] for table in (model.passed(stretch.size), model.levels(stretch.size)))
    own, share = model.colour[0] * model.innovation**2 / passed, model.colour[0] / level
    power = np.maximum(np.abs(lines) ** 2 / stretch.size, np.maximum(1e-200 * own, 1e-300))  # a line may be empty
    expected = share**2 * power + (1 - share) * own
    rest: Real = np.fft.irfft(lines * np.sqrt(expected / power), stretch.size)
    return rest


def _whittle(model: NoiseModel, stretches: Sequence[Real]) -> float:
    """Whittle log-likelihood of a model, less half the logarithm of the number of samples for each coefficient."""
    total = -0.5 * model.lost * np.log(sum(stretch.size for stretch in stretches))
    for stretch in stretches:
        lines = slice(1, stretch.size // 2 + 1)
        density = model.innovation**2 * model.levels(stretch.size)[lines] / model.passed(stretch.size)[lines]
        power = np.abs(np.fft.rfft(stretch)[1:]) ** 2 / stretch.size
        total -= float(np.sum(np.log(density) + power / density))
    return float(total)


def repeat_deviations(repeats: Sequence[Real]) -> list[Real]:
    """Deviations of repeats from their mean, scaled to the variance of one recording; empty for a single recording."""
    if len(repeats) < 2:
        return []
    mean = np.mean(repeats, axis=0)
    scale = np.sqrt(len(repeats) / (len(repeats) - 1))
    return [scale * (repeat - mean) for repeat in repeats]
