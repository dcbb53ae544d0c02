"""The best waveform known of each problem, by a long multi-start search on the exact gradient where there is one.

``python -m experiments.best_known`` writes `best_known.json`, against which the comparison's regrets are measured.
The cost has many local optima and breaks where a peak appears, so gradient descent alone stops on the breaks: the
best of its ends are polished by random steps and by CMA-ES, neither of which needs a gradient. Heads with effects have
none, and are a hundred times slower: there CMA-ES takes the descent's place, and less is polished.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import optimizers
from experiments.problems import BEST_KNOWN_FILE, Problem
from experiments.suite import problem, suite
from inkjet_env.storage import write_json
from optimizers.loop import minimise

ROUNDING = 1e-9
MOST_PASSES, GAINED_V = 5, 1e-7
SCREENED_PER_START = 64
DESCENT_EVALUATIONS = 1500


@dataclass(frozen=True)
class Effort:
    """How much is polished: the best ends of the descents, and rounds of random steps for each step's first size."""

    polished: int
    rounds: int


BY_GRADIENT, WITHOUT = Effort(256, 4000), Effort(24, 500)


def screened_starts(problem: Problem, starts: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Starting points in ``[-1, 1]⁷``, shape (starts, 7): half the best of many Sobol points, half any of them."""
    from scipy.stats import qmc

    count = 1 << int(np.ceil(np.log2(starts * SCREENED_PER_START)))
    points = qmc.scale(qmc.Sobol(7, rng=rng).random(count), -np.ones(7), np.ones(7))
    order = np.argsort(problem.evaluate(points), kind="stable")
    best = order[: starts // 2]
    others = rng.choice(order[starts // 2 :], starts - best.size, replace=False)
    return points[np.concatenate([best, others])]


def descend(problem: Problem, start: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """L-BFGS-B from one start on the exact gradient within the box: the end point and its cost in volts."""
    from scipy.optimize import minimize

    def value_and_slope(point: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        costs, gradients = problem.evaluate_with_gradient(point)
        return float(costs[0]), gradients[0]

    end = minimize(value_and_slope, start, jac=True, method="L-BFGS-B", bounds=[(-1.0, 1.0)] * start.size)
    return end.x, float(end.fun)


def descend_without(problem: Problem, start: NDArray[np.float64], seed: int) -> tuple[NDArray[np.float64], float]:
    """CMA-ES from one start: the best point of so many evaluations, and its cost in volts."""
    optimizer = optimizers.make("cma-es", 7, DESCENT_EVALUATIONS, seed, start=start.tolist(), first_step=0.2)
    run = minimise(problem, optimizer, DESCENT_EVALUATIONS)
    best: int = int(np.argmin(run.costs))
    return run.points[best].copy(), float(run.costs[best])


def polished(
    problem: Problem | Settled, points: NDArray[np.float64], rounds: int, rng: np.random.Generator, step: float = 0.05
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Improve many points side by side by random steps; each adapts its step to one success in five.

    Returns
    -------
    points : ndarray, shape (n, 7)
    costs : ndarray, shape (n,)
        In volts; none is worse than it was.
    """
    points = points.copy()
    costs = problem.evaluate(points)
    steps = np.full(len(points), step)
    for _ in range(rounds):
        # Half the coordinates move at a time, so that one at its bound does not hold the others back.
        moves = rng.standard_normal(points.shape) * (rng.random(points.shape) < 0.5)
        trials = np.clip(points + steps[:, None] * moves, -1.0, 1.0)
        trial_costs = problem.evaluate(trials)
        better = trial_costs < costs
        points[better], costs[better] = trials[better], trial_costs[better]
        steps = np.clip(steps * np.where(better, 1.5, 1.5**-0.25), 1e-10, 0.5)
    return points, costs


class Settled:
    """A problem whose cost is the worst within a rounding: what a waveform costs that lies on a break is no luck.

    The best waveforms lie where a peak is about to appear; there, whoever rounds otherwise sees it.
    """

    def __init__(self, problem: Problem, rng: np.random.Generator) -> None:
        self.problem = problem
        self.moves = ROUNDING * rng.choice([-1.0, 1.0], (4, 7))

    def evaluate(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Costs in volts, shape (n,), of points (n, 7)."""
        worst: NDArray[np.float64] = np.max(
            [self.problem.evaluate(np.clip(points + move, -1.0, 1.0)) for move in self.moves], axis=0
        )
        return worst


def valley_polished(problem: Problem, point: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """CMA-ES about one point, within the box: it learns the direction of a narrow valley along a break."""
    import warnings

    import cma

    cost = float(problem.evaluate(point)[0])
    for sigma in (0.05, 5e-3):
        options = {
            "bounds": [-1.0, 1.0],
            "popsize": 32,
            "maxfevals": 20_000,
            "tolfun": 1e-11,
            "seed": seed,
            "verbose": -9,
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # its advice on the bounds
            strategy = cma.CMAEvolutionStrategy(point, sigma, options)
            while not strategy.stop():
                points = np.clip(strategy.ask(), -1.0, 1.0)
                costs = problem.evaluate(points)
                strategy.tell(points, costs.tolist())
                if costs.min() < cost:
                    point, cost = points[int(np.argmin(costs))], float(costs.min())
    return point


def search(problem: Problem, starts: int, seed: int, known: tuple[float, ...] | None = None) -> dict[str, Any]:
    """Search one problem, on from the best waveform known if there is one: the entry of `best_known.json`."""
    settings = problem.settings()
    problem = replace(problem, reading_V=0.0)  # what is best does not hang on how it is read
    rng = np.random.default_rng(seed)
    effort = BY_GRADIENT if problem.has_gradient else WITHOUT
    descents = [
        descend(problem, start) if problem.has_gradient else descend_without(problem, start, k)
        for k, start in enumerate(screened_starts(problem, starts, rng))
    ]
    ends = np.array([point for point, _ in descents])
    costs = problem.evaluate(ends)
    by_descent = float(costs.min())
    best = ends[np.argsort(costs, kind="stable")[: effort.polished]]
    candidates, costs = polished(problem, best, effort.rounds, rng)
    order = np.argsort(costs, kind="stable")[:8]
    finalists = np.array([valley_polished(problem, point, seed + 1) for point in candidates[order]])
    finalists = np.vstack([finalists, candidates[order]])
    settled = Settled(problem, rng)
    if known is not None:
        finalists = np.vstack([finalists, problem.bounds.to_unit(known)])
    before = math.inf
    for _ in range(MOST_PASSES):
        for step in (0.05, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6):  # steps die out along a break; begin again, smaller each time
            finalists, costs = polished(settled, finalists, effort.rounds, rng, step)
        if before - costs.min() < GAINED_V:
            break
        before = float(costs.min())
    winner = int(np.argmin(costs))
    waveform = problem.bounds.from_unit(finalists[winner])
    winning = problem.bounds.to_unit(waveform)
    response = problem.respond(winning)
    descent = "L-BFGS-B on the exact gradient" if problem.has_gradient else "CMA-ES"
    found_by = (
        f"{descent} from {starts} starts (half the best of "
        f"{SCREENED_PER_START * starts} or more Sobol points, half any of them; it reached {by_descent:.6f} V), "
        f"the best {min(effort.polished, starts)} ends polished by random steps and CMA-ES"
    )
    return {
        "problem": settings,
        "cost_V": float(problem.evaluate(winning)[0]),
        "waveform": [float(v) for v in waveform],
        "peaks_V": [float(v) for v in response.peaks_V[:6]],
        "found_by": found_by,
        "starts": starts,
        "seed": seed,
    }


def main(arguments: list[str] | None = None) -> None:
    """Search the chosen problems; keep an entry that is better already, unless its problem has changed since."""
    from importlib.metadata import version

    parser = argparse.ArgumentParser(prog="python -m experiments.best_known", description=__doc__)
    parser.add_argument(
        "--problem", action="append", choices=list(suite()), help="name of a problem; all of the suite unless given"
    )
    parser.add_argument("--starts", type=int, default=2000, help="descents per problem")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    if chosen.starts < 2:
        parser.error(f"--starts must be at least 2; got {chosen.starts}.")
    file = Path(__file__).with_name(BEST_KNOWN_FILE)
    entries: dict[str, Any] = {}
    if file.is_file():
        entries = json.loads(file.read_text(encoding="utf-8"))["problems"]
    for name in chosen.problem or suite():
        began_s = time.perf_counter()
        best = problem(name).best_known
        entry = search(problem(name), chosen.starts, chosen.seed, best.waveform if best else None)
        known = entries.get(name, {})
        kept = known.get("problem") == entry["problem"] and known["cost_V"] <= entry["cost_V"]
        print(
            f"{name}, {time.perf_counter() - began_s:.0f} s: {entry['cost_V']:.9f} V"
            + (f"; kept {known['cost_V']:.9f} V" if kept else ""),
            flush=True,
        )
        if not kept:
            entries[name] = entry
        written = {"format": "best_known/1", "version": version("inkjet-env"), "problems": entries}
        write_json(file, written)


if __name__ == "__main__":
    main()
