"""Random effects, such as a hum or a drift, distinguished from noise by recordings that no fit has seen.

Their amplitudes are drawn anew in every recording, so no simulation predicts them and repeats differ by them: in a
model without them they pass for noise. Two complete models are compared, each with its own noise: noise alone, as
coloured as the recordings show it, and less noise with amplitudes from one normal distribution, whose variance is
estimated by maximum likelihood. The second must predict other recordings better than the first explains them; see
`split_likelihood`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.legendre import legvander

from inkjet_env.identification.identification import Estimate
from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.selection.amplitude_likelihood import (
    amplitudes_nll,
    amplitudes_of,
    noise_alone_nll,
    white,
    without_amplitudes,
)
from inkjet_env.mismatch.selection.split_likelihood import (
    at_a_frequency,
    gain_on_unseen,
    halves,
    lines_Hz,
    longest_memory,
    noise_of,
    parts_of,
)
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


def detect_random_effects(
    observed: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
    effects: Sequence[Effect],
    printhead: Printhead,
    settings: DiagnosisSettings,
    explained: bool = True,
) -> list[RandomEffect]:
    """Random effects that gain enough on the channel from which their shape is estimated, best first.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        Recordings to search: those at rest, or all where the model explains them.
    residuals : dict of str to ndarray
        Measured minus modelled by recording, in the channel's unit, shape (n,).
    noise : Noise
        Noise without random effects.
    effects : sequence of Effect
        Effects that have a random-effect basis.
    printhead : Printhead
        Base model from which they may derive their starts.
    settings : DiagnosisSettings
        Settings of the diagnosis.
    explained : bool
        Whether the residuals hold nothing else. If not, recordings at rest must show the effect too, as loud as the
        others.

    Returns
    -------
    list of RandomEffect
        One for each effect and channel; ``gain`` includes the gain on all other channels.
    """
    names, found = sorted({o.channel for o in observed} - {"drive_monitor"}), []
    for effect in effects:
        channels = {
            name: _channel(effect, [o for o in observed if o.channel == name], residuals, noise, settings)
            for name in names
        }
        for name, channel in channels.items():
            if (best := _supported(effect, channel, printhead, explained)) is not None:
                # One hum reaches every channel: its frequency is the one that explains most on all of them together.
                elsewhere = sum(_gained(effect, best.values, channels[c]) for c in names if c != name)
                found.append(replace(_with_intervals(best, channel), gain=best.gain + elsewhere))
    return sorted(found, key=lambda one: -one.gain)


@dataclass(frozen=True, eq=False)
class _Channel:
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


def _channel(
    effect: Effect,
    observed: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
    settings: DiagnosisSettings,
) -> _Channel:
    """Recordings of a channel, their residuals without what is not to be taken for the effect.

    An offset that all share is no drift. A tone is looked for in what a slow polynomial leaves of each recording.
    """
    if at_a_frequency(effect):
        own = {o.name: _without_trend(residuals[o.name], settings.selection.hum_trend) for o in observed}
    else:
        level = float(np.mean(np.concatenate([residuals[o.name] for o in observed])))
        own = {o.name: residuals[o.name] - level for o in observed}
    return _described(observed, own, noise, settings, longest_memory(effect, settings.selection))


def _described(
    observed: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
    settings: DiagnosisSettings,
    memory: float,
) -> _Channel:
    """A channel whose noise is estimated from these recordings, as the noise with the effect will be."""
    alone = noise_of(observed, residuals, noise, memory)
    before = noise_alone_nll(observed, residuals, alone)
    lines_Hz = _lines_Hz(observed, residuals, settings.selection.spectral_lines)
    return _Channel(observed, residuals, alone, before, lines_Hz, settings, memory)


def _without_trend(signal: Real, degree: int) -> Real:
    """A signal less the polynomial of this degree that fits it best."""
    columns = legvander(np.linspace(-1, 1, signal.size), degree)
    rest: Real = signal - columns @ np.linalg.lstsq(columns, signal, rcond=None)[0]
    return rest


def _supported(effect: Effect, channel: _Channel, printhead: Printhead, explained: bool) -> RandomEffect | None:
    """The effect if recordings that its fit has not seen support it; otherwise None."""
    settings = channel.settings.selection
    best = _best(effect, channel, printhead)
    if best is None or best.gain <= settings.random_effect_gain:
        return None
    if not _at_rest(best, channel, otherwise=explained) or _rounded(best, channel):
        return None
    longest_s = max(o.excitation.samples * o.excitation.step_s for o in channel.observed)
    if any(line * longest_s < settings.hum_periods for line in lines_Hz(effect, best.values)):
        return None  # as slow as a drift
    if len(channel.observed) < settings.split_recordings and not at_a_frequency(effect):
        return None  # a drift may differ from noise in the recordings' means alone, which parts do not show
    parts, residuals, noise = parts_of(
        channel.observed, channel.residuals, channel.noise, max(lines_Hz(effect, best.values), default=0.0), settings
    )
    gain = math.inf
    first, second = halves(parts)
    for fitted, unseen in ((first, second), (second, first)):
        if not fitted or not unseen:
            return None
        there = _described(fitted, residuals, noise, channel.settings, channel.memory)
        own = [one for form in _forms(effect, there, printhead) if (one := _best(effect, there, printhead, form))]
        if not own:
            return None
        gains = [gain_on_unseen(effect, one.values, fitted, unseen, residuals, noise, settings) for one in own]
        gain = min(gain, _mean_ratio(gains))
        if gain <= settings.random_effect_gain:
            return None
    return replace(best, gain=gain)


def _gained(effect: Effect, values: dict[str, float], channel: _Channel) -> float:
    """Gain on unseen recordings of an effect with these shapes on another channel; 0 if it does not show there."""
    if all(effect.random_effect_basis(values, o.excitation) is None for o in channel.observed):
        return 0.0
    settings = channel.settings.selection
    highest_Hz = max(lines_Hz(effect, values), default=0.0)
    parts, residuals, noise = parts_of(channel.observed, channel.residuals, channel.noise, highest_Hz, settings)
    first, second = halves(parts)
    if not first or not second:
        return 0.0
    gain = min(
        gain_on_unseen(effect, values, fitted, unseen, residuals, noise, settings)
        for fitted, unseen in ((first, second), (second, first))
    )
    return gain if gain > settings.random_effect_gain else 0.0


def _less(effect: Effect, values: dict[str, float], channel: _Channel) -> Noise:
    """The noise of the residuals without what the effect can explain."""
    return noise_of(
        channel.observed,
        without_amplitudes(effect, values, channel.observed, channel.residuals),
        channel.noise,
        channel.memory,
    )


def _at_rest(one: RandomEffect, channel: _Channel, otherwise: bool) -> bool:
    """Whether recordings at rest show it as loud as all recordings; ``otherwise`` if there are none.

    What needs a drive is neither a hum nor a drift.
    """
    resting = [
        o
        for o in channel.observed
        if o.at_rest and one.effect.random_effect_basis(one.values, o.excitation) is not None
    ]
    if not resting:
        return otherwise
    less = _less(one.effect, one.values, channel)
    variance = amplitudes_of(one.effect, one.values, channel.observed, channel.residuals, less).variance
    gain = amplitudes_of(one.effect, one.values, resting, channel.residuals, less).gain(variance)
    return gain > channel.settings.selection.random_effect_gain_at_rest


def _rounded(one: RandomEffect, channel: _Channel) -> bool:
    """Whether it may be rounding: no larger than what the noise leaves of a converter's error.

    Noise of standard deviation σ before rounding to steps q lowers each part of the error that follows the signal by
    exp(-2 π² σ²/q²) at least (Widrow, Kollár & Liu, IEEE Trans. Instrum. Meas. 45, 1996).
    """
    step = math.sqrt(12) * channel.noise.least[one.channel]
    if not step:
        return False
    less = _less(one.effect, one.values, channel)
    noise_rms = min(less.models[o.noise_key].rms for o in channel.observed)
    variance = max(min(noise_rms / step, 1e3) ** 2 - 1 / 12, 0.0)  # beyond, the exponential is 0 in any case
    size = max(one.values[name] for name in one.effect.strengths)
    return size < step * math.exp(-2 * math.pi**2 * variance)


def _mean_ratio(gains: Sequence[float]) -> float:
    """Logarithm of the mean of likelihood ratios: none of several forms need be chosen beforehand."""
    largest = max(gains)
    if not math.isfinite(largest):
        return largest
    return largest + math.log(sum(math.exp(gain - largest) for gain in gains) / len(gains))


def _starts(effect: Effect, channel: _Channel, printhead: Printhead) -> list[dict[str, float]]:
    excitations = [replace(o.excitation, residual_lines_Hz=channel.lines_Hz) for o in channel.observed]
    return [
        start
        for start in effect.starts(printhead, excitations)
        if any(effect.random_effect_basis(start, o.excitation) is not None for o in channel.observed)
    ]


def _form(effect: Effect, start: Mapping[str, float]) -> tuple[float, ...]:
    """Values of the shapes that are chosen from a few, such as a degree."""
    return tuple(start[p.name] for p in effect.parameters if p.name not in effect.strengths and p.scale != "log")


def _forms(effect: Effect, channel: _Channel, printhead: Printhead) -> list[tuple[float, ...]]:
    return list(dict.fromkeys(_form(effect, start) for start in _starts(effect, channel, printhead)))


def _best(
    effect: Effect, channel: _Channel, printhead: Printhead, form: tuple[float, ...] | None = None
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

            bounds = (theta[place] - width, theta[place] + width)
            refined = minimize_scalar(worse, bounds=bounds, method="bounded", options={"xatol": 1e-3 * width})
            theta[place] = refined.x
            values = values_at(effect, theta)
        less = _less(effect, values, channel)
        after, peaks = amplitudes_nll(effect, values, observed, residuals, less)
        size = _root_mean_square(peaks)
        for name in effect.strengths:
            values[name] = size.value
        if best is None or channel.before - after > best.gain:
            estimates = dict.fromkeys(effect.strengths, size)
            best = RandomEffect(effect, observed[0].channel, values, channel.before - after, estimates)
    return best


def _with_intervals(best: RandomEffect, channel: _Channel) -> RandomEffect:
    """The effect with the intervals of its shapes."""
    effect, values = best.effect, best.values
    less = _less(effect, values, channel)
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
