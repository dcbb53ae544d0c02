"""Whether recordings show a resonance: compared with answers that rise and relax but never ring.

The alternative to a resonator is, for each channel, a sum with coefficients of one sign of the hysteretic drive, its
speed, and its low-passed and high-passed copies with one pole each, over all time constants that the recordings could
tell apart. It holds a static law, creep, overdamped systems and sensors with a bandwidth, and no such sum can ring: its
step response is a sum of decays (Bernstein's theorem on completely monotone functions).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.signal import lfilter

from inkjet_env.identification.measurements import RepeatedMeasurement
from inkjet_env.identification.model import Fitted, Model, has_free_state
from inkjet_env.typing import Real

LEAST_GAIN = 50.0
"""Smallest decrease of χ² by a resonance; large because the search tries many."""
EXPLAINED = 1.2
"""Ratio of residual to noise up to which a model counts as complete; beyond it, the residual is systematic, and a
decrease of χ² must be large to mean anything."""
LEAST_RATIO = 1.3
"""Smallest ratio of the residual without a resonance to that with one where the residual is systematic."""
LARGEST_DAMPING_RATIO, SMALLEST_DAMPING_RATIO = 0.95, 1e-4
"""Damping ratios beyond which the answer is no damped oscillation: it does not overshoot, or does not decay."""
TIME_CONSTANTS = 10
"""Number of time constants, from half a sampling step to the longest recording."""
LAW_ROUNDS = 3
"""Rounds of fitting the law to the sum and the sum to the law."""
STIFFNESS = 3000.0
"""Angular frequency times sampling step of a head that follows the drive without ringing."""
LINE_WIDTH = 1.5
"""Half width of a spectral line, in bins."""


@dataclass(frozen=True, eq=False)
class Relaxation:
    """An answer that never rings, for one channel.

    Attributes
    ----------
    time_constants_s : ndarray, shape (k,)
        Time constants of its one-pole filters.
    shares : ndarray, shape (3 + 2k,)
        Coefficients of the hysteretic drive, its speed before and after each sample, and its low- and high-passed
        copies.
    weights : ndarray, shape (d,)
        Coefficients of the branch law, lowest power first, with the sign of the gain.
    offset : float
        Offset in the channel's unit.
    """

    time_constants_s: Real
    shares: Real
    weights: Real
    offset: float


def doubt_of_resonance(fast: Sequence[Fitted], held_out: Sequence[Fitted], model: Model) -> str | None:
    """Why a fitted resonance must not be believed.

    Parameters
    ----------
    fast, held_out : sequence of Fitted
        Recordings of channels that show the resonator: those that were fitted, and those that were not. A recording
        whose end was held out is among the fitted ones.
    model : Model
        The fitted model.

    Returns
    -------
    str or None
        The reason, as the start of a sentence; None if there is none.
    """
    damping_ratio = model.a1 / (2 * math.sqrt(model.a0))
    if not SMALLEST_DAMPING_RATIO < damping_ratio < LARGEST_DAMPING_RATIO:
        return f"the damping ratio of the best fit, {damping_ratio:.3g}, is at its bound"
    relaxations = {
        channel: _relaxation([f for f in fast if f.measurement.channel == channel], model)
        for channel in sorted({f.measurement.channel for f in fast})
    }
    without, with_it = _compared(fast, relaxations, model)
    if _doubtful(without, with_it):
        return "a model without a resonance fits these recordings equally well"
    kept = _off_the_best_line(fast, without, with_it)
    if _doubtful(*([s[k] for s, k in zip(spectra, kept, strict=True)] for spectra in (without, with_it))):
        return "only one line of the spectrum speaks for a resonance, where the drive or a harmonic of it happens to be"
    without, with_it = _compared([f for f in held_out if f.measurement.channel in relaxations], relaxations, model)
    if sum(map(np.sum, without)) < sum(map(np.sum, with_it)):
        return "a model without a resonance predicts held-out recordings better"
    return None


def _compared(
    recordings: Sequence[Fitted], relaxations: Mapping[str, Relaxation], model: Model
) -> tuple[list[Real], list[Real]]:
    """Spectra of the residuals without a resonance, and with it."""
    return (
        [_spectrum(f, _relaxed(f, relaxations[f.measurement.channel])) for f in recordings],
        [_spectrum(f, model.predicted(f.measurement, f.basis, f.noise)) for f in recordings],
    )


def _doubtful(without: Sequence[Real], with_it: Sequence[Real]) -> bool:
    """Whether residual spectra with a resonance are not clearly below those without, line by line."""
    lines = sum(s.size for s in with_it)
    chi_square, other = (float(sum(map(np.sum, spectra))) for spectra in (with_it, without))
    variance = chi_square / max(lines, 1)
    if other - chi_square < LEAST_GAIN * max(variance, 1.0):
        return True
    return variance > EXPLAINED**2 and other < LEAST_RATIO**2 * chi_square


def _spectrum(f: Fitted, predicted: Real) -> Real:
    """Squared residual over the noise in each spectral line, together χ²; a held-out recording counts as a whole."""
    residual = f.measurement.mean - predicted
    n = f.measurement.fitted or residual.size
    white = f.noise.whitened(residual[:n, None])[:, 0] * math.sqrt(len(f.measurement.signals))
    power: Real = np.abs(np.fft.fft(white)) ** 2 / white.size
    return power


def _off_the_best_line(fast: Sequence[Fitted], without: Sequence[Real], with_it: Sequence[Real]) -> list[Real]:
    """Which lines of each spectrum are away from the one that speaks most for a resonance."""
    best, most = 0.0, 0.0
    frequencies = [np.abs(np.fft.fftfreq(s.size, f.measurement.step_s)) for f, s in zip(fast, with_it, strict=True)]
    for frequency, before, after in zip(frequencies, without, with_it, strict=True):
        k = int(np.argmax(before - after))
        if before[k] - after[k] > most:
            best, most = float(frequency[k]), float(before[k] - after[k])
    return [np.abs(frequency - best) > LINE_WIDTH * frequency[1] for frequency in frequencies]


@dataclass(frozen=True, eq=False)
class _Moved:
    """One recording with its hysteretic drive and the speed of it that a stiff head shows, by power, (n, d) each."""

    fitted: Fitted
    v: Real
    speed: Real

    @classmethod
    def of(cls, f: Fitted) -> _Moved:
        omega = STIFFNESS / f.measurement.step_s
        return cls(f, f.basis.hysteretic_V(), f.basis.response("self_sensing", omega**2, omega))

    def answers(self, law: Real, time_constants_s: Real) -> Real:
        """Hysteretic drive of a law, its speed before and after each sample, low- and high-passed copies, (n, 3 + 2k).

        The drive between samples is hardly known, so the speed at a sample lies between those before and after it.
        """
        v, speed = self.v @ law, self.speed @ law
        low = [self._low_passed(v, tau) for tau in time_constants_s]
        return np.column_stack([v, speed, self._after(speed), *low, *(v - copy for copy in low)])

    def answer(self, shares: Real, time_constants_s: Real) -> Real:
        """Sum of `answers` with some shares, for each power of the law, (n, d)."""
        total = shares[0] * self.v + shares[1] * self.speed + shares[2] * self._after(self.speed)
        for tau, low, high in zip(time_constants_s, *np.split(shares[3:], 2), strict=True):
            if low or high:
                total += high * self.v + (low - high) * self._low_passed(self.v, tau)
        return total

    def _after(self, speed: Real) -> Real:
        last = speed[:1] if self.fitted.measurement.initial_state == "periodic" else speed[-1:]
        return np.concatenate([speed[1:], last])

    def _low_passed(self, v: Real, time_constant_s: float) -> Real:
        m = self.fitted.measurement
        return low_passed(v, m.step_s / time_constant_s, m.initial_state == "periodic")


def _relaxation(fitted: Sequence[Fitted], model: Model) -> Relaxation:
    """The answer of one channel that never rings and fits its recordings best."""
    moved = [_Moved.of(f) for f in fitted]
    shortest_s = min(f.measurement.step_s for f in fitted) / 2
    longest_s = max(f.measurement.step_s * f.measurement.drive_V.size for f in fitted)
    time_constants_s = np.geomspace(shortest_s, longest_s, TIME_CONSTANTS)
    weights = model.weights / max(float(np.abs(model.weights).sum()), 1e-300)
    tried = [(law, *_best_shares(moved, law, time_constants_s)) for law in (weights, -weights)]
    law, shares, offset, _ = min(tried, key=lambda found: found[3])
    for _ in range(LAW_ROUNDS):
        law = _best_law(moved, shares, time_constants_s)
        shares, offset, _ = _best_shares(moved, law, time_constants_s)
    return Relaxation(time_constants_s, shares, law, offset)


def _best_shares(moved: Sequence[_Moved], law: Real, time_constants_s: Real) -> tuple[Real, float, float]:
    """Shares above zero for a law, the offset and χ²."""
    rows = []
    for one in moved:
        n, signal = one.fitted.measurement.fitted, one.fitted.measurement.mean
        columns = one.answers(law, time_constants_s)[:n]
        rows.append(_reduced(one.fitted, np.column_stack([columns, np.ones(n), -np.ones(n), signal[:n]])))
    stacked = np.vstack(rows)
    size = np.linalg.norm(stacked, axis=0)
    size[size == 0] = 1.0
    solution, residual = nnls(stacked[:, :-1] / size[:-1], stacked[:, -1] / size[-1], maxiter=20 * stacked.shape[1])
    solution = solution * size[-1] / size[:-1]
    return solution[:-2], float(solution[-2] - solution[-1]), float((residual * size[-1]) ** 2)


def _best_law(moved: Sequence[_Moved], shares: Real, time_constants_s: Real) -> Real:
    """Weights of the branch law for given shares."""
    rows = []
    for one in moved:
        n, signal = one.fitted.measurement.fitted, one.fitted.measurement.mean
        columns = one.answer(shares, time_constants_s)[:n]
        rows.append(_reduced(one.fitted, np.column_stack([columns, np.ones(n), signal[:n]])))
    stacked = np.vstack(rows)
    size = np.linalg.norm(stacked, axis=0)
    size[size == 0] = 1.0
    solution = np.linalg.lstsq(stacked[:, :-1] / size[:-1], stacked[:, -1], rcond=1e-12)[0] / size[:-1]
    weights: Real = solution[:-1]
    return weights


def _reduced(f: Fitted, columns: Real) -> Real:
    """Triangle of whitened columns, without what an unknown initial state can explain."""
    whitened = f.whitened(columns)
    if has_free_state(f.measurement):
        q = np.linalg.qr(f.whitened(_decays(f.measurement)))[0]
        whitened = whitened - q @ (q.T @ whitened)
    triangle: Real = np.linalg.qr(whitened).R
    return triangle


def _relaxed(f: Fitted, found: Relaxation) -> Real:
    """Predicted signal at every sample; an unknown initial state is estimated from the recording itself."""
    signal = _Moved.of(f).answer(found.shares, found.time_constants_s) @ found.weights + found.offset
    if has_free_state(f.measurement):
        decays = _decays(f.measurement)
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


def _decays(m: RepeatedMeasurement) -> Real:
    """What remains of an unknown initial state that does not ring: a fast and a slow decay, shape (n, 2)."""
    place = np.arange(m.drive_V.size) / m.drive_V.size
    return np.column_stack([np.exp(-30 * place), np.exp(-3 * place)])
