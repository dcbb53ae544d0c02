"""The state of a fit of base model and effects, and its result."""

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
    """Everything that determines a simulation of the recordings.

    Attributes
    ----------
    head : Head
        Parameters of the base model.
    active : ActiveEffects
        Effects that are on, with the coordinates of their parameters.
    states : dict of str to tuple of float
        For each recording with a free initial state, by name: deflection and scaled speed at its first sample, in
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
        State at the end of the fit.
    residuals : dict of str to ndarray
        By recording, measured minus modelled, whitened, random effects projected out, shape (n,), all samples.
    nll : float
        Negative log-likelihood less its constant: half the sum of squared residuals over the fitted samples.
    jacobian : ndarray, shape (rows, k)
        Whitened sensitivities of the fitted samples, one recording after another, to the effects' coordinates; random
        effects projected out.
    converged : bool
        Whether the predicted or the actual gain of the last step was below the stopping rule's threshold.
    jacobian_at : ModelState
        State at which the sensitivities were taken: before the last step.
    whole : bool
        Whether every term of the effects' laws took part, or only those that were on at the start.
    started : Head
        Base model whose free ringing represents unknown initial states.
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
        """The result with the base model or the effects at its end replaced, as a start for another fit."""
        end = replace(self.end, head=head or self.head, active=self.active if active is None else active)
        return replace(self, end=end)

    @property
    def idle(self) -> NDArray[np.bool_]:
        """Coordinates with no influence, shape (k,): fixed, of terms that are off, or shapes of such terms."""
        return np.asarray(~self.jacobian.any(axis=0))
