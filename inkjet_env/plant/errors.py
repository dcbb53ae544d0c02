"""Failures of a simulation: parameter values without a solution, which a fit avoids, and faulty code of an effect."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from inkjet_env.printhead.resonator import ImpossibleHeadError


class SimulationError(FloatingPointError):
    """The model has no solution for these values: no steady state, unbounded motion, a resonator that does not ring.

    An effect raises it for values that it cannot simulate; a fit then tries others.
    """


class EffectError(RuntimeError):
    """An effect's own code is at fault; the exception it raised is chained."""


NUMERICAL = (FloatingPointError, OverflowError, np.linalg.LinAlgError)
"""Exceptions that trial values in a fit may cause without a fault of the code: `SimulationError`, numbers out of
range."""


@contextmanager
def blamed(effect: Any, what: str) -> Iterator[None]:
    """Report any exception raised inside, except those of `NUMERICAL`, as an `EffectError` of the effect.

    A head that cannot be, which the effect made of its trial values, is a `SimulationError`.
    """
    try:
        yield
    except (*NUMERICAL, EffectError):
        raise
    except ImpossibleHeadError as error:
        raise SimulationError(str(error)) from error
    except Exception as error:
        name = getattr(effect, "id", type(effect).__name__)
        raise EffectError(
            f"effect {name!r}: {what} raised {type(error).__name__}: {str(error).rstrip('.')}. Correct the effect; "
            "for values that it cannot simulate it should raise inkjet_env.plant.SimulationError."
        ) from error


def answerable(method: Callable[..., Any], name: str) -> Callable[..., Any]:
    """Method of an effect whose faults are reported as an `EffectError`; see `blamed`."""

    @functools.wraps(method)
    def called(self: Any, *args: Any, **options: Any) -> Any:
        with blamed(self, f"its {name}()"):
            return method(self, *args, **options)

    return called
