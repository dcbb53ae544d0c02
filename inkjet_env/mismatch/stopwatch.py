"""How long each step of a diagnosis takes."""

from __future__ import annotations

import time


class Stopwatch:
    """Durations of named steps, which may come back.

    Attributes
    ----------
    stages : dict of str to float
        Duration of each step so far, in seconds.
    """

    def __init__(self) -> None:
        self.started = self.last = time.perf_counter()
        self.stages: dict[str, float] = {}

    def took(self, stage: str) -> None:
        """Add the time since the last call to a step."""
        now = time.perf_counter()
        self.stages[stage] = self.stages.get(stage, 0.0) + now - self.last
        self.last = now

    @property
    def seconds(self) -> float:
        """Time since the stopwatch was started, in seconds."""
        return time.perf_counter() - self.started
