"""Response of a head to a piecewise-linear drive: its peaks, and its signals at any time.

Equations are numbered as in docs/explanation/model.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike

from inkjet_env.naming import check_name
from inkjet_env.printhead.cost import PeakCost
from inkjet_env.printhead.hysteresis import HYSTERESIS_MODELS, BranchLaw, PlayOperators
from inkjet_env.printhead.resonator import PiecewiseResponse
from inkjet_env.typing import Real

PLAY_OPERATORS = 200
"""Number of plays in the classic PI model, ``hysteresis="play_operators"``."""


class BaseModel(Protocol):
    """What a response needs of its head: the coefficients of Eq. (7) and the branch law of Eq. (3)."""

    @property
    def a0(self) -> float:
        """Coefficient of the resonator, in 1/s²."""

    @property
    def a1(self) -> float:
        """Coefficient of the resonator, in 1/s."""

    @property
    def b1(self) -> float:
        """Gain of the resonator, in 1/s."""

    @property
    def branch_law(self) -> BranchLaw:
        """Branch law of the hysteresis."""


@dataclass(frozen=True)
class Response:
    """Response of a head to a piecewise-linear drive that starts at time 0; made by `Printhead.respond`.

    Attributes
    ----------
    printhead : Printhead
        The head.
    knot_times_s, knot_drive_V : ndarray, shape (n,)
        Times in seconds and drive in volts at the knots of the drive.
    initial_state, window_s, hysteresis, period_s, earlier_drops
        As in `Printhead.respond`.
    peak_times_s, peaks_V : ndarray, shape (k,)
        Times in seconds and signed values in volts of every local extremum of the self-sensed signal within the window,
        in time order.
    tail_V : float
        Summed magnitude of the extrema beyond those listed, in volts (infinite window only).
    """

    printhead: BaseModel
    knot_times_s: Real
    knot_drive_V: Real
    initial_state: str
    window_s: float
    hysteresis: str = "full_memory"
    period_s: float = math.inf
    earlier_drops: float = math.inf

    def __post_init__(self) -> None:
        check_name("hysteresis", self.hysteresis, HYSTERESIS_MODELS)
        times, values, tail = self._ringing.extrema(self.window_s)
        object.__setattr__(self, "peak_times_s", times)
        object.__setattr__(self, "peaks_V", values)
        object.__setattr__(self, "tail_V", tail)

    peak_times_s: Real = field(init=False)
    peaks_V: Real = field(init=False)
    tail_V: float = field(init=False)

    @cached_property
    def _ringing(self) -> PiecewiseResponse:
        head, law = self.printhead, self.printhead.branch_law
        if self.hysteresis == "play_operators":
            plays = PlayOperators.of_branch_law(law, PLAY_OPERATORS)
            rows = plays.pieces(self.knot_drive_V, self.initial_state)
            rates = rows[:, 3:4]
        else:
            rows = law.pieces(self.knot_drive_V, self.initial_state, self.hysteresis == "one_point")
            rates = branch_rates(law, rows)
        segment_s = np.diff(self.knot_times_s)
        durations: list[float] = []
        polynomials: list[Real] = []
        for segment, duration in enumerate(segment_s):
            mine = rows[:, 0] == segment
            durations.extend(rows[mine, 2] * duration if mine.any() else [duration])
            polynomials.extend(rates[mine] if mine.any() else np.zeros((1, rates.shape[1])))
        from_rest = PiecewiseResponse(head.a0, head.a1, head.b1, np.array(durations), np.array(polynomials))
        if math.isinf(self.period_s):
            return from_rest
        rest_s = max(self.period_s - float(from_rest.start_s[-1]), 0.0)
        left = from_rest.amplitude[-1] * np.exp(from_rest.pole * rest_s)
        start = left / (1 - np.exp(from_rest.pole * self.period_s))
        if math.isfinite(self.earlier_drops):
            start = start * (1 - np.exp(from_rest.pole * self.period_s * self.earlier_drops))
        return replace(from_rest, start_state=complex(start))

    def drive_V(self, time_s: ArrayLike) -> Real:
        """Drive in volts at times in seconds, same shape."""
        return np.interp(
            np.asarray(time_s, dtype=np.float64),
            self.knot_times_s,
            self.knot_drive_V,
            left=0.0,
            right=float(self.knot_drive_V[-1]),
        )

    def hysteretic_V(self, time_s: ArrayLike) -> Real:
        """Hysteretic drive in volts at times in seconds, same shape; zero at the start."""
        ringing = self._ringing
        antiderivative = np.array([poly.polyint(rate) for rate in ringing.rate_V])
        at_start = np.concatenate([[0.0], np.cumsum(antiderivative.sum(axis=1))])
        time = np.asarray(time_s, dtype=np.float64)
        where = np.searchsorted(ringing.start_s, time.ravel(), side="right") - 1
        value = np.where(where < 0, 0.0, at_start[np.clip(where, 0, None)])
        inside = (where >= 0) & (where < ringing.duration_s.size)
        piece = where[inside]
        tau = (time.ravel()[inside] - ringing.start_s[piece]) / ringing.duration_s[piece]
        value[inside] += np.sum(antiderivative[piece] * tau[:, None] ** np.arange(antiderivative.shape[1]), axis=1)
        return value.reshape(time.shape)

    def sensor_V(self, time_s: ArrayLike) -> Real:
        """Self-sensed signal in volts at times in seconds, same shape."""
        return self._ringing.sensor_V(time_s)

    def deflection_V(self, time_s: ArrayLike) -> Real:
        """Deflection at times in seconds, same shape, as the static hysteretic drive that would hold it, in volts.

        It is ``a0 / (s² + a1 s + a0)`` on the hysteretic drive, zero at the start, and follows from the state of the
        resonator: ``v - (a1 y + y') / b1`` with ``y`` the self-sensed signal. Multiplied by the static gain it is a
        displacement.
        """
        ringing = self._ringing
        amplitude = ringing.amplitude_at(time_s)
        # y' = Im λA and y = Im A, Eq. (8a) of `resonator`; b1 cancels.
        moved = ((ringing.pole + self.printhead.a1) * amplitude).imag
        return self.hysteretic_V(time_s) - moved / self.printhead.b1

    def cost(self, peak_cost: PeakCost | None = None) -> float:
        """Peak cost in volts; the default is `PeakCost()`."""
        return (peak_cost or PeakCost())(self.peaks_V, self.tail_V)


def branch_rates(law: BranchLaw, pieces: Real) -> Real:
    """``dv/dτ`` on branch pieces as polynomials of ``τ``, lowest power first, in volts: shape (pieces, degree)."""
    slope = poly.polyder(law.ascending)
    rates = np.zeros((len(pieces), slope.size))
    for row, (x, dx, scale) in zip(rates, pieces[:, 3:6], strict=True):
        if x >= 1.0:
            row[0] = scale * dx * float(law.slope(1.0))
            continue
        derivative = slope
        for k in range(slope.size):  # Taylor coefficients of Q' at x, Eq. (3) and (5) of `hysteresis`
            row[k] = scale * dx ** (k + 1) * poly.polyval(x, derivative) / math.factorial(k)
            derivative = poly.polyder(derivative)
    return rates
