"""Evidence for a random effect from recordings that its fit has not seen.

The recordings are divided into two halves. Frequency, amplitude and noise with the effect are fitted to one half; noise
alone, as coloured as it may be, is fitted to the other half, on which both are compared. The ratio of these likelihoods
exceeds x with a probability of at most 1/x where noise alone is true, whatever its spectrum (Wasserman, Ramdas &
Balakrishnan, PNAS 117, 2020: universal inference). The halves then change places, and the ratios are averaged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inkjet_env.identification.noise import channel_noise
from inkjet_env.mismatch.fitting.campaign_noise import FLAT_BELOW_FIRST_LINE, Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.selection.amplitude_likelihood import amplitudes_of, noise_alone_nll, without_amplitudes
from inkjet_env.plant import Effect
from inkjet_env.typing import Real

FEWEST = 4
"""Least number of recordings that are divided whole; fewer are cut into parts first."""
ANY_DRIFT = 10.0
"""Memory, in durations of a recording, with which noise is a drift."""
SHORTEST_PART = 100
"""Shortest part of a recording, in samples."""


def parts_of(
    observed: Sequence[ObservedRecording], residuals: dict[str, Real], noise: Noise
) -> tuple[list[ObservedRecording], dict[str, Real], Noise]:
    """The recordings, their residuals and noise; each cut into parts of equal length if there are fewer than `FEWEST`.

    In a part, a tone has a phase of its own, so nothing is assumed of the parts that is not assumed of recordings.
    """
    if len(observed) >= FEWEST:
        return list(observed), residuals, noise
    pieces = math.ceil(FEWEST / len(observed))
    parts, own, levels = [], {}, {}
    for o in observed:
        count = min(pieces, max(1, o.excitation.samples // SHORTEST_PART))
        for k, rows in enumerate(np.array_split(np.arange(o.excitation.samples), count)):
            cut, e = slice(rows[0], rows[-1] + 1), o.excitation
            neighbour_V = None if e.neighbour_V is None else e.neighbour_V[cut]
            excitation = replace(e, drive_V=e.drive_V[cut], neighbour_V=neighbour_V, cache={})
            name = f"{o.name} part {k + 1}"
            parts.append(replace(o, name=name, excitation=excitation, measured=o.measured[cut], fitted=rows.size))
            own[name] = residuals[o.name][cut]
            if o.name in noise.levels:
                levels[name] = noise.levels[o.name][cut]
    return parts, own, replace(noise, levels=levels)


def noise_of(
    observed: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
    longest_memory: float = FLAT_BELOW_FIRST_LINE,
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
        level = noise.levels.get(o.name)
        stretches.setdefault(o.noise_key[1], []).append(
            residuals[o.name] if level is None else residuals[o.name] / level
        )
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
    """
    memory = longest_memory(effect)
    less = noise_of(fitted, without_amplitudes(effect, values, fitted, residuals), noise, memory)
    variance = amplitudes_of(effect, values, fitted, residuals, less).variance
    compared = [o for o in unseen if o.noise_key in less.models]
    if not compared or not variance:
        return -math.inf
    alone = noise_of(compared, residuals, noise, memory, _lines_Hz(effect, values))
    with_it = noise_alone_nll(compared, residuals, less)
    with_it -= amplitudes_of(effect, values, compared, residuals, less).gain(variance)
    return noise_alone_nll(compared, residuals, alone) - with_it


def averaged(gains: Sequence[float]) -> float:
    """Logarithm of the mean likelihood ratio."""
    most = max(gains)
    if not math.isfinite(most):
        return most
    return most + math.log(sum(math.exp(gain - most) for gain in gains) / len(gains))


def at_a_frequency(effect: Effect) -> bool:
    """Whether a random effect is a tone."""
    return any(p.unit == "Hz" for p in effect.parameters if p.name not in effect.strengths)


def longest_memory(effect: Effect) -> float:
    """Longest memory of noise beside an effect, in durations of a recording: a tone may be mistaken for any drift."""
    return ANY_DRIFT if at_a_frequency(effect) else FLAT_BELOW_FIRST_LINE


def _lines_Hz(effect: Effect, values: dict[str, float]) -> list[float]:
    """Frequencies of a tone and of its multiples; none for an effect without a frequency."""
    names = {p.unit: p.name for p in effect.parameters if p.name not in effect.strengths}
    if "Hz" not in names:
        return []
    multiples = round(values.get("multiples", 1.0))
    return [k * values[names["Hz"]] for k in range(1, multiples + 1)]
