"""Figures of an identification: loops, branch law, degree, ringing, spectrum and residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.extras import extra
from inkjet_env.identification import Identification, ModelledRecording, NoiseModel
from inkjet_env.identification.outcome import QUANTILE_90
from inkjet_env.plant.wording import CHANNEL_WORDS
from inkjet_env.reporting import plotting
from inkjet_env.reporting.formatting import short_name, unit_text
from inkjet_env.reporting.plotting import MOST_POINTS, draw_line, time_scale
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MOST_LABELS = 90
"""Largest number of recording names that fit on an axis."""
LARGEST_GAP = 0.05
"""Largest gap between a signal's end and its start, as a fraction of its swing, at which it counts as one period."""
POWER_SHOWN = 0.01
"""Smallest amplitude of the drive, as a fraction of its largest, at which a spectrum is shown."""
CELLS = 40
"""Number of cells of x over which the measured branches are averaged, if a cell holds `FEWEST_IN_CELL` points."""
FEWEST_IN_CELL = 4
BLUE, VERMILION, _, _, NOISE, MEASURED, MODELLED = plotting.COLOURS
LEFT = RISING = FITTED = BLUE
FALLING = HELD_OUT = VERMILION
BAND = "#d9d9d9"
MARKERS = {"self_sensing": "o", "strain_gauge": "s", "displacement": "^"}


@dataclass(frozen=True, eq=False)
class Part:
    """Samples of a recording that were all fitted, or all held out."""

    recording: ModelledRecording
    samples: slice
    held_out: bool

    @property
    def role(self) -> str:
        """``held out`` or ``fitted``."""
        return "held out" if self.held_out else "fitted"

    @property
    def rms(self) -> float:
        """RMS of measured minus modelled, in the channel's unit."""
        return float(np.sqrt(np.mean(self.recording.residual()[self.samples] ** 2)))

    @property
    def over_noise(self) -> float:
        """RMS residual as a multiple of the RMS noise; NaN if the noise is unknown."""
        noise = self.recording.noise_rms
        return self.rms / noise if noise > 0 else math.nan

    @property
    def share(self) -> float:
        """RMS residual as a fraction of the signal's RMS about its mean; NaN if signal or drive is constant."""
        signal = float(np.std(self.recording.measured[self.samples]))
        return self.rms / signal if signal > 0 and np.ptp(self.recording.drive_V) > 0 else math.nan


def terms_of(recording: ModelledRecording) -> list[Part]:
    """The fitted and the held-out part of a recording; a single part if it was fitted or held out as a whole."""
    n, fitted = recording.measured.size, recording.fitted
    pieces = [(slice(0, fitted), False)] * (fitted > 0) + [(slice(fitted, n), True)] * (fitted < n)
    return [Part(recording, samples, held_out) for samples, held_out in pieces]


def loop_figure(recording: ModelledRecording) -> Figure:
    """One recording, measured and modelled, against time and against the drive, with the residuals below."""
    figure, axes = plotting.new_figure(10, 5.0, nrows=2, ncols=2, sharex="col", height_ratios=[3, 1.6])
    seconds, time_unit = time_scale(recording.measured.size * recording.step_s)
    unit = unit_text(recording.unit)
    swing = float(np.ptp(recording.modelled["base"]))
    for column, x in enumerate((recording.time_s / seconds, recording.drive_V)):
        draw_line(axes[0, column], x, recording.measured, color=MEASURED, lw=3.0, label="measured")
        draw_line(axes[0, column], x, recording.modelled["base"], color=MODELLED, lw=0.8, label="modelled")
        axes[0, column].set_ylabel(f"{CHANNEL_WORDS[recording.channel]} ({unit})")
    time_s = recording.time_s / seconds
    _noise_band(axes[1, 0], recording)
    draw_line(axes[1, 0], time_s, recording.residual(), color=LEFT, lw=0.8)
    draw_line(axes[1, 1], recording.drive_V, 100 * recording.residual() / swing, color=LEFT, lw=0.8)
    if 0 < recording.fitted < recording.measured.size:
        for panel in axes[:, 0]:
            panel.axvspan(time_s[recording.fitted], time_s[-1], color=HELD_OUT, alpha=0.12, lw=0, label="held out")
    axes[1, 0].set_ylabel(f"measured −\nmodelled ({unit})")
    axes[1, 1].set_ylabel("measured −\nmodelled (% of swing)")
    axes[1, 0].set_xlabel(f"time ({time_unit})")
    axes[1, 1].set_xlabel("drive (V)")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    figure.align_ylabels()
    return figure


