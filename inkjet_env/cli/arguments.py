"""What the command line gives, turned into problems, costs and settings; what it gives wrongly, into one sentence.

Every function raises ``ValueError`` before any work is done.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from experiments.problems import Problem
    from inkjet_env.printhead import PeakCost, Printhead

MAX_BUDGET = 10_000_000
CostGiven = tuple[float | None, float | None, str | None]


def chosen_problem(
    name: str | None, head_file: Path | None, cost: CostGiven, window_s: float | None, initial_state: str | None
) -> Problem:
    """The problem of that name with what was asked to be otherwise; then it is called "custom"."""
    from dataclasses import replace

    from experiments.suite import problem
    from inkjet_env.printhead.hysteresis import laps_before_recording
    from inkjet_env.printhead.printhead import check_window

    base = problem("nominal" if name is None else name)
    changes: dict[str, Any] = {}
    if head_file is not None:
        changes["printhead"] = chosen_printhead(head_file)
    if any(part is not None for part in cost):
        changes["cost"] = chosen_cost(cost, base.cost)
    if window_s is not None:
        changes["window_s"] = check_window(window_s)
    if initial_state is not None:
        laps_before_recording(initial_state)  # raises where the name is unknown
        changes["initial_state"] = initial_state
    return replace(base, name="custom", **changes) if changes else base


def swarm_options(
    name: str, particles: int | None, generations: int | None, budget: int | None
) -> tuple[dict[str, Any], int]:
    """Options of the optimiser, and its budget, from what was given."""
    for label, value in (("--particles", particles), ("--generations", generations), ("--budget", budget)):
        if value is not None and value < 1:
            raise ValueError(f"{label} must be at least 1; got {value}.")
        if value is not None and value > MAX_BUDGET:
            raise ValueError(f"{label} must be at most {MAX_BUDGET:,}; got {value}.")
    if (particles or 40) * (generations or 50) > MAX_BUDGET:
        raise ValueError(f"--particles × --generations must be at most {MAX_BUDGET:,}.")
    if not name.startswith("pso"):
        if particles is not None or generations is not None:
            raise ValueError(f"--particles and --generations belong to pso and pso-printed; give {name} a --budget.")
        return {}, budget or 2000
    if generations is not None and budget is not None:
        raise ValueError("give --generations or --budget, not both: the budget is particles × generations.")
    return {"particles": particles or 40}, budget or (particles or 40) * (generations or 50)


def chosen_printhead(path: Path | None) -> Printhead:
    """The head of a printhead.json, or the published one."""
    from inkjet_env.printhead import Printhead

    return Printhead.published() if path is None else Printhead.from_json(path)


def chosen_cost(given: CostGiven, base: PeakCost | None = None) -> PeakCost:
    """``base`` with A, B and effective rule replaced where they are given; a number as the rule is a threshold."""
    from inkjet_env.printhead import PeakCost

    A, B, effective = given
    base = base or PeakCost()
    rule: str | float = base.effective if effective is None else effective
    if effective is not None:
        try:
            rule = float(effective)
        except ValueError:
            rule = effective
    return PeakCost(base.A if A is None else A, base.B if B is None else B, rule)


def chosen_seed(seed: int | None) -> int:
    """The seed, 0 unless given."""
    if seed is not None and seed < 0:
        raise ValueError(f"--seed must be at least 0; got {seed}.")
    return seed or 0


def check_rate(sample_rate_Hz: float) -> None:
    """Raise ``ValueError`` at a sample rate that is useless for edges of a microsecond."""
    if not (math.isfinite(sample_rate_Hz) and 1e7 <= sample_rate_Hz <= 1e11):
        raise ValueError(
            f"--sample-rate must be 1e7 to 1e11 Hz, so that every edge has samples; got {sample_rate_Hz:g}."
        )


def check_outputs(inputs: Sequence[Path | None] = (), **files: Path | None) -> None:
    """Raise ``ValueError`` before any work where a result could not be written, or would replace an input."""
    given = {name: path for name, path in files.items() if path is not None and str(path) != "-"}
    read = {os.path.realpath(path) for path in inputs if path is not None}
    for name, path in given.items():
        if os.path.realpath(path) in read:
            raise ValueError(f"--{name} {path} would replace what is read. Give another name.")
        if (path.exists() and not path.is_file()) or not _takes_files(Path(os.path.realpath(path)).parent):
            raise ValueError(
                f"--{name} {path}: {path.parent} must be a folder that can be written to, and {path} a file."
            )
    if len({os.path.realpath(path) for path in given.values()}) < len(given):
        raise ValueError(f"--{' and --'.join(given)} must be different files.")
    for name in ("out", "plot"):
        if str(files.get(name)) == "-":
            raise ValueError(f'--{name} must be a file; only --json takes "-".')
    if files.get("plot") is not None:
        from experiments.pictures import check_picture_name

        check_picture_name(given["plot"])


def _takes_files(folder: Path) -> bool:
    """Whether a file can be made there: rights alone do not tell, of a read-only medium or to one who may do all."""
    try:
        with TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def named_values(option: str, text: str) -> dict[str, str]:
    """``name=value,name=value`` as a dict."""
    pairs = [part.partition("=") for part in text.split(",") if part.strip()]
    if not pairs or any(not name.strip() or not mark or not value.strip() for name, mark, value in pairs):
        raise ValueError(f"{option} must read name=value,name=value; got {text!r}.")
    return {name.strip(): value.strip() for name, _, value in pairs}
