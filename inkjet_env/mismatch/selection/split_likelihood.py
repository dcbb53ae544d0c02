"""Evidence for a random effect from recordings that its fit has not seen.

The recordings are divided into two halves. Frequency, amplitude and noise with the effect are fitted to one half; noise
alone, as coloured as it may be, is fitted to the other half, on which both are compared. The ratio of these likelihoods
exceeds x with a probability of at most 1/x where noise alone is true and its spectrum is the likeliest one (Wasserman,
Ramdas & Balakrishnan, PNAS 117, 2020: universal inference). It is only nearly so: the spectrum is fitted by Whittle's
likelihood, and noise whose memory is a sixth of a recording has gained e¹² in one half. So the halves change places,
and the smaller ratio counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular, toeplitz

from inkjet_env.identification.noise import channel_noise
from inkjet_env.mismatch.fitting.campaign_noise import FLAT_BELOW_FIRST_LINE, Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.selection.amplitude_likelihood import amplitudes_of, noise_alone_nll, without_amplitudes
from inkjet_env.mismatch.settings import SelectionSettings
from inkjet_env.plant import Effect
from inkjet_env.typing import Real

SINGULAR = 1e-10
"""Relative addition to the variance that keeps a covariance positive definite."""


@dataclass(frozen=True, eq=False)
class ExactNoise(Noise):
    """Noise whose covariance is that of a stationary process on a finite recording.

    `Noise` joins the ends of a recording, for speed: noise with a memory then looks as if it jumped there, as a drift
    does.
    """

    _factors: dict[tuple[tuple[str, float], int], Real] = field(default_factory=dict, init=False, repr=False)

    def _factor(self, key: tuple[str, float], samples: int) -> Real:
        if (key, samples) not in self._factors:
            covariance = toeplitz(self.models[key].autocovariance(samples))
            covariance[np.diag_indices(samples)] *= 1 + SINGULAR
            self._factors[key, samples] = cholesky(covariance, lower=True, check_finite=False)
        return self._factors[key, samples]

    def whitened(self, observed: ObservedRecording, columns: Real) -> Real:
        level = self.levels.get(observed.name)
        scaled = columns if level is None else columns / (level if columns.ndim == 1 else level[:, None])
        factor = self._factor(observed.noise_key, columns.shape[0])
        return np.asarray(solve_triangular(factor, scaled, lower=True, check_finite=False), dtype=np.float64)

    def lost(self, observed: ObservedRecording) -> int:
        return 0

    def log_scale(self, observed: ObservedRecording) -> float:
        level = self.levels.get(observed.name)
        factor = self._factor(observed.noise_key, observed.excitation.samples)
        return float(np.mean(np.log(np.diag(factor)))) + (0.0 if level is None else float(np.mean(np.log(level))))


def parts_of(
    observed: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
    highest_Hz: float,
    settings: SelectionSettings,
) -> tuple[list[ObservedRecording], dict[str, Real], Noise]:
    """The recordings, their residuals and noise in parts short enough for an exact likelihood.

    Where an effect is slow, a part holds means of neighbouring samples; else, a recording is cut. In a part, a tone has
    a phase of its own, so nothing is assumed of the parts that is not assumed of recordings. A few recordings are cut
    into parts as well. Means may have less noise than a converter's step leaves a sample.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        Recordings of one channel.
    residuals : dict of str to ndarray
        Residual of each, shape (n,).
    noise : Noise
        Noise whose levels the parts keep.
    highest_Hz : float
        Highest frequency of the effect; 0 for a drift.
    settings : SelectionSettings
        Lengths of the parts.
    """
    parts, own, levels, blocks = [], {}, {}, []
    pieces = math.ceil(settings.split_recordings / len(observed))
    for o in observed:
        e, level = o.excitation, noise.levels.get(o.name)
        block = max(1, e.samples // (settings.longest_part if highest_Hz else settings.slow_part))
        if highest_Hz and highest_Hz * e.step_s * block * settings.samples_a_period > 1:
            block = 1
        blocks.append(block)
        kept = block * (e.samples // block)
        residual, drive_V = (s[:kept].reshape(-1, block).mean(axis=1) for s in (residuals[o.name], e.drive_V))
        level, neighbour_V = (
            None if s is None else s[:kept].reshape(-1, block).mean(axis=1) for s in (level, e.neighbour_V)
        )
        samples = kept // block
        wanted = max(pieces, math.ceil(samples / settings.longest_part))
        count = min(wanted, max(1, samples // settings.shortest_part))
        length = samples // count
        for k in range(count):
            cut = slice(k * length, (k + 1) * length)
            excitation = replace(
                e,
                step_s=e.step_s * block,
                drive_V=drive_V[cut],
                neighbour_V=None if neighbour_V is None else neighbour_V[cut],
                cache={},
            )
            name = f"{o.name} part {k + 1}"
            own[name] = residual[cut]
            one = replace(o, name=name, excitation=excitation, measured=own[name], fitted=length, rounding=None)
            parts.append(one)
            if level is not None:
                levels[name] = level[cut]
    least = {channel: value / math.sqrt(min(blocks)) for channel, value in noise.least.items()}
    return parts, own, replace(noise, levels=levels, least=least)


def noise_of(
    observed: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
    longest_memory: float,
    lines_Hz: Sequence[float] = (),
) -> Noise:
    """Noise whose spectrum is that of these residuals, and whose levels are those of another noise.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        Recordings of one channel.
    residuals : dict of str to ndarray
        Residual of each, shape (n,), in the channel's unit.
    noise : Noise
        Noise whose levels and resolution are kept.
    longest_memory : float
        Longest memory of the noise, in durations of the longest recording.
    lines_Hz : sequence of float
        Frequencies around which the noise may be stronger, in bands wider than a line.
    """
    stretches: dict[float, list[Real]] = {}
    for o in observed:
        stretches.setdefault(o.noise_key[1], []).append(residuals[o.name] / noise.levels.get(o.name, np.ones(1)))
    channel = observed[0].channel
    sources = dict.fromkeys(stretches, "residuals")
    least = noise.least.get(channel, 0.0)
    found = channel_noise(stretches, sources, least, longest_memory, lines_Hz)
    return replace(noise, models={(channel, step_s): model for step_s, model in found.items()})


def halves(observed: Sequence[ObservedRecording]) -> tuple[list[ObservedRecording], list[ObservedRecording]]:
    """The recordings in two halves that share their sampling steps and amplitudes as evenly as possible."""
    ordered = sorted(observed, key=lambda o: (o.noise_key, float(np.std(o.excitation.drive_V)), o.name))
    return ordered[::2], ordered[1::2]


def gain_on_unseen(
    effect: Effect,
    values: dict[str, float],
    fitted: Sequence[ObservedRecording],
    unseen: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
    settings: SelectionSettings,
) -> float:
    """Log-likelihood that a random effect fitted to some recordings gains over noise alone on others.

    Noise alone is fitted to the unseen recordings themselves and may be stronger around the effect's frequencies.

    Parameters
    ----------
    effect : Effect
        The random effect.
    values : dict of str to float
        Values of its parameters, from the fitted recordings.
    fitted, unseen : sequence of ObservedRecording
        Recordings of one channel.
    residuals : dict of str to ndarray
        Residual of each, shape (n,), in the channel's unit.
    noise : Noise
        Noise whose levels are kept.
    settings : SelectionSettings
        Memory of a drift.
    """
    memory = longest_memory(effect, settings)
    less = _exact(noise_of(fitted, without_amplitudes(effect, values, fitted, residuals), noise, memory))
    variance = amplitudes_of(effect, values, fitted, residuals, less).variance
    compared = [o for o in unseen if o.noise_key in less.models]
    if not compared or not variance:
        return -math.inf
    alone = _exact(noise_of(compared, residuals, noise, memory, lines_Hz(effect, values)))
    with_it = noise_alone_nll(compared, residuals, less)
    with_it -= amplitudes_of(effect, values, compared, residuals, less).gain(variance)
    return noise_alone_nll(compared, residuals, alone) - with_it


def _exact(noise: Noise) -> ExactNoise:
    return ExactNoise(noise.models, noise.samples, noise.notes, noise.least, noise.levels, noise.tails)


def at_a_frequency(effect: Effect) -> bool:
    """Whether a random effect is a tone."""
    return any(p.unit == "Hz" for p in effect.parameters if p.name not in effect.strengths)


def longest_memory(effect: Effect, settings: SelectionSettings) -> float:
    """Longest memory of noise beside an effect, in durations of a recording: a tone may be mistaken for any drift."""
    return settings.any_drift if at_a_frequency(effect) else FLAT_BELOW_FIRST_LINE


def lines_Hz(effect: Effect, values: dict[str, float]) -> list[float]:
    """Frequencies of a tone and of its multiples; none for an effect without a frequency."""
    names = {p.unit: p.name for p in effect.parameters if p.name not in effect.strengths}
    if "Hz" not in names:
        return []
    multiples = round(values.get("multiples", 1.0))
    return [k * values[names["Hz"]] for k in range(1, multiples + 1)]
