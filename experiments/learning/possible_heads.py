"""Heads that remain possible after some tries: each is judged by how well it predicts the peaks that were read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from inkjet_env.envs.given_heads import GivenHeads
from inkjet_env.envs.task import Readings, WaveformTask
from inkjet_env.envs.waveform_tuning_task import LARGEST, PEAK_SCALE_V, TIME_SCALE_S
from inkjet_env.plant.head_ensemble import HeadEnsemble
from inkjet_env.typing import Real

HEIGHT_TOLERANCE_V, TIME_TOLERANCE_S = 0.01, 0.1e-6
"""Errors of a prediction in volts, beside those of reading, and in seconds; times are read without errors."""
PARTICLES = 500
"""Number of heads that represent what a drawn head may be."""
EFFECTIVE = 0.1
"""Smallest effective share of the particles; where fewer would count, the likelihood is flattened."""
ROUNDS = 20
"""Largest number of times that particles are drawn anew after a try."""
SETTLED = 0.9
"""Share of the previous round's misfit above which a further round is not worth it."""
BEYOND, FARTHEST = 0.25, 2.0
"""Standard deviation with which the prior falls off beyond the range of heads, and its end, in half ranges from the
middle: somebody else's head may lie outside."""
UNLIKELY = 0.01
"""Share of the weight of the likeliest head below which a head is no longer counted."""


@dataclass(frozen=True, eq=False)
class Try:
    """A waveform that was fired, and the peaks that were read.

    Parameters
    ----------
    waveform : ndarray, shape (7,)
        In volts and seconds.
    heights_V, times_s : ndarray, shape (peaks,)
        The first peaks, as in an observation: zeros if there are fewer.
    """

    waveform: Real
    heights_V: Real
    times_s: Real

    @property
    def numbers(self) -> int:
        """Number of heights and times that were read, at least 1."""
        return max(1, 2 * int(np.count_nonzero(self.times_s)))

    def misfits(self, predicted: Readings, noise_V: float) -> Real:
        """Sums of squared errors of predictions without noise, in their standard deviations, shape (heads,)."""
        heights_V, times_s = predicted.first(self.heights_V.size)
        heights_V = np.clip(heights_V, -LARGEST * PEAK_SCALE_V, LARGEST * PEAK_SCALE_V)
        times_s = np.minimum(times_s, LARGEST * TIME_SCALE_S)
        errors = (heights_V - self.heights_V) / np.hypot(noise_V, HEIGHT_TOLERANCE_V)
        late = (times_s - self.times_s) / TIME_TOLERANCE_S
        return np.asarray((errors**2).sum(axis=1) + (late**2).sum(axis=1))


class PossibleHeads(Protocol):
    """Heads that may be on the bench."""

    def observe(self, one: Try) -> None:
        """Take into account what was read in a further try."""

    def heads(self, most: int) -> HeadEnsemble:
        """The heads that remain possible with their weights, as a rule not more than ``most``."""


def inflation(misfits: Real, numbers: int) -> float:
    """Factor of the variance with which the best head explains the readings, at least 1: the squared Birge ratio.

    Where no head explains the readings to their errors, the errors are taken to be as large as the best head's.
    """
    return max(1.0, float(misfits.min()) / numbers)


class ListedHeads:
    """Heads of a list, each with a weight: what a diagnosis leaves possible.

    Parameters
    ----------
    given : GivenHeads
        The heads, with tasks without noise.
    noise_V : float
        Standard deviation of an error of reading, in volts.
    """

    def __init__(self, given: GivenHeads, noise_V: float) -> None:
        self.given, self.noise_V = given, noise_V
        self.misfits, self.numbers = np.zeros(len(given.tasks)), 0

    def observe(self, one: Try) -> None:
        """Add the misfits of every head in this try."""
        every = np.arange(len(self.given.tasks))
        predicted = self.given.read(every, np.tile(one.waveform, (every.size, 1)), ())
        self.misfits = self.misfits + one.misfits(predicted, self.noise_V)
        self.numbers += one.numbers

    def heads(self, most: int) -> HeadEnsemble:
        """The heads whose weight is not negligible, the likeliest first; not more than ``most``."""
        scale = inflation(self.misfits, self.numbers) if self.numbers else 1.0
        weights = np.array(self.given.ensemble.weights) * np.exp(-(self.misfits - self.misfits.min()) / (2 * scale))
        order = np.argsort(-weights, kind="stable")[:most]
        counted = order[weights[order] >= UNLIKELY * weights[order[0]]]
        return HeadEnsemble(tuple(self.given.ensemble.heads[k] for k in counted), tuple(weights[counted]))


