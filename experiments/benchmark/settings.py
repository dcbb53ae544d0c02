"""Settings of a comparison, and everything that its numbers depend on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.experiments.benchmark import suite
from inkjet_env.experiments.benchmark.entrants import Entrant, entrant
from inkjet_env.experiments.benchmark.problem import MAX_BUDGET, Problem
from inkjet_env.experiments.benchmark.regret import best_known_cost
from inkjet_env.experiments.benchmark.run_files import RunResult
from inkjet_env.experiments.benchmark.suite import BENCHED, problem
from inkjet_env.experiments.execution.provenance import code_digest, versions

BENCH_FORMAT = "bench/1"
KNOWN_COST_ERROR = 1e-6
"""Largest relative error of the cost that a problem states for its best known waveform, and absolute below 1 V."""
DEFAULT_BUDGET = 2000  # 40 particles × 50 generations
DEFAULT_REPEATS = 15
SOURCES = (
    *("inkjet_env/*.py", "inkjet_env/printhead/**/*.py", "inkjet_env/plant/**/*.py", "inkjet_env/envs/**/*.py"),
    "optimizers/**/*.py",
    *("experiments/benchmark/problem.py", "experiments/benchmark/suite.py", "experiments/benchmark/entrants.py"),
    *("experiments/benchmark/data/augmented_heads.json", "experiments/benchmark/data/tuned.json"),
)
"""Files that determine a run's numbers; identification and diagnosis are not among them."""
LEFT_OUT = dict.fromkeys(
    ("nevergrad-NGOpt", "optuna-gp"),
    "Not run by default, because it takes as long as all others together or longer; include it with --optimizers all.",
)
LONGEST = {"optuna-gp": 150, "nevergrad-NGOpt": 2000, "sb3-ppo-tuned": 2000, "sb3-sac-tuned": 2000}
"""Largest number of evaluations of a run of some optimisers, for any budget: longer runs would take days."""


@dataclass(frozen=True)
class BenchSettings:
    """Settings of a bench.

    Parameters
    ----------
    problems, optimizers : tuple of str
        Names of problems and of entrants, without duplicates; also of those of other packages, see
        `inkjet_env.plugins`.
    repeats, budget : int
        Runs of each pair, and evaluations of each run; at least 1.
    seed : int
        Seed from which all other seeds are derived.
    """

    problems: tuple[str, ...]
    optimizers: tuple[str, ...]
    repeats: int = DEFAULT_REPEATS
    budget: int = DEFAULT_BUDGET
    seed: int = 0

    def __post_init__(self) -> None:
        for name in self.problems:
            best_known_cost(name)
            _check_known(problem(name))
        for name in self.optimizers:
            entrant(name)
        for label, names in (("problems", self.problems), ("optimizers", self.optimizers)):
            if not names:
                raise ValueError(f"{label} must name at least one; got none.")
            if len(set(names)) < len(names):
                raise ValueError(f"{label} must not contain duplicates; got {', '.join(names)}.")
        for label, count in (("repeats", self.repeats), ("budget", self.budget)):
            if count < 1:
                raise ValueError(f"{label} must be at least 1; got {count}.")
            if count > MAX_BUDGET:
                raise ValueError(f"{label} must be at most {MAX_BUDGET:,}; got {count}.")
        longest = max(map(self.budget_of, self.optimizers))
        if longest < self.budget:
            raise ValueError(
                f"budget must be at most {longest} for {', '.join(self.optimizers)} alone; got {self.budget}."
            )

    @classmethod
    def default(cls, **changes: Any) -> BenchSettings:
        """The default problems and all optimisers except `LEFT_OUT`; ``changes`` replace fields by name."""
        from inkjet_env import optimizers

        compared = tuple(name for name in optimizers.names() if name not in LEFT_OUT)
        return cls(**{"problems": BENCHED, "optimizers": compared, **changes})

    def budget_of(self, optimizer: str) -> int:
        """Number of evaluations of a run of that optimiser."""
        return min(self.budget, LONGEST.get(optimizer, self.budget))

    def entrant(self, name: str) -> Entrant:
        """The optimiser of that name, with its settings."""
        return entrant(name)

    def uses_gradient(self, name: str) -> bool:
        """Whether that optimiser uses gradients."""
        from inkjet_env import optimizers

        return optimizers.uses_gradient(entrant(name).optimizer)

    def to_json(self) -> dict[str, Any]:
        """Everything that determines the results, as plain JSON values."""
        elsewhere = self.plugins()
        return {
            "format": BENCH_FORMAT,
            "budget": self.budget,
            "shorter": {name: self.budget_of(name) for name in self.optimizers if self.budget_of(name) < self.budget},
            "repeats": self.repeats,
            "seed": self.seed,
            "optimizers": list(self.optimizers),
            "options": {name: options for name in self.optimizers if (options := entrant(name).options)},
            "problems": {name: problem(name).settings() for name in self.problems},
            "code": code_digest(SOURCES),
            "versions": versions(),
            **({"plugins": elsewhere} if elsewhere else {}),
        }

    def sources_json(self) -> list[dict[str, Any]]:
        """Where the runs come from, if not from this bench, as plain JSON values."""
        return []

    def plugins(self) -> dict[str, dict[str, str]]:
        """Place, code and package of each ``optimizer NAME`` and ``problem NAME`` that is not this package's own."""
        from inkjet_env import optimizers

        of_optimizers = {
            f"optimizer {name}": optimizers.provenance(entrant(name).optimizer) for name in self.optimizers
        }
        of_problems = {f"problem {name}": suite.provenance(name) for name in self.problems}
        return {name: found for name, found in (of_problems | of_optimizers).items() if found is not None}


def _check_known(of: Problem) -> None:
    """``ValueError`` if the best known waveform that a problem states has another cost than it states."""
    if of.known is None:
        return
    (cost,) = of.evaluate(of.bounds.to_unit(np.array(of.known.waveform)))
    if abs(cost - of.known.cost) > KNOWN_COST_ERROR * max(1.0, abs(cost)):
        raise ValueError(
            f"problem {of.name!r}: its best known waveform costs {cost:.6f} V, and not {of.known.cost:.6f} V as known= "
            "says, from which regrets are counted. Correct the cost or the waveform."
        )


@dataclass(frozen=True)
class BenchOutcome:
    """A finished bench.

    Parameters
    ----------
    settings : BenchSettings
        Settings of the bench.
    folder : Path
        Folder of its results.
    results : list of RunResult
        Finished runs, in the order of problems, optimisers and repeats.
    unavailable : dict of str to str
        Optimisers that were left out, could not be run or failed, with the reason; none of their runs is scored.
    """

    settings: BenchSettings
    folder: Path
    results: list[RunResult]
    unavailable: dict[str, str]