def law_figure(identification: Identification, rising: tuple[Real, Real], falling: tuple[Real, Real]) -> Figure:
    """The branch law with points measured on branches, and their deviations from it in % of the swing.

    Parameters
    ----------
    identification : Identification
        Supplies the branch law and the covariance of its coefficients.
    rising, falling : (ndarray, ndarray), shape (n,) each
        ``x``, the change of drive in full scales, and the measured deviation from ``Q(x)``, as from
        `identification_report.measured_branches`.
    """
    law = identification.printhead.branch_law
    figure, axes = plotting.new_figure(10, 5.4, nrows=2, sharex=True, height_ratios=[2, 1.5])
    figure.set_dpi(200)  # resolution of the rasterised dots
    x = np.linspace(0, 1, 301)
    percent = 100 / float(law.Q(1.0))
    powers = x[:, None] ** np.arange(1, len(law.coefficients))
    variance = np.einsum("ij,jk,ik->i", powers, identification.coefficient_covariance, powers)
    error = QUANTILE_90 * np.sqrt(np.maximum(variance, 0))  # rounding may make it negative where the scale fixes Q
    for (at, off), colour, heading in ((rising, RISING, "rising"), (falling, FALLING, "falling")):
        if not at.size:
            continue
        every = -(-at.size // MOST_POINTS)
        style: Any = {"ls": "none", "marker": ".", "color": colour, "rasterized": True}
        axes[0].plot(at[::every], (law.Q(at) + off)[::every], ms=3, label=f"measured, {heading}", **style)
        axes[1].plot(at[::every], percent * off[::every], ms=2, alpha=0.4, **style)
        cell = np.minimum((at * CELLS).astype(int), CELLS - 1)
        count = np.bincount(cell)
        full = count >= FEWEST_IN_CELL
        means, centres = (np.bincount(cell, v)[full] / count[full] for v in (off, at))
        axes[1].plot(centres, percent * means, "-", color=colour, lw=1.6, label=f"mean, {heading}")
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


def degree_figure(identification: Identification) -> Figure:
    """Error of the branch law against its degree: on the strain gauge alone, if there is one, and on all recordings.

    The right column leaves out degree 1, the straight line.
    """
    choices = {"all recordings": identification.joint_degree}
    if "strain_gauge" in identification.gains:
        choices = {"strain gauge alone": identification.degree, **choices}
    used = len(identification.printhead.coefficients) - 1
    figure, axes = plotting.new_figure(10, 1.2 + 2.4 * len(choices), nrows=len(choices), ncols=2, squeeze=False)
    for row, (source, choice) in zip(axes, choices.items(), strict=True):
        left_out = choice.held_out_error or (math.nan,) * len(choice.degrees)
        for panel, first in zip(row, (0, 1), strict=True):
            degrees, error = choice.degrees[first:], choice.rms_error[first:]
            panel.plot(degrees, error, "o-", color=FITTED, lw=1.2, ms=5, label="fit")
            if choice.held_out_error is not None:
                style: Any = {"color": HELD_OUT, "lw": 1.2, "ms": 4, "label": "drives left out in turn"}
                panel.plot(degrees, left_out[first:], "D--", **style)
            if choice.by_flattening > first:
                flat = choice.rms_error[choice.by_flattening - 1]
                panel.plot(choice.by_flattening, flat, "o", color=FITTED, mfc="none", ms=11, label="flattened")
            panel.axvline(used, color=MODELLED, lw=1.0, ls=":", label=f"used: {used}")
            panel.set_xticks(degrees)
            panel.set_title(source + (", from degree 2 on" if first else ""), fontsize=9)
        row[0].axhline(1, color=plotting.GREY, lw=1.0, label="the noise")
        shown = [*choice.rms_error[1:], *left_out[1:]]
        low, high = np.nanmin(shown), min(np.nanmax(shown), 1.05 * max(choice.rms_error[1:]))
        row[1].set_ylim(low * (low / high) ** 0.08, high * (high / low) ** 0.08)
        row[0].set_ylabel("RMS error (× noise)")
        for panel in row:
            _log_ticks(panel)
    for panel in axes[-1]:
        panel.set_xlabel("degree of Q")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=5, frameon=False)
    return figure


