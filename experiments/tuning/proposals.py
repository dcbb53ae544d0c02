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
"""Size of the first simplex of the polishing search, in half widths of the box."""


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
    points: dict[str, Real] = {}
    known: list[Real] = []
    objectives = [("base", replace(plain, printhead=base)), ("fit", plain)]
    objectives += [("robust", problem)] if problem.ensemble is not None else []
    for name, objective in objectives:
        progress(f"searching for the best waveform: {name}")
        points[name] = searched(objective, known, budget, searches, seed)
        known.append(points[name])
    ordered: dict[str, Real] = {name: points[name] for name in ("robust", "fit", "base") if name in points}
    return tuple(_proposal(problem, name, points[name]) for name in distinct(ordered))


def distinct(points: Mapping[str, Real]) -> list[str]:
    """Names of the points in ``[-1, 1]⁷``, in their order, that are not those of one before."""
    chosen: list[str] = []
    for name, point in points.items():
        if all(np.abs(point - points[other]).max() > DISTINCT for other in chosen):
            chosen.append(name)
    return chosen


def searched(objective: Objective, known: Sequence[Real], budget: int, searches: int, seed: int) -> Real:
    """Best point in ``[-1, 1]⁷`` of several searches and of those that are known, each refined by a simplex search."""
    from scipy.optimize import minimize

    from inkjet_env import optimizers
    from inkjet_env.optimizers.loop import minimise

    ends = list(known)
    for k in range(searches):
        found = minimise(objective, optimizers.make("cma-es", budget=budget, seed=seed + k), budget).best_point
        if found is not None:
            ends.append(found)
    order = np.argsort(objective.evaluate(np.array(ends)), kind="stable")
    polished = []
    for k in order[:2]:
        corners = np.repeat(ends[k][None, :], 8, axis=0)
        corners[np.arange(1, 8), np.arange(7)] -= SIMPLEX * np.where(ends[k] > 0, 1.0, -1.0)
        options: dict[str, Any] = {"maxfev": budget // 4, "initial_simplex": corners}
        polished.append(
            minimize(
                lambda x: float(objective.evaluate(np.clip(x, -1, 1)[None, :])[0]),
                ends[k],
                method="Nelder-Mead",
                bounds=[(-1.0, 1.0)] * 7,
                options=options,
            )
        )
    best = min(polished, key=lambda result: float(result.fun))
    return np.clip(np.asarray(best.x, dtype=np.float64), -1.0, 1.0)


def _proposal(problem: Problem, name: str, point: Real) -> Proposal:
    waveform = problem.bounds.from_unit(point)
    predicted_V = float(replace(problem, ensemble=None).evaluate(point)[0])
    low_V = high_V = predicted_V
    if problem.ensemble is not None:
        costs = problem.ensemble.costs(waveform, problem.cost, problem.initial_state, problem.window_s)[:, 0]
        low_V, high_V = problem.ensemble.quantile(costs, 0.05), problem.ensemble.quantile(costs, 0.95)
    return Proposal(name, tuple(float(v) for v in waveform), predicted_V, low_V, high_V)
