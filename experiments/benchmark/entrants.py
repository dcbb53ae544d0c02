"""The entrants of a comparison: an optimiser with its defaults, or with tuned settings.

``pso`` is the optimiser of that name. ``pso-tuned`` is the same with the options that
`inkjet_env.experiments.benchmark.studies.tune_optimizers` found on heads outside the suite and stored in `tuned.json`
with the evaluations that the tuning took."""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass, field
from typing import Any

from inkjet_env.experiments.benchmark.data import data_file

TUNED = "-tuned"
TUNED_FILE = "tuned.json"
REMARKS = {
    "sb3-": "On a single head an agent is only a search distribution over seven numbers: nothing that it learns helps "
    "with the next head.",
    "nevergrad-NGOpt": "Chooses its method for the whole budget, a handicap at the smaller ones.",
    "lbfgsb-": "Uses exact gradients; a value with its gradient counts as one evaluation.",
    "pso": "The paper prints neither the coefficients nor the number of particles; the defaults are the usual "
    "coefficients and 40 particles.",
    "pso-printed": "No random factors: the paper prints its equations without them.",
    "coordinate": "Changes one parameter at a time, as practitioners do.",
    "scipy-differential-evolution": "SciPy's tolerance and final descent are switched off: it continues until its "
    "population has collapsed to one point.",
    "scipy-direct": "Draws no random numbers: its runs on a problem differ only by the measurement noise, if any.",
}
"""Remarks on the optimisers whose names start with the key, true at any settings."""


@dataclass(frozen=True)
class Entrant:
    """An optimiser with its settings in a comparison.

    Parameters
    ----------
    name : str
        Name in tables and on the command line.
    optimizer : str
        Name of the optimiser in the registry.
    options : dict
        Keyword arguments of the optimiser; empty for its defaults.
    """

    name: str
    optimizer: str
    options: dict[str, Any] = field(default_factory=dict)

    def made(self, budget: int, seed: int, beside: int = 0) -> Any:
        """A new instance of the optimiser, for as many evaluations beside each other; nevergrad must be told."""
        from inkjet_env import optimizers

        told = {"workers": beside} if beside and self.optimizer.startswith("nevergrad-") else {}
        return optimizers.make(self.optimizer, budget=budget, seed=seed, **self.options | told)

    @property
    def remark(self) -> str:
        """Remark for the reader; empty if there is none."""
        remarks = [text for prefix, text in REMARKS.items() if self.optimizer.startswith(prefix)]
        if self._tuned_here:
            remarks.append(f"Tuned for {tuned_settings()[self.optimizer]['budget']:,} evaluations.")
        return " ".join(remarks)

    @property
    def tuning_evaluations(self) -> int:
        """Number of evaluations that tuning its settings took; 0 for defaults."""
        return int(tuned_settings()[self.optimizer]["evaluations"]) if self._tuned_here else 0

    @property
    def _tuned_here(self) -> bool:
        return self.name.endswith(TUNED) and self.optimizer in tuned_settings()


@functools.cache
def tuned_settings() -> dict[str, dict[str, Any]]:
    """Tuned settings by optimiser: the options, how they were found, and after how many evaluations."""
    file = data_file(TUNED_FILE)
    if not file.is_file():
        return {}
    return dict(json.loads(file.read_text(encoding="utf-8"))["optimizers"])


def entrants() -> tuple[str, ...]:
    """Names of all entrants: every optimiser, the tuned variant of those with tuned settings, and those of plug-ins."""
    from inkjet_env import optimizers

    return (*optimizers.names(), *(name + TUNED for name in tuned_settings()), *optimizers.installed())


def entrant(name: str) -> Entrant:
    """The entrant of that name.

    Raises
    ------
    UnknownOptimizerError, ValueError
        No optimiser has the name, or no settings were found for it.
    """
    from inkjet_env import optimizers

    of = name.removesuffix(TUNED)
    if of not in optimizers.names():
        optimizers.uses_gradient(of)  # raises the error that suggests the nearest name
    if of == name:
        return Entrant(name, name)
    if of not in tuned_settings():
        raise ValueError(
            f"there are no tuned settings for {of!r}; there are for {', '.join(tuned_settings()) or 'none'}. "
            f"Find some with: python -m inkjet_env.experiments.benchmark.studies.tune_optimizers {of}"
        )
    return Entrant(name, of, tuned_settings()[of]["options"])
