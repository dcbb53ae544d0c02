"""Settings of a search, the optimisation that they mean, and the command line that carries out the same."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from inkjet_env.cli.arguments import chosen_seed
from inkjet_env.experiments.benchmark.problem import MAX_BUDGET
from inkjet_env.experiments.benchmark.single_run import Optimisation
from inkjet_env.experiments.commands.optimize import check_changeable, chosen_problem, swarm_options
from inkjet_env.experiments.explore.exports import cost_options, head_options
from inkjet_env.experiments.explore.heads import PUBLISHED, NamedHead
from inkjet_env.naming import check_name
from inkjet_env.plant.head_ensemble import RISKS, read_ensemble
from inkjet_env.printhead import DriverLimits, PeakCost

PLAIN_COST = PeakCost()
NOT_ROBUST = "no"


@dataclass(frozen=True)
class SearchSettings:
    """What is asked of a search.

    Parameters
    ----------
    optimizer, problem : str
        Names, as ``inkjet optimize`` takes them.
    budget : int
        Number of evaluations.
    seed : int
        Seed of all random numbers.
    robust : str
        "no", or how costs over the heads that remain possible are judged: mean, cvar or worst.
    head : str
        Name of the head; the published one leaves the problem's own.
    """

    optimizer: str = "pso"
    problem: str = "nominal"
    budget: int = 2000
    seed: int = 0
    robust: str = NOT_ROBUST
    head: str = PUBLISHED

    def as_json(self) -> dict[str, Any]:
        """The settings as plain JSON values."""
        return asdict(self)

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> SearchSettings:
        """The settings that `as_json` wrote."""
        return cls(
            str(stored["optimizer"]), str(stored["problem"]), int(stored["budget"]), int(stored["seed"]),
            str(stored["robust"]), str(stored["head"]),
        )  # fmt: skip


def planned(settings: SearchSettings, head: NamedHead, cost: PeakCost, limits: DriverLimits) -> Optimisation:
    """The optimisation that ``inkjet optimize`` carries out for the same settings.

    Parameters
    ----------
    settings : SearchSettings
        What is asked.
    head : NamedHead
        The head; the published one leaves the problem's own.
    cost, limits : PeakCost, DriverLimits
        As in *Waveform*; where they are the usual ones, the problem's own stay.

    Raises
    ------
    ValueError
        A name is unknown, a number out of range, or the head does not say which heads remain possible.
    """
    if not 1 <= settings.budget <= MAX_BUDGET:
        raise ValueError(f"the budget must be 1 to {MAX_BUDGET:,} evaluations; got {settings.budget}.")
    options, evaluations = swarm_options(settings.optimizer, None, None, settings.budget)
    given = (
        cost.A if cost.A != PLAIN_COST.A else None,
        cost.B if cost.B != PLAIN_COST.B else None,
        f"{cost.effective}" if cost.effective != PLAIN_COST.effective else None,
        cost.target_height_V if cost.target_height_V != PLAIN_COST.target_height_V else None,
    )
    chosen = chosen_problem(settings.problem, given, None, None)
    if settings.robust != NOT_ROBUST:
        check_name("robust", settings.robust, RISKS)
        ensemble = None if head.path is None else read_ensemble(head.path)
        if ensemble is None:
            raise ValueError(
                f"{head.name}: it does not say which heads the recordings leave possible, so no search can be robust. "
                "Choose a head that a diagnosis wrote."
            )
        check_changeable(chosen)
        chosen = replace(chosen, ensemble=ensemble, risk=settings.robust)
    if head.path is not None:
        check_changeable(chosen)
        chosen = replace(chosen, name="custom", printhead=head.head)
    if limits != DriverLimits():
        check_changeable(chosen)
        chosen = replace(chosen, name="custom", bounds=replace(chosen.bounds, limits=limits), known=None)
    return Optimisation(chosen, settings.optimizer, evaluations, chosen_seed(settings.seed), options)


def command_text(settings: SearchSettings, head: NamedHead, cost: PeakCost, limits: DriverLimits) -> str:
    """The command line that finds the same waveform."""
    command = ["inkjet", "optimize", "--optimizer", settings.optimizer, "--problem", settings.problem]
    command += ["--budget", str(settings.budget), "--seed", str(settings.seed), *head_options(head)]
    if settings.robust != NOT_ROBUST:
        command += ["--robust", settings.robust]
    command += cost_options(cost)
    if limits != DriverLimits():
        command += ["--limits", ",".join(f"{name}={value!r}" for name, value in limits.as_json().items())]
    return shlex.join([*command, "--out", "waveform.csv"])
