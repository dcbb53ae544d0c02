"""Localisation of a fitted model's repeatable residual power, without any knowledge of effects.

Every view divides the residuals into cells and compares each with the noise. One rule for all cells of all views
together keeps the probability that a correct model is flagged anywhere below `LocalizationSettings.false_alarms`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from statistics import NormalDist

import numpy as np

from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.fitting.fit_result import FitResult
from inkjet_env.mismatch.fitting.spikes import without_spikes
from inkjet_env.mismatch.localization.cells import Cell, line_rows, sample_rows, taken_by_fit
from inkjet_env.mismatch.localization.drift import Trend, shifts, trends
from inkjet_env.mismatch.localization.extents import reported
from inkjet_env.mismatch.localization.location import Location
from inkjet_env.mismatch.localization.views import CHANNELS, MONITOR, largest_V, views
from inkjet_env.mismatch.settings import LocalizationSettings
from inkjet_env.plant.wording import percent, span_text, with_prefix
from inkjet_env.typing import Real

STANDING_OUT = {
    "time in the waveform": "mostly ",
    "pulse": "strongest with ",
    "sign": "strongest with ",
    "order": "strongest in the ",
}


def locate(
    observed: Sequence[ObservedRecording], noise: Noise, fit: FitResult, q: Real, settings: LocalizationSettings
) -> Location:
    """Where the residuals of a fitted model exceed the noise.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        All recordings of the fit, in its order.
    noise : Noise
        Noise that whitens them. If it was not measured (``samples`` 0), cells are compared with all residuals instead.
    fit : FitResult
        The fitted model.
    q : ndarray, shape (rows, k)
        Orthonormal columns of the fitted rows, as `OutputErrorFit.basis` has them: the fit removed noise along them.
    settings : LocalizationSettings
        Thresholds of the localisation.

    Returns
    -------
    Location
        Empty if nothing exceeds the noise significantly.

    Raises
    ------
    ValueError
        ``q`` belongs to other recordings.
    """
    columns = [noise.whitened(o, fit.head.sensitivities(o)) for o in observed]
    calm = {
        o.name: without_spikes(fit.residuals[o.name]) if noise.tail(o) > settings.heavy_tails else fit.residuals[o.name]
        for o in observed
    }
    fit = replace(fit, residuals=calm)
    taken = taken_by_fit(observed, noise, fit, columns, q)
    rows = sample_rows(observed, noise, fit, taken, settings)
    lines = line_rows(observed, noise, fit, taken, settings)
    cells = views(observed, rows, lines) + repeats(observed, noise, fit, taken, settings)
    moved = shifts(observed, noise, fit, columns)
    lines_of_drift = trends(observed, moved, settings)
    tests = len(cells) + 2 * len(lines_of_drift)
    sure = NormalDist().inv_cdf(1 - settings.false_alarms / max(tests, 1))
    significant = [cell for cell in cells if cell.z > sure]
    drift = [trend for trend in lines_of_drift if abs(trend.z) > sure]
    tables = _tables(cells, lines_of_drift, moved)
    if not significant and not drift:
        return Location(tables=tables)
    recordings = _recordings(significant, settings.most_recordings)
    if not recordings and drift:
        strongest = sorted(moved, key=lambda name: -float(np.max(np.abs(moved[name][:, 0] / moved[name][:, 1]))))
        recordings = tuple(strongest[: settings.most_recordings])
    times, bands, by_recording = reported(observed, recordings, significant, rows, lines)
    drive_V = _drives(significant, settings.weak_for_its_drive)
    sentence = _sentence(observed, noise, fit, significant, cells, drift, recordings, drive_V, settings)
    return Location(
        recordings,
        tuple((one.low, one.high) for one in times),
        tuple((one.low, one.high) for one in bands),
        drive_V,
        sentence,
        tables,
        by_recording,
    )


def repeats(
    observed: Sequence[ObservedRecording],
    noise: Noise,
    fit: FitResult,
    taken: Sequence[Real],
    settings: LocalizationSettings,
) -> list[Cell]:
    """Cells of the residual power that repeats of one drive share: the mean product of two repeats' residuals."""
    found = []
    for condition in sorted({o.condition for o in observed if not o.still}):
        same = [i for i, o in enumerate(observed) if o.condition == condition]
        if len(same) < 2:
            continue
        residuals = np.array([fit.residuals[observed[i].name] for i in same])
        first = observed[same[0]]
        k, n = len(same), first.excitation.samples - noise.models[first.noise_key].lost
        if n < settings.least_degrees_of_freedom:
            continue
        products = (float(np.sum(residuals.sum(axis=0) ** 2)) - float(np.sum(residuals**2))) / (k * (k - 1))
        shared = float(np.mean([np.sum(taken[i] ** 2) for i in same]))
        common = products + (shared if first.fitted else -shared)
        names = tuple(observed[i].name for i in same)
        own = max(float(np.mean(residuals**2)), 1e-300) * n
        alone = max(own - max(common, 0.0), 1e-300) / n  # what repeats do not share is noise
        z = common / (alone * math.sqrt(2 * n / (k * (k - 1))))
        found.append(Cell("repeats", " = ".join(names), 1 + common / (n * alone), z, names=names))
    return found


