"""One optimiser on one problem, with a record of its evaluations from which an interrupted run resumes exactly."""

from __future__ import annotations

import json
import math
import sys
import time
import zipfile
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.experiments.benchmark import suite
from inkjet_env.experiments.benchmark.cost_check import first_other_cost
from inkjet_env.experiments.benchmark.problem import MAX_BUDGET, Problem
from inkjet_env.experiments.execution.provenance import first_difference
from inkjet_env.plant.registry import UnregisteredEffectError
from inkjet_env.progress import shown_progress
from inkjet_env.storage import archive_bytes, write_atomically
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from inkjet_env.optimizers.loop import Run


RECORD_FORMAT = "evaluations/1"
OPTIMUM_FORMAT = "optimum/1"
RECORD_EVERY_S = 2.0
"""Shortest time between two records of a run, in seconds."""
LARGEST_SHARE = 50.0
"""Shortest time between two records as a multiple of the time that one took to write."""


@dataclass(frozen=True)
class Optimisation:
    """Settings of one optimisation run.

    Parameters
    ----------
    problem : Problem
        The problem to minimise.
    optimizer : str
        Name of the optimiser in the registry.
    budget : int
        Number of evaluations.
    seed : int
        Seed of the optimiser and of any measurement noise.
    options : dict
        Keyword arguments of the optimiser.
    """

    problem: Problem
    optimizer: str
    budget: int
    seed: int
    options: dict[str, Any] = field(default_factory=dict)

    def label(self) -> dict[str, Any]:
        """Everything that determines the run, as plain JSON values."""
        return {
            "format": RECORD_FORMAT,
            "problem": self.problem.name,
            "settings": self.problem.settings(),
            "optimizer": self.optimizer,
            "options": self.options,
            "budget": self.budget,
            "seed": self.seed,
            **({"plugins": plugins} if (plugins := self.plugins()) else {}),
        }

    def plugins(self) -> dict[str, dict[str, str]]:
        """Place, code and package of the optimiser and of the problem, as far as they are not this package's own."""
        from inkjet_env import optimizers

        name = self.problem.name
        found = {
            f"optimizer {self.optimizer}": optimizers.provenance(self.optimizer),
            f"problem {name}": suite.provenance(name),
        }
        return {name: where for name, where in found.items() if where is not None}

    def without_limits(self) -> Optimisation:
        """The same search for a driver without limits."""
        return replace(self, problem=replace(self.problem, bounds=replace(self.problem.bounds, limits=None)))

    def cost_spread(self, point: Real) -> dict[str, Any] | None:
        """How the cost in volts of a point, shape (7,), scatters over an ensemble of heads; None without one."""
        problem = self.problem
        if problem.ensemble is None:
            return None
        waveform = problem.bounds.from_unit(point)
        costs = problem.ensemble.costs(waveform, problem.cost, problem.initial_state, problem.window_s)[:, 0]
        return {
            "risk": problem.risk,
            "heads": len(costs),
            "cost_of_fit": float(replace(problem, ensemble=None).evaluate(point)[0]),
            "mean": float(problem.ensemble.risk(costs[:, None], "mean")[0]),
            "low": problem.ensemble.quantile(costs, 0.05),
            "high": problem.ensemble.quantile(costs, 0.95),
            "worst": float(costs.max()),
        }

    def carry_out(
        self, recorded: Run | tuple | None = None, keep: Callable[[Run], object] | None = None, label: str = ""
    ) -> Run:
        """Run it, resuming after ``recorded``; Ctrl-C returns the run so far, with ``complete`` False.

        ``keep`` is called after every batch with the run so far, such as a `RunningRecord`. ``label`` names the run in
        its progress; by default the optimiser does.

        Raises
        ------
        ValueError
            The optimiser is unknown or unavailable, an option is unknown, or the record does not fit.
        """
        from inkjet_env import optimizers
        from inkjet_env.optimizers.loop import Interrupted, minimise

        optimizer = optimizers.make(self.optimizer, budget=self.budget, seed=self.seed, **self.options)
        done = 0 if recorded is None else len(recorded.costs if hasattr(recorded, "costs") else recorded[1])
        try:
            with shown_progress(label or self.optimizer, self.budget) as progress:

                def made(run: Run) -> None:
                    progress(run.evaluations, f"best cost {run.best_cost:.4f} V")
                    if keep is not None:
                        keep(run)

                return minimise(
                    self.problem.as_measured(self.seed, done),
                    optimizer,
                    self.budget,
                    recorded=recorded,
                    on_batch=made,
                )
        except Interrupted as interruption:
            return interruption.run

    def optimum_json(self, run: Run, without_limits: float | None = None) -> dict[str, Any]:
        """The JSON output of `inkjet optimize`; a `ValueError` for a run without evaluations.

        ``without_limits`` is the cost in volts that the same search reaches without the driver's limits, if known.
        """
        limits = self.problem.bounds.limits
        more: dict[str, Any] = {}
        if limits is not None:
            more |= {"limits": limits.as_json(), "cost_without_limits": without_limits}
        if run.best_point is None:
            raise ValueError("a run without evaluations has no best waveform.")
        if (spread := self.cost_spread(run.best_point)) is not None:
            more["robust"] = spread
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
            **more,
        }


