"""Optimisers with one ask-and-tell interface, created by name and run by `optimizers.loop.minimise`."""

from optimizers.base import Optimizer
from optimizers.registry import (
    UnavailableOptimizerError,
    UnknownOptimizerError,
    availability,
    make,
    names,
    uses_gradient,
)

__all__ = [
    "Optimizer",
    "UnavailableOptimizerError",
    "UnknownOptimizerError",
    "availability",
    "make",
    "names",
    "uses_gradient",
]
