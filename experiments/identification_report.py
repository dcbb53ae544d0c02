"""The page that an identification is read from: what was found, how sure it is, and what the model leaves over.

`write_identification_report` writes one HTML file that needs nothing but itself. From top to bottom: the answer in
words, parameters, hysteresis, ringing, spectrum, the residual of every recording, settings.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments import pictures
from inkjet_env.identification import Estimate, Identification, NoiseModel, Residual
from inkjet_env.identification.identify import NOISE_TOLERANCE, QUANTILE_90
from inkjet_env.storage import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Real = NDArray[np.float64]

CHANNEL_WORDS = {"self_sensing": "self-sensing", "strain_gauge": "strain gauge", "displacement": "displacement"}
EXPLAINED = 1.1
"""Residual over noise of held-out recordings up to which the page says that the model explains them."""
FROM_FIT = "the residual of the fit"
"""How the source of a noise model begins that nothing but the fit has shown."""
MOST_POINTS = 3000
"""Of one line in a picture."""
MOST_REVERSALS = 60
"""Of a drive whose loops can still be told apart in a picture."""
PERIODS_SHOWN = 30
"""Of the resonance, in a picture of ringing."""
MOST_VIEWS = 3
LONGEST_NAME = 24
MOST_LABELS = 90
"""Names of recordings that fit beside each other."""
LARGEST_GAP = 0.05
"""Of a signal's swing, between its end and its start, where a recording counts as one period."""
POWER_SHOWN = 0.01
"""Amplitude of the drive, as a share of its largest, from which on a spectrum is shown."""
CELLS = 40
"""Over which the means of measured branches are taken, where they hold enough points."""
FEWEST_IN_CELL = 4
SHORTEST_BRANCH = 0.2
"""Of a branch drawn beside the branch law, as a share of the recording's swing."""
MEASURED, MODELLED, LEFT, BAND, NOISE = "#56b4e9", "#000000", "#0072b2", "#d9d9d9", "#e69f00"
RISING, FALLING = "#0072b2", "#d55e00"
FITTED, HELD_OUT = "#0072b2", "#d55e00"
MARKERS = {"self_sensing": "o", "strain_gauge": "s", "displacement": "^"}


@dataclass(frozen=True, eq=False)
class Part:
    """Samples of a recording that were all fitted, or all held out."""

    residual: Residual
    samples: slice
    held_out: bool

    @property
    def role(self) -> str:
        """In words."""
        return "held out" if self.held_out else "fitted"

    @property
    def rms(self) -> float:
        """Of measured minus modelled, in the channel's unit."""
        return float(np.sqrt(np.mean(self.residual.difference[self.samples] ** 2)))

    @property
    def over_noise(self) -> float:
        """The same as a multiple of the noise; NaN where that is unknown."""
        noise = self.residual.noise_rms
        return self.rms / noise if noise > 0 else math.nan

    @property
    def share(self) -> float:
        """The same as a share of the measured signal's RMS about its mean; NaN of a signal that stands still."""
        signal = float(np.std(self.residual.measured[self.samples]))
        return self.rms / signal if signal > 0 and np.ptp(self.residual.drive_V) > 0 else math.nan


def parts_of(residual: Residual) -> list[Part]:
    """The fitted and the held-out part of a recording; one where it was treated whole."""
    n, fitted = residual.measured.size, residual.fitted
    pieces = [(slice(0, fitted), False)] * (fitted > 0) + [(slice(fitted, n), True)] * (fitted < n)
    return [Part(residual, samples, held_out) for samples, held_out in pieces]


def write_identification_report(
    path: str | os.PathLike[str], campaign_name: str, identification: Identification
) -> None:
    """Write the page, whole or not at all.

    Parameters
    ----------
    path : path
        Of the HTML file; an existing one is replaced.
    campaign_name : str
        What the head is called on the page; any characters.
    identification : Identification

    Raises
    ------
    OSError
        The folder is missing or not writable.
    """
    write_atomically(path, identification_html(campaign_name, identification))


