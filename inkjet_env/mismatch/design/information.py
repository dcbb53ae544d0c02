"""Expected information of recordings about which of several hypotheses holds, with "none of these" among them.

With Gaussian noise, whose size the hypotheses share, the information about the hypothesis is at least
``-Σ p_i ln Σ_j p_j exp(-d²_ij / 8)``, with ``d`` the distance of two predictions in standard deviations: Kolchinsky and
Tracey, Entropy 19 (2017) 361, for the Bhattacharyya distance. What this leaves of the entropy ``-Σ p_i ln p_i`` can be
computed without loss however far the predictions are apart. Independent recordings add their ``d²``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inkjet_env.mismatch.design.predictions import Judged
from inkjet_env.typing import Real


@dataclass(frozen=True)
class Hypotheses:
    """Probabilities of the candidates, and of none of them.

    Parameters
    ----------
    count : int
        Number of candidates, which are equally probable.
    none : float
        Probability that none of them holds.
    pairs : tuple of tuple of int
        Pairs of candidates, in the order of `Judged.separations`.
    """

    count: int
    none: float
    pairs: tuple[tuple[int, int], ...]

    @property
    def probabilities(self) -> Real:
        """Of each candidate, and last of none, shape (count + 1,)."""
        return np.append(np.full(self.count, (1 - self.none) / self.count), self.none)

    def ln_left(self, plan: list[Judged]) -> float:
        """Natural logarithm of the entropy in nats that a plan of recordings is expected to leave, at most."""
        separation = np.zeros((self.count + 1, self.count + 1))
        for judged in plan:
            for (i, j), value in zip(self.pairs, judged.separations, strict=True):
                separation[i, j] += value
            separation[: self.count, self.count] += judged.from_none
        separation += separation.T
        known = self.probabilities > 0
        with np.errstate(divide="ignore"):
            ln_p = np.log(self.probabilities[known])
        separation = separation[np.ix_(known, known)]
        ln_terms = ln_p[None, :] - separation / 4 - ln_p[:, None]
        np.fill_diagonal(ln_terms, -np.inf)
        ln_sum = np.logaddexp.reduce(ln_terms, axis=1)
        with np.errstate(divide="ignore"):  # ln(1 + x) is x where x is small, however small
            ln_each = np.where(ln_sum < -20, ln_sum, np.log(np.log1p(np.exp(np.maximum(ln_sum, -20)))))
        return float(np.logaddexp.reduce(ln_p + ln_each))

    def information_bits(self, plan: list[Judged]) -> float:
        """Expected information of a plan, in bits."""
        return float((np.exp(self.ln_left([])) - np.exp(self.ln_left(plan))) / np.log(2))
