"""Extent of the mismatch within each recording, in time and in frequency, from cells of all sizes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.localization.cells import Rows, surplus
from inkjet_env.typing import Real

Whole = NDArray[np.intp]


@dataclass(frozen=True)
class Extent:
    """A stretch of one recording's time or spectrum in which its residuals exceed the noise.

    Attributes
    ----------
    low, high : float
        Its ends, in seconds from the start of the recording or in hertz.
    surplus : float
        Residual power beyond that of noise alone, summed over its rows.
    expected : float
        What noise alone would leave.
    """

    low: float
    high: float
    surplus: float
    expected: float


def extents_in_time(o: ObservedRecording, rows: Rows, record: int) -> list[Extent]:
    """Stretches of a recording's time; see `extents`."""
    n, settings = o.excitation.samples, rows.settings
    count = min(settings.time_intervals, max(n // 16, 1))
    edges = n * np.arange(count + 1) // count
    return extents(rows, record, edges, o.excitation.step_s * edges)


def extents_in_frequency(o: ObservedRecording, lines: Rows, record: int) -> list[Extent]:
    """Bands of a recording's spectrum; a line reaches half-way to its neighbours. See `extents`."""
    count = o.excitation.samples // 2
    per_octave = lines.settings.bands_per_octave
    band = np.floor(per_octave * np.log2(np.arange(1, count + 1)))
    edges = np.append(np.flatnonzero(np.diff(band, prepend=-1.0)), count)
    return extents(lines, record, edges, (edges + 0.5) / (o.excitation.samples * o.excitation.step_s))


def extents(rows: Rows, record: int, edges: Whole, axis: Real) -> list[Extent]:
    """Stretches of a recording whose residual power exceeds the noise significantly.

    The finest cells come first, then pairs of them, pairs of pairs and so on, each without the parts that finer ones
    have told already: so what is short is told with its own ends, and what is weak but long is told as well. All cells
    of one size share an equal part of the probability of a false alarm.

    Parameters
    ----------
    rows : Rows
        Residuals by sample or by line.
    record : int
        Index of the recording.
    edges : ndarray of int, shape (cells + 1,)
        Index of the first row of each of the finest cells, counted within the recording, and the number of rows.
    axis : ndarray, shape (cells + 1,)
        Time or frequency at these edges.

    Returns
    -------
    list of Extent
        In their order on the axis; adjacent cells are merged.
    """
    mine = np.flatnonzero(rows.record == record)
    if mine.size == 0:
        return []
    power = np.add.reduceat(rows.power[mine], edges[:-1])
    expected = np.add.reduceat(rows.expected[mine], edges[:-1])
    key = int(rows.key[mine[0]])
    noise_degrees, smooth = float(rows.noise_degrees[key]), float(rows.smooth[key])
    every = float(rows.expected[rows.key == key].sum()) or 1.0
    cells = edges.size - 1
    levels = (cells - 1).bit_length() + 1
    told = np.zeros(cells, bool)
    for level in range(levels):
        width = 1 << level
        starts = range(0, cells, width)
        sure = NormalDist().inv_cdf(1 - rows.settings.false_alarms / (levels * len(starts)))
        for start in starts:
            left = np.arange(start, min(start + width, cells))
            left = left[~told[left]]
            samples = float(expected[left].sum())
            if samples < rows.settings.least_extent_degrees:
                continue
            degrees = noise_degrees
            if rows.by_line:
                degrees = max(noise_degrees * max(samples / every, smooth), 1.0)
            told[left] = surplus(float(power[left].sum()) / samples, samples, degrees) > sure
    found = []
    for is_told, run in itertools.groupby(range(cells), lambda k: bool(told[k])):
        if is_told:
            part = list(run)
            beyond = float(power[part].sum() - expected[part].sum())
            found.append(
                Extent(float(axis[part[0]]), float(axis[part[-1] + 1]), beyond, float(expected[part].sum()))
            )
    return found


def merged(found: Sequence[Extent]) -> list[Extent]:
    """The union of stretches, of several recordings for instance, with their surpluses added; largest surplus first."""
    union: list[Extent] = []
    for one in sorted(found, key=lambda e: (e.low, e.high)):
        if union and one.low <= union[-1].high * (1 + 1e-9):
            last = union[-1]
            union[-1] = Extent(
                last.low, max(last.high, one.high), last.surplus + one.surplus, last.expected + one.expected
            )
        else:
            union.append(one)
    return sorted(union, key=lambda e: -e.surplus)
