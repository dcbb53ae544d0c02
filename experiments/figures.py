"""The pictures of README and docs: ``python -m experiments.figures`` draws ``docs/figures/*.png``."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments import pictures
from experiments.figure7 import GENERATIONS, reproduce
from experiments.identification_study import published_loop
from experiments.statistics import best_known_cost
from experiments.suite import problem
from inkjet_env.printhead import Printhead

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOLDER = Path(__file__).parent.parent / "docs" / "figures"
SHOWN_SEED = 2
"""A seed under which the swarm reaches the best optimum known; `experiments.figure7` lists how the others end."""
COMPARED = ("lbfgsb-multistart", "cma-es", "pso", "pso-printed", "scipy-differential-evolution", "random")
SEEDS, BUDGET, FLOOR_V = 15, 2000, 1e-4


def before_after() -> Figure:
    """Drive and response at generation 1 beside generation 50."""
    run = reproduce(SHOWN_SEED)
    titles = ("generation 1", f"generation {GENERATIONS}")
    return pictures.draw_before_after(run.response(1), run.response(GENERATIONS), run.problem.cost, titles)


def convergence() -> Figure:
    """Median regret of some optimisers on the default problem, with quartile bands."""
    from optimizers import make
    from optimizers.loop import minimise

    nominal = problem("nominal")
    evaluations = np.unique(np.round(np.geomspace(1, BUDGET, 160)).astype(int))
    curves = {}
    for name in COMPARED:
        runs = [minimise(nominal, make(name, budget=BUDGET, seed=seed), BUDGET) for seed in range(SEEDS)]
        best = np.array([np.minimum.accumulate(run.costs)[evaluations - 1] for run in runs])
        curves[name] = np.percentile(best - best_known_cost("nominal"), [25, 50, 75], axis=0)
    ordered = dict(sorted(curves.items(), key=lambda item: item[1][1, -1]))
    return pictures.draw_convergence(evaluations, {"nominal": ordered}, FLOOR_V, "lowest median first")


def hysteresis_loop() -> Figure:
    """Hysteretic drive against drive: virgin curve, the ±90 V loop, and minor loops within it."""
    law = Printhead.published().branch_law
    turns = [0.0, 90.0, -90.0, 90.0, 0.0, 60.0, -40.0, 30.0, -90.0]
    parts = [np.linspace(a, b, 200) for a, b in pairwise(turns)]
    drive_V = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
    hysteretic_V = law.hysteretic_V(drive_V, "demagnetised")
    figure, axes = pictures.new_figure(5.4, 4.4)
    axes.plot(drive_V[:200], hysteretic_V[:200], color=pictures.GREY, lw=1.4, label="virgin curve")
    axes.plot(drive_V[199:598], hysteretic_V[199:598], color=pictures.AFTER, lw=1.8, label="loop of ±90 V", zorder=3)
    axes.plot(drive_V[597:], hysteretic_V[597:], color=pictures.BEFORE, lw=1.2, label="minor loops")
    axes.set(xlabel="drive (V)", ylabel="hysteretic drive (V)")
    axes.legend(frameon=False, loc="upper left")
    return figure


def published_hysteresis() -> Figure:
    """Fig. 5 B–D of the paper again: error against degree, loop and model, what the model leaves."""
    from matplotlib.figure import Figure

    found, _ = published_loop()
    loop = next(r for r in found.residuals if r.channel == "strain_gauge")
    swing = float(np.ptp(loop.measured))
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    against, around, left = figure.subplots(1, 3)
    choice = found.degree
    against.semilogy(choice.degrees, np.square(choice.rms_error), "o-", color=pictures.AFTER, ms=4)
    chosen = choice.by_flattening
    against.semilogy(chosen, choice.rms_error[chosen - 1] ** 2, "o", ms=11, mfc="none", color=pictures.BEFORE)
    against.annotate(
        f"n = {chosen}", (chosen, choice.rms_error[chosen - 1] ** 2), (0, 14), textcoords="offset points", ha="center"
    )
    against.set(xlabel="degree n of Q", ylabel="squared error / noise", title="B  error against degree")
    around.plot(loop.drive_V, loop.measured, ".", ms=7, color="#c9c9c9", label="measured")
    around.plot(loop.drive_V, loop.modelled, color=pictures.AFTER, lw=1.4, label="branch law of degree 8")
    around.set(xlabel="drive (V)", ylabel="strain gauge (V)", title="C  90 sin t loop")
    around.legend(frameon=False, loc="upper left")
    left.plot(loop.time_s, 100 * loop.difference / swing, color=pictures.AFTER, lw=0.8)
    left.set(xlabel="time (s)", ylabel="measured − modelled (% of swing)", title="D  what the model leaves")
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "before-after": before_after,
    "convergence": convergence,
    "hysteresis-loop": hysteresis_loop,
    "identified-hysteresis": published_hysteresis,
}


def main() -> None:
    """Draw the chosen pictures."""
    parser = argparse.ArgumentParser(prog="python -m experiments.figures", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="name", help=f"of {', '.join(FIGURES)}; all unless given")
    names = parser.parse_args().names or list(FIGURES)
    if unknown := [name for name in names if name not in FIGURES]:
        parser.error(f"there is no figure {unknown[0]!r}; known: {', '.join(FIGURES)}")
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in names:
        path = FOLDER / f"{name}.png"
        pictures.write_picture(path, FIGURES[name]())
        print(path)


if __name__ == "__main__":
    main()