def identification_html(campaign_name: str, identification: Identification) -> str:
    """The page as text."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(loader=PackageLoader("experiments"), autoescape=True, undefined=StrictUndefined)
    environment.filters |= {"short": short, "unit": unit_text, "channel": CHANNEL_WORDS.__getitem__}
    parts = [part for residual in identification.residuals for part in parts_of(residual)]
    loops = loop_recordings(identification)
    fast = fast_recordings(identification)
    broadest = broadest_recording(fast)
    return environment.get_template("identification.html").render(
        name=campaign_name,
        headline=headline(identification),
        worst=worst_recording(parts),
        identification=identification,
        head=identification.printhead,
        parameters=parameter_rows(identification),
        coefficients=coefficient_rows(identification),
        loops=[(loop, pictures.svg_text(loop_figure(loop))) for loop in loops],
        law=pictures.svg_text(law_figure(identification)),
        degree=pictures.svg_text(degree_figure(identification)),
        ringing=pictures.svg_text(ringing_figure(ringing_views(fast, identification.printhead.frequency_Hz))),
        broadest=broadest,
        spectrum=pictures.svg_text(spectrum_figure(broadest, noise_of(broadest, identification))),
        parts=parts,
        units={r.channel: unit_text(r.unit) for r in identification.residuals},
        residuals=pictures.svg_text(residuals_figure(parts)),
        explained=EXPLAINED,
    )


def headline(identification: Identification) -> str:
    """What was found, and how well the model explains what no fit has seen, in words."""
    head = identification.printhead
    found = f"resonance {hertz(head.frequency_Hz)}, damping ratio {head.damping_ratio:.3g}; "
    held_out = bool(identification.heldout)
    whose = "held-out recordings" if held_out else "fitted recordings (none was held out)"
    pooled = {channel: identification.rms(channel, held_out) for channel in identification.gains}
    ratios = {channel: rms / noise for channel, (rms, noise) in pooled.items() if rms / noise >= 0}
    if not ratios:
        return found + f"how well the model explains the {whose} cannot be told, since their noise is not known"
    worst = max(ratios, key=lambda channel: ratios[channel])
    mine = [r for r in identification.residuals if r.channel == worst and r.held_out == held_out]
    signal = math.sqrt(float(np.mean([np.var(r.measured[parts_of(r)[-1].samples]) for r in mine])))
    share = f"{100 * pooled[worst][0] / signal:.2g}\u00a0% of their signal" if signal > 0 else "all of their signal"
    theirs = whose if len(ratios) == 1 else f"{whose} of {CHANNEL_WORDS[worst]}"
    if any(m.source.startswith(FROM_FIT) for (channel, _), m in identification.noise.items() if channel == worst):
        return found + (
            f"the model leaves {share} in the {theirs}; whether that is noise cannot be told, since nothing but the "
            "fit shows their noise"
        )
    if ratios[worst] > EXPLAINED:
        return found + (
            f"the model does not explain the {theirs}: its residual there is {ratios[worst]:.3g} times their noise, "
            f"{share}"
        )
    loud = max(identification.misfit, key=lambda channel: identification.misfit[channel])
    if identification.misfit[loud] > NOISE_TOLERANCE:
        return found + (
            f"the model leaves {ratios[worst]:.2f} times their noise in the {whose}, yet structure in the fitted ones: "
            f"whitened, the residual of {CHANNEL_WORDS[loud]} is {identification.misfit[loud]:.3g} times the noise"
        )
    return found + f"the model explains the {whose} to {ratios[worst]:.2f} times their noise"


def worst_recording(parts: Sequence[Part]) -> Part | None:
    """The one that exceeds its noise most; None where no noise is known."""
    known = [part for part in parts if math.isfinite(part.over_noise)]
    return max(known, key=lambda part: part.over_noise, default=None)


def parameter_rows(identification: Identification) -> list[tuple[str, str, str, str, str]]:
    """Symbol, value, 90 % interval, unit and meaning of every parameter but the branch law's coefficients."""
    a0, a1 = identification.dynamics["a0"], identification.dynamics["a1"]
    turns = 2 * math.pi
    b1 = "gain of self-sensing" + ("" if "self_sensing" in identification.gains else ": not observed, set to √a0")
    frequency = Estimate(*(math.sqrt(v) / turns for v in (a0.value, a0.low, a0.high)))
    # ln ζ = ln a1 - ln(a0) / 2; a ringing tells its frequency and its decay independently.
    spread = math.hypot(math.log(a1.high / a1.low), math.log(a0.high / a0.low) / 2) / 2
    zeta = identification.printhead.damping_ratio
    damping = Estimate(zeta, zeta * math.exp(-spread), zeta * math.exp(spread))
    rows = [
        ("f0", frequency, "Hz", "resonance, √a0 / 2π"),
        ("ζ", damping, "", "damping ratio, a1 / (2 √a0)"),
        ("a0", a0, "1/s²", "of G(s) = b1 s / (s² + a1 s + a0)"),
        ("a1", a1, "1/s", "of the same"),
        ("b1", identification.dynamics["b1"], "1/s", b1),
    ]
    units = {residual.channel: unit_text(residual.unit) for residual in identification.residuals}
    for channel, gain in identification.gains.items():
        if channel != "self_sensing":  # whose gain is b1
            rows.append(("gain", gain, f"{units[channel]}/V", f"{CHANNEL_WORDS[channel]}: per hysteretic volt"))
    told = [(symbol, *interval_text(estimate), unit, meaning) for symbol, estimate, unit, meaning in rows]
    for channel, offset in identification.offsets.items():
        told.append(("offset", short(offset), "", units[channel], CHANNEL_WORDS[channel]))
    return told


