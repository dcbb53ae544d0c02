"""Whether recordings show a resonance: whether one adds to answers that rise and relax but never ring.

An answer that never rings is, for each channel, a sum with coefficients of one sign of the hysteretic drive, its
speed, and its low-passed and high-passed copies with one pole each, over all time constants that the recordings could
tell apart. It holds a static law, creep, overdamped systems and sensors with a bandwidth, and no such sum can ring: its
step response is a sum of decays (Bernstein's theorem on completely monotone functions). The same sum with the answer of
the fitted resonator as one more term is compared with it, so that a head that rings and creeps is known to ring.
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

LEAST_GAIN = 500.0
"""Smallest decrease of χ² by a resonance; large: the search tries many, and no sensor is quite linear."""
LEAST_SAMPLES_A_CYCLE = 4.0
"""Samples in a cycle below which a resonance is mistaken for what the drive does between samples."""
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
STRETCHES, STRETCH_SAMPLES = 10, 1000
"""Largest number of stretches of a recording that are judged one by one, and how many samples each has at least."""
LINE_WIDTH = 1.5
"""Half width of a spectral line, in bins."""
SHARE_OF_A_SINE = 0.99
"""Share of a drive's power about one line from which it is a sine."""


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
    ringing : ndarray, shape (d,)
        Coefficients of what a resonator adds to a stiff head, by power of the law; empty if it never rings.
    offset : float
        Offset in the channel's unit.
    """

    time_constants_s: Real
    resonator: tuple[float, float] | None
    shares: Real
    weights: Real
    ringing: Real
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
    samples = 2 * math.pi / math.sqrt(model.a0) / min(f.measurement.step_s for f in fast)
    if samples < LEAST_SAMPLES_A_CYCLE:
        return f"the best fit has {samples:.2g} samples in a cycle, too few to tell a resonance"
    if all(_is_harmonic(model, f.measurement) for f in fast):
        return "the frequency of the best fit is a harmonic of the sine that drives these recordings"
    answers = _best_answers(fast, model)
    doubt = _doubt_of(fast, *_compared(fast, answers))
    if doubt and not any(_rings(f, model) for f in fast):
        return doubt
    known = [f for f in held_out if f.measurement.channel in answers]
    told = [  # where neither predicts half of the signal, as where the law is extrapolated, the ratio says nothing
        (rings @ rings + rings.size) / (never @ never + never.size)
        for f, never, rings in zip(known, *_compared(known, answers), strict=True)
        if min(never @ never, rings @ rings) < _power(f) / 2
    ]
    if told and np.log(told).mean() > 0:
        return "a model without a resonance predicts held-out recordings better"
    return None


def _rings(f: Fitted, model: Model) -> bool:
    """Whether one recording, or a stretch of it, shows a resonance though not all recordings do.

    What else they show, such as creep, may be far louder; and a long recording may ring in a short part only.
    """
    without, with_it = _compared([f], _best_answers([f], model))
    stretches = min(max(without[0].size // STRETCH_SAMPLES, 1), STRETCHES)
    return any(
        _doubt_of([f], [before], [after]) is None
        for before, after in zip(
            np.array_split(without[0], stretches), np.array_split(with_it[0], stretches), strict=True
        )
    )


def _doubt_of(recordings: Sequence[Fitted], without: Sequence[Real], with_it: Sequence[Real]) -> str | None:
    """Why whitened residuals without a resonance and with it do not show one."""
    if _doubtful(without, with_it):
        return "a model without a resonance fits these recordings equally well"
    before, after = ([_spectrum(r) for r in residuals] for residuals in (without, with_it))
    kept = _off_the_best_line(recordings, before, after)
    if _doubtful(*([np.sqrt(s[k]) for s, k in zip(spectra, kept, strict=True)] for spectra in (before, after))):
        return "only one line of the spectrum speaks for a resonance, where the drive or a harmonic of it happens to be"
    return None


def _compared(
    recordings: Sequence[Fitted], answers: Mapping[str, tuple[Answer, Answer]]
) -> tuple[list[Real], list[Real]]:
    """Whitened residuals without a resonance, and with it; a held-out recording counts as a whole."""
    without, with_it = ([_residual(f, answers[f.measurement.channel][which]) for f in recordings] for which in (0, 1))
    return without, with_it


def _doubtful(without: Sequence[Real], with_it: Sequence[Real]) -> bool:
    """Whether residuals with a resonance are not clearly below those without."""
    values = sum(r.size for r in with_it)
    chi_square, other = _chi_square(with_it), _chi_square(without)
    variance = chi_square / max(values, 1)
    if other - chi_square < LEAST_GAIN * max(variance, 1.0):
        return True
    return variance > EXPLAINED**2 and other < LEAST_RATIO**2 * chi_square


def _chi_square(residuals: Sequence[Real]) -> float:
    return float(sum(r @ r for r in residuals))


def _residual(f: Fitted, answer: Answer) -> Real:
    """Whitened residual over the noise."""
    residual = f.measurement.mean - _predicted(f, answer)
    n = f.measurement.fitted or residual.size
    white: Real = f.noise.whitened(residual[:n, None])[:, 0] * math.sqrt(len(f.measurement.signals))
    return white


def _power(f: Fitted) -> float:
    """Whitened power of a recording's signal about its mean, as that of `_residual`."""
    signal = f.measurement.mean - f.measurement.mean.mean()
    white = f.noise.whitened(signal[: f.measurement.fitted or signal.size, None])
    return float(np.sum(white**2)) * len(f.measurement.signals)


