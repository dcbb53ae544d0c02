"""Challenge of the best known waveforms with three methods and seeds other than those that found them.

``python -m inkjet_env.experiments.benchmark.studies.challenge_best_known --minutes 60`` divides the time among all
problems and three methods. The exit status is 1 if one of them finds a waveform whose cost is lower by more than a
thousandth. The cost must be lower for any rounding: a waveform on a discontinuity is counted with the cost beyond it
(`inkjet_env.experiments.benchmark.studies.search_best_known.settled`)."""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from inkjet_env.experiments.benchmark.regret import best_known_cost, scale_V
from inkjet_env.experiments.benchmark.suite import VERSION, problem, suite
from inkjet_env.extras import extra
from inkjet_env.progress import shown_progress
from inkjet_env.reporting.tables import print_table
from inkjet_env.storage import write_json

FORMAT = "beating/1"
METHODS = ("bipop-cma-es", "scipy-differential-evolution", "lbfgsb-multistart")
WITHOUT_GRADIENT = "pymoo-pso"
"""Method used instead of one that needs a gradient which the problem does not have."""
BUDGET = 20_000
"""Evaluations of one run; runs follow one another with other seeds until the time is up."""
ENDS, ROUNDS, STEP = 4, 100, 1e-10
"""Number of best points of a run that are moved off a discontinuity, rounds of random steps, and first step size."""
ALLOWED = 1e-3
"""Largest `Attempt.gain` at which a best known cost does not yet count as beaten."""


@dataclass(frozen=True)
class Attempt:
    """The best result of a method on a problem.

    Attributes
    ----------
    problem, method : str
        Names of the problem and of the optimiser.
    cost_V : float
        Lowest cost in volts.
    evaluations : int
        Number of evaluations spent.
    """

    problem: str
    method: str
    cost_V: float
    evaluations: int

    @property
    def gain(self) -> float:
        """Reduction below the best known cost, as a fraction of that cost or of the problem's scale if that is smaller.

        Negative if the cost is higher. The cost of a problem with a wanted drop height is offset by the reward for that
        drop, so a fraction of it would mean little.
        """
        known_V = best_known_cost(self.problem)
        return (known_V - self.cost_V) / min(abs(known_V), scale_V(self.problem))


def attempt(name: str, method: str, seconds: float) -> Attempt:
    """Search one problem with one method, run after run, for ``seconds``."""
    from dataclasses import replace

    import numpy as np

    from inkjet_env import optimizers
    from inkjet_env.experiments.benchmark.studies.search_best_known import polished, settled
    from inkjet_env.optimizers.loop import minimise

    of = replace(problem(name), measurement_noise_V=0.0, instruments=0)  # the optimum does not depend on how it is read
    if optimizers.uses_gradient(method) and not of.has_gradient:
        method = WITHOUT_GRADIENT
    of.evaluate([[0.0] * 7])
    evaluate = settled(of)
    best_V, spent, seed, end_s = float("inf"), 0, 0, time.perf_counter() + seconds
    while not spent or time.perf_counter() < end_s:
        run = minimise(of, optimizers.make(method, 7, BUDGET, seed), BUDGET)
        if run.best_cost < best_V:
            ends = run.points[np.argsort(run.costs, kind="stable")[:ENDS]]
            _, costs = polished(evaluate, ends, ROUNDS, np.random.default_rng(seed), STEP)
            best_V = min(best_V, float(costs.min()))
        spent, seed = spent + BUDGET, seed + 1
    return Attempt(name, method, best_V, spent)


def attempts(names: list[str], seconds: float, workers: int) -> list[Attempt]:
    """The attempts of all methods on all problems, with ``seconds`` of wall time in total."""
    with extra("the challenge"):
        from joblib import Parallel, delayed

    jobs = [(name, method) for name in names for method in METHODS]
    each_s = seconds * workers / len(jobs)
    found: list[Attempt] = []
    with shown_progress("beating", len(jobs)) as progress:
        for one in Parallel(n_jobs=workers, return_as="generator")(
            delayed(attempt)(name, method, each_s) for name, method in jobs
        ):
            found.append(one)
            progress(len(found), f"{one.method} on {one.problem}: {100 * one.gain:+.3f} %")
    return found


def main(arguments: list[str] | None = None) -> int:
    """Challenge the chosen problems and print the results; the exit status is 1 if any was beaten."""
    parser = argparse.ArgumentParser(
        prog="python -m inkjet_env.experiments.benchmark.studies.challenge_best_known", description=__doc__
    )
    parser.add_argument(
        "--problem",
        action="append",
        choices=list(suite()),
        help="problem to challenge, may be repeated; all of the suite unless given",
    )
    parser.add_argument("--minutes", type=float, default=60.0, help="total time in minutes (60)")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="number of processes; one per core unless given"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all attempts as JSON")
    chosen = parser.parse_args(arguments)
    if not chosen.minutes > 0 or chosen.workers < 1:
        parser.error("--minutes must be above 0 and --workers at least 1.")
    found = attempts(chosen.problem or list(suite()), 60 * chosen.minutes, chosen.workers)
    if chosen.json is not None:
        tried = [asdict(one) | {"known_V": best_known_cost(one.problem), "gain": one.gain} for one in found]
        record = {
            "format": FORMAT,
            "suite": VERSION,
            "minutes": chosen.minutes,
            "workers": chosen.workers,
            "attempts": tried,
        }
        write_json(chosen.json, record)
    print_table(
        ("problem", "best known, V", "method", "its best, V", "gain, %", "evaluations"),
        [
            (one.problem, f"{best_known_cost(one.problem):.6f}", one.method, f"{one.cost_V:.6f}",
             f"{100 * one.gain:+.4f}", f"{one.evaluations:,}")
            for one in found
        ],
    )  # fmt: skip
    beaten = [one for one in found if one.gain > ALLOWED]
    for one in beaten:
        print(
            f"{one.problem} has a lower cost by {one.method}: {one.cost_V:.9f} V. "
            "Run python -m inkjet_env.experiments.benchmark.studies.search_best_known."
        )
    if not beaten:
        most = max(found, key=lambda one: one.gain)
        print(
            f"No best known cost is beaten by more than {100 * ALLOWED:g} %; the largest gain is "
            f"{100 * most.gain:+.4f} % ({most.method} on {most.problem})."
        )
    return 1 if beaten else 0


if __name__ == "__main__":
    sys.exit(main())
