"""Waveforms to try on a head: robust, of the fit, of the base model, and one near the best that was checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.tuning.careful_cost import Careful, margin_of
from inkjet_env.experiments.tuning.check import Measured
from inkjet_env.experiments.tuning.drop_signal import ERRORS, Shown
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
LEAST_GAIN = 1e-3
"""Least gain that is worth one more recording, as a fraction of the cost."""


@dataclass(frozen=True)
class Proposal:
    """A waveform that is proposed for a check on the head.

    Attributes
    ----------
    name : {"robust", "fit", "base", "refined"}
        What it is the best of: of all heads that the recordings leave possible, of the corrected head, of the base
        model, or of the corrected head moved by what a check has shown.
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
    problem: Problem,
    base: Printhead,
    fit: Mapping[str, Any],
    budget: int,
    searches: int,
    seed: int,
    progress: Callable[[str], None],
) -> tuple[Proposal, ...]:
    """Up to three waveforms to try, the one to expect most of first.

    Parameters
    ----------
    problem : Problem
        The head as it was fitted, with the ensemble of heads that the recordings leave possible, the risk by which
        they are judged, and the driver's limits.
    base : Printhead
        The base model, identified without any effect: what would be fired without a diagnosis.
    fit : mapping
        Quality of the fit of both, which tells how well they predict the signal; see `careful_cost`.
    budget, searches, seed : int
        Evaluations of each search, number of searches of each objective, and seed of the first.
    progress : callable
        Told what is searched.
    """
    objectives = objectives_of(problem, base, fit)
    points = best_points(objectives, budget, searches, seed, progress)
    ordered = {name: points[name] for name in ("robust", "fit", "base")}
    return tuple(proposal(problem, name, points[name]) for name in distinct(ordered))


def distinct(points: Mapping[str, Real]) -> list[str]:
    """Names of the points in ``[-1, 1]⁷``, in their order, that are not those of one before."""
    chosen: list[str] = []
    for name, point in points.items():
        if all(np.abs(point - points[other]).max() > DISTINCT for other in chosen):
            chosen.append(name)
    return chosen


def objectives_of(problem: Problem, base: Printhead, fit: Mapping[str, Any]) -> dict[str, Objective]:
    """What the waveforms of `proposals` are the best of; the parameters are those of `proposals`.

    Returns
    -------
    dict
        ``base`` and ``fit``: the peak cost of the base model and of the corrected head; ``safe``: that head's careful
        cost; ``robust``: the same of the heads that remain possible.
    """
    plain = replace(problem, ensemble=None)
    margin_V = margin_of(fit, isinstance(problem.printhead, AugmentedPrinthead))
    safe = Careful(plain, margin_V)
    robust = safe if problem.ensemble is None else Careful(problem, margin_V)
    return {"base": replace(plain, printhead=base), "fit": plain, "safe": safe, "robust": robust}


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
    of both and from the safe ones of the corrected head.

    Parameters
    ----------
    objectives : mapping of str to Objective
        Those of `objectives_of`.
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
    progress("searching for the best waveform: robust")
    of_safe = [*of_fit, *best_of_fit, *ends_of_searches(objectives["safe"], budget, searches, seed)]
    safe = refined(objectives["safe"], of_safe)
    points["robust"] = refined(objectives["robust"], [*safe, *best_of_fit, points["base"]], 2, REFINING // 2)[0]
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


def nearby(problem: Problem, shown: Sequence[Shown], checks: Sequence[Measured]) -> Real | None:
    """A point in ``[-1, 1]⁷`` near the best waveform that was checked, to be checked next; None if none promises more.

    It is the best of the problem's head, moved by what that check has shown beyond its prediction.

    Parameters
    ----------
    problem : Problem
        The head as it was fitted, and the driver's limits.
    shown, checks : sequence of Shown and of Measured
        What each check has shown, and what each waveform costs.
    """
    best = best_of(checks)
    objective = Careful(replace(problem, ensemble=None), ERRORS * shown[best].error_V, shown[best])
    point = problem.bounds.to_unit(shown[best].waveform.to_array())
    now_V = float(objective.evaluate(point)[0])
    for _ in range(2):
        point = refined(objective, [point], 1)[0]
    gain_V = now_V - float(objective.evaluate(point)[0])
    return point if gain_V > LEAST_GAIN * abs(now_V) else None


def best_of(checks: Sequence[Measured]) -> int:
    """Index of the waveform to fire: the one with the least risk."""
    return int(np.argmin([check.risk_V for check in checks]))


def proposal(problem: Problem, name: str, point: Real) -> Proposal:
    """The proposal of a point in ``[-1, 1]⁷``, with what it costs on the heads that the recordings leave possible."""
    waveform = problem.bounds.from_unit(point)
    predicted_V = float(replace(problem, ensemble=None).evaluate(point)[0])
    low_V = high_V = predicted_V
    if problem.ensemble is not None:
        costs = problem.ensemble.costs(waveform, problem.cost, problem.initial_state, problem.window_s)[:, 0]
        low_V, high_V = problem.ensemble.quantile(costs, 0.05), problem.ensemble.quantile(costs, 0.95)
    return Proposal(name, tuple(float(v) for v in waveform), predicted_V, low_V, high_V)
