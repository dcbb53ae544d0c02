"""Problems for Optuna's samplers, with the interface of a benchmark of OptunaHub."""

from __future__ import annotations

from typing import Any

from optuna.distributions import FloatDistribution
from optuna.study import StudyDirection
from optuna.trial import Trial

from inkjet_env.experiments.benchmark.interfaces.objective import Objective
from inkjet_env.experiments.benchmark.problem import Problem


class OptunaProblem:
    """A problem whose parameters are those of the waveform, in volts and microseconds.

    It has what ``optunahub.benchmarks.BaseProblem`` asks for, and needs Optuna alone.

    Parameters
    ----------
    problem : str or Problem
        A problem, or the name of one.
    seed : int
        Seed of the reading errors, see `Objective`.

    Examples
    --------
    >>> import optuna
    >>> optuna.logging.set_verbosity(optuna.logging.ERROR)
    >>> problem = OptunaProblem("nominal")
    >>> study = optuna.create_study(directions=problem.directions, sampler=optuna.samplers.TPESampler(seed=1))
    >>> study.optimize(problem, n_trials=20)
    >>> list(study.best_params)
    ['U1_V', 'U2_V', 't1_us', 't2_us', 't3_us', 't4_us', 't5_us']
    """

    def __init__(self, problem: str | Problem, seed: int = 0) -> None:
        self.objective = Objective(problem, seed, physical=True)
        names = self.objective.problem.bounds.names
        self._scales = {f"{name}_V": 1.0 if name[0] == "U" else 1e-6 for name in names if name[0] == "U"}
        self._scales |= {f"{name}_us": 1e-6 for name in names if name[0] != "U"}

    @property
    def search_space(self) -> dict[str, Any]:
        """Range of each parameter by its name."""
        ends = zip(self._scales.items(), self.objective.lower, self.objective.upper, strict=True)
        return {name: FloatDistribution(low / scale, high / scale) for (name, scale), low, high in ends}

    @property
    def directions(self) -> list[StudyDirection]:
        """One cost, to be minimised."""
        return [StudyDirection.MINIMIZE]

    def evaluate(self, params: dict[str, Any]) -> float:
        """Cost in volts of the parameters."""
        return self.objective([params[name] * scale for name, scale in self._scales.items()])

    def __call__(self, trial: Trial) -> float:
        """Cost in volts of the parameters that a trial suggests."""
        return self.evaluate(
            {name: trial.suggest_float(name, ends.low, ends.high) for name, ends in self.search_space.items()}
        )
