"""How much of an identification is done: counted in passes over the recordings, so that the time left can be told.

How many Gauss–Newton steps a fit takes is not known beforehand, nor how many fits follow. So each stage takes a share
of what is left, and within it every recording that is simulated takes a share of what is left of the stage: what is
done only grows, and reaches the total at the end, whatever the fit needs.
"""

from __future__ import annotations

import math
from collections.abc import Callable

PARTS = 100
"""Number of parts that are counted."""
PASSES = 6.0
"""Passes over the recordings within which a fit does most of its work: three Gauss–Newton steps, each of which
linearises the model and tries the next one."""


class WorkDone:
    """What is done of an identification; tells each step, and each part of it, in words.

    Parameters
    ----------
    tell : callable
        Called with the name of the current step, which ends in ``(k of 100)`` as soon as a part is finished.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._name = ""
        self._before = self._end = self._passes = 0.0
        self._told = -1

    @property
    def done(self) -> float:
        """Share that is done, 0 … 1; it never decreases."""
        return self._before + (self._end - self._before) * -math.expm1(-self._passes / PASSES)

    def begin(self, name: str, share: float) -> None:
        """Begin a stage that takes a ``share``, 0 … 1, of all that is left."""
        self._before, self._passes, self._name = self._end, 0.0, name
        self._end += share * (1.0 - self._end)
        self._told = -1
        self._tell_part()

    def passed(self, passes: float) -> None:
        """Count a part of a pass, or several passes, over the recordings of the stage."""
        self._passes += passes
        self._tell_part()

    def finish(self) -> None:
        """Count all that is left."""
        self.begin("describing the head", 1.0)
        self._before = 1.0
        self._tell_part()

    def _tell_part(self) -> None:
        part = math.floor(PARTS * self.done)
        if part > self._told:
            self._told = part
            self._tell(f"{self._name} ({min(part + 1, PARTS)} of {PARTS})")
