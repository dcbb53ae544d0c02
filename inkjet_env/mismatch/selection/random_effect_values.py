"""The likeliest values of a random effect on the recordings of one channel, with their intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from inkjet_env.identification.identification import Estimate
from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.selection.amplitude_likelihood import (
    amplitudes_nll,
    noise_alone_nll,
    white,
    without_amplitudes,
)
from inkjet_env.mismatch.selection.split_likelihood import noise_of
from inkjet_env.mismatch.settings import DiagnosisSettings
from inkjet_env.plant import Effect
from inkjet_env.plant.effect import Parameter, coordinates, values_at
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

PROFILE_90 = 1.353
"""Loss of log-likelihood at the ends of a 90 % interval: half the 90 % quantile of chi-square with one degree of
freedom."""
BISECTIONS = 12
"""Number of bisections at each end of an interval."""


@dataclass(frozen=True, eq=False)
class RandomEffect:
    """A random effect on one channel.

    Attributes
    ----------
    effect : Effect
        The effect; its amplitudes are drawn anew in every recording.
    channel : str
        Channel from which its shape was estimated.
    values : dict of str to float
        Values of its parameters, in their units. The amplitude is the root mean square over the recordings of the peak
        of what it adds.
    gain : float
        Gain in log-likelihood over noise alone, on recordings that the fit has not seen.
    estimates : dict of str to Estimate
        The values with their 90 % intervals.
    """

    effect: Effect
    channel: str
    values: dict[str, float]
    gain: float
    estimates: dict[str, Estimate]


@dataclass(frozen=True, eq=False)
class Channel:
    """Recordings of one channel, their residuals, noise with its negative log-likelihood ``before``, and lines.

    ``memory`` is the longest memory of the noise, in durations of a recording.
    """

    observed: Sequence[ObservedRecording]
    residuals: dict[str, Real]
    noise: Noise
    before: float
    lines_Hz: tuple[float, ...]
    settings: DiagnosisSettings
    memory: float


def described(
    observed: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
    settings: DiagnosisSettings,
    memory: float,
) -> Channel:
    """A channel whose noise is estimated from these recordings, as the noise with the effect will be."""
    alone = noise_of(observed, residuals, noise, memory)
    before = noise_alone_nll(observed, residuals, alone)
    lines_Hz = _lines_Hz(observed, residuals, settings.selection.spectral_lines)
    return Channel(observed, residuals, alone, before, lines_Hz, settings, memory)


def noise_beside(effect: Effect, values: dict[str, float], channel: Channel) -> Noise:
    """The noise of the residuals without what the effect can explain."""
    return noise_of(
        channel.observed,
        without_amplitudes(effect, values, channel.observed, channel.residuals),
        channel.noise,
        channel.memory,
    )


def _starts(effect: Effect, channel: Channel, printhead: Printhead) -> list[dict[str, float]]:
    """Starts within the bounds that some recording shows: a tone out of bounds is no other tone at a bound."""
    excitations = [replace(o.excitation, residual_lines_Hz=channel.lines_Hz) for o in channel.observed]
    return [
        start
        for start in effect.starts(printhead, excitations)
        if all(p.low <= start[p.name] <= p.high for p in effect.parameters)
        and any(effect.random_effect_basis(start, o.excitation) is not None for o in channel.observed)
    ]


def _form(effect: Effect, start: Mapping[str, float]) -> tuple[float, ...]:
    """Values of the shapes that are chosen from a few, such as a degree."""
    return tuple(start[p.name] for p in effect.parameters if p.name not in effect.strengths and p.scale != "log")


def forms(effect: Effect, channel: Channel, printhead: Printhead) -> list[tuple[float, ...]]:
    """The forms among the starts, such as each degree of a polynomial and a random walk."""
    return list(dict.fromkeys(_form(effect, start) for start in _starts(effect, channel, printhead)))


def likeliest(
    effect: Effect, channel: Channel, printhead: Printhead, form: tuple[float, ...] | None = None
) -> RandomEffect | None:
    """The effect with its likeliest values, of one form if it is given; None if none gains anything to speak of."""
    from scipy.optimize import minimize_scalar

    observed, residuals, noise = channel.observed, channel.residuals, channel.noise
    free = [p for p in effect.parameters if p.name not in effect.strengths and p.scale == "log"]
    starts = _starts(effect, channel, printhead)
    if form is not None:
        starts = [start for start in starts if _form(effect, start) == form]
    # A loud tone shapes the noise model that is to judge it, so starts are ranked with white noise as well.
    tried: list[tuple[int, Noise]] = []
    for judge in (noise, white(noise)):
        before = noise_alone_nll(observed, residuals, judge)
        losses = [amplitudes_nll(effect, start, observed, residuals, judge)[0] for start in starts]
        ranked = sorted(range(len(starts)), key=losses.__getitem__)[:2]
        fair = [k for k in ranked if before - losses[k] > channel.settings.selection.random_effect_refined]
        tried += [(k, judge) for k in fair if free or k not in [other for other, _ in tried]]
    best: RandomEffect | None = None
    for k, judge in tried:
        start = starts[k]
        values = dict(start)
        if len(free) == 1:  # refine a frequency within the width of a line
            place = [p.name for p in effect.parameters].index(free[0].name)
            theta = coordinates(effect, values)
            longest = max(o.excitation.samples * o.excitation.step_s for o in observed)
            width = 1 / max(values[free[0].name] * longest, 1.0)

            def worse(z: float, theta: Real = theta, place: int = place, judge: Noise = judge) -> float:
                there = theta.copy()
                there[place] = z
                return amplitudes_nll(effect, values_at(effect, there), observed, residuals, judge)[0]

            low, high = free[0].bounds
            bounds = (max(low, theta[place] - width), min(high, theta[place] + width))
            refined = minimize_scalar(worse, bounds=bounds, method="bounded", options={"xatol": 1e-3 * width})
            theta[place] = refined.x
            values = values_at(effect, theta)
        less = noise_beside(effect, values, channel)
        after, peaks = amplitudes_nll(effect, values, observed, residuals, less)
        size = _root_mean_square(peaks)
        for name in effect.strengths:
            values[name] = size.value
        if best is None or channel.before - after > best.gain:
            estimates = dict.fromkeys(effect.strengths, size)
            best = RandomEffect(effect, observed[0].channel, values, channel.before - after, estimates)
    return best


def with_intervals(best: RandomEffect, channel: Channel) -> RandomEffect:
    """The effect with the intervals of its shapes."""
    effect, values = best.effect, best.values
    less = noise_beside(effect, values, channel)
    estimates = {
        p.name: best.estimates[p.name]
        if p.name in effect.strengths
        else _shapes_interval(effect, values, p, channel.observed, channel.residuals, less)
        if p.scale == "log"
        else Estimate(values[p.name], values[p.name], values[p.name])  # chosen, not fitted
        for p in effect.parameters
    }
    return replace(best, estimates=estimates)


def _root_mean_square(peaks: Real) -> Estimate:
    """Population root mean square of the peaks with its 90 % interval, as if each peak were one normal amplitude."""
    from scipy.special import chdtri

    value, count = float(np.sqrt(np.mean(peaks**2))), peaks.size
    low, high = (value * math.sqrt(count / float(chdtri(count, tail))) for tail in (0.05, 0.95))
    return Estimate(value, low, high)


def _shapes_interval(
    effect: Effect,
    values: dict[str, float],
    parameter: Parameter,
    observed: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
) -> Estimate:
    """Profile-likelihood interval of a shape, 90 %, amplitudes at their optimum; its ends by bisection."""
    place = [p.name for p in effect.parameters].index(parameter.name)
    theta = coordinates(effect, values)
    least = amplitudes_nll(effect, values, observed, residuals, noise)[0]
    longest = max(o.excitation.samples * o.excitation.step_s for o in observed)
    width = 1 / max(values[parameter.name] * longest, 1.0)
    ends = []
    for sign in (-1, 1):
        inside, outside = 0.0, width
        for _ in range(BISECTIONS):
            middle = 0.5 * (inside + outside)
            there = theta.copy()
            there[place] += sign * middle
            if amplitudes_nll(effect, values_at(effect, there), observed, residuals, noise)[0] - least < PROFILE_90:
                inside = middle
            else:
                outside = middle
        ends.append(parameter.value(float(theta[place] + sign * outside)))
    return Estimate(values[parameter.name], min(ends), max(ends))


def _lines_Hz(observed: Sequence[ObservedRecording], residuals: dict[str, Real], most: int) -> tuple[float, ...]:
    """Frequencies of the strongest lines, at most ``most``, in the pooled periodogram of the residuals, in hertz."""
    by_step: dict[float, list[ObservedRecording]] = {}
    for o in observed:
        by_step.setdefault(o.noise_key[1], []).append(o)
    step_s, mine = max(by_step.items(), key=lambda pair: sum(o.excitation.samples for o in pair[1]))
    longest = max(o.excitation.samples for o in mine)
    length = 4 * longest
    power = np.zeros(length // 2 + 1)
    for o in mine:
        signal = residuals[o.name] - residuals[o.name].mean()
        lines = np.abs(np.fft.rfft(signal * np.hanning(signal.size), length)) ** 2
        power += lines / max(float(np.median(lines)), 1e-300)
    frequency = np.fft.rfftfreq(length, mine[0].excitation.step_s)
    found: list[float] = []
    for at in np.argsort(power)[::-1]:
        if frequency[at] * longest * step_s < 1.5:
            continue
        if all(abs(frequency[at] - other) * longest * step_s > 3 for other in found):
            found.append(float(frequency[at]))
        if len(found) == most:
            break
    return tuple(found)
