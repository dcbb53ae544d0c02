"""Noise with a memory: bands of the spectrum, and their powers by Whittle's likelihood.

A band is noise whose correlation falls exponentially and oscillates: ``exp(-|t|/m) cos 2πft``. At zero frequency it is
a relaxation; a sum of relaxations with times over several decades is 1/f noise (van der Ziel 1950), and one whose
memory exceeds the record is a random walk. The powers, none negative, minimise Itakura and Saito's divergence between
the periodograms and the model, which is Whittle's likelihood, by multiplicative updates (Févotte, Bertin & Durrieu,
Neural Computation 21, 2009; exponent 1/2: the likelihood rises with every update).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from inkjet_env.typing import Real

PER_DECADE = 3
"""Number of memories in a decade; neighbouring relaxations overlap."""
SHORTEST_MEMORY = 5.0
"""Shortest memory, in the shortest sampling step; an autoregression follows shorter ones."""
WIDTHS = (2.0, 5.0, 15.0)
"""Widths of the bands around a given frequency, in lines of the longest stretch."""
UPDATES = 120
"""Number of multiplicative updates in a round."""
LEAST_POWER = 1e-150
"""Power of a silent line, whose square can still be divided by."""
NEGLIGIBLE = 1e-3
"""Share of the level that a band must reach at some line to be kept."""
SINGLE_LINES = 24
"""Number of lowest lines that are taken one by one; above, lines are averaged."""
BANDS_PER_OCTAVE = 12
"""Number of averages per octave."""


@dataclass(frozen=True)
class Band:
    """A band of noise in samples of a sampling step.

    Attributes
    ----------
    frequency : float
        Centre, in cycles per sample.
    memory : float
        Time in which the correlation falls to 1/e, in samples.
    power : float
        Variance.
    """

    frequency: float
    memory: float
    power: float


def band_shape(cycles_a_sample: Real, band: Band) -> Real:
    """Power spectrum of sampled noise in a band of unit variance, of mean 1 over all frequencies, shape (lines,)."""
    keep = np.exp(-1 / band.memory)
    shape: Real = np.zeros(cycles_a_sample.shape)
    for centre in (band.frequency, -band.frequency):
        turn = 2 * np.pi * (cycles_a_sample - centre)
        shape = shape + 0.5 * (1 - keep**2) / (1 - 2 * keep * np.cos(turn) + keep**2)
    return shape


@lru_cache(maxsize=1024)
def _shape_at_lines(samples: int, band: Band) -> Real:
    """`band_shape` at the lines of a real Fourier transform; the mean has the power of the first line."""
    shape = band_shape(np.maximum(np.arange(samples // 2 + 1), 1) / samples, band)
    shape.flags.writeable = False
    return shape


def relaxations(
    stretches: Mapping[float, Sequence[Real]], longest_memory: float, lines_Hz: Sequence[float]
) -> list[tuple[float, float]]:
    """Frequencies in hertz and memories in seconds of all bands that a channel's noise may have.

    Parameters
    ----------
    stretches : mapping of float to sequence of ndarray
        Stretches of noise by sampling step in seconds.
    longest_memory : float
        Longest memory, in durations of the longest stretch.
    lines_Hz : sequence of float
        Frequencies around which there are bands, wider than a line, besides those at zero frequency.
    """
    longest_s = max(step * stretch.size for step, mine in stretches.items() for stretch in mine)
    ends = SHORTEST_MEMORY * min(stretches), longest_memory * longest_s
    count = max(2, round(PER_DECADE * np.log10(max(ends[1] / ends[0], 1.0))) + 1)
    atoms = [(0.0, float(memory)) for memory in np.geomspace(*ends, count)]
    return atoms + [(float(f), longest_s / (np.pi * width)) for f in lines_Hz for width in WIDTHS]


def band_powers(
    whitened: Sequence[tuple[float, Real, float, Callable[[int], Real]]],
    atoms: Sequence[tuple[float, float]],
    start: Real,
) -> tuple[dict[float, float], Real]:
    """Powers of bands beside an autoregression.

    Parameters
    ----------
    whitened : sequence of (float, ndarray, float, callable)
        For each stretch: its sampling step in seconds, the stretch after the autoregression's filter, the
        autoregression's innovation, and the power of the filter's transfer function at each line of a Fourier transform
        of a given length.
    atoms : sequence of (float, float)
        Frequency in hertz and memory in seconds of each band, k of them.
    start : ndarray, shape (k,)
        Powers to start from; zero where unknown.

    Returns
    -------
    white : dict of float to float
        By sampling step, the factor on the autoregression's power.
    powers : ndarray, shape (k,)
        Variance of each band, in the signal's unit squared.
    """
    groups: dict[tuple[float, int], list[tuple[Real, float, Callable[[int], Real]]]] = {}
    for step, row, own, transfer in whitened:
        groups.setdefault((step, row.size), []).append((row, own, transfer))
    steps = sorted({step for step, _ in groups})
    tables, levels, weights = [], [], []
    for (step, samples), mine in groups.items():
        if samples < 4:
            continue
        power = np.mean([np.abs(np.fft.rfft(row)) ** 2 / samples for row, _, _ in mine], axis=0)
        _, innovation, passed_at = mine[0]
        passed = passed_at(samples)[: power.size] / innovation**2
        rows = _pooled(power.size)
        table = np.zeros((power.size, len(steps) + len(atoms)))
        table[:, steps.index(step)] = 1.0
        for k, (frequency_Hz, memory_s) in enumerate(atoms, start=len(steps)):
            table[:, k] = passed * _shape_at_lines(samples, Band(frequency_Hz * step, memory_s / step, 1.0))
        count = np.diff(np.append(rows, power.size)).astype(np.float64)
        tables.append(np.add.reduceat(table, rows, axis=0) / count[:, None])
        levels.append(np.add.reduceat(power, rows) / count)
        weights.append(count * len(mine))
        weights[-1][0] = len(mine) - 1  # the mean over the stretches was removed
    if not tables:
        return dict.fromkeys(steps, 1.0), np.zeros(len(atoms))
    table, level, weight = np.concatenate(tables), np.concatenate(levels), np.concatenate(weights)
    total = weight @ table
    begin = np.maximum(start, 1e-3 * float(weight @ level) / np.maximum(total[len(steps) :], 1e-300) / len(atoms))
    found: Real = np.concatenate([np.ones(len(steps)), begin])
    for _ in range(UPDATES):
        model = np.maximum(table @ found, LEAST_POWER)
        rising, falling = table.T @ (weight * level / model**2), table.T @ (weight / model)
        found = found * np.sqrt(rising / np.maximum(falling, 1e-300))
    model = np.maximum(table @ found, LEAST_POWER)
    share = (table[:, len(steps) :] * found[len(steps) :] / model[:, None]).max(axis=0)
    powers = np.where(share > NEGLIGIBLE, found[len(steps) :], 0.0)
    return {step: float(found[k]) for k, step in enumerate(steps)}, powers


def _pooled(lines: int) -> np.ndarray:
    """First line of each average: the lowest lines one by one, those above in equal shares of an octave."""
    octaves = np.log2(max(lines / SINGLE_LINES, 1.0))
    starts = SINGLE_LINES * 2 ** (np.arange(int(np.ceil(octaves * BANDS_PER_OCTAVE))) / BANDS_PER_OCTAVE)
    found = np.unique(np.concatenate([np.arange(min(SINGLE_LINES, lines)), np.round(starts)]).astype(np.intp))
    return found[found < lines]
