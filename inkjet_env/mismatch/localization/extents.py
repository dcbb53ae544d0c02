"""Extent of the mismatch in time and in frequency: of each recording from cells of all sizes, and of all together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.localization.cells import Cell, Rows, surplus
from inkjet_env.mismatch.localization.views import MONITOR, time_group
from inkjet_env.typing import Real

Whole = NDArray[np.intp]
Intervals = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Extent:
    """A stretch of time or of a spectrum in which residuals exceed the noise.

    Attributes
    ----------
    low, high : float
        Its ends, in seconds from the start of a recording or in hertz.
    surplus : float
        Residual power beyond that of noise alone, summed over its rows.
    """

    low: float
    high: float
    surplus: float


def reported(
    observed: Sequence[ObservedRecording],
    recordings: Sequence[str],
    significant: Sequence[Cell],
    rows: Rows,
    lines: Rows,
) -> tuple[list[Extent], list[Extent], dict[str, tuple[Intervals, Intervals]]]:
    """All times and frequencies at which residuals exceed the noise, largest surplus first.

    Each listed recording contributes its own, all recordings together contribute their bands, and their times where no
    listed recording with the same channel and sampling step shows any by itself. Times of different channels or
    sampling steps are never merged: their recordings last differently long.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        All recordings of the fit, in its order.
    recordings : sequence of str
        Names of the recordings that are listed.
    significant : sequence of Cell
        Significant cells of all views.
    rows, lines : Rows
        Residuals by sample and by spectral line.

    Returns
    -------
    times, frequencies : list of Extent
    by_recording : dict of str to (times, frequencies)
        Intervals of each listed recording that has any, in the order of ``recordings``.
    """
    times: dict[str, list[Extent]] = {}
    bands: list[Extent] = []
    own: dict[str, tuple[list[Extent], list[Extent]]] = {name: ([], []) for name in recordings}
    for i, o in enumerate(observed):
        name = o.name.removesuffix(MONITOR)
        if name in own:
            in_time, in_frequency = extents_in_time(o, rows, i), extents_in_frequency(o, lines, i)
            own[name][0].extend(in_time)
            own[name][1].extend(in_frequency)
            times.setdefault(time_group(o), []).extend(in_time)
            bands.extend(in_frequency)
    shown = {group for group, mine in times.items() if mine}
    for view, least in _least_power(significant, rows.settings.weak).items():
        for cell in (c for c in significant if c.view == view and c.power - 1 >= least):
            if view == "frequency":
                bands.append(Extent(cell.span[0], cell.span[1], cell.surplus))
            elif cell.group not in shown:
                times.setdefault(cell.group, []).append(Extent(cell.span[0], cell.span[1], cell.surplus))
    everywhen = sorted((one for mine in times.values() for one in merged(mine)), key=lambda e: -e.surplus)
    by_recording = {
        name: (_intervals(merged(in_time)), _intervals(merged(in_frequency)))
        for name, (in_time, in_frequency) in own.items()
        if in_time or in_frequency
    }
    return everywhen, merged(bands), by_recording


def _least_power(significant: Sequence[Cell], weak: float) -> dict[str, float]:
    """Surplus power per sample from which cells of all recordings together are told, by view."""
    return {
        view: weak * max((c.power - 1 for c in significant if c.view == view), default=0.0)
        for view in ("time", "frequency")
    }


def _intervals(found: Sequence[Extent]) -> Intervals:
    return tuple((one.low, one.high) for one in found)


def extents_in_time(o: ObservedRecording, rows: Rows, record: int) -> list[Extent]:
    """Stretches of a recording's time; see `extents`."""
    n, settings = o.excitation.samples, rows.settings
    count = min(settings.time_intervals, max(n // 16, 1))
    edges = n * np.arange(count + 1) // count
    axis: Real = o.excitation.step_s * edges.astype(np.float64)
    return extents(rows, record, edges, axis)


def extents_in_frequency(o: ObservedRecording, lines: Rows, record: int) -> list[Extent]:
    """Bands of a recording's spectrum; a line reaches half-way to its neighbours. See `extents`."""
    count = o.excitation.samples // 2
    per_octave = lines.settings.bands_per_octave
    band = np.floor(per_octave * np.log2(np.arange(1, count + 1)))
    edges = np.append(np.flatnonzero(np.diff(band, prepend=-1.0)), count)
    axis: Real = (edges + 0.5) / (o.excitation.samples * o.excitation.step_s)
    return extents(lines, record, edges, axis)


def extents(rows: Rows, record: int, edges: Whole, axis: Real) -> list[Extent]:
    """Stretches of a recording whose residual power exceeds the noise significantly.

    The finest cells come first, then pairs of them, pairs of pairs and so on, each without the parts that finer ones
    have told already: so what is short is told with its own ends, and what is weak but long is told as well. All cells
    of one size share an equal part of the probability of a false alarm. What is far weaker than the strongest cell, the
    end of a ring-down for instance, is left out; see `LocalizationSettings.weak`.

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
    key = int(rows.key[mine[0]])  # one recording has one noise
    noise_degrees, smooth, scatter = (float(v[key]) for v in (rows.noise_degrees, rows.smooth, rows.scatter))
    every = float(rows.expected[rows.key == key].sum()) or 1.0
    cells = edges.size - 1
    levels = (cells - 1).bit_length() + 1
    told = np.zeros(cells, bool)
    strength = np.zeros(cells)  # surplus power per sample, relative to the noise
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
            ratio = float(power[left].sum()) / samples
            if surplus(ratio, samples / scatter, degrees) > sure:
                told[left], strength[left] = True, ratio - 1
    if not told.any():
        return []
    told &= strength >= rows.settings.weak * strength.max()
    found = []
    for is_told, run in itertools.groupby(range(cells), lambda k: bool(told[k])):
        if is_told:
            part = list(run)
            beyond = float(power[part].sum() - expected[part].sum())
            found.append(Extent(float(axis[part[0]]), float(axis[part[-1] + 1]), beyond))
    return found


def merged(found: Sequence[Extent]) -> list[Extent]:
    """The union of stretches, of several recordings for instance, with their surpluses added; largest surplus first."""
    union: list[Extent] = []
    for one in sorted(found, key=lambda e: (e.low, e.high)):
        if union and one.low <= union[-1].high * (1 + 1e-9):
            last = union[-1]
            union[-1] = Extent(last.low, max(last.high, one.high), last.surplus + one.surplus)
        else:
            union.append(one)
    return sorted(union, key=lambda e: -e.surplus)
