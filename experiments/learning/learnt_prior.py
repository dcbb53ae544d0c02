"""Bayesian optimisation whose prior is learnt from heads: what a waveform costs on one head tells what others cost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import ndtr

from inkjet_env.envs.tune_waveform import NOISE_V
from inkjet_env.experiments.learning.heads import TRAIN_SEED, Heads, drawn, stretched
from inkjet_env.experiments.learning.learners import labelled
from inkjet_env.typing import Real

LABELLED = 100_000
"""Evaluations spent on the best waveforms of some heads, from which the candidates are made."""
RESONANCES = 9
"""Each of them is stretched to so many resonances, evenly over their range."""
SAMPLED = 1000
"""Number of heads over which means and covariances of the costs are taken."""


class LearntPriorOptimiser:
    """Fires the candidate with the largest expected improvement; the costs of all candidates are jointly Gaussian.

    Their means and covariances are those over sampled heads: Z. Wang, B. Kim, L. P. Kaelbling, "Regret bounds for meta
    Bayesian optimization with an unknown Gaussian process prior", NeurIPS 2018.

    Parameters
    ----------
    points : ndarray, shape (n, 7)
        Candidates, in ``[-1, 1]``.
    mean_V : ndarray, shape (n,)
        Mean cost of each, in volts.
    covariance_V2 : ndarray, shape (n, n)
        Covariances of the costs, in V².
    noise_V : float
        Standard deviation of an error of a reading, in volts.
    """

    def __init__(self, points: Real, mean_V: Real, covariance_V2: Real, noise_V: float) -> None:
        self.points, self.mean_V, self.covariance_V2, self.noise_V = points, mean_V, covariance_V2, noise_V
        self.fired: list[list[int]] = []
        self.read_V: list[list[float]] = []

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """The candidate to try next on each head, shape (n, 7)."""
        if not self.fired:
            self.fired, self.read_V = [[] for _ in observations], [[] for _ in observations]
        for fired, read_V in zip(self.fired, self.read_V, strict=True):
            fired.append(int(self._improvement_V(fired, read_V).argmax()))
        return self.points[[fired[-1] for fired in self.fired]]

    def tell(self, readings: Real) -> None:
        """Report the measured costs in volts, shape (n,)."""
        for read_V, reading_V in zip(self.read_V, readings, strict=True):
            read_V.append(float(reading_V))

    def _improvement_V(self, fired: list[int], read_V: list[float]) -> Real:
        """Expected improvement of every candidate over the lowest reading, and over firing nothing, in volts."""
        mean_V, variance_V2 = self.mean_V, np.diag(self.covariance_V2)
        if fired:
            across = self.covariance_V2[:, fired]
            known = cho_factor(across[fired] + self.noise_V**2 * np.eye(len(fired)))
            mean_V = mean_V + across @ cho_solve(known, np.array(read_V) - self.mean_V[fired])
            variance_V2 = variance_V2 - np.einsum("ij,ji->i", across, cho_solve(known, across.T))
        deviation_V = np.sqrt(np.maximum(variance_V2, 1e-12))
        better_V = min([0.0, *read_V]) - mean_V
        score = better_V / deviation_V
        density = np.exp(-(score**2) / 2) / np.sqrt(2 * np.pi)
        return np.asarray(better_V * ndtr(score) + deviation_V * density)


def learnt_prior(seed: int, sampled: int = SAMPLED, evaluations: int = LABELLED) -> tuple[LearntPriorOptimiser, int]:
    """The optimiser with a prior from heads that are drawn with a seed, and the evaluations that this took."""
    observations, best, spent = labelled(evaluations, seed)
    resonances = np.zeros((RESONANCES, 4))
    resonances[:, 0] = np.linspace(-1.0, 1.0, RESONANCES)
    points = np.concatenate([stretched(best, observations, np.tile(one, (len(best), 1))) for one in resonances])
    heads = Heads(drawn(sampled, TRAIN_SEED + seed))
    costs_V = np.array([heads.evaluate(np.tile(point, (sampled, 1))) for point in points])
    return LearntPriorOptimiser(points, costs_V.mean(axis=1), np.cov(costs_V), NOISE_V), spent + costs_V.size
