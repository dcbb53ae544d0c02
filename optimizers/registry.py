"""The optimisers by name. A third-party package is imported only when one of its optimisers is requested.

Besides the names listed here, `make` takes those that other packages offer as entry points of the group
``inkjet_env.optimizers``, and ``module:Class`` for a class of your own; see `inkjet_env.plugins`."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Collection, Iterable
from importlib import import_module
from typing import Any

import numpy as np

from inkjet_env import plugins
from inkjet_env.extras import MissingExtraError, extra
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
    """Names of this package's optimisers. `make` also accepts any other ``nevergrad-<name of its registry>``."""
    return tuple(CLASSES)


def installed() -> tuple[str, ...]:
    """Names of the optimisers that other installed packages offer."""
    return tuple(plugins.installed(plugins.OPTIMIZERS, CLASSES))


def modules(of: Iterable[str]) -> set[str]:
    """Modules of this package that hold these optimisers, to be imported before they are needed."""
    return {f"{__package__}.{CLASSES[name][0]}" for name in of if name in CLASSES}


def provenance(name: str) -> dict[str, str] | None:
    """Place, code and package of an optimiser that is not this package's own; None for one that is."""
    found = _plugin(name)
    return None if found is None else found.provenance()


def make(name: str, dimension: int = 7, budget: int = 2000, seed: int = 0, **options: Any) -> Optimizer:
    """Make an optimiser.

    Parameters
    ----------
    name : str
        One of `names` or `installed`, ``nevergrad-`` followed by any name of nevergrad's registry, or ``module:Class``.
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
        It has no such option, a number is out of range, or a class of your own is not an `Optimizer`.
    """
    made = _class_of(name)
    known = [p.name for p in inspect.signature(made).parameters.values() if p.kind is p.KEYWORD_ONLY]
    if name.startswith(NEVERGRAD):
        known.remove("method")
        _check_nevergrad(name)
    for option in options:
        if option not in known:
            raise ValueError(f"{name} has no option {option!r}; it has {', '.join(known) or 'none'}.")
    if name.startswith(NEVERGRAD):
        options["method"] = name.removeprefix(NEVERGRAD)
    try:
        return made(dimension, budget, seed, **options)
    except TypeError as error:
        traceback = error.__traceback__
        if traceback is None or traceback.tb_next is not None:  # not raised by the call itself
            raise
        raise ValueError(f"optimiser {name}: it must be made from dimension, budget and seed ({error}).") from None


def uses_gradient(name: str) -> bool:
    """Whether an optimiser needs gradients; False if it is not available."""
    try:
        return bool(_class_of(name).uses_gradient)
    except UnavailableOptimizerError:
        return False


def _class_of(name: str) -> type[Optimizer]:
    if name in CLASSES or name.startswith(NEVERGRAD):
        module, class_name = CLASSES.get(name, CLASSES["nevergrad-NGOpt"])
        try:
            with extra(name):
                return getattr(import_module(f"inkjet_env.optimizers.{module}"), class_name)
        except MissingExtraError as error:
            raise UnavailableOptimizerError(f"{error}.") from None
    found = _plugin(name)
    if found is None:
        raise UnknownOptimizerError(_unknown(name, [*CLASSES, *installed()]))
    try:
        made = found.load()
    except ValueError as error:
        raise UnknownOptimizerError(f"optimiser {name}: {error}") from None
    if not (isinstance(made, type) and issubclass(made, Optimizer)):
        raise UnknownOptimizerError(
            f"optimiser {name}: it must be a subclass of inkjet_env.optimizers.Optimizer; got {made!r}."
        )
    for method in ("propose", "learn"):
        if getattr(made, method) is getattr(Optimizer, method):
            raise UnknownOptimizerError(
                f"optimiser {name}: it must define {method}, see inkjet_env.optimizers.Optimizer."
            )
    return made


def _plugin(name: str) -> plugins.Plugin | None:
    if name in CLASSES or name.startswith(NEVERGRAD):
        return None
    try:
        return plugins.plugin(plugins.OPTIMIZERS, name, CLASSES)
    except ValueError as error:
        raise UnknownOptimizerError(f"optimiser {name}: {error}") from None


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
        failure = f"{type(error).__name__}: {error}"
        if _plugin(name) is None:
            return f"it fails in this installation: {failure}"
        return f"its code fails: {failure}{plugins.place_of(error)}"
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
        raise UnknownOptimizerError(_unknown(name, CLASSES, [*CLASSES, *(NEVERGRAD + known for known in registry)]))
    if re.search("BO(?!BYQA)", method):
        raise UnavailableOptimizerError(
            f"{name} is refused: nevergrad's Bayesian optimisers depend on outdated libraries and hang."
        )


def _unknown(name: str, known: Collection[str], similar: Iterable[str] | None = None) -> str:
    from inkjet_env.naming import nearest_name

    nearest = nearest_name(name, known if similar is None else similar)
    return f"there is no optimiser {name!r}.{nearest} Known: {', '.join(known)}."