def ringing_figure(views: Sequence[Part]) -> Figure:
    """Drive, signal and residual of some segments of recordings, one column per segment."""
    figure, axes = plotting.new_figure(
        max(3.6 * len(views), 7.2),
        5.6,
        nrows=3,
        ncols=len(views),
        sharex="col",
        squeeze=False,
        height_ratios=[1, 2, 1.4],
    )
    for column, view in zip(axes.T, views, strict=True):
        recording, where = view.recording, view.samples
        seconds, time_unit = time_scale(float(np.ptp(recording.time_s[where])))
        time = recording.time_s[where] / seconds
        draw_line(column[0], time, recording.drive_V[where], color=plotting.GREY, lw=1.2)
        draw_line(column[1], time, recording.measured[where], color=MEASURED, lw=2.6, label="measured")
        draw_line(column[1], time, recording.modelled["base"][where], color=MODELLED, lw=0.8, label="modelled")
        _noise_band(column[2], recording)
        draw_line(column[2], time, recording.residual()[where], color=LEFT, lw=0.7)
        ratio = f", residual here {view.over_noise:.3g} × noise" if math.isfinite(view.over_noise) else ""
        title = f"{short_name(recording.name)}\n{view.role}{ratio}"
        column[0].set_title(title, fontsize=9, parse_math=False)
        column[2].set_xlabel(f"time ({time_unit})")
    unit = unit_text(views[0].recording.unit)
    axes[0, 0].set_ylabel("drive (V)")
    axes[1, 0].set_ylabel(f"{CHANNEL_WORDS[views[0].recording.channel]} ({unit})")
    axes[2, 0].set_ylabel(f"measured −\nmodelled ({unit})")
    figure.legend(*axes[1, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    figure.align_ylabels()
    return figure


def spectrum_figure(recording: ModelledRecording, noise: NoiseModel | None) -> Figure:
    """Amplitude spectral densities of a recording: measured, modelled, residual and noise model."""
    figure, axes = plotting.new_figure(10, 4.2)
    signals = (recording.drive_V, recording.measured, recording.modelled["base"], recording.residual())
    frequency, drive, measured, modelled, residuals = amplitude_densities(recording, *signals)
    scale, unit = (1e3, "kHz") if frequency[-1] > 1e4 else (1.0, "Hz")
    excited = drive > POWER_SHOWN * drive[1:].max()
    excited[0] = False
    at = frequency[excited] / scale
    draw_line(axes, at, measured[excited], ls="none", marker="o", ms=4.5, color=MEASURED, label="measured")
    draw_line(axes, at, modelled[excited], ls="none", marker=".", ms=2.5, color=MODELLED, label="modelled")
    edges = np.unique(np.round(np.geomspace(1, frequency.size, 200)).astype(int))
    mean = np.sqrt(np.add.reduceat(residuals**2, edges[:-1]) / np.diff(edges))
    axes.plot(frequency[edges[:-1]] / scale, mean, color=LEFT, lw=1.0, label="measured − modelled")
    if noise is not None:
        density = np.sqrt(noise.spectrum(frequency[1:], recording.step_s))
        axes.plot(frequency[1:] / scale, density, "--", color=NOISE, lw=1.6, label="noise model")
    axes.set(xscale="log", yscale="log")
    axes.set_xlabel(f"frequency ({unit})")
    axes.set_ylabel(f"amplitude density ({unit_text(recording.unit)}/√Hz)")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)
    return figure


def amplitude_densities(recording: ModelledRecording, *signals: Real) -> tuple[Real, ...]:
    """Frequencies in Hz, and the amplitude spectral density of each signal in its unit / √Hz.

    That is the square root of the one-sided power spectral density. The recording is taken as one period if its end
    continues into its start; otherwise it is multiplied by a Hann window.
    """
    n = recording.measured.size
    closed = all(
        abs(2 * x[-1] - x[-2] - x[0]) <= LARGEST_GAP * np.ptp(x)
        for x in (recording.drive_V, recording.modelled["base"])
    )
    window = np.ones(n) if closed else np.hanning(n + 1)[:n]
    scale = math.sqrt(2 * recording.step_s / float(window @ window))
    frequency = np.asarray(np.fft.rfftfreq(n, recording.step_s), dtype=np.float64)
    return frequency, *(scale * np.abs(np.fft.rfft((x - x.mean()) * window)) for x in signals)


def residuals_figure(parts: Sequence[Part]) -> Figure:
    """RMS residual over RMS noise, one dot per recording."""
    known = [part for part in parts if math.isfinite(part.over_noise)]
    figure, axes = plotting.new_figure(10, 3.6)
    kinds = [(channel, held_out) for channel in CHANNEL_WORDS for held_out in (False, True)]
    for channel, held_out in kinds:
        at = [i for i, p in enumerate(known) if (p.recording.channel, p.held_out) == (channel, held_out)]
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
    names = [short_name(part.recording.name) for part in known[::every]]
    axes.set_xticks(range(0, len(known), every), names, rotation=90, fontsize=7, parse_math=False)
    axes.set_xlabel("recording")
    axes.set_ylabel("RMS residual / RMS noise")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=5, frameon=False)
    return figure


def _noise_band(axes: Axes, recording: ModelledRecording) -> None:
    if math.isfinite(recording.noise_rms):
        axes.axhspan(-2 * recording.noise_rms, 2 * recording.noise_rms, color=BAND, lw=0, label="± 2 × noise")


def _log_ticks(axes: Axes) -> None:
    """Make the ordinate logarithmic, with plain numbers and enough ticks on a short range too."""
    with extra("a figure"):
        from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    subs = (1, 2, 5) if high / low < 300 else (1,)
    axes.yaxis.set_major_locator(LogLocator(subs=subs) if high / low > 5 else MaxNLocator(8, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
