"""Views: recordings divided into cells by what their drives do, by time, by frequency, by their order."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.localization.cells import Cell, Rows
from inkjet_env.mismatch.settings import LocalizationSettings
from inkjet_env.plant.wording import span_text, with_prefix

Whole = NDArray[np.intp]

CHANNELS = {
    "self_sensing": "the self-sensing signal",
    "displacement": "the displacement",
    "strain_gauge": "the strain gauge",
    "drive_monitor": "the voltage at the head",
}
"""Channels in words."""
MONITOR = " (drive monitor)"
"""Ending of the name under which a voltage measured at the head is observed."""
PHASES = ("on the edges", "in the dwells", "in the ring-down", "while the drive keeps moving", "with no drive")
PULSES = ("the first pulse", "the second pulse", "the third pulse")
SIGNS = ("positive drives", "negative drives", "drives of both signs")
QUARTERS = ("first quarter of the session", "second quarter", "third quarter", "last quarter of the session")
STILL = 1e-6
"""Step of the drive, as a share of its swing, below which it counts as standing still."""
EMPTY = 1e-6
"""Share of a drive's power, below which a spectral line counts as empty."""


def views(observed: Sequence[ObservedRecording], rows: Rows, lines: Rows) -> list[Cell]:
    """Every cell of every view.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        All recordings of the fit, in its order.
    rows, lines : Rows
        Their residuals by sample, as from `sample_rows`, and by spectral line, as from `line_rows`.
    """
    several, settings = len({o.channel for o in observed}) > 1, rows.settings
    found = rows.cells("recording", rows.record, [o.name for o in observed], names=[(o.name,) for o in observed])
    found += _by_sample("time in the waveform", PHASES, lambda o: phases(o, settings), observed, rows, several)
    found += _by_sample("pulse", PULSES, lambda o: pulses(o, settings), observed, rows, several)
    found += by_time(observed, rows)
    found += by_frequency(lines)
    found += by_level(observed, rows, several)
    found += by_slope(observed, rows, several)
    found += _by_recording("sign", SIGNS, sign, observed, rows, several)
    quarter = _quarters(observed)
    found += _by_recording("order", QUARTERS, lambda o: quarter[o.name], observed, rows, several)
    found += by_parity(observed, lines)
    return found


def phases(o: ObservedRecording, settings: LocalizationSettings) -> Whole:
    """Index of each sample into `PHASES`, shape (n,)."""
    drive, n = o.excitation.drive_V, o.excitation.samples
    if o.still:
        return np.full(n, 4)
    moving = _moving(o)
    if moving.mean() > 1 - settings.settled_drive:
        return np.full(n, 3)
    at_rest = ~moving & (np.abs(drive - rest_V(o)) <= STILL * np.ptp(drive))
    result = np.where(moving, 0, np.where(at_rest, 2, 1))
    if not o.excitation.periodic:
        result[: int(np.argmax(moving))] = 4
    return result


def _moving(o: ObservedRecording) -> NDArray[np.bool_]:
    """Whether the drive moves in the step before each sample."""
    drive = o.excitation.drive_V
    before = drive[-1] if o.excitation.periodic else drive[0]
    return np.abs(np.diff(drive, prepend=before)) > STILL * np.ptp(drive)


def rest_V(o: ObservedRecording) -> float:
    """The level at which the drive stands still longest, in volts."""
    still = o.excitation.drive_V[~_moving(o)]
    levels, counts = np.unique(np.round(still / (STILL * np.ptp(o.excitation.drive_V))), return_counts=True)
    return float(levels[np.argmax(counts)]) * STILL * float(np.ptp(o.excitation.drive_V))


