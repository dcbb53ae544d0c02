"""Tuning of the optimisers' settings on heads outside the suite; every evaluation is counted.

A comparison at defaults shows how good an optimiser is as supplied; one with tuned settings, how good it can be made.
``python -m inkjet_env.experiments.benchmark.studies.tune_optimizers`` gives all optimisers the same effort: Optuna's
sampler tries the same number of settings for each, on the same heads and seeds; the best few and the defaults are run
again on other heads with other seeds, and the best of those, defaults included, is stored in `tuned.json`."""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.experiments.benchmark.data import data_file
from inkjet_env.experiments.benchmark.entrants import TUNED_FILE, tuned_settings
from inkjet_env.experiments.benchmark.metrics import interquartile_mean
from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.benchmark.regret import best_of_random_V
from inkjet_env.extras import extra
from inkjet_env.optimizers.loop import minimise
from inkjet_env.printhead import Printhead
from inkjet_env.progress import shown_progress
from inkjet_env.storage import write_json

if TYPE_CHECKING:
    from optuna.trial import Trial

FORMAT = "tuned/1"
BUDGET = 2000
TRIALS, FINALISTS = 40, 5
HEADS, REPEATS = 8, 2
TRYING, AGAIN = 1, 2
"""Seed of the heads on which settings are tried, and of those on which the best are tried again."""
REFERENCE_BUDGET = 20_000

Asked = Callable[["Trial"], dict[str, Any]]


def _swarm(most_pull: float) -> Asked:
    def asked(trial: Trial) -> dict[str, Any]:
        return {
            "particles": trial.suggest_int("particles", 8, 100, log=True),
            "c1": trial.suggest_float("c1", 0.3, 0.95),
            "c2": trial.suggest_float("c2", 0.1, most_pull),
            "c3": trial.suggest_float("c3", 0.1, most_pull),
        }

    return asked


def _cma(trial: Trial) -> dict[str, Any]:
    return {
        "population": trial.suggest_int("population", 5, 60, log=True),
        "first_step": trial.suggest_float("first_step", 0.05, 1.0, log=True),
    }


def _differences(individuals: str, low: int, high: int) -> Asked:
    def asked(trial: Trial) -> dict[str, Any]:
        return {
            individuals: trial.suggest_int(individuals, low, high, log=True),
            "mutation": trial.suggest_float("mutation", 0.3, 1.0),
            "recombination": trial.suggest_float("recombination", 0.1, 0.99),
        }

    return asked


def _pymoo_swarm(trial: Trial) -> dict[str, Any]:
    return {
        "particles": trial.suggest_int("particles", 8, 100, log=True),
        "fastest": trial.suggest_float("fastest", 0.02, 1.0, log=True),
    }


def _ppo(trial: Trial) -> dict[str, Any]:
    return {
        "tasks": trial.suggest_int("tasks", 8, 100, log=True),
        "learning_rate": trial.suggest_float("learning_rate", 1e-3, 1e-1, log=True),
        "log_std": trial.suggest_float("log_std", -2.5, 0.3),
    }


def _sac(trial: Trial) -> dict[str, Any]:
    return {
        "learning_rate": trial.suggest_float("learning_rate", 3e-4, 3e-2, log=True),
        "entropy": trial.suggest_float("entropy", 1e-3, 0.3, log=True),
    }


def _scan(trial: Trial) -> dict[str, Any]:
    return {"steps": trial.suggest_int("steps", 3, 21)}


SPACES: dict[str, Asked] = {
    "pso": _swarm(2.5),
    "pso-printed": _swarm(1.5),
    "coordinate": _scan,
    "cma-es": _cma,
    "pymoo-pso": _pymoo_swarm,
    "pymoo-de": _differences("individuals", 10, 150),
    "scipy-differential-evolution": _differences("individuals_per_dimension", 1, 20),
    "sb3-ppo": _ppo,
    "sb3-sac": _sac,
}
"""Search space of each optimiser's settings. Optimisers not listed have no settings, or choose them themselves."""


