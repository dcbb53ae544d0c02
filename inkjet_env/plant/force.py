"""A restoring force in addition to those of spring and damper, by a compiled law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class Force:
    """A restoring force in addition to those of spring and damper: one ``F`` of Eq. (11).

    Attributes
    ----------
    law : compiled law
        ``law(x_V, speed_V, values)`` in hysteretic volts, from the deflection, the scaled speed ``x' / ω0``, and an
        array of numbers; compiled by `compiled_force`.
    values : ndarray, shape (k,)
        Parameters of the law, followed by its memory of the motion, if it has one, which is 0 before all motion. The
        law is called once per step, in time order, and may change its memory.
    """

    law: Any
    values: Real


def compiled_force(law: Callable[..., float]) -> Any:
    """Decorator that compiles a force law ``law(x_V, speed_V, values) -> float`` so that the kernels can call it."""
    from numba import cfunc, types

    signature = types.float64(types.float64, types.float64, types.CPointer(types.float64))
    try:
        return cfunc(signature, cache=True, error_model="numpy")(law)
    except RuntimeError:  # a function typed into a console has no file, so its code cannot be cached
        return cfunc(signature, error_model="numpy")(law)
