"""Figures of README and docs: ``python -m inkjet_env.experiments.publish.figures`` draws ``docs/figures/*.png``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from inkjet_env.experiments.benchmark.regret_figure import draw_regrets
from inkjet_env.experiments.benchmark.report import RANKING_FORMAT
from inkjet_env.experiments.benchmark.studies.figure7 import GENERATIONS, reproduce
from inkjet_env.experiments.tuning.exchange import Exchange
from inkjet_env.experiments.tuning.figures import waveforms_figure
from inkjet_env.experiments.tuning.session import Session, TuneSettings
from inkjet_env.experiments.validation.identification_study import published_loop
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import DriverLimits, Printhead
from inkjet_env.reporting import plotting
from inkjet_env.reporting.waveform_figures import draw_before_after
from inkjet_env.rig import VirtualRig, default_battery, record_campaign

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOLDER = Path(__file__).parents[2] / "docs" / "figures"
SHOWN_SEED = 2
"""A seed with which the swarm reaches the best known optimum; `studies.figure7` lists the results of other seeds."""
RANKING = Path(__file__).parents[2] / "docs" / "comparison" / "ranking.json"
COMPARED = (
    *("scipy-differential-evolution", "scipy-differential-evolution-tuned", "lbfgsb-multistart", "bipop-cma-es"),
    *("pso", "pso-printed", "coordinate", "sb3-ppo", "optuna-gp", "nevergrad-NGOpt", "random"),
)
"""Optimisers of the comparison that are drawn, if they took part: one or two of each kind."""
TUNED_LINES = ("trapezoid-60V", "trapezoid-100V", "bipolar-full", "pulse-pair-1.50T", "zero")
TUNED_SNR_dB = 30.0
"""Drives and signal-to-noise ratio of the campaign with which the tuning session begins."""


def before_after() -> Figure:
    """Drive and response in generation 1 and in generation 50, side by side."""
    run = reproduce(SHOWN_SEED)
    titles = ("generation 1", f"generation {GENERATIONS}")
    return draw_before_after(run.response(1), run.response(GENERATIONS), run.problem.cost, titles)


def comparison() -> Figure:
    """Regret against budget of some optimisers, with intervals, from docs/comparison/ranking.json."""
    ranking = json.loads(RANKING.read_text(encoding="utf-8"))
    if ranking["format"] != RANKING_FORMAT:
        raise ValueError(f"{RANKING} is not a {RANKING_FORMAT}; it is {ranking['format']!r}. Make it again.")
    found: dict[str, list[tuple[float, ...]]] = {name: [] for name in COMPARED}
    for budget, standings in ranking["standings"].items():
        for row in standings["rows"]:
            quality = row["quality"]
            if row["optimizer"] in found and quality["value"] is not None:
                found[row["optimizer"]].append((int(budget), quality["low"], quality["value"], quality["high"]))
    return draw_regrets({name: np.array(rows).T for name, rows in found.items() if rows})


def published_hysteresis() -> Figure:
    """Fig. 5 B–D of the paper reproduced: error against degree, loop and model, residual."""
    from matplotlib.figure import Figure

    found, _ = published_loop()
    loop = next(r for r in found.recordings if r.channel == "strain_gauge")
    swing = float(np.ptp(loop.measured))
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    against, around, left = figure.subplots(1, 3)
    choice = found.degree
    against.semilogy(choice.degrees, np.square(choice.rms_error), "o-", color=plotting.AFTER, ms=4)
    chosen = choice.by_flattening
    against.semilogy(chosen, choice.rms_error[chosen - 1] ** 2, "o", ms=11, mfc="none", color=plotting.BEFORE)
    against.annotate(
        f"n = {chosen}", (chosen, choice.rms_error[chosen - 1] ** 2), (0, 14), textcoords="offset points", ha="center"
    )
    against.set(xlabel="degree n of Q", ylabel="squared error / noise", title="B  error against degree")
    around.plot(loop.drive_V, loop.measured, ".", ms=7, color="#c9c9c9", label="measured")
    around.plot(loop.drive_V, loop.modelled["base"], color=plotting.AFTER, lw=1.4, label="branch law of degree 8")
    around.set(xlabel="drive (V)", ylabel="strain gauge (V)", title="C  90 sin t loop")
    around.legend(frameon=False, loc="upper left")
    left.plot(loop.time_s, 100 * loop.residual() / swing, color=plotting.AFTER, lw=0.8)
    left.set(xlabel="time (s)", ylabel="measured − modelled (% of swing)", title="D  residual")
    return figure


def tuned_waveforms() -> Figure:
    """Waveforms of a session of `inkjet tune` on a virtual head with an echo, as its page shows them."""
    echo = next(effect for effect in catalogue() if effect.id == "wave_echo")
    published = Printhead.published()
    head = AugmentedPrinthead(published, ((echo, echo.example_values(published)),))
    lines = [line for line in default_battery() if line.channel == "self_sensing" and line.label in TUNED_LINES]
    settings = TuneSettings(budget=300, limits=DriverLimits(-80, 80, 20, 20, 0.1), seed=1)
    with TemporaryDirectory() as name:
        folder = Path(name)
        campaign = record_campaign(head, 3, battery=lines, snr_dB=TUNED_SNR_dB)
        exchange = Exchange(folder, VirtualRig(head, 1, TUNED_SNR_dB))
        return waveforms_figure(Session(folder, settings, exchange, campaign, workers=1).run(), settings)


FIGURES: dict[str, Callable[[], Figure]] = {
    "before-after": before_after,
    "comparison": comparison,
    "identified-hysteresis": published_hysteresis,
    "tuned-waveforms": tuned_waveforms,
}


def main() -> None:
    """Draw the chosen figures."""
    parser = argparse.ArgumentParser(prog="python -m inkjet_env.experiments.publish.figures", description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="name", help=f"one or more of {', '.join(FIGURES)}; all unless given"
    )
    names = parser.parse_args().names or list(FIGURES)
    if unknown := [name for name in names if name not in FIGURES]:
        parser.error(f"there is no figure {unknown[0]!r}; choose from {', '.join(FIGURES)}.")
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in names:
        path = FOLDER / f"{name}.png"
        plotting.write_picture(path, FIGURES[name]())
        print(path)


if __name__ == "__main__":
    main()