def _recordings(significant: Sequence[Cell], most: int) -> tuple[str, ...]:
    """Names of the recordings that stand out, strongest first."""
    strength: dict[str, float] = {}
    for cell in significant:
        if cell.view in ("recording", "repeats"):
            for name in cell.names:
                name = name.removesuffix(MONITOR)
                strength[name] = max(strength.get(name, 0.0), cell.power)
    return tuple(sorted(strength, key=lambda name: (-strength[name], name))[:most])


def _stretches(significant: Sequence[Cell], strong_share: float) -> tuple[tuple[float, float], ...]:
    """Intervals of the strongest cells, adjacent ones merged, strongest first."""
    if not significant:
        return ()
    least = strong_share * (max(c.power for c in significant) - 1)
    strong = sorted((c for c in significant if c.power - 1 >= least), key=lambda c: (c.group, c.span))
    merged: list[tuple[str, float, float, float]] = []
    for c in strong:
        low, high = c.span
        if merged and merged[-1][0] == c.group and low <= merged[-1][2] * (1 + 1e-9):
            merged[-1] = (c.group, merged[-1][1], high, max(merged[-1][3], c.power))
        else:
            merged.append((c.group, low, high, c.power))
    return tuple((low, high) for _, low, high, _ in sorted(merged, key=lambda one: -one[3]))


def _drives(significant: Sequence[Cell], weak: float) -> tuple[tuple[float, float], ...]:
    """Range of the largest drive, in volts, on the channel that shows the mismatch most; empty if none does."""
    mine = [c for c in significant if c.view == "amplitude"]
    if not mine:
        return ()
    strongest = max(mine, key=lambda c: c.power)
    most = strongest.span[1] or 1.0
    ranges = [
        c.span
        for c in mine
        if c.group == strongest.group and c.power - 1 >= weak * (strongest.power - 1) * min(c.span[1] / most, 1.0) ** 2
    ]
    return ((min(low for low, _ in ranges), max(high for _, high in ranges)),)


def _tables(
    cells: Sequence[Cell], lines: Sequence[Trend], moved: dict[str, Real]
) -> dict[str, tuple[tuple[str, float, float], ...]]:
    tables: dict[str, list[tuple[str, float, float]]] = {}
    for cell in cells:
        tables.setdefault(cell.view, []).append((cell.label, cell.power, cell.z))
    for trend in lines:
        significant = f"{trend.what} against {trend.against}: {percent(trend.change, signed=True)} in total"
        tables.setdefault("drift", []).append((significant, trend.power, trend.z))
    for name, table in moved.items():
        for (value, error), what in zip(table, ("frequency", "damping"), strict=True):
            significant = f"{name}: {what} {percent(value, signed=True)} ± {percent(error, 1)}"
            tables.setdefault("drift", []).append((significant, float((value / error) ** 2), float(value / error)))
    return {view: tuple(table) for view, table in tables.items()}


