"""What it costs to wait: optimisers on instruments that work beside each other, batch by batch and in any order.

``python -m inkjet_env.experiments.benchmark.studies.late_readings [--slots N] [--budget N] [--repeats N]``

Readings take differently long, some never come, and the clock is simulated: `LateBenches`. An optimiser is told its
costs when a whole batch is there or, if it can, one by one.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from inkjet_env import optimizers
from inkjet_env.experiments.benchmark.late_benches import LateBenches
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.optimizers.asynchronous import minimise_late
from inkjet_env.progress import shown_progress
from inkjet_env.reporting.tables import print_table

ENTRANTS = ("random", "pso", "cma-es", "nevergrad-TwoPointsDE", "nevergrad-NGOpt")
PROBLEM = "nominal"


def repeated(name: str, by_batch: bool, slots: int, budget: int, repeats: int) -> tuple[float, float, float]:
    """Medians over the repeats of lowest cost in volts and time in readings' median, and the share of time at work."""
    costs, times_s, busy = [], [], []
    for seed in range(repeats):
        benches = LateBenches(problem(PROBLEM), seed)
        options = {"workers": slots} if name.startswith("nevergrad") else {}
        optimizer = optimizers.make(name, budget=budget, seed=seed, **options)
        costs.append(minimise_late(benches, optimizer, budget, slots=slots, by_batch=by_batch).best_cost)
        times_s.append(benches.now_s)
        busy.append(benches.busy_s / (slots * benches.now_s))
    return float(np.median(costs)), float(np.median(times_s)), float(np.mean(busy))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--slots", type=int, default=8, help="number of instruments")
    parser.add_argument("--budget", type=int, default=2000, help="evaluations of a run")
    parser.add_argument("--repeats", type=int, default=15, help="number of runs")
    asked = parser.parse_args(arguments)
    ways = [(name, by_batch) for name in ENTRANTS for by_batch in (True, False)]
    ways = [way for way in ways if way[1] or optimizers.make(way[0], budget=2).in_any_order]
    rows = []
    with shown_progress("late readings", len(ways)) as progress:
        for done, (name, by_batch) in enumerate(ways, start=1):
            cost_V, time_s, busy = repeated(name, by_batch, asked.slots, asked.budget, asked.repeats)
            told = "batch by batch" if by_batch else "one by one"
            rows.append((name, told, f"{cost_V:.2f}", f"{time_s:.0f}", f"{100 * busy:.0f} %"))
            progress(done)
    print_table(("optimiser", "told", "lowest cost (V)", "time (median readings)", "instruments at work"), rows)


if __name__ == "__main__":
    main()
