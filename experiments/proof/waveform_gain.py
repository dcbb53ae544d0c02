"""Gain of a diagnosis in printing: the waveforms optimised on each model, tried on the concealed head."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Bounds, Printhead
from inkjet_env.typing import Real

STARTS, BUDGET = 4, 600
"""Number of searches of one objective, and evaluations of each."""
POLISH = 300
"""Evaluations of a simplex search from the base model's result, and from the best of the other searches."""


class Objective(Protocol):
    """The function to minimise over ``[-1, 1]⁷``."""

    def evaluate(self, points: Real) -> Real:
        """Costs in volts, shape (n,), of points, shape (n, 7)."""


@dataclass(frozen=True)
class PlantObjective:
    """The peak cost of the concealed plant itself.

    Attributes
    ----------
    plant : object
        The concealed plant, with ``peak_cost`` of a waveform of seven parameters.
    """

    plant: Any

    def evaluate(self, points: Real) -> Real:
        """Costs in volts, shape (n,), of points in ``[-1, 1]``, shape (n, 7)."""
        return np.array([self.plant.peak_cost(row) for row in Bounds().from_unit(np.atleast_2d(points))])


def reoptimised_costs(
    base: Printhead | AugmentedPrinthead, augmented: Printhead | AugmentedPrinthead, plant: Any, seed: int
) -> dict[str, Any]:
    """Peak costs on the concealed plant, in volts, of the best waveforms of base model, augmented model and plant.

    All three are searched with the same optimiser, seeds and budget; the latter two also from the base model's
    waveform, which is available before the diagnosis.

    Parameters
    ----------
    base, augmented : Printhead or AugmentedPrinthead
        The two models.
    plant : object
        The concealed plant, with ``peak_cost``.
    seed : int
        Seed of the first search; each further one's is one higher.
    """
    truly = PlantObjective(plant)
    first = searched(Problem("base", base), seed, ())
    found = {"base": first}
    for name, objective in (("augmented", Problem("augmented", augmented)), ("oracle", truly)):
        found[name] = searched(objective, seed, (first,))
    costs = {name: float(truly.evaluate(point)[0]) for name, point in found.items()}
    predicted = {
        "base": float(Problem("base", base).evaluate(first)[0]),
        "augmented": float(Problem("augmented", augmented).evaluate(found["augmented"])[0]),
    }
    waveforms = {name: Bounds().from_unit(point).tolist() for name, point in found.items()}
    return {**costs, "foretold": predicted, "waveforms": waveforms}


def searched(objective: Objective, seed: int, known: Sequence[Real]) -> Real:
    """Best point of several searches, refined by a simplex search from it and from each known point; shape (7,)."""
    from scipy.optimize import minimize

    from inkjet_env import optimizers
    from inkjet_env.optimizers.loop import minimise

    ends = list(known)
    for start in range(STARTS):
        optimizer = optimizers.make("cma-es", budget=BUDGET, seed=seed + start)
        point = minimise(objective, optimizer, BUDGET).best_point
        if point is not None:
            ends.append(point)
    costs = objective.evaluate(np.array(ends))
    candidates = [*known, ends[int(np.argmin(costs))]]
    polished = [
        minimize(
            lambda x: float(objective.evaluate(np.clip(x, -1, 1)[None, :])[0]),
            point,
            method="Nelder-Mead",
            bounds=[(-1.0, 1.0)] * len(point),
            options={"maxfev": POLISH, "initial_simplex": _simplex(point)},
        )
        for point in candidates
    ]
    best = min(polished, key=lambda result: float(result.fun))
    return np.clip(np.asarray(best.x, dtype=np.float64), -1, 1)


def _simplex(point: Real) -> Real:
    """Corners of a simplex, each offset inwards by a twentieth of the box's width, shape (8, 7)."""
    corners = np.repeat(point[None, :], len(point) + 1, axis=0)
    for k in range(len(point)):
        corners[k + 1, k] -= 0.1 if point[k] > 0 else -0.1
    return corners
