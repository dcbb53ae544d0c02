"""What may go wrong in a simulation: values that have no answer, which a fit leaves, and code that is at fault."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np


class SimulationError(FloatingPointError):
    """A model with these values has no answer: no steady state, a motion without bound, a resonator that does not ring.

    An effect raises it for values that it cannot simulate: a fit then tries others.
    """


class EffectError(RuntimeError):
    """An effect's own code is at fault; the exception it raised is chained."""


NUMERICAL = (FloatingPointError, OverflowError, np.linalg.LinAlgError)
"""What a trial value may come to in a fit, which is no fault of the code: a `SimulationError`, numbers out of range."""


@contextmanager
def blamed(effect: Any, what: str) -> Iterator[None]:
    """Whatever is raised inside, but for `NUMERICAL`, is told as a fault of an effect's: an `EffectError`."""
    try:
        yield
    except (*NUMERICAL, EffectError):
        raise
    except Exception as error:
        name = getattr(effect, "id", type(effect).__name__)
        raise EffectError(
            f"effect {name!r}: {what} raised {type(error).__name__}: {str(error).rstrip('.')}. Mend the effect; for "
            "values that it cannot simulate it should raise inkjet_env.plant.SimulationError."
        ) from error


def answerable(method: Callable[..., Any], name: str) -> Callable[..., Any]:
    """An effect's method of that name, with its faults told as such; see `blamed`."""

    @functools.wraps(method)
    def called(self: Any, *args: Any, **options: Any) -> Any:
        with blamed(self, f"its {name}()"):
            return method(self, *args, **options)

    return called
