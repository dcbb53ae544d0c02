"""Waveforms to try on a head: the robust one, that of the fit, and that of the base model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.optimizers.loop import Objective
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.printhead_file import printhead_of
from inkjet_env.printhead import Printhead, Waveform
from inkjet_env.typing import Real

DISTINCT = 0.02
"""Smallest distance, in half widths of the box, between two waveforms that are both worth a recording."""
SIMPLEX = 0.1
"""Size of the first simplex of a refining search, in half widths of the box."""
REFINED, REFINING = 4, 400
"""Number of points that are refined, and evaluations of each refining search."""
BASE_SEARCHES = 8
"""Searches of the base model, for each of the corrected head's."""


@dataclass(frozen=True)
class Proposal:
    """A waveform that is proposed for a check on the head.

    Attributes
    ----------
    name : {"robust", "fit", "base"}
        What it is the best of: of all heads that the recordings leave possible, of the corrected head, or of the base
        model.
    waveform : tuple of 7 floats
        ``U1 U2`` in volts, ``t1 … t5`` in seconds.
    predicted_V, low_V, high_V : float
        Cost on the corrected head, and the range that holds it with 90 % on the heads that recordings leave possible.
    """

    name: str
    waveform: tuple[float, ...]
    predicted_V: float
    low_V: float
    high_V: float

    @property
    def as_waveform(self) -> Waveform:
        """The waveform itself."""
        return Waveform.from_array(self.waveform)


def head_to_use(data: Mapping[str, Any], base: Printhead) -> Printhead | AugmentedPrinthead:
    """The corrected head of a ``printhead/1``; the base model where it predicts held-out recordings no better."""
    fit = data["fit"]
    before, after = fit.get("base_heldout_rms_V"), fit.get("augmented_heldout_rms_V")
    head = printhead_of(data)
    if isinstance(head, AugmentedPrinthead) and head.effects and before and after and after >= before:
        return base
    return head


def proposals(
    problem: Problem, base: Printhead, budget: int, searches: int, seed: int, progress: Callable[[str], None]
) -> tuple[Proposal, ...]:
    """Up to three waveforms to try, the one to expect most of first.

    Parameters
    ----------
    problem : Problem
        The head as it was fitted, with the ensemble of heads that the recordings leave possible, the risk by which
        they are judged, and the driver's limits.
    base : Printhead
        The base model, identified without any effect: what would be fired without a diagnosis.
    budget, searches, seed : int
        Evaluations of each search, number of searches of each objective, and seed of the first.
    progress : callable
        Told what is searched.
    """
    plain = replace(problem, ensemble=None)
    objectives: dict[str, Objective] = {"base": replace(plain, printhead=base), "fit": plain}
    if problem.ensemble is not None:
        objectives["robust"] = problem
    points = best_points(objectives, budget, searches, seed, progress)
    ordered: dict[str, Real] = {name: points[name] for name in ("robust", "fit", "base") if name in points}
    return tuple(_proposal(problem, name, points[name]) for name in distinct(ordered))


def distinct(points: Mapping[str, Real]) -> list[str]:
    """Names of the points in ``[-1, 1]⁷``, in their order, that are not those of one before."""
    chosen: list[str] = []
    for name, point in points.items():
        if all(np.abs(point - points[other]).max() > DISTINCT for other in chosen):
            chosen.append(name)
    return chosen


def best_points(
    objectives: Mapping[str, Objective],
    budget: int,
    searches: int,
    seed: int,
    progress: Callable[[str], None] = lambda text: None,
) -> dict[str, Real]:
    """Best points in ``[-1, 1]⁷`` of base model, corrected head and the heads that remain possible.

    Each model has many local optima, close to those of the others. The base model is searched most often, because it is
    the fastest by far; the corrected head is refined from all of its optima too, and the robust waveform from the best
    of both.

    Parameters
    ----------
    objectives : mapping of str to Objective
        ``base``, ``fit`` and, optionally, ``robust``.
    budget, searches, seed : int
        Evaluations of a search, number of searches of the corrected head, and seed of the first.
    progress : callable
        Told what is searched.
    """
    progress("searching for the best waveform: base")
    of_base = ends_of_searches(objectives["base"], budget, BASE_SEARCHES * searches, seed)
    points = {"base": refined(objectives["base"], of_base)[0]}
    progress("searching for the best waveform: fit")
    of_fit = [*of_base, points["base"], *ends_of_searches(objectives["fit"], budget, searches, seed)]
    best_of_fit = refined(objectives["fit"], of_fit)
    points["fit"] = best_of_fit[0]
    if "robust" in objectives:
        progress("searching for the best waveform: robust")
        points["robust"] = refined(objectives["robust"], [*best_of_fit, points["base"]], 2, REFINING // 2)[0]
    return points


def searched(objective: Objective, known: Sequence[Real], budget: int, searches: int, seed: int) -> Real:
    """Best point in ``[-1, 1]⁷`` of several searches and of those that are known, refined."""
    return refined(objective, [*known, *ends_of_searches(objective, budget, searches, seed)], 2, budget // 4)[0]


def ends_of_searches(objective: Objective, budget: int, searches: int, seed: int) -> list[Real]:
    """Best point of each of several searches with CMA-ES."""
    from inkjet_env import optimizers
    from inkjet_env.optimizers.loop import minimise

    found = []
    for k in range(searches):
        end = minimise(objective, optimizers.make("cma-es", budget=budget, seed=seed + k), budget).best_point
        if end is not None:
            found.append(end)
    return found


def refined(
    objective: Objective, points: Sequence[Real], count: int = REFINED, evaluations: int = REFINING
) -> list[Real]:
    """The best so many of these points, each refined by a simplex search; best first."""
    from scipy.optimize import minimize

    order = np.argsort(objective.evaluate(np.array(points)), kind="stable")
    found = []
    for k in order[:count]:
        corners = np.repeat(points[k][None, :], 8, axis=0)
        corners[np.arange(1, 8), np.arange(7)] -= SIMPLEX * np.where(points[k] > 0, 1.0, -1.0)
        options: dict[str, Any] = {"maxfev": evaluations, "initial_simplex": corners}
        found.append(
            minimize(
                lambda x: float(objective.evaluate(np.clip(x, -1, 1)[None, :])[0]),
                points[k],
                method="Nelder-Mead",
                bounds=[(-1.0, 1.0)] * 7,
                options=options,
            )
        )
    found.sort(key=lambda result: float(result.fun))
    return [np.clip(np.asarray(result.x, dtype=np.float64), -1.0, 1.0) for result in found]


def _proposal(problem: Problem, name: str, point: Real) -> Proposal:
    waveform = problem.bounds.from_unit(point)
    predicted_V = float(replace(problem, ensemble=None).evaluate(point)[0])
    low_V = high_V = predicted_V
    if problem.ensemble is not None:
        costs = problem.ensemble.costs(waveform, problem.cost, problem.initial_state, problem.window_s)[:, 0]
        low_V, high_V = problem.ensemble.quantile(costs, 0.05), problem.ensemble.quantile(costs, 0.95)
    return Proposal(name, tuple(float(v) for v in waveform), predicted_V, low_V, high_V)
