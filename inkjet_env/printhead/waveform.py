"""The bipolar trapezoid: seven parameters, six knots, linear edges between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.printhead.driver_limits import PARAMETER_NAMES, DriverLimits
from inkjet_env.typing import Real

PARAMETER_UNITS = ("V", "V", "s", "s", "s", "s", "s")


LARGEST_DRIVE_V = 1e5
"""Largest plateau accepted, in volts; anything above is a mistake of unit."""

LONGEST_DURATION_S = 0.01
"""Longest duration accepted, in seconds; anything above is a mistake of unit."""

_RULES = (
    ("must be at least 0 V", "The first pulse is the positive one; a negative pulse goes into U2"),
    ("must be at most 0 V", "The second pulse is the negative one; a positive pulse goes into U1"),
    *[("must be a duration of at least 0 s", "Check the sign and the order U1 U2 t1 t2 t3 t4 t5")] * 5,
)


def _check_rules(values: Real) -> None:
    """Raise ``ValueError`` at the first broken rule of an ``(n, 7)`` array."""
    not_finite = ~np.isfinite(values)
    wrong_sign = np.column_stack([values[:, 0] < 0, values[:, 1] > 0, values[:, 2:] < 0])
    too_large = np.abs(values) > np.array([LARGEST_DRIVE_V] * 2 + [LONGEST_DURATION_S] * 5)
    for broken in (not_finite, wrong_sign, too_large):
        if broken.any():
            row, column = (int(i) for i in np.argwhere(broken)[0])
            if broken is not_finite:
                rule, fix = "must be finite", "Replace the NaN or infinity"
            elif broken is wrong_sign:
                rule, fix = _RULES[column]
            elif column < 2:
                rule, fix = f"must be within ±{LARGEST_DRIVE_V:g} V", "Check the unit, volts"
            else:
                rule, fix = f"must be at most {LONGEST_DURATION_S:g} s", "Durations are in seconds: 10 µs is 10e-6"
            place = f" in row {row} of the waveforms" if len(values) > 1 else ""
            got = f"{values[row, column]:g} {PARAMETER_UNITS[column]}"
            raise ValueError(f"{PARAMETER_NAMES[column]} {rule}; got {got}{place}. {fix}.")


def as_waveform_array(waveforms: ArrayLike) -> Real:
    """Check waveform parameters and return them as one contiguous array.

    Parameters
    ----------
    waveforms : array_like, shape (7,) or (n, 7)
        ``U1, U2`` in volts and ``t1 … t5`` in seconds.

    Returns
    -------
    ndarray, shape (n, 7)
        The checked parameters in the same order and units, float64 and C-contiguous.

    Raises
    ------
    ValueError
        Wrong shape, a value that is not finite, ``U1 < 0``, ``U2 > 0``, a duration below zero, or a value so large
        that its unit must be wrong.
    """
    try:
        values = np.ascontiguousarray(waveforms, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError("waveforms must be numbers of shape (7,) or (n, 7): U1 U2 t1 t2 t3 t4 t5.") from None
    if values.ndim == 1:
        values = values[None, :]
    if values.ndim != 2 or values.shape[1] != 7:
        raise ValueError(
            f"waveforms must have shape (7,) or (n, 7): U1 U2 t1 t2 t3 t4 t5; got shape {np.shape(waveforms)}."
        )
    _check_rules(values)
    return values


@dataclass(frozen=True)
class Waveform:
    """Bipolar trapezoid drive waveform (Zhu et al. 2024, Fig. 3).

    Parameters
    ----------
    U1 : float
        Positive plateau in volts, at least 0.
    U2 : float
        Negative plateau in volts, at most 0.
    t1, t2, t3, t4, t5 : float
        Durations in seconds, at least 0: rise (0 → U1), dwell (at U1), fall (U1 → U2), second dwell (at U2),
        return (U2 → 0). A duration of zero is a jump.

    Examples
    --------
    >>> waveform = Waveform(100.0, -50.0, 2e-6, 10e-6, 4e-6, 8e-6, 2e-6)
    >>> waveform.knots()[1]
    array([  0., 100., 100., -50., -50.,   0.])
    """

    U1: float
    U2: float
    t1: float
    t2: float
    t3: float
    t4: float
    t5: float

    def __post_init__(self) -> None:
        as_waveform_array(self._values())

    @classmethod
    def from_array(cls, values: ArrayLike) -> Waveform:
        """Waveform from an array of shape (7,) in the order ``U1 U2 t1 t2 t3 t4 t5`` (V, V, s …)."""
        rows = as_waveform_array(values)
        if len(rows) != 1:
            raise ValueError(f"values must be one waveform of shape (7,); got {len(rows)} rows.")
        return cls(*(float(v) for v in rows[0]))

    def _values(self) -> tuple[float, ...]:
        return self.U1, self.U2, self.t1, self.t2, self.t3, self.t4, self.t5

    def to_array(self) -> Real:
        """The seven parameters, shape (7,), in volts and seconds."""
        return np.array(self._values())

    @property
    def duration_s(self) -> float:
        """Sum of the five durations, in seconds."""
        return math.fsum((self.t1, self.t2, self.t3, self.t4, self.t5))

    def knots(self) -> tuple[Real, Real]:
        """Times in seconds and drive in volts at the six corners: two arrays of shape (6,)."""
        time_s = np.concatenate([[0.0], np.cumsum([self.t1, self.t2, self.t3, self.t4, self.t5])])
        return time_s, np.array([0.0, self.U1, self.U1, self.U2, self.U2, 0.0])

    def drive_V(self, time_s: ArrayLike) -> Real:
        """Drive in volts at times in seconds (same shape); zero outside the waveform."""
        knot_s, knot_V = self.knots()
        return np.interp(np.asarray(time_s, dtype=np.float64), knot_s, knot_V, left=0.0, right=0.0)


@dataclass(frozen=True)
class Bounds:
    """Search box for the seven waveform parameters, and its map to the box [-1, 1]⁷.

    Parameters
    ----------
    lower, upper : tuple of 7 floats
        Ends in volts and seconds, order ``U1 U2 t1 t2 t3 t4 t5``. Defaults: U1 0…100 V, U2 −100…0 V, durations
        1…20 µs (the paper prints the voltages, not the durations).
    limits : DriverLimits, optional
        What the driver can do. Each waveform of the box is then replaced by a legal one: its voltages are clipped,
        rounded towards 0 V to the converter's steps, and lowered in proportion where their edges would not fit; edges
        are lengthened to what the slew rates need, durations rounded to time steps and, if the waveform is too long,
        shortened in proportion to what can be spared. A legal waveform stays as it is.

    Raises
    ------
    ValueError
        An end is no waveform's, the ends are the wrong way round, or no waveform of the box is within the limits.

    Examples
    --------
    >>> Bounds().from_unit([1, -1, -1, 0, 0, 0, 1])[:2]
    array([ 100., -100.])
    >>> limits = DriverLimits(lowest_V=0, highest_V=48, rise_V_per_us=20, step_us=0.1)
    >>> Bounds(limits=limits).from_unit([1, -1, -1, 0, 0, 0, 1])[:3]
    array([4.8e+01, 0.0e+00, 2.4e-06])
    """

    lower: tuple[float, ...] = (0.0, -100.0, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6)
    upper: tuple[float, ...] = (100.0, 0.0, 20e-6, 20e-6, 20e-6, 20e-6, 20e-6)
    limits: DriverLimits | None = None
    names: ClassVar[tuple[str, ...]] = PARAMETER_NAMES
    _low: Real = field(init=False, repr=False, compare=False)
    _high: Real = field(init=False, repr=False, compare=False)
    _legal_box: tuple[Real, Real] | None = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for label in ("lower", "upper"):
            try:
                values = tuple(float(v) for v in np.ravel(getattr(self, label)))
            except (TypeError, ValueError):
                raise ValueError(
                    f"bounds.{label} must be numbers (U1 U2 t1 … t5); got {getattr(self, label)!r}."
                ) from None
            if len(values) != 7:
                raise ValueError(f"bounds.{label} must hold 7 values (U1 U2 t1 … t5); got {len(values)}.")
            object.__setattr__(self, label, values)
        low, high = as_waveform_array(self.lower)[0], as_waveform_array(self.upper)[0]
        if (low > high).any():
            name = PARAMETER_NAMES[int(np.argmax(low > high))]
            raise ValueError(f"bounds.lower must not exceed bounds.upper; they are the wrong way round for {name}.")
        object.__setattr__(self, "_low", low)
        object.__setattr__(self, "_high", high)
        object.__setattr__(self, "_legal_box", None if self.limits is None else self.limits.within(low, high))

    @property
    def half_width(self) -> Real:
        """Half the widths of the box, in volts and seconds, shape (7,): d(physical)/d(unit)."""
        return (self._high - self._low) / 2

    def from_unit(self, points: ArrayLike) -> Real:
        """Physical parameters (V, s) of points in [-1, 1], shape (7,) or (n, 7); ±1 maps exactly to the bounds."""
        points = np.asarray(points, dtype=np.float64)
        if points.shape[-1:] != (7,):
            raise ValueError(f"points must have shape (7,) or (n, 7); got shape {points.shape}.")
        return self.legal(np.clip(((1 - points) * self._low + (1 + points) * self._high) / 2, self._low, self._high))

    def legal(self, waveforms: Real) -> Real:
        """The waveforms of the box, shape (7,) or (n, 7), as the driver can do them; the same ones without limits."""
        if self.limits is None or self._legal_box is None:
            return waveforms
        return self.limits.made_legal(waveforms, *self._legal_box)

    @property
    def longest_s(self) -> float:
        """Duration of the longest waveform, in seconds."""
        longest_s = math.fsum(self.upper[2:])
        return longest_s if self.limits is None else min(longest_s, 1e-6 * self.limits.longest_us)

    def slope(self, points: ArrayLike) -> Real:
        """Derivative of `from_unit` in each coordinate, V or s per unit, shape (7,) or (n, 7), as the points.

        It is half the width of the box, and zero outside [-1, 1], where `from_unit` is constant; at ±1 exactly it is
        that of the inside. With a driver's limits there is none.
        """
        if self.limits is not None:
            raise ValueError("waveforms within a driver's limits change in steps: there is no derivative.")
        return np.where(np.abs(np.asarray(points, dtype=np.float64)) > 1.0, 0.0, self.half_width)

    def to_unit(self, waveforms: ArrayLike) -> Real:
        """Points in [-1, 1] of physical parameters, shape (7,) or (n, 7); an axis of zero width maps to 0."""
        offset = np.asarray(waveforms, dtype=np.float64) - (self._low + self._high) / 2
        half_width = self.half_width
        return np.divide(offset, half_width, out=np.zeros_like(offset), where=half_width > 0)
