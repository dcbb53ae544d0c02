"""Where a fit of base model and effects has come to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.plant import Effect
from inkjet_env.plant.effect import terms_of, values_at
from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class Place:
    """Where a fit is: base parameters, coordinates of the effects' parameters, free initial states by recording."""

    head: Head
    theta: Real
    states: Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class FitResult:
    """Base model and effects at the minimum.

    Attributes
    ----------
    head : Head
    effects : tuple of Effect
    theta : ndarray, shape (k,)
        Coordinates of all effects' parameters, one effect after another.
    states : dict of str to tuple
        Initial deflection and speed of recordings with a free initial state.
    residuals : dict of str to ndarray
        Measured minus modelled, whitened, chance differences between recordings taken out; of all samples.
    nll : float
        Half the sum of squares over the fitted samples.
    jacobian : ndarray, shape (rows, k)
        Whitened sensitivities to the point, chance taken out; rows of the fitted samples in order.
    converged : bool
    jacobian_at : Place
        Where the sensitivities were taken: before the last step.
    whole : bool
        Whether every part of the effects' laws took part, or only those that were on when it began.
    started : Head
        Base model whose free ringing stands for unknown initial states.
    """

    head: Head
    effects: tuple[Effect, ...]
    theta: Real
    states: Mapping[str, tuple[float, float]]
    residuals: Mapping[str, Real]
    nll: float
    jacobian: Real
    converged: bool
    jacobian_at: Place
    whole: bool
    started: Head

    @property
    def ids(self) -> tuple[str, ...]:
        """Of the effects."""
        return tuple(effect.id for effect in self.effects)

    @property
    def idle(self) -> NDArray[np.bool_]:
        """Which coordinates did nothing, shape (k,): fixed, of parts that are off, or shapes of such parts."""
        return np.asarray(~self.jacobian.any(axis=0))

    @property
    def with_values(self) -> tuple[tuple[Effect, dict[str, float]], ...]:
        """Each effect with its values."""
        return split(self.effects, self.theta)


def held(effects: Sequence[Effect], theta: Real) -> NDArray[np.bool_]:
    """Which coordinates are of terms of the effects' laws that are off, shape (k,)."""
    result, at = np.zeros(theta.size, dtype=bool), 0
    for effect in effects:
        count = len(effect.parameters)
        off = {name for part in terms_of(effect, theta[at : at + count])[1] for name in part}
        result[at : at + count] = [p.name in off for p in effect.parameters]
        at += count
    return result


def split(effects: Sequence[Effect], theta: Real) -> tuple[tuple[Effect, dict[str, float]], ...]:
    """Effects with their values, from the coordinates of all one after another."""
    result, at = [], 0
    for effect in effects:
        count = len(effect.parameters)
        result.append((effect, values_at(effect, theta[at : at + count])))
        at += count
    return tuple(result)