def pulses(o: ObservedRecording, settings: LocalizationSettings) -> Whole:
    """Index of each sample's pulse, ring-down included, shape (n,); −1 if there are not two or three pulses."""
    n = o.excitation.samples
    none = np.full(n, -1)
    moving = _moving(o)
    if o.still or moving.mean() > 1 - settings.settled_drive:
        return none
    away = np.abs(o.excitation.drive_V - rest_V(o)) > 10 * STILL * np.ptp(o.excitation.drive_V)
    starts = np.flatnonzero(np.diff(away.astype(np.int8), prepend=0) == 1)
    begun = [int(start) for start in starts if not away[max(start - settings.pulse_gap, 0) : start].any()]
    if not 2 <= len(begun) <= len(PULSES):
        return none
    result = none.copy()
    for k, start in enumerate(begun):
        result[start:] = k
    return result


def sign(o: ObservedRecording) -> int:
    """Index of the drive's sign into `SIGNS`; −1 for a drive that never changes."""
    high, low = float(o.excitation.drive_V.max()), float(o.excitation.drive_V.min())
    if o.still:
        return -1
    size = max(high, -low)
    return 2 if min(high, -low) > 0.01 * size else int(high < -low)


def steepest_V_s(o: ObservedRecording) -> float:
    """Largest rate of change of the drive, in volts per second."""
    return float(np.abs(np.diff(o.excitation.drive_V)).max(initial=0.0)) / o.excitation.step_s


def largest_V(o: ObservedRecording) -> float:
    """Largest magnitude of the drive, in volts."""
    return float(np.abs(o.excitation.drive_V).max())


def _by_sample(
    view: str,
    labels: Sequence[str],
    of: Callable[[ObservedRecording], Whole],
    observed: Sequence[ObservedRecording],
    rows: Rows,
    several: bool,
) -> list[Cell]:
    channels = sorted({o.channel for o in observed})
    place = np.concatenate(
        [np.where((k := of(o)) < 0, -1, k + len(labels) * channels.index(o.channel)) for o in observed]
    )
    return rows.cells(
        view,
        place,
        [_labelled(label, c, several) for c in channels for label in labels],
        groups=[c for c in channels for _ in labels],
    )


def _by_recording(
    view: str,
    labels: Sequence[str],
    of: Callable[[ObservedRecording], int],
    observed: Sequence[ObservedRecording],
    rows: Rows,
    several: bool,
) -> list[Cell]:
    return _by_sample(view, labels, lambda o: np.full(o.excitation.samples, of(o)), observed, rows, several)


def _labelled(label: str, channel: str, several: bool) -> str:
    return f"{channel}: {label}" if several else label


