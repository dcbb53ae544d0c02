"""Optimisers with one ask-and-tell interface, created by name and run by `inkjet_env.optimizers.loop.minimise`."""

from inkjet_env.optimizers.base import Optimizer
from inkjet_env.optimizers.registry import (
    UnavailableOptimizerError,
    UnknownOptimizerError,
    availability,
    installed,
    make,
    modules,
    names,
    provenance,
    uses_gradient,
)

__all__ = [
    "Optimizer",
    "UnavailableOptimizerError",
    "UnknownOptimizerError",
    "availability",
    "installed",
    "make",
    "modules",
    "names",
    "provenance",
    "uses_gradient",
]
