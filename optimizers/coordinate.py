"""Tuning by hand, as it is done at the bench: one parameter at a time."""

from __future__ import annotations

import numpy as np

from optimizers.base import Real, checked_count
from optimizers.callback import CallbackOptimizer

FINEST = 1e-3
"""Half width of a scan, in parts of the box's, below which nobody reads a generator's display."""
DIGITS = 9
"""Points that agree so far are one; scans that share a value compute it differently."""


class Coordinate(CallbackOptimizer):
    """Coordinate search: a parameter is scanned, its best value kept, and the next one is scanned.

    The usual way to tune a jetting waveform: pulse widths and voltages one after another, a scan over the whole range
    first, then finer ones about what was found; as a method of optimisation, Kolda, Lewis & Torczon, SIAM Rev. 45
    (2003) 385, section 1.2. A round scans all parameters in an order drawn anew; a round without improvement halves the
    width of the scans. Nobody measures twice: waveforms that the search has tried already cost nothing. Scans that have
    become finer than a thousandth of the box end the search, and the next begins at another random point; the first
    begins at the centre.

    Parameters
    ----------
    steps : int
        Values of a scan, at least 2.
    """

    name = "coordinate"

    def __init__(self, dimension: int, budget: int, seed: int, *, steps: int = 9) -> None:
        super().__init__(dimension, budget, seed)
        self._steps = checked_count("steps", steps, least=2)
        self._begun = False

    def search(self) -> None:
        """From one starting point until the scans are too fine."""
        known: dict[tuple[float, ...], float] = {}
        here = self.rng.uniform(-1.0, 1.0, self.dimension) if self._begun else np.zeros(self.dimension)
        self._begun = True
        cost = self._costs(here[None, :], known)[0]
        width = 1.0
        while width >= FINEST:
            before = cost
            for k in self.rng.permutation(self.dimension):
                points = self._scan(here, int(k), width)
                costs = self._costs(points, known)
                best = int(np.argmin(costs))
                if costs[best] < cost:
                    here, cost = points[best], costs[best]
            if cost >= before:
                width /= 2

    def _costs(self, points: Real, known: dict[tuple[float, ...], float]) -> list[float]:
        """Costs of points (n, d): known ones as they were read, the others measured."""
        keys = [tuple(point) for point in np.round(points, DIGITS).tolist()]
        new = [k for k, key in enumerate(keys) if key not in known]
        if new:
            known.update(zip((keys[k] for k in new), self.evaluate(points[new]).tolist(), strict=True))
        return [known[key] for key in keys]

    def _scan(self, here: Real, k: int, width: float) -> Real:
        """Points that differ in one coordinate, over a stretch about where it is, which the box may shift."""
        low = np.clip(here[k] - width, -1.0, 1.0 - 2 * width)
        points = np.tile(here, (self._steps, 1))
        points[:, k] = np.clip(np.linspace(low, low + 2 * width, self._steps), -1.0, 1.0)
        return points