def by_time(observed: Sequence[ObservedRecording], rows: Rows) -> list[Cell]:
    """Cells by time: equal intervals of the longest recording with the same channel and sampling step."""
    place = np.full(rows.record.size, -1)
    labels: list[str] = []
    spans: list[tuple[float, ...]] = []
    groups: list[str] = []
    sizes = np.array([o.excitation.samples for o in observed])
    index = np.arange(rows.record.size) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    for key in sorted({o.noise_key for o in observed}):
        mine = [i for i, o in enumerate(observed) if o.noise_key == key and not o.still]
        if not mine:
            continue
        longest = int(sizes[mine].max())
        count = min(rows.settings.time_intervals, max(longest // 16, 1))
        own = np.isin(rows.record, mine)
        place[own] = len(labels) + index[own] * count // longest
        step_s = observed[mine[0]].excitation.step_s
        edges = [step_s * -(-longest * k // count) for k in range(count + 1)]
        for low, high in itertools.pairwise(edges):
            labels.append(f"{with_prefix(low, 's')} to {with_prefix(high, 's')}")
            spans.append((low, high))
            groups.append(time_group(observed[mine[0]]))
    return rows.cells("time", place, labels, spans, groups)


def time_group(o: ObservedRecording) -> str:
    """Recordings whose times are told together: those of one channel and sampling step."""
    return f"{o.channel} {o.noise_key[1]:g}"


def by_frequency(lines: Rows) -> list[Cell]:
    """Cells by frequency: equal bands of each octave."""
    per_octave = lines.settings.bands_per_octave
    band = np.floor(per_octave * np.log2(lines.axis)).astype(np.intp)
    kinds, place = np.unique(band, return_inverse=True)
    spans = [(float(2 ** (k / per_octave)), float(2 ** ((k + 1) / per_octave))) for k in kinds]
    labels = [f"{with_prefix(low, 'Hz')} to {with_prefix(high, 'Hz')}" for low, high in spans]
    return lines.cells("frequency", place, labels, spans)


def by_level(observed: Sequence[ObservedRecording], rows: Rows, several: bool) -> list[Cell]:
    """Cells by the largest magnitude of a recording's drive, in equal parts of the largest of all."""
    values = {o.name: largest_V(o) for o in observed}
    most = max(values.values()) or 1.0
    bins = {name: math.ceil(round(rows.settings.drive_levels * value / most, 6)) for name, value in values.items()}
    return _by_value("amplitude", "V", values, bins, observed, rows, several)


def by_slope(observed: Sequence[ObservedRecording], rows: Rows, several: bool) -> list[Cell]:
    """Cells by the largest rate of change of a recording's drive, in octaves."""
    values = {o.name: steepest_V_s(o) for o in observed if not o.still}
    bins = {name: math.floor(round(math.log2(value), 6)) for name, value in values.items()}
    return _by_value("slope", "V/s", values, bins, observed, rows, several)


def _by_value(
    view: str,
    unit: str,
    values: dict[str, float],
    bins: dict[str, int],
    observed: Sequence[ObservedRecording],
    rows: Rows,
    several: bool,
) -> list[Cell]:
    kinds = sorted({(o.channel, bins[o.name]) for o in observed if o.name in bins})
    members = [[o.name for o in observed if o.name in bins and (o.channel, bins[o.name]) == kind] for kind in kinds]
    of = {name: i for i, names in enumerate(members) for name in names}
    place = np.array([of.get(o.name, -1) for o in observed])[rows.record]
    spans = [(min(values[n] for n in names), max(values[n] for n in names)) for names in members]
    labels = [
        _labelled(span_text(low, high, unit), c, several) for (c, _), (low, high) in zip(kinds, spans, strict=True)
    ]
    return rows.cells(view, place, labels, spans, [c for c, _ in kinds], [tuple(names) for names in members])


def _quarters(observed: Sequence[ObservedRecording]) -> dict[str, int]:
    """Quarter of the session for each recording, 0 … 3, counted over the recordings of its channel."""
    result = {}
    for channel in sorted({o.channel for o in observed}):
        mine = sorted((o for o in observed if o.channel == channel), key=lambda o: o.excitation.order)
        result.update({o.name: len(QUARTERS) * i // len(mine) for i, o in enumerate(mine)})
    return result


def by_parity(observed: Sequence[ObservedRecording], lines: Rows) -> list[Cell]:
    """Cells by even and odd multiples of the repetition rate, under periodic drives with odd lines only."""
    place = np.full(lines.record.size, -1)
    for i, o in enumerate(observed):
        last = last_odd_line(o)
        if last:
            mine = np.flatnonzero(lines.record == i)
            line = np.round(lines.axis[mine] * o.excitation.samples * o.excitation.step_s).astype(np.intp)
            place[mine] = np.where(line <= lines.settings.distortion_lines * last, line % 2, -1)
    labels = ["even multiples of the repetition rate", "odd multiples of the repetition rate"]
    return lines.cells("distortion", place, labels)


def last_odd_line(o: ObservedRecording) -> int:
    """Number of the highest line of a periodic drive with odd lines only; 0 for any other drive."""
    if not o.excitation.periodic or o.still:
        return 0
    power = np.abs(np.fft.rfft(o.excitation.drive_V - o.excitation.drive_V.mean())) ** 2
    if power[::2].sum() > EMPTY * power.sum():
        return 0
    return int(np.flatnonzero(power > EMPTY * power.max())[-1])
