"""A restoring force in addition to those of spring and damper, by a compiled law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    relaxations : tuple of (int, float)
        Places in ``values`` that relax in proportion to their distance from a balance, each with its time constant in
        seconds: so slowly, perhaps, that the steady state of a repeated drive is found only with it. The memory of such
        a force begins at the first sample, with ``values``.
    """

    law: Any
    values: Real
    relaxations: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Memory:
    """Relaxing memory of a force, and what of a change of it decays over one period of the drive.

    Attributes
    ----------
    values : ndarray, shape (k,)
        Values of the force, which its law changes.
    first : ndarray, shape (k,)
        The same before all motion.
    places : ndarray of int, shape (m,)
        Places of the relaxing values.
    decays : ndarray, shape (m,)
        Share of a change of each that decays over one period.
    """

    values: Real
    first: Real
    places: NDArray[np.int64]
    decays: Real

    @classmethod
    def of(cls, force: Force, values: Real, period_s: float) -> Memory:
        """Memory of a force whose law changes ``values``, under a drive that repeats every ``period_s`` seconds."""
        places = np.array([place for place, _ in force.relaxations], dtype=np.int64)
        times_s = np.array([time_s for _, time_s in force.relaxations])
        return cls(values, np.array(force.values, dtype=np.float64), places, -np.expm1(-period_s / times_s))

    @property
    def relaxing(self) -> Real:
        """Copy of the relaxing values, shape (m,)."""
        return self.values[self.places]

    @property
    def size(self) -> float:
        """Largest magnitude of the relaxing values, above 0."""
        return max(float(np.abs(self.relaxing).max()), 1e-12)

    def set(self, relaxing: Real) -> None:
        """Set the relaxing values, shape (m,)."""
        self.values[self.places] = relaxing

    def step(self, before: Real) -> Real:
        """Distance from the relaxing values ``before`` a period to where many such periods would lead, shape (m,)."""
        result: Real = (self.relaxing - before) / self.decays
        return result


def compiled_force(law: Callable[..., float]) -> Any:
    """Decorator that compiles a force law ``law(x_V, speed_V, values) -> float`` so that the kernels can call it."""
    from numba import cfunc, types

    signature = types.float64(types.float64, types.float64, types.CPointer(types.float64))
    try:
        return cfunc(signature, cache=True, error_model="numpy")(law)
    except RuntimeError:  # a function typed into a console has no file, so its code cannot be cached
        return cfunc(signature, error_model="numpy")(law)
