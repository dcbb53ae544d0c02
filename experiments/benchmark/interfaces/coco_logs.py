"""The runs of a bench in COCO's format of logs, of which ``python -m cocopp FOLDER/pso FOLDER/cma-es`` makes a page."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from inkjet_env.experiments.benchmark.analysis import Comparison
from inkjet_env.experiments.benchmark.interfaces.objective import DIMENSION
from inkjet_env.experiments.benchmark.regret import best_known_cost
from inkjet_env.experiments.benchmark.run_files import RunResult
from inkjet_env.storage import write_atomically

MOST_FUNCTIONS = 24
"""Number of functions in COCO's suite ``bbob-boxed``, under whose numbers, f1 to f24, problems are logged."""
SUITE = "suite = 'bbob-boxed', coco_version = '2.6', logger = 'bbob', data_format = 'bbob-new2'"
HEADER = "% f evaluations | g evaluations | best noise-free fitness - Fopt | measured fitness | best measured fitness\n"


def write_coco_logs(comparison: Comparison, folder: Path) -> list[Path]:
    """Write the improvements of every run: regrets in volts, the cost above the best known one.

    ``functions.csv`` beside them tells which problem each of COCO's function numbers stands for: cocopp has names of
    its own for them. Each repeat is an instance.

    Parameters
    ----------
    comparison : Comparison
        The finished bench.
    folder : Path
        Made if missing; the logs of each optimiser go to a folder of its name.

    Returns
    -------
    list of Path
        Folder of each optimiser.

    Raises
    ------
    ValueError
        There are more problems than COCO has functions, or the folder holds something else: logs of other problems.
    """
    names = comparison.problems
    if len(names) > MOST_FUNCTIONS:
        raise ValueError(
            f"COCO has {MOST_FUNCTIONS} functions; the bench has {len(names)} problems. Bench fewer with --problems."
        )
    functions, index = _table((f"f{k}", name) for k, name in enumerate(names, 1)), folder / "functions.csv"
    if folder.exists() and any(folder.iterdir()) and not (index.is_file() and index.read_text("utf-8") == functions):
        raise ValueError(f"{folder} holds something else than logs of these problems. Give another folder.")
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(index, functions)
    written = []
    for optimizer in comparison.optimizers:
        place = folder / optimizer.replace(":", ".")
        for number, name in enumerate(names, 1):
            if runs := comparison.runs.get((optimizer, name)):
                _write_function(place, number, optimizer, runs, best_known_cost(name))
        written.append(place)
    return written


def _write_function(place: Path, number: int, optimizer: str, runs: Sequence[RunResult], best_V: float) -> None:
    data = f"data_f{number}/bbobexp_f{number}_DIM{DIMENSION}"
    (place / data).parent.mkdir(parents=True, exist_ok=True)
    improvements, ends = [], []
    for k, run in enumerate(runs, 1):
        # one line for each improvement, and one for the end of the run
        told = [*zip(run.evaluations.tolist(), run.costs_V.tolist(), strict=True), (run.budget, run.costs_V[-1])]
        lowest, lines = float("inf"), []
        for evaluations, cost_V in told:
            lowest = min(lowest, cost_V)
            lines.append(f"{evaluations} 0 {lowest - best_V:+.12e} {cost_V - best_V:+.12e} {lowest - best_V:+.12e}\n")
        improvements.append(HEADER + "".join(lines))
        ends.append(f"{k}:{run.budget}|{lowest - best_V:.12e}")
    for ending in ("dat", "tdat"):
        write_atomically(place / f"{data}.{ending}", "".join(improvements))
    index = (
        f"funcId = {number}, DIM = {DIMENSION}, Precision = 1.000e-08, algId = '{optimizer}', {SUITE}\n"
        f"% {optimizer}\n{data}.dat, {', '.join(ends)}\n"
    )
    write_atomically(place / f"bbobexp_f{number}.info", index)


def _table(rows: Iterable[tuple[str, str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([("function", "problem"), *rows])
    return text.getvalue()