class DrawnHeads:
    """Heads drawn around a base model, as the environment does or beyond: a cloud of them follows what is read.

    Nonlinear population Monte Carlo (Koblents & Míguez, Stat. Comput. 2015): particles are weighted by their likelihood
    over the density from which they were drawn, raised to a power at which enough of them count, and drawn anew from
    a kernel density estimate with these weights, until the power is 1.

    Parameters
    ----------
    task : WaveformTask
        Task with heads drawn at random, without noise.
    noise_V : float
        Standard deviation of an error of reading, in volts.
    rng : Generator
        Of the particles.
    """

    def __init__(self, task: WaveformTask, noise_V: float, rng: np.random.Generator) -> None:
        self.task, self.noise_V, self.rng = task, noise_V, rng
        self.tries: list[Try] = []
        self.contexts = rng.uniform(-1.0, 1.0, (PARTICLES, 4))
        self.log_density = np.zeros(PARTICLES)
        self.weights = np.full(PARTICLES, 1 / PARTICLES)

    def observe(self, one: Try) -> None:
        """Weigh the particles by all tries, and draw them anew until enough of them are likely."""
        from scipy.stats import gaussian_kde

        self.tries.append(one)
        before = np.inf
        for _ in range(ROUNDS):
            misfits = self._misfits()
            scale = inflation(misfits, sum(one.numbers for one in self.tries))
            power, self.weights = flattened(self._log_prior() - misfits / (2 * scale) - self.log_density)
            if power == 1 and (scale == 1 or scale > SETTLED * before):
                return
            before = scale
            counted = self.weights > 0  # the logarithm of the others would spoil the density
            density = gaussian_kde(self.contexts[counted].T, weights=self.weights[counted])
            self.contexts = density.resample(PARTICLES, seed=self.rng).T
            self.log_density = density.logpdf(self.contexts.T)
        _, self.weights = flattened(self._log_prior() - self._misfits() / (2 * before) - self.log_density)

    def _log_prior(self) -> Real:
        """Logarithm of the prior but for a constant: even within the range, and falling beyond."""
        outside = np.maximum(np.abs(self.contexts) - 1.0, 0.0)
        prior = -0.5 * ((outside / BEYOND) ** 2).sum(axis=1)
        return np.where((np.abs(self.contexts) <= FARTHEST).all(axis=1), prior, -np.inf)

    def _misfits(self) -> Real:
        inside = np.clip(self.contexts, -FARTHEST, FARTHEST)
        heads, total = self.task.heads(inside), np.zeros(len(inside))
        for one in self.tries:
            predicted = self.task.read(np.tile(one.waveform, (len(inside), 1)), heads, (), 1)
            total += one.misfits(predicted, self.noise_V)
        return total

    def heads(self, most: int) -> HeadEnsemble:
        """So many draws of the particles by their weights; one head for equal draws."""
        draws, counts = np.unique(self.rng.choice(PARTICLES, most, p=self.weights), return_counts=True)
        heads = tuple(self.task.head(self.contexts[k]) for k in draws)
        return HeadEnsemble(heads, tuple(counts))


def flattened(log_weights: Real) -> tuple[float, Real]:
    """The largest power, up to 1, at which the effective share of weights is `EFFECTIVE`; these weights, of sum 1.

    Parameters
    ----------
    log_weights : ndarray, shape (n,)
        Their logarithms; minus infinity where the weight is zero.
    """

    possible = np.isfinite(log_weights)

    def at(power: float) -> Real:
        weights = np.zeros_like(log_weights)
        weights[possible] = np.exp(power * (log_weights[possible] - log_weights.max()))
        return np.asarray(weights / weights.sum())

    low, high = 0.0, 1.0
    if 1 / (at(1.0) ** 2).sum() >= EFFECTIVE * log_weights.size:
        return 1.0, at(1.0)
    for _ in range(50):
        middle = (low + high) / 2
        if 1 / (at(middle) ** 2).sum() >= EFFECTIVE * log_weights.size:
            low = middle
        else:
            high = middle
    return low, at(low)
