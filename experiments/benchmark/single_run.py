"""One optimiser on one problem, with a record of its evaluations from which an interrupted run goes on exactly."""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.benchmark.problem import MAX_BUDGET, Problem
from experiments.benchmark.run_files import first_other_cost
from inkjet_env.plant.registry import UnregisteredEffectError
from inkjet_env.progress import shown_progress
from inkjet_env.storage import archive_bytes, write_atomically
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from optimizers.loop import Run


RECORD_FORMAT = "evaluations/1"
OPTIMUM_FORMAT = "optimum/1"


@dataclass(frozen=True)
class Optimisation:
    """What is run: an optimiser by name with its options, a problem, a budget, a seed.

    Parameters
    ----------
    problem : Problem
    optimizer : str
    budget : int
        Evaluations.
    seed : int
    options : dict
        Keywords of the optimiser.
    """

    problem: Problem
    optimizer: str
    budget: int
    seed: int
    options: dict[str, Any] = field(default_factory=dict)

    def label(self) -> dict[str, Any]:
        """Everything that decides the run, as plain JSON values."""
        return {
            "format": RECORD_FORMAT,
            "problem": self.problem.name,
            "settings": self.problem.settings(),
            "optimizer": self.optimizer,
            "options": self.options,
            "budget": self.budget,
            "seed": self.seed,
        }

    def carry_out(self, recorded: Run | tuple | None = None) -> Run:
        """Run it, or what is left of it after ``recorded``; Ctrl-C gives the run so far, with ``complete`` False.

        Raises
        ------
        ValueError
            Unknown or unavailable optimiser, unknown option, or a record that does not fit.
        """
        import optimizers
        from optimizers.loop import Interrupted, minimise

        optimizer = optimizers.make(self.optimizer, budget=self.budget, seed=self.seed, **self.options)
        done = 0 if recorded is None else len(recorded.costs if hasattr(recorded, "costs") else recorded[1])
        try:
            with shown_progress(self.optimizer, self.budget) as progress:
                return minimise(
                    self.problem.as_measured(self.seed, done),
                    optimizer,
                    self.budget,
                    recorded=recorded,
                    on_batch=lambda run: progress(run.evaluations, f"best cost {run.best_cost:.4f} V"),
                )
        except Interrupted as interruption:
            return interruption.run

    def optimum_json(self, run: Run) -> dict[str, Any]:
        """The JSON that `inkjet optimize` promises; `ValueError` for a run without any evaluation."""
        if run.best_point is None:
            raise ValueError("a run without any evaluation has no best waveform.")
        return {
            "format": OPTIMUM_FORMAT,
            "waveform": [float(v) for v in self.problem.bounds.from_unit(run.best_point)],
            "cost": run.best_cost,
            "evaluations": run.evaluations,
            "history": run.history,
            "seed": self.seed,
            "optimizer": self.optimizer,
            "problem": self.problem.name,
            "complete": run.complete,
        }


def write_record(path: Path, optimisation: Optimisation, run: Run) -> None:
    """Store all evaluations of a run and what it was a run of."""
    arrays = {"label": np.array(json.dumps(optimisation.label())), "points": run.points, "costs": run.costs}
    if run.gradients is not None:
        arrays["gradients"] = run.gradients
    write_atomically(path, archive_bytes(arrays))


def read_record(path: Path) -> tuple[Optimisation, tuple]:
    """What was run, and its evaluations as `optimizers.loop.minimise` takes them.

    Raises
    ------
    ValueError
        The file is missing or is not such a record; the message names it.
    """
    try:
        if path.is_file() and not zipfile.is_zipfile(path):
            raise ValueError("it is no .npz archive")
        with np.load(path, allow_pickle=False) as archive:
            label = json.loads(str(archive["label"]))
            recorded = tuple(archive[name] for name in ("points", "costs", "gradients") if name in archive)
        if not isinstance(label, dict) or label.get("format") != RECORD_FORMAT:
            raise ValueError(f"its label is not of {RECORD_FORMAT}")
        for name, kind in (("problem", str), ("optimizer", str), ("budget", int), ("seed", int), ("options", dict)):
            if type(label[name]) is not kind:
                raise ValueError(f"its {name} is {label[name]!r}")
        problem = Problem.from_settings(label["problem"], label["settings"])
        optimisation = Optimisation(problem, label["optimizer"], label["budget"], label["seed"], label["options"])
        _check_evaluations(optimisation, *recorded)
    except UnregisteredEffectError as error:
        raise ValueError(f"{path}: {error}") from None
    except FileNotFoundError:
        raise ValueError(f"{path}: there is no such file. Give the .npz that the interrupted run left.") from None
    except (
        ValueError, KeyError, TypeError, EOFError, OSError, RecursionError, zipfile.BadZipFile, NotImplementedError
    ) as error:  # fmt: skip
        reason = "it holds pickled objects, which are never loaded" if "pickle" in str(error) else error
        raise ValueError(
            f"{path}: is not a whole record of an optimisation ({str(reason).rstrip('.') or type(error).__name__}). "
            "Give the .npz that the interrupted run left, or begin again without it."
        ) from None
    return optimisation, recorded


def _check_evaluations(optimisation: Optimisation, points: Real, costs: Real, *gradients: Real) -> None:
    """Raise ``ValueError`` unless these are evaluations that `carry_out` may be told again."""
    for name, array, shape in (
        ("points", points, (len(costs), 7)),
        ("costs", costs, (len(costs),)),
        *(("gradients", gradient, (len(costs), 7)) for gradient in gradients),
    ):
        if array.dtype != np.float64 or array.shape != shape or not np.isfinite(array).all():
            raise ValueError(f"its {name} are not {shape} finite numbers")
    if not 0 < len(costs) <= optimisation.budget <= MAX_BUDGET or np.abs(points).max() > 1:
        raise ValueError(f"its {len(costs)} evaluations do not fit a budget of {optimisation.budget} in the box")
    if difference := first_other_cost(optimisation.problem, points, costs, optimisation.seed):
        raise ValueError(difference)
