"""Whether recordings show a resonance: whether one adds to answers that rise and relax but never ring.

The best answer that never rings (`relaxation`) is compared with the same sum and the answer of the fitted resonator as
one more term, so that a head that rings and creeps is known to ring.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from inkjet_env.identification.measurements import RepeatedMeasurement
from inkjet_env.identification.model import Fitted, Model
from inkjet_env.identification.relaxation import Answer, best_answers, predicted
from inkjet_env.typing import Real

LEAST_GAIN = 500.0
"""Smallest decrease of χ² by a resonance; large: the search tries many, and no sensor is quite linear."""
LEAST_SAMPLES_A_CYCLE = 4.0
"""Samples in a cycle below which a resonance is mistaken for what the drive does between samples."""
EXPLAINED = 1.2
"""Ratio of residual to noise, or of noise to residual, up to which a model counts as complete; beyond it, the residual
is systematic or the noise not known, and a decrease of χ² must be large to mean anything."""
LEAST_RATIO = 1.3
"""Smallest ratio of the residual without a resonance to that with one where it does not tell the noise."""
LEAST_SHARE = 3e-3
"""Share of a signal's RMS below which a residual tells nothing: no law and no sensor is known better."""
LARGEST_DAMPING_RATIO, SMALLEST_DAMPING_RATIO = 0.95, 1e-4
"""Damping ratios beyond which the answer is no damped oscillation: it does not overshoot, or does not decay."""
STRETCHES, STRETCH_SAMPLES = 10, 1000
"""Largest number of stretches of a recording that are judged one by one, and how many samples each has at least."""
LINE_WIDTH = 1.5
"""Half width of a spectral line, in bins."""
SHARE_OF_A_SINE = 0.99
"""Share of a drive's power in one sine from which it is one."""