def coefficient_rows(identification: Identification) -> list[tuple[int, str, str]]:
    """Power, coefficient and standard error, highest power first."""
    errors = np.sqrt(np.diag(identification.coefficient_covariance))
    coefficients = identification.printhead.branch_law.ascending[1:]
    rows = [
        (k + 1, *interval_text(Estimate(c, c - e, c + e))[:1], short(e))
        for k, (c, e) in enumerate(zip(coefficients, errors, strict=True))
    ]
    return rows[::-1]


def interval_text(estimate: Estimate) -> tuple[str, str]:
    """The value and its interval, to two digits of the interval's half width.

    Examples
    --------
    >>> interval_text(Estimate(1.05512e11, 1.05489e11, 1.05535e11))
    ('1.05512e11', '1.05489e11 … 1.05535e11')
    >>> interval_text(Estimate(-0.0469, -0.0481, -0.0457))
    ('−0.0469', '−0.0481 … −0.0457')
    """
    half = (estimate.high - estimate.low) / 2
    digits = 6
    if half > 0 and estimate.value != 0:
        digits = min(max(math.floor(math.log10(abs(estimate.value))) - math.floor(math.log10(half)) + 2, 2), 10)
    value, low, high = (short(v, digits) for v in (estimate.value, estimate.low, estimate.high))
    return value, f"{low} … {high}"


def short(value: float, digits: int = 3) -> str:
    """A number for people; a dash where there is none.

    Examples
    --------
    >>> short(-3.14159e-7), short(12345.678), short(12345.678, 5), short(float("nan"))
    ('−3.14e−7', '12300', '12346', '–')
    """
    if not math.isfinite(value):
        return "–"
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
    if -4 < exponent < 6:
        text = f"{float(f'{value:.{digits}g}'):.{max(digits - 1 - exponent, 0)}f}"
    else:
        text = f"{value / 10.0**exponent:.{digits - 1}f}e{exponent}"
    return text.replace("-", "−")


def hertz(frequency_Hz: float) -> str:
    """A frequency in Hz, kHz or MHz.

    Examples
    --------
    >>> hertz(51694.6), hertz(412.3)
    ('51.69 kHz', '412.3 Hz')
    """
    for size, unit in ((1e6, "MHz"), (1e3, "kHz")):
        if frequency_Hz >= size:
            return f"{frequency_Hz / size:.4g} {unit}"
    return f"{frequency_Hz:.4g} Hz"


def unit_text(unit: str) -> str:
    """Micrometres as people write them."""
    return unit.replace("um", "µm")


def loop_recordings(identification: Identification) -> list[Residual]:
    """The widest plain loop, and the richest nested ones, of the channel that chose the degree.

    None of self-sensing, which shows the rate of the deflection, nor of drives that turn too often to be followed.
    """
    if identification.degree_channel == "self_sensing":
        return []
    mine = [r for r in identification.residuals if r.channel == identification.degree_channel]
    turns = {r.name: len(turning_points(r.drive_V)) for r in mine}
    mine = [r for r in mine if np.ptp(r.drive_V) > 0 and turns[r.name] <= MOST_REVERSALS]
    if not mine:
        return []
    widest = max(float(np.ptp(r.drive_V)) for r in mine)
    wide = [r for r in mine if np.ptp(r.drive_V) >= 0.9 * widest]
    first = min(wide, key=lambda r: (turns[r.name] < 2, turns[r.name], not r.held_out))
    nested = [r for r in mine if turns[r.name] > turns[first.name] + 2]
    return [first, *sorted(nested, key=lambda r: -turns[r.name])[:1]]


