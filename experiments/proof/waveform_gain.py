"""Gain of a diagnosis in printing: the waveforms optimised on each model, tried on the concealed head."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.proof.answering import ConcealedRig
from inkjet_env.experiments.tuning.check import Measured, check_request, measured, seen
from inkjet_env.experiments.tuning.drop_signal import Shown
from inkjet_env.experiments.tuning.proposals import (
    best_of,
    best_points,
    distinct,
    ends_of_searches,
    head_to_use,
    nearby,
    objectives_of,
    refined,
)
from inkjet_env.experiments.tuning.session import TuneSettings
from inkjet_env.optimizers.loop import Objective
from inkjet_env.plant.head_ensemble import ensemble_of
from inkjet_env.plant.printhead_file import printhead_of
from inkjet_env.printhead import Bounds, PeakCost, Printhead, Waveform
from inkjet_env.printhead.window import DEFAULT_WINDOW_S
from inkjet_env.typing import Real

SEARCHES, BUDGET = 3, 2000
"""Number of searches of the corrected head, and evaluations of each; of the plant itself, as many and half of them."""
RISK = "cvar"
"""How the robust waveform is judged on the heads that the recordings leave possible."""


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


def reoptimised_costs(base: Mapping[str, Any], corrected: Mapping[str, Any], plant: Any, seed: int) -> dict[str, Any]:
    """Peak costs on the concealed plant, in volts, of the best waveforms of several models and of the plant itself.

    The oracle's is refined from those of all models and found by searches of its own.

    Parameters
    ----------
    base, corrected : dict
        Base model and corrected head as ``printhead/1``.
    plant : object
        The concealed plant, with ``peak_cost``.
    seed : int
        Seed of the first search; each further one's is one higher.
    """
    truly = PlantObjective(plant)
    points = waveforms_of(base, corrected, seed)
    points["oracle"] = refined(truly, [*points.values(), *ends_of_searches(truly, BUDGET // 2, SEARCHES, seed)])[0]
    costs = {name: float(truly.evaluate(point)[0]) for name, point in points.items()}
    of = objectives(base, corrected)
    foretold = {
        name: float(of[model].evaluate(points[name])[0])
        for name, model in (("base", "base"), ("augmented", "fit"), ("robust", "robust"))
    }
    waveforms = {name: Bounds().from_unit(point).tolist() for name, point in points.items()}
    return {**costs, "foretold": foretold, "waveforms": waveforms}


def checked(
    base: Mapping[str, Any], corrected: Mapping[str, Any], points: Mapping[str, Real], rig: ConcealedRig, order: int
) -> dict[str, Any]:
    """The waveforms of several models tried on the concealed head, as by `inkjet tune`: the best recorded is fired.

    Parameters
    ----------
    base, corrected : dict
        Base model and corrected head as ``printhead/1``.
    points : mapping of str to ndarray
        Waveforms of `waveforms_of`.
    rig : ConcealedRig
        What records them.
    order : int
        Position of the first of these recordings within the session.

    Returns
    -------
    dict
        ``cost``: true peak cost of the chosen waveform in volts; ``chosen``; ``waveforms`` that were checked, by name;
        ``measured``: by name, cost as recorded, its standard error, and what it costs at worst.
    """
    before = printhead_of(base)
    assert isinstance(before, Printhead)
    head = head_to_use(corrected, before)
    problem = Problem("checked", head)
    tried = {name: points[name] for name in distinct({name: points[name] for name in ("robust", "augmented", "base")})}
    shown: list[Shown] = []
    checks: list[Measured] = []

    def check(name: str, point: Real) -> None:
        waveform = Waveform.from_array(Bounds().from_unit(point))
        request = check_request(name, waveform, head.frequency_Hz, DEFAULT_WINDOW_S)
        taken = rig.record(request, order + len(checks))
        shown.append(seen(taken, waveform, head, DEFAULT_WINDOW_S))
        checks.append(measured(shown[-1], head, PeakCost(), DEFAULT_WINDOW_S))

    for name, point in tried.items():
        check(name, point)
    for k in range(TuneSettings().most_refinements):
        if (near := nearby(problem, shown, checks)) is None:
            break
        tried[f"refined-{k + 1}"] = near
        check(f"refined-{k + 1}", near)
    names = list(tried)
    chosen = names[best_of(checks)]
    return {
        "cost": float(PlantObjective(rig.plant).evaluate(tried[chosen])[0]),
        "chosen": chosen,
        "waveforms": {name: Bounds().from_unit(point).tolist() for name, point in tried.items()},
        "measured": {name: [one.cost_V, one.error_V, one.worst_V] for name, one in zip(names, checks, strict=True)},
    }


def objectives(base: Mapping[str, Any], corrected: Mapping[str, Any]) -> dict[str, Objective]:
    """Base model, corrected head, and the heads that remain possible, as functions to minimise."""
    before = printhead_of(base)
    assert isinstance(before, Printhead)
    problem = Problem("proof", head_to_use(corrected, before), ensemble=ensemble_of(corrected), risk=RISK)
    return objectives_of(problem, before, corrected["fit"])


def waveforms_of(base: Mapping[str, Any], corrected: Mapping[str, Any], seed: int) -> dict[str, Real]:
    """The best point in ``[-1, 1]⁷`` of base model, corrected head and the heads that remain possible."""
    points = best_points(objectives(base, corrected), BUDGET, SEARCHES, seed)
    return {"base": points["base"], "augmented": points["fit"], "robust": points["robust"]}
