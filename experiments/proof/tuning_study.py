"""`inkjet tune` from nothing on concealed heads: what it takes, and what its waveform costs beside the best one.

``python -m inkjet_env.experiments.proof.tuning_study FOLDER [--heads N] [--seed N] [--workers N]``

Each head conceals a strong effect. Its rig records the default battery, what diagnoses ask for, and the checks of
waveforms. FOLDER gets the session of each head, a JSON file with its result, and all results as ``study.json``; a head
whose file is there is not done again, and a session that was stopped goes on.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.experiments.concealed_plant import RIG
from inkjet_env.experiments.proof.answering import ConcealedRig
from inkjet_env.experiments.proof.concealment import conceal, families, plant_of
from inkjet_env.experiments.proof.corpus import DEVELOPMENT_SEED, PUBLISHED_SEED, Draw, corpus
from inkjet_env.experiments.proof.judge import questions
from inkjet_env.experiments.proof.printing import gains_table
from inkjet_env.experiments.proof.sealing import read_json
from inkjet_env.experiments.proof.waveform_gain import PlantObjective
from inkjet_env.experiments.tuning.exchange import Exchange
from inkjet_env.experiments.tuning.proposals import ends_of_searches, refined
from inkjet_env.experiments.tuning.session import Session, TuneSettings
from inkjet_env.printhead import Bounds
from inkjet_env.progress import shown_progress
from inkjet_env.reporting.tables import print_table
from inkjet_env.storage import write_json

FORMAT = "tuning-study/1"
SEARCHES, BUDGET = 2, 2000
"""Number of searches for the best waveform of a concealed head itself, and evaluations of each."""


def heads(seed: int, count: int) -> list[Draw]:
    """Draws of strong effects that show in a waveform's cost, from all effects in turn."""
    draws = corpus(seed, "full", *families(RIG))
    asked = questions(draws, count, 0)
    return [draw for draw in draws if asked[draw.number]["reoptimise"]]


def tuned(draw: Draw, folder: Path) -> dict[str, Any]:
    """Result of one head, read from the folder if it is there; otherwise its session is carried out."""
    file = folder / f"{draw.number:04d}.json"
    if not file.exists():
        attempt = conceal(draw, "head").attempt
        plant = plant_of(draw, attempt)
        session = folder / f"{draw.number:04d}"
        session.mkdir(exist_ok=True)
        begin_s = time.perf_counter()
        settings = TuneSettings(seed=draw.number, frequency_Hz=float(f"{plant.plant.head.resonance_Hz:.1g}"))
        found = Session(session, settings, Exchange(session, ConcealedRig(plant)), workers=1).run()
        seconds = time.perf_counter() - begin_s
        truly = PlantObjective(plant)
        names = [one.name if one.name != "refined" else f"refined-{k}" for k, one in enumerate(found.proposals)]
        waveforms = [one.waveform for one in found.proposals]
        points = {name: Bounds().to_unit(np.array(one)) for name, one in zip(names, waveforms, strict=True)}
        searched = ends_of_searches(truly, BUDGET, SEARCHES, draw.number)
        best = refined(truly, [*points.values(), *searched])[0]
        costs = {name: float(truly.evaluate(point)[0]) for name, point in points.items()}
        result = {
            "draw": draw.as_json(),
            "verdict": found.rounds[-1]["verdict"],
            "effects": found.rounds[-1]["effects"],
            "rounds": len(found.rounds),
            "recordings": found.recordings,
            "seconds": seconds,
            "costs": costs,
            "chosen": names[found.best],
            "measured_V": found.checks[found.best].cost_V,
            "oracle": min(float(truly.evaluate(best)[0]), *costs.values()),
        }
        write_json(file, result)
    case: dict[str, Any] = read_json(file)
    return case


def head_row(result: dict[str, Any]) -> dict[str, Any]:
    """Costs of a result by the names of `gains`; a waveform that was not proposed is that of the best one like it."""
    costs = result["costs"]
    fit = costs.get("fit", costs.get("robust", costs.get("base")))
    return {
        "base": costs.get("base", fit),
        "augmented": fit,
        "robust": costs.get("robust", fit),
        "loop": costs[result["chosen"]],
        "oracle": result["oracle"],
    }


def table(results: Sequence[dict[str, Any]]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headings and rows: a row for each head; a verdict that names the concealed effect is told without its name."""

    def told(result: dict[str, Any]) -> str:
        others = result["effects"] if result["effects"] != result["draw"]["effects"] else ()
        return " ".join((result["verdict"], *others))

    header = ("concealed", "verdict", "recordings", "minutes", "base (V)", "tuned (V)", "oracle (V)")
    return header, [
        (
            result["draw"]["effects"][0], told(result), str(result["recordings"]),
            f"{result['seconds'] / 60:.1f}", f"{row['base']:.2f}", f"{row['loop']:.2f}", f"{row['oracle']:.2f}",
        )
        for result, row in ((result, head_row(result)) for result in results)
    ]  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Tune, write and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of the sessions and results")
    parser.add_argument("--heads", type=int, default=20, help="number of heads")
    parser.add_argument("--seed", type=int, default=DEVELOPMENT_SEED, help="seed of the corpus")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    asked = parser.parse_args(arguments)
    if asked.seed == PUBLISHED_SEED:
        parser.error(
            f"--seed: {PUBLISHED_SEED} is that of the published proof, which must stay unseen. Choose another."
        )
    asked.folder.mkdir(parents=True, exist_ok=True)
    draws = heads(asked.seed, asked.heads)
    results = []
    with ProcessPoolExecutor(asked.workers, multiprocessing.get_context("spawn")) as pool:
        jobs = [pool.submit(tuned, draw, asked.folder) for draw in draws]
        try:
            with shown_progress("Tuning concealed heads", len(draws)) as progress:
                for done, job in enumerate(jobs, start=1):
                    results.append(job.result())
                    progress(done)
        finally:  # an interrupt does not wait for heads that have not begun
            pool.shutdown(cancel_futures=True)
    write_json(asked.folder / "study.json", {"format": FORMAT, "seed": asked.seed, "heads": results})
    print_table(*table(results))
    print_table(*gains_table([head_row(result) for result in results]))


if __name__ == "__main__":
    main()
