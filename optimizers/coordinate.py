"""Manual tuning as it is done in the lab: one parameter at a time."""

from __future__ import annotations

import numpy as np

from inkjet_env.optimizers.base import checked_count
from inkjet_env.optimizers.callback import CallbackOptimizer
from inkjet_env.typing import Real

FINEST = 1e-3
"""Smallest half width of a scan, as a fraction of the box's: below it a generator's display shows no difference."""
DIGITS = 9
"""Decimals to which coordinates are rounded before points are compared: scans compute a shared value differently."""


class Coordinate(CallbackOptimizer):
    """Coordinate search: one parameter is scanned and set to its best value, then the next one is scanned.

    This is the usual way to tune a jetting waveform: pulse widths and voltages one after another, first over the whole
    range, then in finer scans around the best value. As an optimisation method: Kolda, Lewis & Torczon, SIAM Rev. 45
    (2003) 385, section 1.2. A round scans all parameters in a new random order; a round without improvement halves the
    width of the scans. A waveform that the search has already evaluated is not evaluated again. A search ends when its
    scans are finer than a thousandth of the box, and the next starts at another random point; the first starts at the
    centre.

    Parameters
    ----------
    dimension, budget, seed : int
        See `Optimizer`.
    steps : int
        Number of values in a scan, at least 2.
    """

    name = "coordinate"

    def __init__(self, dimension: int, budget: int, seed: int, *, steps: int = 9) -> None:
        super().__init__(dimension, budget, seed)
        self._steps = checked_count("steps", steps, least=2)
        self._begun = False

    def search(self) -> None:
        """Search from one starting point until the scans are finer than `FINEST`."""
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
        """Costs of points, shape (n, d): looked up where known, evaluated otherwise."""
        keys = [tuple(point) for point in np.round(points, DIGITS).tolist()]
        new = [k for k, key in enumerate(keys) if key not in known]
        if new:
            known.update(zip((keys[k] for k in new), self.evaluate(points[new]).tolist(), strict=True))
        return [known[key] for key in keys]

    def _scan(self, here: Real, k: int, width: float) -> Real:
        """Points that differ in coordinate ``k`` only, spread around its present value but shifted into the box."""
        low = np.clip(here[k] - width, -1.0, 1.0 - 2 * width)
        points = np.tile(here, (self._steps, 1))
        points[:, k] = np.clip(np.linspace(low, low + 2 * width, self._steps), -1.0, 1.0)
        return points
