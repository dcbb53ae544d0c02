"""Where a fit of base model and effects stands, and what it ended with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class ModelState:
    """Everything that decides a simulation of the recordings.

    Attributes
    ----------
    head : Head
        Parameters of the base model.
    active : ActiveEffects
        Effects that are on, with the coordinates of their parameters.
    states : dict of str to tuple of float
        By name of a recording with a free initial state: deflection and scaled speed at its first sample, in
        hysteretic volts.
    """

    head: Head
    active: ActiveEffects
    states: Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class FitResult:
    """Base model and effects at the minimum.

    Attributes
    ----------
    end : ModelState
        Where the fit ended.
    residuals : dict of str to ndarray
        By recording, measured minus modelled, whitened, random effects taken out, shape (n,); all samples.
    nll : float
        Negative log-likelihood less its constant: half the sum of squares over the fitted samples.
    jacobian : ndarray, shape (rows, k)
        Whitened sensitivities of the fitted samples, in order, to the coordinates; random effects taken out.
    converged : bool
        Whether the last step promised or gained less than the stopping rule asks for.
    jacobian_at : ModelState
        Where the sensitivities were taken: before the last step.
    whole : bool
        Whether every term of the effects' laws took part, or only those that were on when it began.
    started : Head
        Base model whose free ringing stands for unknown initial states.
    """

    end: ModelState
    residuals: Mapping[str, Real]
    nll: float
    jacobian: Real
    converged: bool
    jacobian_at: ModelState
    whole: bool
    started: Head

    @property
    def head(self) -> Head:
        """Base model at the end."""
        return self.end.head

    @property
    def active(self) -> ActiveEffects:
        """Effects with their coordinates at the end."""
        return self.end.active

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of the effects."""
        return self.active.ids

    def moved(self, head: Head | None = None, active: ActiveEffects | None = None) -> FitResult:
        """The result with the base model or the effects of its end replaced: where another fit may begin."""
        end = replace(self.end, head=head or self.head, active=self.active if active is None else active)
        return replace(self, end=end)

    @property
    def idle(self) -> NDArray[np.bool_]:
        """Coordinates that did nothing, shape (k,): fixed, of terms that are off, or shapes of such terms."""
        return np.asarray(~self.jacobian.any(axis=0))
