"""Search for the best known waveform of each problem: a long multi-start search, with the exact gradient if available.

``python -m inkjet_env.experiments.benchmark.studies.search_best_known`` (that of a problem of your own, ``--problem
my_lab:tall_drop``, is printed instead) writes `best_known.json`, against which the
comparison's regrets are measured. The cost has many local optima and is discontinuous where a peak appears, so gradient
descent alone stops at the discontinuities. The best of its end points are polished by random steps and by CMA-ES,
neither of which needs a gradient, and so are the end points of complete runs of BIPOP-CMA-ES; the number of these that
end near the best shows how certain it is. Heads with effects have no gradients: CMA-ES replaces the descents there.
They are a hundred times slower and lots ten times, so fewer points are polished for both."""

from __future__ import annotations

import argparse
import itertools
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from inkjet_env import __version__, optimizers
from inkjet_env.experiments.benchmark.data import data_file
from inkjet_env.experiments.benchmark.problem import BEST_KNOWN_FILE, BestKnown, Problem
from inkjet_env.experiments.benchmark.regret import best_of_random_V
from inkjet_env.experiments.benchmark.suite import VERSION, problem, suite
from inkjet_env.extras import extra
from inkjet_env.optimizers.loop import minimise
from inkjet_env.storage import write_json
from inkjet_env.typing import Real