def training_problems(seed: int, heads: int = HEADS) -> tuple[Problem, ...]:
    """Default problems on heads drawn from the range of the suite's heads; none of the suite's is among them."""
    rng = np.random.default_rng([seed, heads])
    drawn = rng.uniform([35e3, 0.02, 0.7, 0.5], [70e3, 0.08, 1.3, 1.5], (heads, 4))
    return tuple(
        Problem(f"training-{seed}-{k}", Printhead.published().varied(*map(float, row))) for k, row in enumerate(drawn)
    )


@functools.cache
def best_and_scale_V(problem: Problem) -> tuple[float, float]:
    """Best cost in volts of a long search on a training problem, and mean regret of the best of 50 random waveforms."""
    from inkjet_env import optimizers

    search = optimizers.make("lbfgsb-multistart", 7, REFERENCE_BUDGET, 0)
    best_V = minimise(problem, search, REFERENCE_BUDGET).best_cost
    return best_V, best_of_random_V(problem) - best_V


def quality(name: str, options: dict[str, Any], problems: Sequence[Problem], seed: int, budget: int = BUDGET) -> float:
    """Interquartile mean of the final regrets in the problems' scales, over `REPEATS` runs on each problem."""
    from inkjet_env import optimizers

    regrets = np.empty((REPEATS, len(problems)))
    for k, problem in enumerate(problems):
        best_V, scale_V = best_and_scale_V(problem)
        for repeat in range(REPEATS):
            optimizer = optimizers.make(name, 7, budget, seed * 10_000 + 100 * k + repeat, **options)
            regrets[repeat, k] = (minimise(problem, optimizer, budget).best_cost - best_V) / scale_V
    return float(interquartile_mean(regrets))


def tune(name: str, trials: int = TRIALS, budget: int = BUDGET, heads: int = HEADS) -> dict[str, Any]:
    """The entry of `tuned.json` for one optimiser.

    Parameters
    ----------
    name : str
        One of `SPACES`.
    trials : int
        Number of settings tried, in addition to the defaults.
    budget : int
        Evaluations of each run.
    heads : int
        Number of heads in each of the two sets of training problems.
    """
    with extra("tuning"):
        import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=0))
    trying, again = training_problems(TRYING, heads), training_problems(AGAIN, heads)
    tried: list[tuple[float, dict[str, Any]]] = []
    with shown_progress(f"tuning {name}", trials) as progress:
        for k in range(trials):
            trial = study.ask()
            options = SPACES[name](trial)
            found = quality(name, options, trying, TRYING, budget)
            study.tell(trial, found)
            tried.append((found, options))
            progress(k + 1, f"{found:.4g}")
    tried.sort(key=lambda one: one[0])
    finalists = [{}, *(options for _, options in tried[:FINALISTS])]
    ends = [quality(name, options, again, AGAIN, budget) for options in finalists]
    best = int(np.argmin(ends))
    return {
        "options": finalists[best],
        "quality": ends[best],
        "quality_of_defaults": ends[0],
        "evaluations": (trials + len(finalists)) * heads * REPEATS * budget,
        "budget": budget,
        "found_by": f"Optuna's TPE sampler, {trials} settings on {heads} heads, {REPEATS} runs each; the best "
        f"{FINALISTS} and the defaults again on {heads} other heads",
    }


def main(arguments: list[str] | None = None) -> None:
    """Tune the chosen optimisers and store their settings."""
    parser = argparse.ArgumentParser(
        prog="python -m inkjet_env.experiments.benchmark.studies.tune_optimizers", description=__doc__
    )
    parser.add_argument(
        "names", nargs="*", metavar="optimizer", help=f"one or more of {', '.join(SPACES)}; all unless given"
    )
    names = parser.parse_args(arguments).names or list(SPACES)
    if unknown := [name for name in names if name not in SPACES]:
        parser.error(f"{unknown[0]!r} has no settings to tune; choose from {', '.join(SPACES)}.")
    entries = dict(tuned_settings())
    for name in names:
        entries[name] = tune(name)
        ordered = {known: entries[known] for known in SPACES if known in entries}
        write_json(data_file(TUNED_FILE), {"format": FORMAT, "optimizers": ordered})
        print(f"{name}: {entries[name]['quality_of_defaults']:.4g} → {entries[name]['quality']:.4g}", flush=True)


if __name__ == "__main__":
    main()
