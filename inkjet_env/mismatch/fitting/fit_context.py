"""What every step of a diagnosis needs besides the recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from inkjet_env.mismatch.fitting.checkpoint import FitCheckpoint
from inkjet_env.mismatch.fitting.fit_result import FitResult
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.fitting.process_pool import ProcessPool
from inkjet_env.mismatch.settings import DiagnosisSettings
from inkjet_env.plant.active_effects import ActiveEffects

Task = TypeVar("Task")


@dataclass(frozen=True, eq=False)
class FitContext:
    """The processes, random numbers, progress messages, checkpoint and settings that a diagnosis's fits share.

    Parameters
    ----------
    pool : ProcessPool
        Processes that the fits run on; one unless given.
    rng : Generator
        Source of the diagnosis's random numbers, drawn in the order of its steps.
    progress : callable
        Called with a short text that says what is being done.
    checkpoint : FitCheckpoint
        Fits that an earlier, interrupted diagnosis finished; none unless given.
    settings : DiagnosisSettings
        Thresholds and limits of all steps.
    """

    pool: ProcessPool = field(default_factory=lambda: ProcessPool(1))
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    progress: Callable[[str], None] = lambda _: None
    checkpoint: FitCheckpoint = field(default_factory=FitCheckpoint)
    settings: DiagnosisSettings = field(default_factory=DiagnosisSettings)

    def fits(
        self,
        joint: OutputErrorFit,
        function: Callable[[Task], FitResult | None],
        tasks: Sequence[Task],
        questions: Sequence[tuple[ActiveEffects, FitResult, int | str | None]],
    ) -> Iterator[FitResult | None]:
        """Results of fits in the order of the tasks, each as soon as it is ready; see `FitCheckpoint.fits`."""
        return self.checkpoint.fits(self.pool, joint, function, tasks, questions)