class RunningRecord:
    """Writes a record of a run while it runs, so that one that is killed can be resumed.

    Parameters
    ----------
    path : Path
        File of the record.
    optimisation : Optimisation
        What runs.
    replayed : int
        Number of evaluations that are replayed, which a record holds already.
    """

    def __init__(self, path: Path, optimisation: Optimisation, replayed: int = 0) -> None:
        self.path, self.optimisation, self.replayed = path, optimisation, replayed
        self.due_s = time.monotonic() + RECORD_EVERY_S

    def __call__(self, run: Run) -> None:
        begin_s = time.monotonic()
        if begin_s < self.due_s or run.evaluations <= self.replayed:
            return
        try:
            write_record(self.path, self.optimisation, run)
        except OSError as error:
            print(f"{self.path}: {error.strerror}; if this run is killed, it cannot be resumed.", file=sys.stderr)
            self.due_s = math.inf
            return
        end_s = time.monotonic()
        self.due_s = end_s + max(RECORD_EVERY_S, LARGEST_SHARE * (end_s - begin_s))


def write_record(path: Path, optimisation: Optimisation, run: Run) -> None:
    """Store all evaluations of a run, labelled with its settings."""
    arrays = {"label": np.array(json.dumps(optimisation.label())), "points": run.points, "costs": run.costs}
    if run.gradients is not None:
        arrays["gradients"] = run.gradients
    write_atomically(path, archive_bytes(arrays))


def read_record(path: Path, trusted: Collection[str] = ()) -> tuple[Optimisation, tuple]:
    """The optimisation in a record, and its evaluations in the form that `inkjet_env.optimizers.loop.minimise` takes.

    Parameters
    ----------
    path : Path
        File of the record.
    trusted : collection of str
        Each ``optimizer NAME`` and ``problem NAME`` of another package whose code may be run: a record alone never
        imports any.

    Raises
    ------
    ValueError
        The file is missing or is not such a record; the message names it.
    """
    try:
        if path.exists() and not (path.is_file() and zipfile.is_zipfile(path)):
            raise ValueError("it is not an .npz archive")
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            label = json.loads(str(archive["label"]))
            recorded = tuple(archive[name] for name in ("points", "costs", "gradients") if name in archive)
        if not isinstance(label, dict) or label.get("format") != RECORD_FORMAT:
            raise ValueError(f"its label is not of {RECORD_FORMAT}")
        for name, kind in (("problem", str), ("optimizer", str), ("budget", int), ("seed", int), ("options", dict)):
            if type(label[name]) is not kind:
                raise ValueError(f"its {name} is {label[name]!r}")
        for option in ("problem", "optimizer"):
            name = label[option]
            if f"{option} {name}" in set(label.get("plugins", {})) - set(trusted):
                raise ValueError(f"it is of {name}, whose code is run only if you name it: add --{option} {name}")
        named = label["problem"]
        whose = f"problem {named}" in trusted
        problem = suite.problem(named) if whose else Problem.from_settings(named, label["settings"])
        optimisation = Optimisation(problem, label["optimizer"], label["budget"], label["seed"], label["options"])
        if difference := first_difference(label.get("plugins", {}), optimisation.plugins()):
            raise ValueError(f"the code of a plug-in has changed since: {difference}")
        _check_evaluations(optimisation, *recorded)
    except UnregisteredEffectError as error:
        raise ValueError(f"{path}: {error}") from None
    except FileNotFoundError:
        raise ValueError(f"{path}: there is no such file. Give the .npz file that the interrupted run wrote.") from None
    except (
        ValueError, KeyError, TypeError, EOFError, OSError, RecursionError, zipfile.BadZipFile, NotImplementedError
    ) as error:  # fmt: skip
        broken = isinstance(error, (OSError, zipfile.BadZipFile, NotImplementedError))
        reason: object = "its archive is damaged" if broken else str(error)[:200]
        if "pickle" in str(error):
            reason = "it holds pickled objects, which are never loaded"
        raise ValueError(
            f"{path}: is not a complete record of an optimisation ({str(reason).rstrip('.') or type(error).__name__}). "
            "Give the .npz file that the interrupted run wrote, or start again without it."
        ) from None
    return optimisation, recorded


def _check_evaluations(optimisation: Optimisation, points: Real, costs: Real, *gradients: Real) -> None:
    """Raise ``ValueError`` unless `carry_out` can resume after these evaluations."""
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