def _sentence(
    observed: Sequence[ObservedRecording],
    noise: Noise,
    fit: FitResult,
    significant: Sequence[Cell],
    cells: Sequence[Cell],
    drift: Sequence[Trend],
    recordings: Sequence[str],
    drive_V: Sequence[tuple[float, float]],
    settings: LocalizationSettings,
) -> str:
    parts = []
    fast = [o for o in observed if o.excitation.fast]
    if recordings:
        alike = [o for o in observed if o.name.removesuffix(MONITOR) == recordings[0]]
        surplus = {c.names[0]: c.power for c in cells if c.view == "recording"}
        o = max(alike, key=lambda o: surplus.get(o.name, 0.0))
        least, most = drive_V[0] if drive_V else (0.0, 0.0)
        largest = max(largest_V(other) for other in observed)
        start = ""
        if most >= 0.99 * largest and any(0 < largest_V(other) < 0.99 * least for other in observed):
            start = f"with drives of {with_prefix(least, 'V')} and more, "
        elif 0 < most < 0.99 * largest:
            start = f"with drives of {span_text(least, most, 'V')}, "
        parts.append(f"{start}{CHANNELS[o.channel]} differs from the model{_amount(o, noise, fit)}")
    else:
        grouped = [c for c in significant if c.group]
        shown = max(grouped, key=lambda c: c.z).group.split()[0] if grouped else ""
        mine = [other for other in observed if other.channel == shown]
        o = (mine or fast or list(observed))[0]
        parts.append(f"{CHANNELS[o.channel]} differs from the model, but in no single recording significantly")
    several = len({other.channel for other in observed}) > 1
    prefix = f"{o.channel}: " if several else ""
    for view, words in STANDING_OUT.items():
        stands = _standing_out(cells, significant, view, o.channel, settings)
        if stands and (len(recordings) != 1 or view == "time in the waveform"):
            parts.append(words + stands.label.removeprefix(prefix))
    in_frequency = [c for c in significant if c.view == "frequency"]
    bands = _stretches(in_frequency, settings.strong)
    if bands:
        more = len(bands) > 2 or any(not any(a <= c.span[0] <= b for a, b in bands) for c in in_frequency)
        parts.append(
            ("strongest at " if more else "at ") + " and ".join(span_text(low, high, "Hz") for low, high in bands[:2])
        )
    parity = [c for c in significant if c.view == "distortion"]
    if parity and max(parity, key=lambda c: c.power).label.startswith("even"):
        parts.append("strongest at even multiples of the repetition rate, where this drive has no power")
    growth = _growth(significant, o.channel)
    if growth:
        parts.append(growth)
    if drift:
        most_sure = max(drift, key=lambda trend: abs(trend.z))
        over = {"order": "from the first to the last recording", "drive": "from the smallest drive to the largest"}
        way = "rose" if most_sure.change > 0 else "fell"
        name = "the resonance frequency" if most_sure.what == "frequency" else "the damping"
        parts.append(f"as if {name} {way} by {percent(abs(most_sure.change))} {over[most_sure.against]}")
    unknown = sorted({other.channel for other in observed if not noise.known(other)})
    if o.channel in unknown:
        parts.append("compared with the other residuals, because the noise is unknown")
    times = _stretches([c for c in significant if c.view == "time"], settings.strong)
    if times and not recordings:
        parts.append(f"{span_text(*times[0], 's')} after the start of the recordings")
    sentence = ", ".join(parts)
    return sentence[0].upper() + sentence[1:] + "."


def _amount(o: ObservedRecording, noise: Noise, fit: FitResult) -> str:
    """The RMS by which one recording differs, beyond noise, in its unit and in words."""
    excitation = replace(o.excitation, start=fit.end.states[o.name]) if o.name in fit.end.states else o.excitation
    residuals = o.measured - fit.head.plant(fit.active.pairs).signal(excitation)
    beyond = float(np.mean(residuals**2)) - noise.rms(o) ** 2
    if beyond <= 0:
        return f" in {o.name.removesuffix(MONITOR)}"
    return f" by {with_prefix(math.sqrt(beyond), o.unit)} RMS (noise subtracted) in {o.name.removesuffix(MONITOR)}"


def _standing_out(
    cells: Sequence[Cell], significant: Sequence[Cell], view: str, channel: str, settings: LocalizationSettings
) -> Cell | None:
    """The cell of a view whose surplus power is well above the next one's; None if there is no such cell."""
    mine = sorted((c for c in cells if c.view == view and c.group == channel), key=lambda c: -c.power)
    of_parts = view in ("time in the waveform", "pulse")
    apart = settings.part_stands_out if of_parts else settings.group_stands_out
    if len(mine) < 2 or mine[0] not in significant or mine[0].power - 1 < apart * max(mine[1].power - 1, 0.0):
        return None
    return mine[0]


def _growth(significant: Sequence[Cell], channel: str) -> str:
    """How the mismatch grows with the largest drive, in words; empty if drives are too few or too similar."""
    mine = [c for c in significant if c.view == "amplitude" and c.group == channel and c.span[1] > 0]
    if len(mine) < 3 or mine[-1].span[1] < 1.5 * mine[0].span[1]:
        return ""
    drive = np.log([c.span[1] for c in mine])
    size = 0.5 * np.log([c.power - 1 for c in mine])
    exponent = float(np.polyfit(drive, size, 1)[0])
    if exponent > 1.5:
        return "increasing faster than the drive"
    return "increasing with the drive" if exponent > 0.5 else "nearly independent of the drive"
