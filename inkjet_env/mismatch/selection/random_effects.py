"""Random effects, such as a hum or a drift, distinguished from noise by recordings that no fit has seen.

Their amplitudes are drawn anew in every recording, so no simulation predicts them and repeats differ by them: in a
model without them they pass for noise. Two complete models are compared, each with its own noise: noise alone, as
coloured as the recordings show it, and less noise with amplitudes from one normal distribution, whose variance is
estimated by maximum likelihood. The second must predict other recordings better than the first explains them; see
`split_likelihood`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.polynomial.legendre import legvander

from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.selection.amplitude_likelihood import amplitudes_of
from inkjet_env.mismatch.selection.random_effect_values import (
    Channel,
    RandomEffect,
    described,
    forms,
    likeliest,
    noise_beside,
    with_intervals,
)
from inkjet_env.mismatch.selection.split_likelihood import (
    at_a_frequency,
    gain_on_unseen,
    halves,
    lines_Hz,
    longest_memory,
    parts_of,
)
from inkjet_env.mismatch.settings import DiagnosisSettings
from inkjet_env.plant import Effect
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real


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
                found.append(replace(with_intervals(best, channel), gain=best.gain + elsewhere))
    return sorted(found, key=lambda one: -one.gain)


def _channel(
    effect: Effect,
    observed: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
    settings: DiagnosisSettings,
) -> Channel:
    """Recordings of a channel, their residuals without what is not to be taken for the effect.

    An offset that all share is no drift. A tone is looked for in what a slow polynomial leaves of each recording.
    """
    if at_a_frequency(effect):
        own = {o.name: _without_trend(residuals[o.name], settings.selection.hum_trend) for o in observed}
    else:
        level = float(np.mean(np.concatenate([residuals[o.name] for o in observed])))
        own = {o.name: residuals[o.name] - level for o in observed}
    return described(observed, own, noise, settings, longest_memory(effect, settings.selection))


def _without_trend(signal: Real, degree: int) -> Real:
    """A signal less the polynomial of this degree that fits it best."""
    columns = legvander(np.linspace(-1, 1, signal.size), degree)
    rest: Real = signal - columns @ np.linalg.lstsq(columns, signal, rcond=None)[0]
    return rest


def _supported(effect: Effect, channel: Channel, printhead: Printhead, explained: bool) -> RandomEffect | None:
    """The effect if recordings that its fit has not seen support it; otherwise None."""
    settings = channel.settings.selection
    best = likeliest(effect, channel, printhead)
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
        there = described(fitted, residuals, noise, channel.settings, channel.memory)
        own = [one for form in forms(effect, there, printhead) if (one := likeliest(effect, there, printhead, form))]
        if not own:
            return None
        gains = [gain_on_unseen(effect, one.values, fitted, unseen, residuals, noise, settings) for one in own]
        gain = min(gain, _mean_ratio(gains))
        if gain <= settings.random_effect_gain:
            return None
    return replace(best, gain=gain)


def _gained(effect: Effect, values: dict[str, float], channel: Channel) -> float:
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


def _at_rest(one: RandomEffect, channel: Channel, otherwise: bool) -> bool:
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
    less = noise_beside(one.effect, one.values, channel)
    variance = amplitudes_of(one.effect, one.values, channel.observed, channel.residuals, less).variance
    gain = amplitudes_of(one.effect, one.values, resting, channel.residuals, less).gain(variance)
    return gain > channel.settings.selection.random_effect_gain_at_rest


def _rounded(one: RandomEffect, channel: Channel) -> bool:
    """Whether it may be rounding: no larger than what the noise leaves of a converter's error.

    Noise of standard deviation σ before rounding to steps q lowers each part of the error that follows the signal by
    exp(-2 π² σ²/q²) at least (Widrow, Kollár & Liu, IEEE Trans. Instrum. Meas. 45, 1996).
    """
    step = math.sqrt(12) * channel.noise.least[one.channel]
    if not step:
        return False
    less = noise_beside(one.effect, one.values, channel)
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
