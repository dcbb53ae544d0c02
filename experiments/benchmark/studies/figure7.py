"""Reproduction of Fig. 7 of the paper: how a particle swarm changes the response within 50 generations.

``python -m inkjet_env.experiments.benchmark.studies.figure7`` runs ``pso`` (40 particles, 50 generations) on the
default problem with 20 seeds and prints in how many of them each of the figure's claims holds. The paper shows one run
and no numbers; `CLAIMS` states how its words are interpreted."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.printhead import PeakCost, Response
from inkjet_env.typing import Real

PARTICLES, GENERATIONS = 40, 50
SEEDS = range(20)
SETTLED_GENERATIONS, SETTLED_SHARE = 10, 0.05

CLAIMS = {
    "higher": "the effective peak is at least as high in generation 50 as in generation 1",
    "rivalled before": "in generation 1 the peak after it is at least half as high",
    "unrivalled after": "in generation 50 the peak after it is below a quarter of it",
    "suppressed": "in generation 50 every later peak is below a third of it",
    "settled": "in the last 10 generations no duration is further than 5 % of its range from where it ends",
}


@dataclass(frozen=True)
class Reproduction:
    """One run of the swarm.

    Parameters
    ----------
    seed : int
        Seed of the swarm.
    problem : Problem
        The problem that it minimises.
    best_points : ndarray, shape (generations, 7)
        Best point so far after each generation, in ``[-1, 1]``.
    costs : ndarray, shape (generations,)
        Cost of that point in volts.
    """

    seed: int
    problem: Problem
    best_points: Real
    costs: Real

    def response(self, generation: int) -> Response:
        """Response to the best waveform after that generation, counted from 1."""
        return self.problem.respond(self.best_points[generation - 1])

    def claims(self) -> dict[str, bool]:
        """Whether each of `CLAIMS` holds."""
        cost = self.problem.cost
        first, first_next, _ = effective_and_later(self.response(1), cost)
        last, last_next, last_later = effective_and_later(self.response(len(self.costs)), cost)
        durations = self.best_points[-SETTLED_GENERATIONS:, 2:]
        return {
            "higher": last >= first,
            "rivalled before": first_next >= first / 2,
            "unrivalled after": last_next < last / 4,
            "suppressed": last_later < last / 3,
            "settled": bool((np.abs(durations - durations[-1]) <= 2 * SETTLED_SHARE).all()),
        }


def effective_and_later(response: Response, cost: PeakCost) -> tuple[float, float, float]:
    """Magnitudes in volts of the effective peak, the next peak and the largest later peak; 0 where there is none."""
    magnitude = np.abs(response.peaks_V)
    e = cost.effective_index(magnitude)
    if e is None:
        return 0.0, 0.0, 0.0
    later = magnitude[e + 1 :]
    return float(magnitude[e]), float(later[0]) if later.size else 0.0, float(later.max(initial=0.0))


def reproduce(seed: int, problem_name: str = "nominal") -> Reproduction:
    """Run a swarm of the paper's size once."""
    from inkjet_env.optimizers import make
    from inkjet_env.optimizers.loop import minimise

    solved = problem(problem_name)
    budget = PARTICLES * GENERATIONS
    run = minimise(solved, make("pso", budget=budget, seed=seed, particles=PARTICLES), budget)
    best = [int(np.argmin(run.costs[: PARTICLES * (g + 1)])) for g in range(GENERATIONS)]
    return Reproduction(seed, solved, run.points[best], run.costs[best])


def table(runs: Iterable[Reproduction]) -> str:
    """Number of runs in which each claim holds, and the costs, as text."""
    runs = list(runs)
    found = [run.claims() for run in runs]
    lines = [f"{sum(f[name] for f in found):3d} of {len(runs)}: {sentence}" for name, sentence in CLAIMS.items()]
    lines.append(f"{sum(all(f.values()) for f in found):3d} of {len(runs)}: all of these")
    costs = np.array([run.costs[-1] for run in runs])
    lines.append(f"final cost: best {costs.min():.3f} V, median {np.median(costs):.3f} V, worst {costs.max():.3f} V")
    lines.append("seed  cost 1 (V)  cost 50 (V)  claims that fail")
    for run, f in zip(runs, found, strict=True):
        failing = ", ".join(name for name, holds in f.items() if not holds) or "–"
        lines.append(f"{run.seed:4d}  {run.costs[0]:10.3f}  {run.costs[-1]:11.3f}  {failing}")
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m inkjet_env.experiments.benchmark.studies.figure7", description=__doc__
    )
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="number of seeds, from 0 (default 20)")
    seeds = parser.parse_args().seeds
    if seeds < 1:
        parser.error(f"--seeds must be at least 1; got {seeds}.")
    print(table(reproduce(seed) for seed in range(seeds)))


if __name__ == "__main__":
    main()