def fast_recordings(identification: Identification) -> list[Residual]:
    """Recordings of self-sensing, or of displacement where there is none, whose drive moves."""
    channel = "self_sensing" if "self_sensing" in identification.gains else "displacement"
    return [r for r in identification.residuals if r.channel == channel and np.ptp(r.drive_V) > 0]


def turning_points(drive_V: Real) -> list[int]:
    """Samples at which the drive starts on its way back."""
    moving = np.flatnonzero(np.diff(drive_V))
    up = drive_V[moving + 1] > drive_V[moving]
    return [int(k) for k in moving[1:][up[1:] != up[:-1]]]


def branches(drive_V: Real) -> list[tuple[int, int]]:
    """First and last sample of the stretches of drive that follow the branch law ``Q`` whatever came before.

    The outermost turning point wipes out all memory; the branch from there follows ``Q``, and so does the next one,
    until it is back at that level.
    """
    turns = turning_points(drive_V)
    level = np.abs(drive_V).max() * (1 - 1e-3)
    found, after_outermost = [], False
    for start, end in pairwise([*turns, drive_V.size - 1]):
        outermost = abs(drive_V[start]) >= level
        if (outermost or after_outermost) and abs(drive_V[end] - drive_V[start]) >= SHORTEST_BRANCH * np.ptp(drive_V):
            found.append((start, end))
        after_outermost = outermost
    return found


def loop_figure(residual: Residual) -> Figure:
    """One recording against time and against the drive, measured and modelled; differences beneath."""
    figure, axes = pictures.new_figure(10, 5.0, nrows=2, ncols=2, sharex="col", height_ratios=[3, 1.6])
    seconds, time_unit = time_scale(residual.measured.size * residual.step_s)
    unit = unit_text(residual.unit)
    swing = float(np.ptp(residual.modelled))
    for column, x in enumerate((residual.time_s / seconds, residual.drive_V)):
        _line(axes[0, column], x, residual.measured, color=MEASURED, lw=3.0, label="measured")
        _line(axes[0, column], x, residual.modelled, color=MODELLED, lw=0.8, label="modelled")
        axes[0, column].set_ylabel(f"{CHANNEL_WORDS[residual.channel]} ({unit})")
    time_s = residual.time_s / seconds
    _noise_band(axes[1, 0], residual)
    _line(axes[1, 0], time_s, residual.difference, color=LEFT, lw=0.8)
    _line(axes[1, 1], residual.drive_V, 100 * residual.difference / swing, color=LEFT, lw=0.8)
    if 0 < residual.fitted < residual.measured.size:
        for panel in axes[:, 0]:
            panel.axvspan(time_s[residual.fitted], time_s[-1], color=HELD_OUT, alpha=0.12, lw=0, label="held out")
    axes[1, 0].set_ylabel(f"measured −\nmodelled ({unit})")
    axes[1, 1].set_ylabel("measured −\nmodelled (% of swing)")
    axes[1, 0].set_xlabel(f"time ({time_unit})")
    axes[1, 1].set_xlabel("drive (V)")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    figure.align_ylabels()
    return figure


def law_figure(identification: Identification) -> Figure:
    """The branch law with the branches it was measured on, and what these differ by, in % of the swing."""
    law = identification.printhead.branch_law
    figure, axes = pictures.new_figure(10, 5.4, nrows=2, sharex=True, height_ratios=[2, 1.5])
    figure.set_dpi(200)  # of the dots
    x = np.linspace(0, 1, 301)
    percent = 100 / float(law.Q(1.0))
    powers = x[:, None] ** np.arange(1, len(law.coefficients))
    variance = np.einsum("ij,jk,ik->i", powers, identification.coefficient_covariance, powers)
    error = QUANTILE_90 * np.sqrt(np.maximum(variance, 0))  # rounding, where the convention of scale makes it 0
    for heading, colour, label in ((1, RISING, "measured, rising"), (-1, FALLING, "measured, falling")):
        at, off = measured_branches(identification, heading)
        if not at.size:
            continue
        every = -(-at.size // MOST_POINTS)
        axes[0].plot(at[::every], (law.Q(at) + off)[::every], ".", ms=3, color=colour, label=label, rasterized=True)
        axes[1].plot(at[::every], percent * off[::every], ".", ms=2, color=colour, alpha=0.4, rasterized=True)
        cell = np.minimum((at * CELLS).astype(int), CELLS - 1)
        count = np.bincount(cell)
        full = count >= FEWEST_IN_CELL
        means, centres = (np.bincount(cell, v)[full] / count[full] for v in (off, at))
        axes[1].plot(centres, percent * means, "-", color=colour, lw=1.6, label=f"mean, {label.split()[1]}")
    axes[0].plot(x, law.Q(x), color=MODELLED, lw=1.0, label=f"Q(x), degree {len(law.coefficients) - 1}")
    axes[1].fill_between(
        x, -percent * error, percent * error, color=NOISE, alpha=0.7, lw=0, label="90 % interval of Q", zorder=1
    )
    axes[0].legend(frameon=False, markerscale=3)
    axes[1].legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 0.98), borderaxespad=0.1)
    axes[0].set_ylabel("hysteretic drive\n(full scales)")
    axes[1].set_ylabel("difference from Q\n(% of swing)")
    axes[1].set_xlabel(f"x = change of drive since the turning point / {law.full_scale_V:g} V")
    figure.align_ylabels()
    return figure