def _spectrum(residual: Real) -> Real:
    """Power in each line of the spectrum; the sum is that of the squares."""
    power: Real = np.abs(np.fft.fft(residual)) ** 2 / residual.size
    return power


def _off_the_best_line(recordings: Sequence[Fitted], without: Sequence[Real], with_it: Sequence[Real]) -> list[Real]:
    """Which lines of each spectrum are away from the one that speaks most for a resonance."""
    best, most = 0.0, 0.0
    frequencies = [
        np.abs(np.fft.fftfreq(s.size, f.measurement.step_s)) for f, s in zip(recordings, with_it, strict=True)
    ]
    for frequency, before, after in zip(frequencies, without, with_it, strict=True):
        k = int(np.argmax(before - after))
        if before[k] - after[k] > most:
            best, most = float(frequency[k]), float(before[k] - after[k])
    return [np.abs(frequency - best) > LINE_WIDTH * frequency[1] for frequency in frequencies]


def _is_harmonic(model: Model, m: RepeatedMeasurement) -> bool:
    """Whether a resonance cannot be told from a harmonic of a drive that is one sine."""
    sine_Hz = _frequency_of_a_sine(m)
    if not sine_Hz:
        return False
    width_Hz = LINE_WIDTH / (m.drive_V.size * m.step_s)
    frequency_Hz, bandwidth_Hz = math.sqrt(model.a0) / (2 * math.pi), model.a1 / (2 * math.pi)
    return max(abs(frequency_Hz - sine_Hz * round(frequency_Hz / sine_Hz)), bandwidth_Hz) < width_Hz


def _frequency_of_a_sine(m: RepeatedMeasurement) -> float:
    """Frequency of a drive that is one sine, in hertz; 0 for any other."""
    drive_V = m.drive_V - m.drive_V.mean()
    power = np.abs(np.fft.rfft(drive_V * np.hanning(drive_V.size))) ** 2
    k = int(np.argmax(power))
    near = power[max(k - 2, 0) : k + 3]
    if near.sum() < SHARE_OF_A_SINE * power.sum():
        return 0.0
    place = float(near @ np.arange(max(k - 2, 0), max(k - 2, 0) + near.size) / near.sum())
    return place / (drive_V.size * m.step_s)