ROUNDING = 1e-11
MOST_PASSES, GAINED_V = 5, 1e-7
STEPS = (2e-11, 1e-10, 1e-9, 0.05, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
"""First step sizes of the final polishing, in half widths of the box. The first three move a point off a discontinuity;
since steps shrink away along one, polishing then restarts from a large step with successively smaller ones."""
LEAST_STEP = 1e-11
BLOCK = 16
SCREENED_PER_START = 64
DESCENT_EVALUATIONS = 1500
RUN_EVALUATIONS = 20_000
FIRST_RUN = 10_000
"""Seed of the first complete run: `challenge_best_known` starts at 0 and must not repeat these runs."""
NEAR = 1e-3
"""Distance from the best cost, as a fraction of the problem's scale (the mean regret of the best of 50 random
waveforms), within which a run counts as having reached it."""


Evaluate = Callable[[Real, Real], Real]


@dataclass(frozen=True)
class Effort:
    """Effort of a search: number of end points polished and rounds; number of finalists of each kind and rounds."""

    polished: int
    rounds: int
    finalists: int
    last_rounds: int


USUAL, WHERE_SLOW = Effort(256, 4000, 8, 400), Effort(24, 300, 3, 100)


def screened_starts(problem: Problem, starts: int, rng: np.random.Generator) -> Real:
    """Starting points in ``[-1, 1]⁷``, shape (starts, 7): half are the best of many Sobol points, half random ones."""
    from scipy.stats import qmc

    count = 1 << int(np.ceil(np.log2(starts * SCREENED_PER_START)))
    points = qmc.scale(qmc.Sobol(7, rng=rng).random(count), -np.ones(7), np.ones(7))
    order = np.argsort(problem.evaluate(points), kind="stable")
    best = order[: starts // 2]
    others = rng.choice(order[starts // 2 :], starts - best.size, replace=False)
    return points[np.concatenate([best, others])]


def descend(problem: Problem, start: Real) -> tuple[Real, float]:
    """L-BFGS-B with the exact gradient from one start within the box: the end point and its cost in volts."""
    from scipy.optimize import minimize

    def value_and_slope(point: Real) -> tuple[float, Real]:
        costs, gradients = problem.evaluate_with_gradient(point)
        return float(costs[0]), gradients[0]

    end = minimize(value_and_slope, start, jac=True, method="L-BFGS-B", bounds=[(-1.0, 1.0)] * start.size)
    return end.x, float(end.fun)


def descend_without(problem: Problem, start: Real, seed: int) -> tuple[Real, float]:
    """CMA-ES from one start: the best point of `DESCENT_EVALUATIONS`, and its cost in volts."""
    optimizer = optimizers.make("cma-es", 7, DESCENT_EVALUATIONS, seed, start=start.tolist(), first_step=0.2)
    run = minimise(problem, optimizer, DESCENT_EVALUATIONS)
    best: int = int(np.argmin(run.costs))
    return run.points[best].copy(), float(run.costs[best])


def polished(
    evaluate: Evaluate, points: Real, rounds: int, rng: np.random.Generator, step: float = 0.05
) -> tuple[Real, Real]:
    """Improve many points in parallel by random steps; each adapts its step size to a success rate of one in five.

    Parameters
    ----------
    evaluate : callable
        Costs in volts, shape (n,), of points, shape (n, 7). A cost above its entry of the second argument, shape (n,),
        need not be exact.
    points : ndarray, shape (n, 7)
        Points to improve, in ``[-1, 1]``.
    rounds : int
        Number of steps tried per point.
    rng : Generator
        Draws the steps.
    step : float
        First step size, in half widths of the box.

    Returns
    -------
    points : ndarray, shape (n, 7)
        Improved points, in ``[-1, 1]``.
    costs : ndarray, shape (n,)
        Their costs in volts; none is higher than before.
    """
    points = points.copy()
    costs = evaluate(points, np.full(len(points), math.inf))
    steps = np.full(len(points), step)
    for _ in range(rounds):
        # Half the coordinates move at a time, so that one at its bound does not block the others.
        moves = rng.standard_normal(points.shape) * (rng.random(points.shape) < 0.5)
        trials = np.clip(points + steps[:, None] * moves, -1.0, 1.0)
        trial_costs = evaluate(trials, costs)
        better = trial_costs < costs
        points[better], costs[better] = trials[better], trial_costs[better]
        steps = np.clip(steps * np.where(better, 1.5, 1.5**-0.25), LEAST_STEP, 0.5)
    return points, costs


def plain(problem: Problem) -> Evaluate:
    """The problem's cost, unchanged."""
    return lambda points, _: problem.evaluate(points)


def settled(problem: Problem) -> Evaluate:
    """The worst cost within a rounding error, so that a waveform on a discontinuity gains nothing by lucky rounding.

    The best waveforms lie where a peak is about to appear; with other rounding it does appear. At this distance a
    discontinuity is flat, so the corners of a small box around the waveform include the worst cost.
    """
    corners = ROUNDING * np.random.default_rng(0).permutation(list(itertools.product([-1.0, 1.0], repeat=7)))

    def evaluate(points: Real, below: Real) -> Real:
        costs = problem.evaluate(points)
        for k in np.flatnonzero(costs < below):
            for some in np.split(corners, len(corners) // BLOCK):
                costs[k] = max(costs[k], problem.evaluate(np.clip(points[k] + some, -1.0, 1.0)).max())
                if costs[k] >= below[k]:
                    break
        return costs

    return evaluate


def valley_polished(problem: Problem, point: Real, seed: int) -> Real:
    """CMA-ES around one point within the box: it learns the direction of a narrow valley along a discontinuity."""
    import warnings

    with extra("the search"):
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
            warnings.simplefilter("ignore")  # ignores its warnings about the bounds
            strategy = cma.CMAEvolutionStrategy(point, sigma, options)
            while not strategy.stop():
                points = np.clip(strategy.ask(), -1.0, 1.0)
                costs = problem.evaluate(points)
                strategy.tell(points, costs.tolist())
                if costs.min() < cost:
                    point, cost = points[int(np.argmin(costs))], float(costs.min())
    return point


def whole_runs(problem: Problem, runs: int, seed: int) -> tuple[Real, Real]:
    """Best points, shape (runs, 7), of complete runs of BIPOP-CMA-ES, and their costs in volts, shape (runs,)."""
    ends, costs = np.empty((runs, 7)), np.empty(runs)
    for k in range(runs):
        optimizer = optimizers.make("bipop-cma-es", 7, RUN_EVALUATIONS, FIRST_RUN * (seed + 1) + k)
        run = minimise(problem, optimizer, RUN_EVALUATIONS)
        ends[k], costs[k] = run.points[int(np.argmin(run.costs))], run.best_cost
    return ends, costs


def search(
    problem: Problem, starts: int, runs: int, seed: int, known: tuple[float, ...] | None = None
) -> dict[str, Any]:
    """Search one problem, also from the best known waveform if there is one; return the entry of `best_known.json`."""
    settings = problem.settings()
    problem = replace(problem, measurement_noise_V=0.0, instruments=0)  # the optimum does not depend on how it is read
    rng = np.random.default_rng(seed)
    effort = USUAL if problem.has_gradient and not problem.spread else WHERE_SLOW
    descents = [
        descend(problem, start) if problem.has_gradient else descend_without(problem, start, k)
        for k, start in enumerate(screened_starts(problem, starts, rng))
    ]
    ends = np.array([point for point, _ in descents])
    costs = problem.evaluate(ends)
    by_descent = float(costs.min())
    best = ends[np.argsort(costs, kind="stable")[: effort.polished]]
    candidates, costs = polished(plain(problem), best, effort.rounds, rng)
    order = np.argsort(costs, kind="stable")[: effort.finalists]
    finalists = np.array([valley_polished(problem, point, seed + 1) for point in candidates[order]])
    run_ends, run_costs = whole_runs(problem, runs, seed)
    finalists = np.vstack(
        [finalists, candidates[order], run_ends[np.argsort(run_costs, kind="stable")[: effort.finalists]]]
    )
    if known is not None:
        finalists = np.vstack([finalists, problem.bounds.to_unit(known)])
    before = math.inf
    for _ in range(MOST_PASSES):
        for step in STEPS:
            finalists, costs = polished(settled(problem), finalists, effort.last_rounds, rng, step)
        if before - costs.min() < GAINED_V:
            break
        before = float(costs.min())
    winner = int(np.argmin(costs))
    waveform = problem.bounds.from_unit(finalists[winner])
    winning = problem.bounds.to_unit(waveform)
    cost_V = float(problem.evaluate(winning)[0])
    response = problem.respond(winning)
    descent = "L-BFGS-B on the exact gradient" if problem.has_gradient else "CMA-ES"
    near = int(np.sum(run_costs <= cost_V + NEAR * (best_of_random_V(problem) - cost_V)))
    found_by = (
        f"{descent} from {starts} starts (half the best of "
        f"{SCREENED_PER_START * starts} or more Sobol points, half any of them; it reached {by_descent:.6f} V) and "
        f"{runs} runs of BIPOP-CMA-ES ({near} of them within {NEAR:g} of the scale), the best ends polished"
    )
    if known is not None:
        found_by += ", with what had been known before"
    return {
        "problem": settings,
        "cost_V": cost_V,
        "waveform": [float(v) for v in waveform],
        "peaks_V": [float(v) for v in response.peaks_V[:6]],
        "found_by": found_by,
        "starts": starts,
        "runs": runs,
        "runs_near": near,
        "seed": seed,
    }


def main(arguments: list[str] | None = None) -> None:
    """Search the chosen problems, starting also from their best known waveforms unless the problems have changed."""

    parser = argparse.ArgumentParser(
        prog="python -m inkjet_env.experiments.benchmark.studies.search_best_known", description=__doc__
    )
    parser.add_argument("--problem", action="append", help="name of a problem; all of the suite unless given")
    parser.add_argument("--starts", type=int, default=2000, help="descents per problem")
    parser.add_argument("--runs", type=int, default=25, help="complete runs of BIPOP-CMA-ES per problem")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    for name, least in (("starts", 2), ("runs", 1), ("seed", 0)):
        if getattr(chosen, name) < least:
            parser.error(f"--{name} must be at least {least}; got {getattr(chosen, name)}.")
    try:
        for name in chosen.problem or ():
            problem(name)
    except ValueError as error:
        parser.error(str(error))
    file = data_file(BEST_KNOWN_FILE)
    for name in chosen.problem or suite():
        began_s = time.perf_counter()
        best = problem(name).best_known
        entry = search(problem(name), chosen.starts, chosen.runs, chosen.seed, best.waveform if best else None)
        print(f"{name}, {time.perf_counter() - began_s:.0f} s: {entry['cost_V']:.9f} V", flush=True)
        if name not in suite():
            numbers = entry["cost_V"], tuple(entry["waveform"]), entry["found_by"], entry["runs"], entry["runs_near"]
            known = BestKnown(*numbers)
            print(f"Write this into the problem, as known=…:\n{known}", flush=True)
            continue
        entries: dict[str, Any] = {}
        if file.is_file():  # read now: another process may have searched another problem meanwhile
            entries = json.loads(file.read_text(encoding="utf-8"))["problems"]
        entries[name] = entry
        written = {
            "format": "best_known/1", "version": __version__, "suite": VERSION, "problems": entries
        }  # fmt: skip
        write_json(file, written)


if __name__ == "__main__":
    main()