def measured_branches(identification: Identification, heading: int) -> tuple[Real, Real]:
    """Points measured on rising (1) or falling (-1) `branches`: ``x``, and how far off ``Q(x)`` they lie.

    What the resonator adds has been taken off as modelled: the difference of the recording stands for that of the law.
    None from self-sensing.
    """
    law, channel = identification.printhead.branch_law, identification.degree_channel
    at, off = [np.zeros(0)], [np.zeros(0)]
    for residual in identification.residuals:
        if residual.channel != channel or channel == "self_sensing" or np.ptp(residual.drive_V) == 0:
            continue
        drive, gain = residual.drive_V, identification.gains[channel].value
        for start, end in branches(drive):
            if heading * (drive[end] - drive[start]) > 0:
                moving = start + 1 + np.flatnonzero(np.diff(drive[start : end + 1]))
                at.append(np.abs(drive[moving] - drive[start]) / law.full_scale_V)
                off.append(heading * residual.difference[moving] / (gain * law.full_scale_V))
    return np.concatenate(at), np.concatenate(off)


def degree_figure(identification: Identification) -> Figure:
    """Error of the branch law against its degree; on the right without that of the straight line."""
    choice = identification.degree
    used = len(identification.printhead.coefficients) - 1
    figure, axes = pictures.new_figure(10, 3.4, ncols=2)
    for panel, first in zip(axes, (0, 1), strict=True):
        degrees = choice.degrees[first:]
        panel.plot(degrees, choice.rms_error[first:], "o-", color=FITTED, lw=1.2, ms=5, label="fit")
        if choice.held_out_error is not None:
            left_out = choice.held_out_error[first:]
            panel.plot(degrees, left_out, "D--", color=HELD_OUT, lw=1.2, ms=4, label="drives left out in turn")
        panel.axvline(used, color=MODELLED, lw=1.0, ls=":", label=f"used: {used}")
        if first == 0:
            panel.axhline(1, color=pictures.GREY, lw=1.0, label="the noise")
        else:
            shown = [*choice.rms_error[first:], *(choice.held_out_error or ())[first:]]
            low, high = min(shown), min(max(shown), 1.05 * max(choice.rms_error[first:]))
            panel.set_ylim(low * (low / high) ** 0.08, high * (high / low) ** 0.08)
        panel.set_xticks(degrees)
        _log_ticks(panel)
        panel.set_xlabel("degree of Q")
    axes[0].set_ylabel("RMS error (multiples of the noise)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)
    return figure


def ringing_views(fast: Sequence[Residual], frequency_Hz: float) -> list[Part]:
    """What is drawn of the ringing: held-out pulses first, each drive once, the steepest edge of a long recording."""
    views: list[Part] = []
    drives: set[bytes] = set()
    for residual in sorted(fast, key=lambda r: (not r.held_out, not _pulsed(r), -np.ptp(r.drive_V))):
        if residual.drive_V.tobytes() in drives:
            continue
        drives.add(residual.drive_V.tobytes())
        most = max(round(PERIODS_SHOWN / (frequency_Hz * residual.step_s)), 60)
        for part in parts_of(residual):
            first, last = part.samples.start, part.samples.stop
            steepest = first + int(np.argmax(np.abs(np.diff(residual.drive_V[part.samples]))))
            if last - first > most:
                first = min(max(first, steepest - most // 10), last - most)
            views.append(Part(residual, slice(first, min(first + most, last)), part.held_out))
    return views[:MOST_VIEWS]


def _pulsed(residual: Residual) -> bool:
    return bool(np.mean(np.diff(residual.drive_V) == 0) > 0.5)


def ringing_figure(views: Sequence[Part]) -> Figure:
    """Drive, signal and residual of some stretches of recordings, a column each."""
    figure, axes = pictures.new_figure(
        max(3.6 * len(views), 7.2),
        5.6,
        nrows=3,
        ncols=len(views),
        sharex="col",
        squeeze=False,
        height_ratios=[1, 2, 1.4],
    )
    for column, view in zip(axes.T, views, strict=True):
        residual, where = view.residual, view.samples
        seconds, time_unit = time_scale(float(np.ptp(residual.time_s[where])))
        time = residual.time_s[where] / seconds
        _line(column[0], time, residual.drive_V[where], color=pictures.GREY, lw=1.2)
        _line(column[1], time, residual.measured[where], color=MEASURED, lw=2.6, label="measured")
        _line(column[1], time, residual.modelled[where], color=MODELLED, lw=0.8, label="modelled")
        _noise_band(column[2], residual)
        _line(column[2], time, residual.difference[where], color=LEFT, lw=0.7)
        ratio = f", residual here {view.over_noise:.3g} × noise" if math.isfinite(view.over_noise) else ""
        title = f"{short_name(residual.name)}\n{view.role}{ratio}"
        column[0].set_title(title, fontsize=9, parse_math=False)
        column[2].set_xlabel(f"time ({time_unit})")
    unit = unit_text(views[0].residual.unit)
    axes[0, 0].set_ylabel("drive (V)")
    axes[1, 0].set_ylabel(f"{CHANNEL_WORDS[views[0].residual.channel]} ({unit})")
    axes[2, 0].set_ylabel(f"measured −\nmodelled ({unit})")
    figure.legend(*axes[1, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    figure.align_ylabels()
    return figure


def broadest_recording(fast: Sequence[Residual]) -> Residual:
    """The recording whose drive spreads its power over most hertz; held out and strong where several do."""
    width = {}
    for residual in fast:
        frequency, density = amplitude_densities(residual, residual.drive_V)
        below = np.cumsum(density**2) / np.sum(density**2)
        first, last = np.searchsorted(below, (0.05, 0.95))
        width[residual.name] = frequency[last] - frequency[first]
    broad = [r for r in fast if width[r.name] >= 0.9 * max(width.values())]
    return max(broad, key=lambda r: (r.held_out, np.ptp(r.drive_V)))


def noise_of(residual: Residual, identification: Identification) -> NoiseModel | None:
    """The noise model of a recording's channel at the nearest sampling step; None where there is none.

    Where the residual is louder than the noise, the identification raised the model to it; this one is lowered again.
    """
    known = {step: model for (channel, step), model in identification.noise.items() if channel == residual.channel}
    if not known:
        return None
    model = known[min(known, key=lambda step: abs(math.log(step / residual.step_s)))]
    misfit = identification.misfit.get(residual.channel, 1.0)
    return replace(model, innovation=model.innovation / misfit) if misfit > NOISE_TOLERANCE else model


def spectrum_figure(residual: Residual, noise: NoiseModel | None) -> Figure:
    """Amplitude densities of a recording, measured and modelled, of what is left, and of the noise."""
    figure, axes = pictures.new_figure(10, 4.2)
    signals = (residual.drive_V, residual.measured, residual.modelled, residual.difference)
    frequency, drive, measured, modelled, left = amplitude_densities(residual, *signals)
    scale, unit = (1e3, "kHz") if frequency[-1] > 1e4 else (1.0, "Hz")
    excited = drive > POWER_SHOWN * drive[1:].max()
    excited[0] = False
    at = frequency[excited] / scale
    _line(axes, at, measured[excited], ls="none", marker="o", ms=4.5, color=MEASURED, label="measured")
    _line(axes, at, modelled[excited], ls="none", marker=".", ms=2.5, color=MODELLED, label="modelled")
    edges = np.unique(np.round(np.geomspace(1, frequency.size, 200)).astype(int))
    mean = np.sqrt(np.add.reduceat(left**2, edges[:-1]) / np.diff(edges))
    axes.plot(frequency[edges[:-1]] / scale, mean, color=LEFT, lw=1.0, label="measured − modelled")
    if noise is not None:
        density = np.sqrt(noise.spectrum(frequency[1:], residual.step_s))
        axes.plot(frequency[1:] / scale, density, "--", color=NOISE, lw=1.6, label="noise model")
    axes.set(xscale="log", yscale="log")
    axes.set_xlabel(f"frequency ({unit})")
    axes.set_ylabel(f"amplitude density ({unit_text(residual.unit)}/√Hz)")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)
    return figure


def amplitude_densities(residual: Residual, *signals: Real) -> tuple[Real, ...]:
    """Frequencies in Hz, and the root of each signal's one-sided power density in its unit / √Hz.

    Of the recording as one period where its end leads on to its start, else through a Hann window.
    """
    n = residual.measured.size
    closed = all(
        abs(2 * x[-1] - x[-2] - x[0]) <= LARGEST_GAP * np.ptp(x) for x in (residual.drive_V, residual.modelled)
    )
    window = np.ones(n) if closed else np.hanning(n + 1)[:n]
    scale = math.sqrt(2 * residual.step_s / float(window @ window))
    frequency = np.asarray(np.fft.rfftfreq(n, residual.step_s), dtype=np.float64)
    return frequency, *(scale * np.abs(np.fft.rfft((x - x.mean()) * window)) for x in signals)


def residuals_figure(parts: Sequence[Part]) -> Figure:
    """Residual over noise, a dot a recording."""
    known = [part for part in parts if math.isfinite(part.over_noise)]
    figure, axes = pictures.new_figure(10, 3.6)
    kinds = [(channel, held_out) for channel in CHANNEL_WORDS for held_out in (False, True)]
    for channel, held_out in kinds:
        at = [i for i, p in enumerate(known) if (p.residual.channel, p.held_out) == (channel, held_out)]
        if at:
            colour, label = (HELD_OUT, "held out") if held_out else (FITTED, "fitted")
            ratios = [known[i].over_noise for i in at]
            face = colour if held_out else "none"
            style: Any = {"color": colour, "mfc": face, "ms": 6, "label": f"{CHANNEL_WORDS[channel]}, {label}"}
            axes.plot(at, ratios, MARKERS[channel], **style)
    axes.axhline(1, color=MODELLED, lw=1.0, label="the noise")
    ratios = [part.over_noise for part in known] or [1.0]
    axes.set(xlim=(-1, max(len(known), 12)), ylim=(min(*ratios, 0.85) / 1.1, max(*ratios, 1.2) * 1.1))
    _log_ticks(axes)
    every = -(-len(known) // MOST_LABELS) or 1
    names = [short_name(part.residual.name) for part in known[::every]]
    axes.set_xticks(range(0, len(known), every), names, rotation=90, fontsize=7, parse_math=False)
    axes.set_xlabel("recording")
    axes.set_ylabel("RMS residual / RMS noise")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=5, frameon=False)
    return figure


def short_name(name: str) -> str:
    """A recording's name as far as a picture has room."""
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…"


def time_scale(span_s: float) -> tuple[float, str]:
    """Seconds in the unit that suits a span of time, and its name."""
    for seconds, unit in ((1.0, "s"), (1e-3, "ms")):
        if span_s >= 2 * seconds:
            return seconds, unit
    return 1e-6, "µs"


def _noise_band(axes: Axes, residual: Residual) -> None:
    if math.isfinite(residual.noise_rms):
        axes.axhspan(-2 * residual.noise_rms, 2 * residual.noise_rms, color=BAND, lw=0, label="± 2 × noise")


def _line(axes: Axes, x: Real, y: Real, **style: Any) -> None:
    """A line of many points, drawn through the least and the largest of each run of neighbours."""
    run = -(-2 * x.size // MOST_POINTS)
    if run > 2:
        rows = y[: y.size // run * run].reshape(-1, run)
        first = np.arange(len(rows)) * run
        kept = np.unique(np.concatenate([first + rows.argmin(axis=1), first + rows.argmax(axis=1), [y.size - 1]]))
        x, y = x[kept], y[kept]
    axes.plot(x, y, **style)


def _log_ticks(axes: Axes) -> None:
    """A logarithmic ordinate with plain numbers, enough of them on a short range too."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    subs = (1, 2, 5) if high / low < 300 else (1,)
    axes.yaxis.set_major_locator(LogLocator(subs=subs) if high / low > 5 else MaxNLocator(8, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
