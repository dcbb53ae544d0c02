"""Who takes part in a comparison: an optimiser with its defaults, or with the settings that were found for it.

``pso`` is the optimiser of that name, ``pso-tuned`` the same with the options that `experiments.tuning` found on heads
outside the suite, and keeps in `tuned.json` with what they cost.
"""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass, field
from importlib import resources
from typing import Any

TUNED = "-tuned"
TUNED_FILE = "tuned.json"


@dataclass(frozen=True)
class Entrant:
    """An optimiser as it takes part.

    Parameters
    ----------
    name : str
        In tables and on the command line.
    optimizer : str
        Its name among the optimisers.
    options : dict
        Its keywords; empty for its defaults.
    """

    name: str
    optimizer: str
    options: dict[str, Any] = field(default_factory=dict)

    def made(self, budget: int, seed: int) -> Any:
        """The optimiser, fresh."""
        import optimizers

        return optimizers.make(self.optimizer, budget=budget, seed=seed, **self.options)


@functools.cache
def tuned_settings() -> dict[str, dict[str, Any]]:
    """What was found for each optimiser: options, how, and after how many evaluations."""
    file = resources.files("experiments") / TUNED_FILE
    if not file.is_file():
        return {}
    return dict(json.loads(file.read_text(encoding="utf-8"))["optimizers"])


def entrants() -> tuple[str, ...]:
    """Names of all: every optimiser, and those that have found settings."""
    import optimizers

    return (*optimizers.names(), *(name + TUNED for name in tuned_settings()))


def entrant(name: str) -> Entrant:
    """The entrant of that name.

    Raises
    ------
    UnknownOptimizerError, ValueError
        No optimiser has the name, or no settings were found for it.
    """
    import optimizers

    of = name.removesuffix(TUNED)
    if of not in optimizers.names():
        optimizers.make(of).close()  # raises the error that suggests the nearest name
    if of == name:
        return Entrant(name, name)
    if of not in tuned_settings():
        raise ValueError(
            f"there are no tuned settings of {of!r}; there are of {', '.join(tuned_settings()) or 'none'}. "
            f"Find some with: python -m experiments.tuning {of}"
        )
    return Entrant(name, of, tuned_settings()[of]["options"])
