"""Closed-form response of the second-order resonator to a piecewise polynomial input.

The self-sensed signal obeys ``G_s`` of Zhu et al. 2024, section 3.2 (equations are numbered as in
docs/explanation/model.md; 8a and 8b are steps towards its closed form 8):

    y'' + a1 y' + a0 y = b1 v'.                                                                     (7)

With the pole ``λ = -a1/2 + i √(a0 - a1²/4)`` it is the imaginary part of a complex amplitude ``A``,

    A' = λ A + c v',   c = b1 / Im λ,   y = Im A,   y' = Im λA.                                     (8a)

On a piece of duration T, ``v`` is a polynomial of ``τ = t/T`` with ``dv/dτ = Σ q_k τ^k``, so with ``z = λT``

    A(τ) = A(0) e^{zτ} + c Σ q_k τ^{k+1} m_k(zτ),   m_k(z) = ∫₀¹ e^{z(1-s)} s^k ds.                  (8b)

The moments are ``k! φ_{k+1}``, the φ functions of exponential integrators. The recursion ``m_k = (k m_{k-1} - 1)/z`` is
stable while ``k ≤ |z|``; beyond, it runs backwards from the power series of the last moment, which does not cancel
there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike, NDArray

from inkjet_env.typing import Real

Complex = NDArray[np.complex128]

ROUNDING = 1e-14
"""Ringing that cancels to less than this share of the terms that cancelled is rounding error and is taken as rest."""

JUMP_S = 1e-20
"""An edge shorter than this, in seconds, is a jump: the ringing that it drives differs by less than rounding."""


class ImpossibleHeadError(ValueError):
    """Values that no head has; the message names the rule."""


def check_resonator(a0: float, a1: float) -> None:
    """Raise `ImpossibleHeadError` unless ``s² + a1 s + a0`` is a damped oscillation."""
    if not (math.isfinite(a0) and a0 > 0):
        raise ImpossibleHeadError(
            f"a0 must be a positive number (the square of the angular frequency, 1/s²); got {a0!r}."
        )
    if not 2e-6 * math.sqrt(a0) <= a1 < 2 * math.sqrt(a0):
        raise ImpossibleHeadError(
            f"a1 must be below 2√a0 = {2 * math.sqrt(a0):g} 1/s and at least a millionth of it, so that the head rings "
            f"and decays; got {a1!r}."
        )


def pole(a0: float, a1: float) -> complex:
    """The pole λ in the upper half plane, in 1/s."""
    return complex(-a1 / 2, math.sqrt((math.sqrt(a0) - a1 / 2) * (math.sqrt(a0) + a1 / 2)))


def moments(z: ArrayLike, count: int) -> Complex:
    """Moments ``m_k(z) = ∫₀¹ e^{z(1-s)} s^k ds`` for ``k = 0 … count - 1``.

    Parameters
    ----------
    z : array_like of complex, shape (n,)
        Arguments, dimensionless, with real part ≤ 0.
    count : int
        Number of moments, at least 1.

    Returns
    -------
    ndarray of complex, shape (n, count)
        The moments, accurate to a few units of rounding relative to the bound ``1/(k+1)`` of ``m_k``.
    """
    z = np.atleast_1d(np.asarray(z, dtype=np.complex128))
    last = count - 1
    result = np.empty((z.size, count), dtype=np.complex128)
    forward = np.where(np.abs(z) < 1.0, 0, np.floor(np.abs(z)) + 1)  # number of moments computed from m_0 upwards
    large = forward > 0
    if large.any():
        total = np.expm1(z[large]) / z[large]
        result[large, 0] = total
        for k in range(1, count):
            total = (k * total - 1.0) / z[large]
            result[large, k] = total
    small = forward <= last
    if small.any():
        zs = z[small]
        term = np.full(zs.shape, 1.0 / count, dtype=np.complex128)
        total = term.copy()
        j = 0
        while np.abs(term).max() > 1e-18 / count:
            j += 1
            term = term * zs / (count + j)
            total += term
        backward = np.empty((zs.size, count), dtype=np.complex128)
        backward[:, last] = total
        for k in range(last, 0, -1):
            total = (zs * total + 1.0) / k
            backward[:, k - 1] = total
        result[small] = np.where(np.arange(count) < forward[small, None], result[small], backward)
    return result


@dataclass(frozen=True)
class PiecewiseResponse:
    """Response of a resonator to an input given by polynomial pieces from time 0.

    Parameters
    ----------
    a0, a1, b1 : float
        Coefficients of ``G_s(s) = b1 s / (s² + a1 s + a0)``, Eq. (7), in 1/s², 1/s, 1/s.
    duration_s : ndarray, shape (p,)
        Durations of the consecutive pieces from time 0, in seconds. A duration below `JUMP_S` is a jump.
    rate_V : ndarray, shape (p, d)
        ``dv/dτ`` on each piece as a polynomial of ``τ`` in 0…1, lowest power first, in volts.
    start_state : complex, optional
        Amplitude A at time 0, in volts; zero, the default, is rest.

    Attributes
    ----------
    pole : complex
        λ, in 1/s.
    gain : float
        ``c`` of Eq. (8a), dimensionless.
    start_s : ndarray, shape (p + 1,)
        Start of each piece, and the end of the last, in seconds.
    amplitude : ndarray of complex, shape (p + 1,)
        Amplitude A at these times, in volts.
    """

    a0: float
    a1: float
    b1: float
    duration_s: Real
    rate_V: Real
    start_state: complex = 0j

    def __post_init__(self) -> None:
        check_resonator(self.a0, self.a1)
        object.__setattr__(self, "duration_s", np.where(self.duration_s < JUMP_S, 0.0, self.duration_s))
        pole_ = pole(self.a0, self.a1)
        gain = self.b1 / pole_.imag
        z = pole_ * self.duration_s
        forced = gain * np.sum(self.rate_V * moments(z, self.rate_V.shape[1]), axis=1)  # Eq. (8b) at τ = 1
        amplitude = np.empty(self.duration_s.size + 1, dtype=np.complex128)
        amplitude[0] = a = self.start_state
        size = abs(a)  # bound on the terms that the amplitude is the sum of
        for i, (step, increment) in enumerate(zip(np.exp(z), forced, strict=True)):
            a = a * step + increment
            size = size * abs(step) + abs(increment)
            if abs(a) < ROUNDING * size:
                a = 0j
            amplitude[i + 1] = a
        object.__setattr__(self, "pole", pole_)
        object.__setattr__(self, "gain", gain)
        object.__setattr__(self, "start_s", np.concatenate([[0.0], np.cumsum(self.duration_s)]))
        object.__setattr__(self, "amplitude", amplitude)

    pole: complex = field(init=False)
    gain: float = field(init=False)
    start_s: Real = field(init=False)
    amplitude: Complex = field(init=False)

    def amplitude_in(self, piece: int, tau: ArrayLike) -> Complex:
        """Complex amplitude A in volts at fractions ``tau`` of one piece, Eq. (8b)."""
        tau = np.atleast_1d(np.asarray(tau, dtype=np.float64))
        z = self.pole * self.duration_s[piece]
        powers = tau[:, None] ** np.arange(1, self.rate_V.shape[1] + 1)
        # Eq. (8b), the sum over k.
        forced = np.sum(self.rate_V[piece] * powers * moments(z * tau, self.rate_V.shape[1]), axis=1)
        return self.amplitude[piece] * np.exp(z * tau) + self.gain * forced

    def amplitude_at(self, time_s: ArrayLike) -> Complex:
        """Complex amplitude A in volts at times in seconds, same shape; at a jump, the value after it."""
        time = np.asarray(time_s, dtype=np.float64)
        flat = time.ravel()
        result = np.zeros(flat.shape, dtype=np.complex128)
        where = np.searchsorted(self.start_s, flat, side="right") - 1
        for piece in np.unique(where[where >= 0]):
            mine = where == piece
            since = flat[mine] - self.start_s[piece]
            if piece < self.duration_s.size:
                result[mine] = self.amplitude_in(piece, since / self.duration_s[piece])
            else:
                result[mine] = self.amplitude[-1] * np.exp(self.pole * since)
        return result.reshape(time.shape)

    def sensor_V(self, time_s: ArrayLike) -> Real:
        """Self-sensed signal ``y`` in volts at times in seconds, same shape."""
        return self.amplitude_at(time_s).imag  # Eq. (8a)

    def extrema(self, window_s: float) -> tuple[Real, Real, float]:
        """Every local extremum from the start to the end of the window.

        Parameters
        ----------
        window_s : float
            End of the window in seconds; later extrema are left out. May be infinite: then extrema of the final
            ring-down are listed until they fall below 1e-12 of its first one.

        Returns
        -------
        times_s, values_V : ndarray, shape (k,)
            Times in seconds and signed values in volts, in time order.
        tail_V : float
            Summed magnitude of the extrema beyond the list, in volts: a geometric series for an infinite window,
            otherwise 0.
        """
        found: list[tuple[float, float]] = []
        heading = 0.0  # sign of y' just before the knot; 0 at rest
        for piece, duration in enumerate(self.duration_s):
            start, a, forced = self.start_s[piece], self.amplitude[piece], self.rate_V[piece].any()
            if start > window_s:
                break
            if duration == 0.0 or (a == 0 and not forced):
                heading *= bool(a != 0 or forced)
                continue
            if heading * self._heading(piece, 0.0) < 0:  # a jump reversed the sign of y', or y' is zero on the knot
                found.append((start, a.imag))
            if forced:
                roots = self._stationary_fractions(piece)
                found.extend(zip(start + duration * roots, self.amplitude_in(piece, roots).imag, strict=True))
            else:
                found.extend(self._ring_down(a, start, duration, 0.0)[0])
            heading = self._heading(piece, 1.0)
        last = self.amplitude[-1]
        if last != 0 and heading * (np.sign((self.pole * last).imag) or np.sign((self.pole**2 * last).imag)) < 0:
            found.append((self.start_s[-1], last.imag))
        tail = 0.0
        if self.start_s[-1] <= window_s:
            remaining = window_s - self.start_s[-1]
            rows, tail = self._ring_down(self.amplitude[-1], self.start_s[-1], remaining, 1e-12)
            found.extend(rows)
        listed = np.array([row for row in found if row[0] <= window_s], dtype=np.float64).reshape(-1, 2)
        return listed[:, 0].copy(), listed[:, 1].copy(), tail

    def _ring_down(
        self, a: complex, start_s: float, duration_s: float, floor: float
    ) -> tuple[list[tuple[float, float]], float]:
        """Extrema of ``Im(a e^{λt})`` for 0 < t ≤ duration: equally spaced, in geometric progression."""
        slope = self.pole * a
        if a == 0:
            return [], 0.0
        phase = math.atan2(slope.imag, slope.real)
        half_period = math.pi / self.pole.imag
        ratio = math.exp(self.pole.real * half_period)
        first = (-phase if phase < 0 else math.pi - phase) / self.pole.imag
        if slope.imag == 0.0:
            first = half_period
        value = (a * np.exp(self.pole * first)).imag
        if math.isinf(duration_s):
            count = math.ceil(math.log(floor) / math.log(ratio))
            tail = abs(value) * ratio**count / (1 - ratio)
        else:
            count = max(0, math.floor((duration_s - first) / half_period) + 1)
            tail = 0.0
        n = np.arange(count)
        return list(zip(start_s + first + n * half_period, value * (-ratio) ** n, strict=True)), tail

    def _slope_and_curvature(self, piece: int, tau: Real) -> tuple[Real, Real]:
        """``y'`` in V/s and ``y''`` in V/s² at fractions of a piece, from Eq. (8a)."""
        a = self.amplitude_in(piece, tau)
        input_rate = poly.polyval(tau, self.rate_V[piece]) / self.duration_s[piece]
        return (self.pole * a).imag, (self.pole**2 * a).imag + self.b1 * input_rate  # Eq. (8a)

    def _heading(self, piece: int, tau: float) -> float:
        """Sign of ``y'`` just inside a piece, at its start (``tau = 0``) or its end (1)."""
        slope = (self.pole * self.amplitude[piece + int(tau)]).imag
        return float(np.sign(slope) or (1 - 2 * tau) * np.sign(self._slope_and_curvature(piece, np.array([tau]))[1][0]))

    def _stationary_fractions(self, piece: int) -> Real:
        """Zeros of ``y'`` inside a piece, each bracketed by an interval on which it is proved to be the only one.

        On an interval of length h, ``|y'''| ≤ M`` proves that ``y'`` has no zero (both ends further from zero than
        ``M h²/8``) or is monotone (``|y''|`` at the ends adds up to more than ``M h``, same sign). An interval for
        which neither is proved is halved. M follows from the equation of motion ``y''' = b1 v'' - a1 y'' - a0 y'``:
        with ``|b1 v''| ≤ F`` the energy norm ``E = √(a0 y'² + y''²)`` grows by at most F per second, and
        ``|a1 y'' + a0 y'| ≤ √(a0 + a1²) E``.
        """
        from scipy.optimize import brentq

        duration, rate = float(self.duration_s[piece]), self.rate_V[piece]
        cells = max(1, math.ceil(abs(self.pole) * duration))
        nodes = np.linspace(0.0, 1.0, cells + 1)
        low, high = nodes[:-1], nodes[1:]
        brackets: list[tuple[float, float]] = []
        while low.size:
            (g0, d0), (g1, d1) = (self._slope_and_curvature(piece, t) for t in (low, high))
            h = (high - low) * duration
            # |v''| on the interval, from the expansion about its middle.
            middle, half = (low + high) / 2, (high - low) / 2
            bound, derivative = np.zeros_like(low), poly.polyder(rate)
            for k in range(derivative.size):
                bound += np.abs(poly.polyval(middle, derivative)) * half**k / math.factorial(k)
                derivative = poly.polyder(derivative)
            forcing = abs(self.b1) * bound / duration**2
            energy = np.sqrt(self.a0 * g0**2 + d0**2) + h * forcing
            third = forcing + math.sqrt(self.a0 + self.a1**2) * energy
            sign0, sign1 = np.where(g0 == 0, np.sign(d0), np.sign(g0)), np.where(g1 == 0, 0.0, np.sign(g1))
            sign1 = np.where(sign1 == 0, sign0, sign1)
            monotone = (d0 * d1 > 0) & (np.abs(d0) + np.abs(d1) > third * h)
            far = (sign0 == sign1) & (np.minimum(np.abs(g0), np.abs(g1)) > third * h * h / 8)
            tiny = high - low < 1e-13
            settled = monotone | far | tiny
            brackets.extend(zip(low[settled & (sign0 != sign1)], high[settled & (sign0 != sign1)], strict=True))
            on_node = settled & (g0 == 0) & (low > 0) & (d0 != 0)
            brackets.extend(zip(low[on_node], low[on_node], strict=True))
            unsettled = ~settled
            low, high = (
                np.concatenate([low[unsettled], middle[unsettled]]),
                np.concatenate([middle[unsettled], high[unsettled]]),
            )

        def slope(t: float) -> float:
            return float(self._slope_and_curvature(piece, np.array([t]))[0][0])

        return np.array([brentq(slope, a, b, xtol=1e-16) if a < b else a for a, b in sorted(brackets)])
