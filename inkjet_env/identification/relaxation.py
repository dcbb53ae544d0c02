"""Answers that rise and relax, with a resonator or without: what a head whose law is unknown may do.

An answer that never rings is, for each channel, a sum with coefficients of one sign of the hysteretic drive, its
speed, and its low-passed and high-passed copies with one pole each, over all time constants that the recordings could
tell apart. It holds a static law, creep, overdamped systems and sensors with a bandwidth, and no such sum can ring: its
step response is a sum of decays (Bernstein's theorem on completely monotone functions).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.signal import lfilter

from inkjet_env.identification.model import Fitted, Model, has_free_state
from inkjet_env.identification.work_done import PASSES
from inkjet_env.typing import Real

TIME_CONSTANTS = 10
"""Number of time constants, from half a sampling step to the longest recording."""
STARTING_LAWS = 4
"""Number of laws that a sum is fitted to at first."""
LAW_ROUNDS = 3
"""Rounds of fitting the law to the sum and the sum to the law."""
STIFFNESS = 3000.0
"""Angular frequency times sampling step of a head that follows the drive without ringing."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What one channel answers to the hysteretic drive.

    Attributes
    ----------
    time_constants_s : ndarray, shape (k,)
        Time constants of its one-pole filters.
    resonator : tuple of float or None
        ``a0`` and ``a1`` of its resonator; None if it never rings.
    shares : ndarray, shape (3 + 2k,)
        Coefficients of the hysteretic drive, its speed before and after each sample, and its low- and high-passed
        copies.
    weights : ndarray, shape (d,)
        Coefficients of the branch law, lowest power first, with the sign of the gain.
    ringing : float
        Share of what a resonator adds to a stiff head; 0 if it never rings.
    offset : float
        Offset in the channel's unit.
    """

    time_constants_s: Real
    resonator: tuple[float, float] | None
    shares: Real
    weights: Real
    ringing: float
    offset: float


@dataclass(frozen=True, eq=False)
class _Moved:
    """One recording with its hysteretic drive, the speed of it that a stiff head shows, and what a resonator adds.

    Each by power of the law, (n, d); without a resonator, the last is zero.
    """

    fitted: Fitted
    resonator: tuple[float, float] | None
    v: Real
    speed: Real
    ringing: Real

    @classmethod
    def of(cls, f: Fitted, resonator: tuple[float, float] | None) -> _Moved:
        omega = STIFFNESS / f.measurement.step_s
        v, speed = f.basis.hysteretic_V(), f.basis.response("self_sensing", omega**2, omega)
        ringing = np.zeros_like(v)
        if resonator is not None:
            stiff = speed if f.measurement.channel == "self_sensing" else v
            ringing = f.measurement.response(f.basis, *resonator) - stiff
        return cls(f, resonator, v, speed, ringing)

    def answers(self, law: Real, time_constants_s: Real) -> Real:
        """What shares are of, for a law, shape (n, 3 + 2k).

        The drive between samples is hardly known, so the speed at a sample lies between those before and after it.
        """
        v, speed = self.v @ law, self.speed @ law
        low = [self._low_passed(v, tau) for tau in time_constants_s]
        return np.column_stack([v, speed, self._after(speed), *low, *(v - copy for copy in low)])

    def answer(self, answer: Answer) -> Real:
        """The answer without its offset, for each power of the law, (n, d)."""
        shares = answer.shares
        total = shares[0] * self.v + shares[1] * self.speed + shares[2] * self._after(self.speed)
        total += answer.ringing * self.ringing
        for tau, low, high in zip(answer.time_constants_s, *np.split(shares[3:], 2), strict=True):
            if low or high:
                total += high * self.v + (low - high) * self._low_passed(self.v, tau)
        return total

    def decays(self) -> Real:
        """What remains of an unknown initial state: a fast and a slow decay, and what rings, shape (n, 2) or (n, 4)."""
        place = np.arange(len(self.v)) / len(self.v)
        decays = np.column_stack([np.exp(-30 * place), np.exp(-3 * place)])
        if self.resonator is None:
            return decays
        return np.column_stack([decays, self.fitted.basis.free_states(*self.resonator)])

    def _after(self, speed: Real) -> Real:
        last = speed[:1] if self.fitted.measurement.initial_state == "periodic" else speed[-1:]
        return np.concatenate([speed[1:], last])

    def _low_passed(self, v: Real, time_constant_s: float) -> Real:
        m = self.fitted.measurement
        return low_passed(v, m.step_s / time_constant_s, m.initial_state == "periodic")


def best_answers(
    fitted: Sequence[Fitted], model: Model, passed: Callable[[float], None] = lambda _: None
) -> dict[str, tuple[Answer, Answer]]:
    """For each channel, the best answer that never rings and the best that does.

    Parameters
    ----------
    fitted : sequence of Fitted
        Recordings of channels that show the resonator.
    model : Model
        The fitted model: where the law starts, and the resonator.
    passed : callable, optional
        Told a share of a pass over the recordings after each that is simulated; all together make three times `PASSES`.
    """
    found = {}
    part = 3 * PASSES / (2 * (STARTING_LAWS + LAW_ROUNDS) * len(fitted)) if fitted else 0.0
    for channel in sorted({f.measurement.channel for f in fitted}):
        its = [f for f in fitted if f.measurement.channel == channel]
        never, rings = (
            _best_answer(its, model.weights, resonator, lambda: passed(part))
            for resonator in (None, (model.a0, model.a1))
        )
        found[channel] = (never, rings)
    return found


def _best_answer(
    fitted: Sequence[Fitted], law: Real, resonator: tuple[float, float] | None, passed: Callable[[], None]
) -> Answer:
    """The answer of one channel that fits its recordings best."""
    moved = [_Moved.of(f, resonator) for f in fitted]
    shortest_s = min(f.measurement.step_s for f in fitted) / 2
    longest_s = max(f.measurement.step_s * f.measurement.drive_V.size for f in fitted)
    time_constants_s = np.geomspace(shortest_s, longest_s, TIME_CONSTANTS)
    weights = law / max(float(np.abs(law).sum()), 1e-300)
    linear = np.eye(law.size)[0]  # the law of a fit that went wrong may lead nowhere
    starts = (weights, -weights, linear, -linear)
    tried = [_best_shares(moved, start, time_constants_s, passed) for start in starts]
    found, _ = min(tried, key=lambda pair: pair[1])
    for _ in range(LAW_ROUNDS):
        law = _best_law(moved, found)
        found, _ = _best_shares(moved, law, time_constants_s, passed)
    return found


def _best_shares(
    moved: Sequence[_Moved], law: Real, time_constants_s: Real, passed: Callable[[], None]
) -> tuple[Answer, float]:
    """The answer with shares above zero for a law, and its χ²."""
    rows = []
    for one in moved:
        n, signal = one.fitted.measurement.fitted, one.fitted.measurement.mean
        free = np.column_stack([one.ringing @ law, np.ones(len(signal))])
        columns = np.column_stack([one.answers(law, time_constants_s), free, -free, signal])
        rows.append(_reduced(one, columns[:n]))
        passed()
    stacked = np.vstack(rows)
    size = np.linalg.norm(stacked, axis=0)
    size[size == 0] = 1.0
    solution, residual = nnls(stacked[:, :-1] / size[:-1], stacked[:, -1] / size[-1], maxiter=20 * stacked.shape[1])
    solution = solution * size[-1] / size[:-1]
    k = 3 + 2 * time_constants_s.size
    ringing, offset = np.subtract(*np.split(solution[k:], 2))
    answer = Answer(time_constants_s, moved[0].resonator, solution[:k], law, float(ringing), float(offset))
    return answer, float((residual * size[-1]) ** 2)


def _best_law(moved: Sequence[_Moved], answer: Answer) -> Real:
    """Weights of the branch law for the shares of an answer."""
    rows = []
    for one in moved:
        n, signal = one.fitted.measurement.fitted, one.fitted.measurement.mean
        columns = [one.answer(answer), np.ones(len(signal)), signal]
        rows.append(_reduced(one, np.column_stack(columns)[:n]))
    stacked = np.vstack(rows)
    size = np.linalg.norm(stacked, axis=0)
    size[size == 0] = 1.0
    solution = np.linalg.lstsq(stacked[:, :-1] / size[:-1], stacked[:, -1], rcond=1e-12)[0] / size[:-1]
    weights: Real = solution[: moved[0].v.shape[1]]
    return weights


def _reduced(one: _Moved, columns: Real) -> Real:
    """Triangle of whitened columns, without what an unknown initial state can explain."""
    f = one.fitted
    whitened = f.whitened(columns)
    if has_free_state(f.measurement):
        q = np.linalg.qr(f.whitened(one.decays()))[0]
        whitened = whitened - q @ (q.T @ whitened)
    triangle: Real = np.linalg.qr(whitened).R
    return triangle


def predicted(f: Fitted, answer: Answer) -> Real:
    """Predicted signal at every sample, in the channel's unit, shape (n,).

    An unknown initial state is estimated from the recording itself.
    """
    one = _Moved.of(f, answer.resonator)
    signal = one.answer(answer) @ answer.weights + answer.offset
    if has_free_state(f.measurement):
        decays = one.decays()
        n = f.measurement.fitted or signal.size
        pair = f.noise.whitened(np.column_stack([decays, f.measurement.mean - signal])[:n])
        signal = signal + decays @ np.linalg.lstsq(pair[:, :-1], pair[:, -1], rcond=None)[0]
    return np.asarray(signal)


def low_passed(v: Real, ratio: float, periodic: bool) -> Real:
    """One pole on an input that is linear between samples, along the first axis.

    Parameters
    ----------
    v : ndarray, shape (n,) or (n, d)
        Input at the samples.
    ratio : float
        Sampling step over the time constant.
    periodic : bool
        Whether the input is repeated and the output is in the steady state; otherwise it starts at rest under the first
        sample.
    """
    kept = math.exp(-ratio)
    mean = -math.expm1(-ratio) / ratio
    numerator, denominator = [1 - mean, mean - kept], [1.0, -kept]
    start = v[:1]
    if periodic:
        around = np.concatenate([v[1:], v[:1]])
        last = lfilter(numerator, denominator, around, axis=0, zi=(mean - kept) * v[:1])[0][-1:]
        start = last / -math.expm1(-ratio * len(v))
    rest = lfilter(numerator, denominator, v[1:], axis=0, zi=(mean - kept) * v[:1] + kept * start)[0]
    return np.concatenate([start, rest])