def doubt_of_resonance(
    fast: Sequence[Fitted], held_out: Sequence[Fitted], model: Model, passed: Callable[[float], None] = lambda _: None
) -> str | None:
    """Why a fitted resonance must not be believed.

    Parameters
    ----------
    fast, held_out : sequence of Fitted
        Recordings of channels that show the resonator: those that were fitted, and those that were not. A recording
        whose end was held out is among the fitted ones.
    model : Model
        The fitted model.
    passed : callable, optional
        Told the share of a pass over the recordings that is finished, after each answer that is fitted.

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
    if _is_one_steady_sine([f.measurement for f in fast]):
        return "one steady sine drives all recordings, so nothing is known between its harmonics"
    if all(_is_harmonic(model, f.measurement) for f in fast):
        return "the frequency of the best fit is a harmonic of the sine that drives these recordings"
    answers = best_answers(fast, model, passed)
    # The noise may be overestimated: what was taken for it may be the error in a recording that is spoilt.
    power = sum(_power(f) for f in fast) / sum(map(_count, fast))
    doubt = _doubt_of(fast, *_compared(fast, answers), min(1.0, LEAST_SHARE**2 * power))
    if doubt and not any(_rings(f, [other for other in fast if other is not f], model) for f in fast):
        return doubt
    if _worse_predicted([f for f in held_out if f.measurement.channel in answers], answers, model):
        return "a model without a resonance predicts held-out recordings better"
    return None


def _rings(f: Fitted, others: Sequence[Fitted], model: Model) -> bool:
    """Whether one recording, or a stretch of it, shows a resonance though not all recordings do.

    What else they show, such as creep, may be far louder; and a long recording may ring in a short part only.
    """
    answers = best_answers([f], model)
    without, with_it = _compared([f], answers)
    stretches = min(max(without[0].size // STRETCH_SAMPLES, 1), STRETCHES)
    rings = any(
        _doubt_of([f], [before], [after], 1.0) is None
        for before, after in zip(
            np.array_split(without[0], stretches), np.array_split(with_it[0], stretches), strict=True
        )
    )
    return rings and not _worse_predicted([g for g in others if g.measurement.channel in answers], answers)


def _worse_predicted(
    unseen: Sequence[Fitted], answers: Mapping[str, tuple[Answer, Answer]], model: Model | None = None
) -> bool:
    """Whether recordings that answers were not fitted to are predicted worse with a resonance than without.

    The answer with a resonance is that of the model, if it is given, or the best sum, whichever is better. Where
    neither predicts half of the signal, as where the law is extrapolated, the ratio says nothing; where there is no
    model, as for answers of one recording alone, both must.
    """
    told = []
    error = max if model is None else min
    for f, never, rings in zip(unseen, *_compared(unseen, answers), strict=True):
        without, with_it = float(never @ never), float(rings @ rings)
        if model is not None:
            own = _whitened(f, f.measurement.mean - model.predicted(f.measurement, f.basis, f.noise))
            with_it = min(with_it, float(own @ own))
        if error(without, with_it) < _power(f) / 2:
            told.append(math.log((with_it + never.size) / (without + never.size)))
    return bool(told) and float(np.mean(told)) > 0


def _doubt_of(
    recordings: Sequence[Fitted], without: Sequence[Real], with_it: Sequence[Real], least: float
) -> str | None:
    """Why whitened residuals without a resonance and with it, of at least some variance, do not show one."""
    if _doubtful(without, with_it, least):
        return "a model without a resonance fits these recordings equally well"
    before, after = ([_spectrum(r) for r in residuals] for residuals in (without, with_it))
    kept = _off_the_best_line(recordings, before, after)
    off = [[np.sqrt(s[k]) for s, k in zip(spectra, kept, strict=True)] for spectra in (before, after)]
    if _doubtful(off[0], off[1], least):
        return "only one line of the spectrum speaks for a resonance, where the drive or a harmonic of it happens to be"
    return None


def _compared(
    recordings: Sequence[Fitted], answers: Mapping[str, tuple[Answer, Answer]]
) -> tuple[list[Real], list[Real]]:
    """Whitened residuals without a resonance, and with it; a held-out recording counts as a whole."""
    without, with_it = ([_residual(f, answers[f.measurement.channel][which]) for f in recordings] for which in (0, 1))
    return without, with_it


def _doubtful(without: Sequence[Real], with_it: Sequence[Real], least: float) -> bool:
    """Whether residuals with a resonance are not clearly below those without."""
    values = max(sum(r.size for r in with_it), 1)
    variance = max(_chi_square(with_it) / values, least)
    explained, other = variance * values, _chi_square(without)
    if other - explained < LEAST_GAIN * variance:
        return True
    return not EXPLAINED**-2 < variance < EXPLAINED**2 and other < LEAST_RATIO**2 * explained


def _chi_square(residuals: Sequence[Real]) -> float:
    return float(sum(r @ r for r in residuals))


def _residual(f: Fitted, answer: Answer) -> Real:
    """Whitened residual of an answer over the noise."""
    return _whitened(f, f.measurement.mean - predicted(f, answer))


def _whitened(f: Fitted, residual: Real) -> Real:
    """The samples of a residual that count, over the noise of the mean of the repeats."""
    white: Real = f.noise.whitened(residual[: _count(f), None])[:, 0] * math.sqrt(len(f.measurement.signals))
    return white


def _count(f: Fitted) -> int:
    """Number of samples that count: those fitted, or all of a held-out recording."""
    return f.measurement.fitted or f.measurement.mean.size


def _power(f: Fitted) -> float:
    """Whitened power of a recording's signal about its mean, as that of `_residual`."""
    white = _whitened(f, f.measurement.mean - f.measurement.mean.mean())
    return float(white @ white)


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


def _is_one_steady_sine(measured: Sequence[RepeatedMeasurement]) -> bool:
    """Whether all drives are repeated sines of one frequency."""
    frequencies_Hz = [_frequency_of_a_sine(m) if m.initial_state == "periodic" else 0.0 for m in measured]
    line_Hz = 1 / max(m.drive_V.size * m.step_s for m in measured)
    return min(frequencies_Hz) > 0 and max(frequencies_Hz) - min(frequencies_Hz) < line_Hz / 2


def _frequency_of_a_sine(m: RepeatedMeasurement) -> float:
    """Frequency of a drive that is one sine, in hertz; 0 for any other."""
    drive_V = m.drive_V - m.drive_V.mean()
    power = np.abs(np.fft.rfft(drive_V * np.hanning(drive_V.size))) ** 2
    first = max(int(np.argmax(power)) - 2, 0)
    near = power[first : first + 5]
    if not near.any():
        return 0.0
    place = float(near @ np.arange(first, first + near.size) / near.sum())
    phase = 2 * np.pi * place * np.arange(drive_V.size) / drive_V.size
    waves = np.column_stack([np.cos(phase), np.sin(phase), np.ones(drive_V.size)])
    rest_V = drive_V - waves @ np.linalg.lstsq(waves, drive_V)[0]
    return place / (drive_V.size * m.step_s) if rest_V @ rest_V < (1 - SHARE_OF_A_SINE) * (drive_V @ drive_V) else 0.0
