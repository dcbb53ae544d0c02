"""The optimisers by name. A third-party package is imported only when one of its optimisers is requested."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Iterable
from importlib import import_module
from typing import Any

import numpy as np

from inkjet_env.optimizers.base import Optimizer

# Name → module and class of this package. The rest of a name that begins with NEVERGRAD is one of nevergrad's registry.
CLASSES: dict[str, tuple[str, str]] = {
    "random": ("sampling", "Random"),
    "sobol": ("sampling", "Sobol"),
    "pso": ("particle_swarm", "ParticleSwarm"),
    "pso-printed": ("particle_swarm", "PrintedParticleSwarm"),
    "coordinate": ("coordinate", "Coordinate"),
    "cma-es": ("cma_es", "CmaEs"),
    "bipop-cma-es": ("cma_es", "BipopCmaEs"),
    "nevergrad-TwoPointsDE": ("nevergrad_adapter", "Nevergrad"),
    "nevergrad-NGOpt": ("nevergrad_adapter", "Nevergrad"),
    "nevergrad-PSO": ("nevergrad_adapter", "Nevergrad"),
    "nevergrad-OnePlusOne": ("nevergrad_adapter", "Nevergrad"),
    "pymoo-pso": ("pymoo_adapter", "PymooPSO"),
    "pymoo-de": ("pymoo_adapter", "PymooDE"),
    "optuna-gp": ("optuna_gp", "OptunaGp"),
    "scipy-differential-evolution": ("scipy_global", "DifferentialEvolution"),
    "scipy-dual-annealing": ("scipy_global", "DualAnnealing"),
    "scipy-direct": ("scipy_global", "Direct"),
    "lbfgsb-multistart": ("lbfgsb_multistart", "LbfgsbMultistart"),
    "sb3-ppo": ("sb3_one_step", "OneStepPPO"),
    "sb3-sac": ("sb3_one_step", "OneStepSAC"),
}
NEVERGRAD = "nevergrad-"
PROBED_BUDGET, PROBED_EVALUATIONS = 2000, 64


class UnknownOptimizerError(ValueError):
    """No optimiser has that name."""


class UnavailableOptimizerError(ValueError):
    """The optimiser exists but cannot be used in this installation; the message gives the reason."""


def names() -> tuple[str, ...]:
    """Names of the optimisers that are compared. `make` also accepts any other ``nevergrad-<name of its registry>``."""
    return tuple(CLASSES)


def make(name: str, dimension: int = 7, budget: int = 2000, seed: int = 0, **options: Any) -> Optimizer:
    """Make an optimiser.

    Parameters
    ----------
    name : str
        One of `names`, or ``nevergrad-`` followed by any name of nevergrad's registry.
    dimension, budget, seed : int
        See `Optimizer`.
    **options
        Keyword arguments of that optimiser, such as ``particles`` of ``pso``.

    Raises
    ------
    UnknownOptimizerError
        No optimiser has that name. The message suggests the nearest one.
    UnavailableOptimizerError
        Its package is not installed, or it is known not to work.
    ValueError
        It has no such option, or a number is out of range.
    """
    module, class_name = CLASSES.get(name, CLASSES["nevergrad-NGOpt"])
    if name not in CLASSES and not name.startswith(NEVERGRAD):
        raise UnknownOptimizerError(_unknown(name, CLASSES))
    try:
        made = getattr(import_module(f"inkjet_env.optimizers.{module}"), class_name)
    except ModuleNotFoundError as error:
        raise UnavailableOptimizerError(f"{name} needs the package {error.name!r}, which is not installed.") from None
    known = [p.name for p in inspect.signature(made).parameters.values() if p.kind is p.KEYWORD_ONLY]
    if name.startswith(NEVERGRAD):
        known.remove("method")
        _check_nevergrad(name)
    for option in options:
        if option not in known:
            raise ValueError(f"{name} has no option {option!r}; it has {', '.join(known) or 'none'}.")
    if name.startswith(NEVERGRAD):
        options["method"] = name.removeprefix(NEVERGRAD)
    return made(dimension, budget, seed, **options)


def uses_gradient(name: str) -> bool:
    """Whether an optimiser needs gradients; False if it is not available."""
    module, class_name = CLASSES.get(name, CLASSES["nevergrad-NGOpt"])
    try:
        return bool(getattr(import_module(f"inkjet_env.optimizers.{module}"), class_name).uses_gradient)
    except ModuleNotFoundError:
        return False


def availability(of: Iterable[str] | None = None) -> dict[str, str | None]:
    """Which optimisers work in this installation: for each name None, or the reason why it does not.

    Each is created with a budget of 2,000 and tried for 64 evaluations, once per process.

    Parameters
    ----------
    of : iterable of str, optional
        Names of optimisers; those of `names` unless given.
    """
    return {name: _fault(name) for name in (names() if of is None else of)}


@functools.cache
def _fault(name: str) -> str | None:
    try:
        optimizer = make(name, budget=PROBED_BUDGET)
        try:
            _probe(optimizer)
        finally:
            optimizer.close()
    except UnavailableOptimizerError as error:
        return str(error)
    except Exception as error:  # any exception of a third-party optimiser is the reason
        return f"it fails in this installation: {type(error).__name__}: {error}"
    return None


def _probe(optimizer: Optimizer) -> None:
    while optimizer.budget - optimizer.remaining < PROBED_EVALUATIONS:
        points = optimizer.ask()
        optimizer.tell(points, (points**2).sum(axis=1), 2 * points if optimizer.uses_gradient else None)
        if not np.isfinite(points).all():
            raise ValueError(f"it asks for {points.tolist()}")


def _check_nevergrad(name: str) -> None:
    import nevergrad

    method, registry = name.removeprefix(NEVERGRAD), nevergrad.optimizers.registry
    if method not in registry:
        raise UnknownOptimizerError(_unknown(name, [*CLASSES, *(NEVERGRAD + known for known in registry)]))
    if re.search("BO(?!BYQA)", method):
        raise UnavailableOptimizerError(
            f"{name} is refused: nevergrad's Bayesian optimisers depend on outdated libraries and hang."
        )


def _unknown(name: str, known: Iterable[str]) -> str:
    from inkjet_env.naming import nearest_name

    return f"there is no optimiser {name!r}.{nearest_name(name, known)} Known: {', '.join(CLASSES)}."