@dataclass(frozen=True, eq=False)
class _Moved:
    """One recording with its hysteretic drive, the speed of it that a stiff head shows, and what a resonator adds.

    Each by power of the law, (n, d); without a resonator, the last is (n, 0).
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
        ringing = v[:, :0]
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

    def answer(self, shares: Real, time_constants_s: Real) -> Real:
        """Sum of `answers` with some shares, for each power of the law, (n, d)."""
        total = shares[0] * self.v + shares[1] * self.speed + shares[2] * self._after(self.speed)
        for tau, low, high in zip(time_constants_s, *np.split(shares[3:], 2), strict=True):
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


def _best_answers(fitted: Sequence[Fitted], model: Model) -> dict[str, tuple[Answer, Answer]]:
    """For each channel, the best answer that never rings and the best that does."""
    found = {}
    for channel in sorted({f.measurement.channel for f in fitted}):
        its = [f for f in fitted if f.measurement.channel == channel]
        never, rings = (_best_answer(its, model.weights, resonator) for resonator in (None, (model.a0, model.a1)))
        found[channel] = (never, rings)
    return found


def _best_answer(fitted: Sequence[Fitted], law: Real, resonator: tuple[float, float] | None) -> Answer:
    """The answer of one channel that fits its recordings best."""
    moved = [_Moved.of(f, resonator) for f in fitted]
    shortest_s = min(f.measurement.step_s for f in fitted) / 2
    longest_s = max(f.measurement.step_s * f.measurement.drive_V.size for f in fitted)
    time_constants_s = np.geomspace(shortest_s, longest_s, TIME_CONSTANTS)
    weights = law / max(float(np.abs(law).sum()), 1e-300)
    tried = [_best_shares(moved, signed, time_constants_s) for signed in (weights, -weights)]
    found, _ = min(tried, key=lambda pair: pair[1])
    for _ in range(LAW_ROUNDS):
        law = _best_law(moved, found.shares, time_constants_s)
        found, _ = _best_shares(moved, law, time_constants_s)
    return found


def _best_shares(moved: Sequence[_Moved], law: Real, time_constants_s: Real) -> tuple[Answer, float]:
    """The answer with shares above zero for a law, and its χ²."""
    rows = []
    for one in moved:
        n, signal = one.fitted.measurement.fitted, one.fitted.measurement.mean
        free = np.column_stack([one.ringing, np.ones(len(signal))])
        columns = np.column_stack([one.answers(law, time_constants_s), free, -free, signal])
        rows.append(_reduced(one, columns[:n]))
    stacked = np.vstack(rows)
    size = np.linalg.norm(stacked, axis=0)
    size[size == 0] = 1.0
    solution, residual = nnls(stacked[:, :-1] / size[:-1], stacked[:, -1] / size[-1], maxiter=20 * stacked.shape[1])
    solution = solution * size[-1] / size[:-1]
    k = 3 + 2 * time_constants_s.size
    *ringing, offset = np.subtract(*np.split(solution[k:], 2))
    answer = Answer(time_constants_s, moved[0].resonator, solution[:k], law, np.array(ringing), float(offset))
    return answer, float((residual * size[-1]) ** 2)


def _best_law(moved: Sequence[_Moved], shares: Real, time_constants_s: Real) -> Real:
    """Weights of the branch law for given shares."""
    rows = []
    for one in moved:
        n, signal = one.fitted.measurement.fitted, one.fitted.measurement.mean
        columns = [one.answer(shares, time_constants_s), one.ringing, np.ones(len(signal)), signal]
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


def _predicted(f: Fitted, answer: Answer) -> Real:
    """Predicted signal at every sample; an unknown initial state is estimated from the recording itself."""
    one = _Moved.of(f, answer.resonator)
    signal = one.answer(answer.shares, answer.time_constants_s) @ answer.weights
    signal += one.ringing @ answer.ringing + answer.offset
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
