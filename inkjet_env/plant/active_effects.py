"""Effects that are on together, with the vector of their fitted parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from inkjet_env.plant.effect import Effect, Parameter, Values, coordinates, rest, terms_of, values_at
from inkjet_env.typing import Real

SMALLEST_SCALE = 1e-6
"""Smallest scale of a strength for a finite difference, as a share of its range."""
SMALLEST_SCALE_OF_SHAPE = 1e-2
"""The same for a dimensionless shape, which changes the signal in proportion to a strength that may be small."""


@dataclass(frozen=True, eq=False)
class ActiveEffects:
    """Effects that are on together and the coordinates of all their parameters, one effect after another.

    Parameters
    ----------
    effects : tuple of Effect
        The effects, in the order in which they were switched on; each id once.
    theta : ndarray, shape (k,)
        Coordinates (see `Parameter.coordinate`): each parameter, its logarithm or its reciprocal.

    Raises
    ------
    ValueError
        ``theta`` does not have one coordinate for each parameter, or an id comes twice.
    """

    effects: tuple[Effect, ...] = ()
    theta: Real = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        count = sum(len(effect.parameters) for effect in self.effects)
        if self.theta.shape != (count,):
            raise ValueError(
                f"theta must have shape ({count},), one coordinate for each parameter of {', '.join(self.ids)}; "
                f"got {self.theta.shape}."
            )
        if len(set(self.ids)) < len(self.ids):
            raise ValueError(f"an effect can be active only once; got {', '.join(self.ids)}.")

    @classmethod
    def of(cls, pairs: Iterable[tuple[Effect, Values]]) -> ActiveEffects:
        """Effects with their values.

        Parameters
        ----------
        pairs : iterable of (Effect, mapping of str to float)
            Each effect with the values of all its parameters, in their units.
        """
        chosen = tuple(pairs)
        theta = np.concatenate([coordinates(effect, values) for effect, values in chosen] or [np.zeros(0)])
        return cls(tuple(effect for effect, _ in chosen), theta)

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of the effects, in their order."""
        return tuple(effect.id for effect in self.effects)

    @cached_property
    def slices(self) -> Mapping[str, slice]:
        """Slice of ``theta`` that holds the coordinates of each effect, by id."""
        ends = np.cumsum([len(effect.parameters) for effect in self.effects])
        return {e.id: slice(int(end) - len(e.parameters), int(end)) for e, end in zip(self.effects, ends, strict=True)}

    @cached_property
    def parameters(self) -> tuple[tuple[Effect, Parameter], ...]:
        """Effect and parameter of each coordinate."""
        return tuple((effect, parameter) for effect in self.effects for parameter in effect.parameters)

    @cached_property
    def pairs(self) -> tuple[tuple[Effect, dict[str, float]], ...]:
        """Each effect with the values of its parameters, in their units."""
        return tuple((effect, values_at(effect, self.theta_of(effect))) for effect in self.effects)

    def theta_of(self, effect: Effect) -> Real:
        """Coordinates of one of the effects, shape (number of its parameters,)."""
        return self.theta[self.slices[effect.id]]

    def at(self, theta: Real) -> ActiveEffects:
        """The same effects at other coordinates, shape (k,)."""
        return replace(self, theta=theta)

    def stepped(self, place: int, step: float) -> ActiveEffects:
        """The same effects with the coordinate at index ``place`` moved by ``step``."""
        theta = self.theta.copy()
        theta[place] += step
        return self.at(theta)

    def plus(self, effect: Effect, values: Values) -> ActiveEffects:
        """These effects and one more, after the others."""
        return ActiveEffects((*self.effects, effect), np.concatenate([self.theta, coordinates(effect, values)]))

    def with_values(self, effect: Effect, values: Values) -> ActiveEffects:
        """The same effects, one of them with other values."""
        theta = self.theta.copy()
        theta[self.slices[effect.id]] = coordinates(effect, values)
        return self.at(theta)

    def minus(self, effect: Effect) -> ActiveEffects:
        """These effects without one of them."""
        return ActiveEffects.of((e, v) for e, v in self.pairs if e.id != effect.id)

    @property
    def last(self) -> Effect:
        """The effect that was switched on last."""
        return self.effects[-1]

    def terms(self, effect: Effect) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]]]:
        """Terms of an effect's law that are on and that are off: names of their parameters."""
        return terms_of(effect, self.theta_of(effect))

    def without_term(self, effect: Effect, term: Sequence[str]) -> ActiveEffects:
        """The same effects with one term of an effect's law switched off."""
        theta = self.theta.copy()
        for place, parameter in enumerate(effect.parameters, start=self.slices[effect.id].start):
            if parameter.name in term:
                theta[place] = rest(effect, parameter)
        return self.at(theta)

    @cached_property
    def off(self) -> NDArray[np.bool_]:
        """Whether each coordinate belongs to a term that is off, shape (k,)."""
        result = np.zeros(self.theta.size, dtype=bool)
        for effect in self.effects:
            names = {name for term in self.terms(effect)[1] for name in term}
            result[self.slices[effect.id]] = [p.name in names for p in effect.parameters]
        return result

    def scale(self, place: int) -> float:
        """Scale of a coordinate for a finite difference: its magnitude, or a small share of its range."""
        effect, parameter = self.parameters[place]
        if parameter.scale == "log":
            return 1.0
        low, high = parameter.bounds
        shape = parameter.unit == "1" and parameter.name not in effect.strengths
        least = SMALLEST_SCALE_OF_SHAPE if shape else SMALLEST_SCALE
        return max(abs(float(self.theta[place])), least * (high - low))
