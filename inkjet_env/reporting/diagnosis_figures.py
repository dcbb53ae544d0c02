"""Figures of a diagnosis: recordings with both models, fits side by side, residual spectra, the next drive."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.extras import extra
from inkjet_env.plant.wording import CHANNEL_WORDS
from inkjet_env.reporting import plotting
from inkjet_env.reporting.diagnosis_tables import Row
from inkjet_env.reporting.formatting import short_name, unit_text
from inkjet_env.reporting.identification_figures import BAND, amplitude_densities
from inkjet_env.reporting.plotting import draw_line, time_scale
from inkjet_env.reporting.zoomable import Line, Panel, Picture, stacked_picture
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from inkjet_env.identification import ModelledRecording
    from inkjet_env.mismatch.design.next_experiment import NextExperiment
    from inkjet_env.mismatch.diagnosis import Diagnosis


WIDTH = 5.4
"""Width of a figure in inches: two fit side by side on a desktop, one fills a phone."""
AUGMENTED, BASE, CORRECTED = plotting.COLOURS[0], plotting.COLOURS[1], plotting.COLOURS[2]
MEASURED, NOISE = "#9a9a9a", "#444444"
SHADE = "#f3e6bf"
PERIODS_SHOWN = 6
"""Periods of the resonance shown in the enlarged view of the difference."""
FEWEST_SHOWN = 60
"""Smallest number of samples in the enlarged view."""
MOST_CONDITIONS = 60
"""Largest number of conditions in a figure; the table has all."""
BINS = 160
"""Number of frequency bins of a spectrum, equally wide on a logarithmic axis."""
LABELS = {"base": "base model", "augmented": "corrected model", "with remainder": "with the unexplained remainder"}
REJECTED = LABELS | {"augmented": "closest hypothesis"}
"""Names of the models where the verdict is unknown: what came closest was not accepted, so it corrects nothing."""
COLOURS = {"base": BASE, "augmented": AUGMENTED, "with remainder": CORRECTED}


def figures_of(diagnosis: Diagnosis, conditions: Sequence[tuple[Row, list[Row]]]) -> dict[str, Any]:
    """Every figure of the report, and what its captions name, by the template's names.

    Parameters
    ----------
    diagnosis : Diagnosis
        The diagnosis to report.
    conditions : sequence of (Row, list of Row)
        The fit of each condition, as `condition_rows` has it.
    """
    proof = proof_recording(diagnosis)
    labels = REJECTED if diagnosis.verdict == "unknown" else LABELS
    models = models_of(proof, diagnosis)
    head = diagnosis.printhead
    zoom = slice(0, proof.measured.size)
    if diagnosis.verdict != "none":  # where there is nothing to see, the whole is seen
        zoom = zoom_of(proof, models, head.frequency_Hz if head.has_dynamics else None)
    return {
        "proof": proof,
        "models": models,
        "most_conditions": MOST_CONDITIONS,
        "labels": labels,
        "pictures": [view_picture("shows", proof, models, zoom, labels)],
        "whole": view_figure(proof, models, slice(0, proof.measured.size), zoom, labels),
        "fits": [fits_figure(rows, labels) for rows in shown_conditions(conditions)],
        "spectra": [spectrum_figure(recordings, labels) for recordings in spectrum_recordings(diagnosis)],
        "next_pictures": [
            (experiment, next_figure(experiment) if len(experiment.drive_V) > 1 else None)
            for experiment in diagnosis.next_experiments
        ],
    }


def augmented(recordings: Sequence[ModelledRecording]) -> bool:
    """Whether the augmented model differs from the base model on any of these recordings."""
    return any(not np.array_equal(r.modelled["base"], r.modelled["augmented"]) for r in recordings)


def proof_recording(diagnosis: Diagnosis) -> ModelledRecording:
    """The recording that best shows the evidence for the verdict: one with a varying drive, held out if there is one.

    If the augmented model differs from the base model, it is the recording whose likelihood increases most; otherwise
    the one with the largest ratio of residual to noise.
    """
    changed = augmented(diagnosis.recordings)

    def evidence(recording: ModelledRecording) -> float:
        rows = slice(recording.fitted, None) if recording.held_out else slice(None)
        noise = recording.noise_rms if recording.noise_rms > 0 else 1.0
        squares = (recording.residual("base")[rows] / noise) ** 2
        if changed:
            squares = squares - (recording.residual("augmented")[rows] / noise) ** 2
        return float(np.sum(squares))

    moving = [r for r in diagnosis.recordings if np.ptp(r.drive_V) > 0] or list(diagnosis.recordings)
    return max(moving, key=lambda r: (r.held_out, evidence(r)))


def models_of(recording: ModelledRecording, diagnosis: Diagnosis) -> dict[str, Real]:
    """The signals to draw: the base model's, and those of the models that differ from it."""
    models = {"base": recording.modelled["base"]}
    if augmented([recording]):
        models["augmented"] = recording.modelled["augmented"]
    if diagnosis.remainder is not None and recording.channel in diagnosis.remainder.remainder.channels:
        models["with remainder"] = recording.modelled["with_remainder"]
    return models


def zoom_of(recording: ModelledRecording, models: Mapping[str, Real], frequency_Hz: float | None) -> slice:
    """The segment where the best model differs most from the base model, or the base model from the measurement.

    ``frequency_Hz`` is that of the resonance; None if it is unknown.
    """
    n = recording.measured.size
    periods = n // 6
    if frequency_Hz is not None and recording.channel != "strain_gauge":
        periods = round(PERIODS_SHOWN / (frequency_Hz * recording.step_s))
    width = min(max(periods, FEWEST_SHOWN), n)
    other = recording.measured if len(models) == 1 else list(models.values())[-1]
    power = np.concatenate([[0.0], np.cumsum((other - recording.modelled["base"]) ** 2)])
    first = recording.fitted if recording.held_out and n - recording.fitted >= width else 0
    start = first + int(np.argmax(power[first + width :] - power[first : n - width + 1]))
    half = (power[start] + power[start + width]) / 2
    start = min(max(int(np.searchsorted(power, half)) - 1 - width // 4, 0), n - width)  # shows what precedes it too
    return slice(start, start + width)


def spectrum_recordings(diagnosis: Diagnosis) -> list[list[ModelledRecording]]:
    """Recordings whose spectra are pooled: each channel's driven held-out recordings, or all driven ones if none is."""
    chosen = []
    for channel in CHANNEL_WORDS:
        mine = [r for r in diagnosis.recordings if r.channel == channel and np.ptp(r.drive_V) > 0]
        if mine:
            chosen.append([r for r in mine if r.held_out] or mine)
    return chosen


def shown_conditions(conditions: Sequence[tuple[Row, list[Row]]]) -> list[list[Row]]:
    """Rows of each figure: a channel's conditions, at most `MOST_CONDITIONS` with the largest residual over noise."""
    pictures = []
    for channel in CHANNEL_WORDS:
        mine = [row for row, _ in conditions if row.channel == channel]
        kept = sorted(range(len(mine)), key=lambda k: -mine[k].base / max(mine[k].noise, 1e-300))[:MOST_CONDITIONS]
        if kept:
            pictures.append([mine[k] for k in sorted(kept)])
    return pictures


def view_figure(
    recording: ModelledRecording,
    models: Mapping[str, Real],
    samples: slice,
    zoom: slice | None = None,
    labels: Mapping[str, str] = LABELS,
) -> Figure:
    """Drive, signal and residuals over some samples of a recording; the segment ``zoom`` is shaded.

    Parameters
    ----------
    recording : ModelledRecording
        The recording, of n samples.
    models : mapping of str to ndarray, shape (n,)
        Modelled signals in the recording's unit by "base", "augmented", "with remainder"; drawn in that order.
    samples : slice
        Samples to draw.
    zoom : slice, optional
        Samples to shade; none unless given.
    labels : mapping of str to str
        Name of each model; `LABELS` unless given.
    """
    figure, axes = plotting.new_figure(WIDTH, 5.4, nrows=3, sharex=True, height_ratios=[1, 2, 2])
    time_s = sample_times_s(recording.measured.size, recording.step_s)
    seconds, time_unit = time_scale(float(np.ptp(time_s[samples])))
    time, unit = time_s / seconds, unit_text(recording.unit)
    draw_line(axes[0], time[samples], recording.drive_V[samples], color=plotting.GREY, lw=1.2)
    draw_line(axes[1], time[samples], recording.measured[samples], color=MEASURED, lw=3.4, label="measured")
    if math.isfinite(recording.noise_rms):
        band = 2 * recording.noise_rms
        axes[2].axhspan(-band, band, color=BAND, lw=0, zorder=0.5, label="± 2 × noise")
    for which, modelled in models.items():
        style: Any = {"color": COLOURS[which], "label": labels[which] if len(models) > 1 else "model"}
        draw_line(axes[1], time[samples], modelled[samples], lw=0.9, **style)
        draw_line(axes[2], time[samples], (recording.measured - modelled)[samples], lw=0.8, **style)
    if zoom is not None:
        for panel in axes:
            panel.axvspan(time[zoom.start], time[zoom.stop - 1], color=SHADE, lw=0, zorder=0)
    axes[0].set_ylabel("drive (V)")
    axes[1].set_ylabel(f"{CHANNEL_WORDS[recording.channel]} ({unit})")
    axes[2].set_ylabel(f"measured −\nmodelled ({unit})")
    axes[2].set_xlabel(f"time ({time_unit})")
    legend = {label: line for panel in axes[1:] for line, label in zip(*panel.get_legend_handles_labels(), strict=True)}
    _above(figure, list(legend.values()), list(legend))
    figure.align_ylabels()
    return figure


def view_picture(
    name: str,
    recording: ModelledRecording,
    models: Mapping[str, Real],
    samples: slice,
    labels: Mapping[str, str] = LABELS,
) -> Picture:
    """The same as `view_figure`, to zoom: some samples are seen first, the whole recording after a reset.

    Parameters
    ----------
    name : str
        Id of the picture on its page.
    recording : ModelledRecording
        The recording, of n samples.
    models : mapping of str to ndarray, shape (n,)
        Modelled signals in the recording's unit by "base", "augmented", "with remainder"; drawn in that order.
    samples : slice
        Samples that are seen first.
    labels : mapping of str to str
        Name of each model; `LABELS` unless given.
    """
    time_s = sample_times_s(recording.measured.size, recording.step_s)
    seconds, time_unit = time_scale(float(np.ptp(time_s[samples])))
    unit = unit_text(recording.unit)
    signals = [Line("measured", recording.measured, MEASURED, 4.0)]
    residuals = []
    for which, modelled in models.items():
        label = labels[which] if len(models) > 1 else "model"
        signals.append(Line(label, modelled, COLOURS[which]))
        residuals.append(Line(label, recording.measured - modelled, COLOURS[which]))
    band = 2 * recording.noise_rms if math.isfinite(recording.noise_rms) else 0.0
    panels = (
        Panel("drive (V)", "V", [Line("drive", recording.drive_V, plotting.GREY)], 110),
        Panel(f"{CHANNEL_WORDS[recording.channel]} ({unit})", unit, signals, 220),
        Panel(f"measured − modelled ({unit})", unit, residuals, 190, band),
    )
    return stacked_picture(
        name,
        time_s / seconds,
        "time",
        time_unit,
        panels,
        view_figure(recording, models, samples, labels=labels),
        view=samples,
    )


def fits_figure(rows: Sequence[Row], labels: Mapping[str, str] = LABELS) -> Figure:
    """RMS residuals of both models in each condition of a channel, with its noise; held-out conditions are shaded."""
    figure, axes = plotting.new_figure(WIDTH, 1.2 + 0.17 * max(len(rows), 4))
    at = np.arange(len(rows))
    noise, base, after = (np.array([getattr(r, name) for r in rows]) for name in ("noise", "base", "augmented"))
    for k, row in enumerate(rows):
        if row.held_out:
            axes.axhspan(k - 0.5, k + 0.5, color=SHADE, lw=0, zorder=0)
    axes.hlines(at, np.minimum(base, after), np.maximum(base, after), color=plotting.GREY, lw=0.8)
    axes.plot(noise, at, "|", color=NOISE, ms=8, mew=1.6, label="noise")
    axes.plot(base, at, "o", color=BASE, mfc="white", ms=5, label=labels["base"])
    if not np.array_equal(base, after):
        axes.plot(after, at, "o", color=AUGMENTED, ms=4, label=labels["augmented"])
    axes.set_yticks(at, [short_name(row.label) for row in rows], fontsize=7, parse_math=False)
    shown = np.concatenate([noise, base, after])
    shown = shown[np.isfinite(shown) & (shown > 0)]
    low, high = (float(shown.min()), float(shown.max())) if shown.size else (1.0, 1.0)
    axes.set(ylim=(len(rows) - 0.4, -0.6), xscale="log", xlim=(low / 1.3, high * 1.3))
    _plain_log_ticks(axes.xaxis, low / 1.3, high * 1.3)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel(f"RMS residual, {CHANNEL_WORDS[rows[0].channel]} ({unit_text(rows[0].unit)})")
    _above(figure, *axes.get_legend_handles_labels())
    return figure


def spectrum_figure(recordings: Sequence[ModelledRecording], labels: Mapping[str, str] = LABELS) -> Figure:
    """Amplitude spectral densities of both models' residuals, pooled over a channel's recordings, and of the noise."""
    figure, axes = plotting.new_figure(WIDTH, 3.4)
    frequency, base, after, noise = residual_densities(recordings)
    scale, unit = next(((s, u) for s, u in ((1e6, "MHz"), (1e3, "kHz")) if frequency[-1] > 10 * s), (1.0, "Hz"))
    axes.plot(frequency / scale, noise, "--", color=NOISE, lw=1.2, label="noise, if white")
    axes.plot(frequency / scale, base, color=BASE, lw=1.3, label=labels["base"])
    if augmented(recordings):
        axes.plot(frequency / scale, after, color=AUGMENTED, lw=1.1, label=labels["augmented"])
    axes.set(xscale="log", yscale="log")
    _plain_log_ticks(axes.xaxis, *(frequency[[0, -1]] / scale))
    _log_ticks_in_powers(axes.yaxis, *axes.get_ylim())
    axes.set_xlabel(f"frequency ({unit})")
    axes.set_ylabel(f"residual, {CHANNEL_WORDS[recordings[0].channel]}\n({unit_text(recordings[0].unit)}/√Hz)")
    _above(figure, *axes.get_legend_handles_labels())
    return figure


def residual_densities(recordings: Sequence[ModelledRecording]) -> tuple[Real, Real, Real, Real]:
    """Frequencies in Hz, and amplitude spectral densities of both models' residuals and of white noise.

    Each is the square root of the mean power over all lines of all recordings in each of `BINS` frequency bins; empty
    bins are left out.
    """
    lines = []
    for r in recordings:
        frequency, base, after = amplitude_densities(r, r.residual("base"), r.residual("augmented"))
        noise = np.full(frequency.size, math.sqrt(2 * r.step_s) * r.noise_rms)
        lines.append(np.stack([frequency, base, after, noise])[:, 1:])
    frequency, *densities = np.concatenate(lines, axis=1)
    edges = np.geomspace(frequency.min(), frequency.max() * (1 + 1e-9), BINS + 1)
    place = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, BINS - 1)
    count = np.bincount(place, minlength=BINS)
    full = count > 0
    means = [np.sqrt(np.bincount(place, d**2, BINS)[full] / count[full]) for d in densities]
    return np.sqrt(edges[:-1] * edges[1:])[full], means[0], means[1], means[2]


def next_figure(experiment: NextExperiment) -> Figure:
    """The drive of the next experiment against time."""
    figure, axes = plotting.new_figure(WIDTH, 2.2)
    time_s = sample_times_s(len(experiment.drive_V), experiment.step_s)
    seconds, unit = time_scale(float(time_s[-1]))
    draw_line(axes, time_s / seconds, np.array(experiment.drive_V), color=AUGMENTED, lw=1.2)
    axes.set_xlabel(f"time ({unit})")
    axes.set_ylabel("drive (V)")
    return figure


def sample_times_s(samples: int, step_s: float) -> Real:
    """Sample times in seconds, from 0 s, shape (samples,)."""
    return np.arange(samples, dtype=np.float64) * np.float64(step_s)


def _above(figure: Figure, handles: Sequence[Any], labels: Sequence[str]) -> None:
    """Draw the legend above the axes, in one line if it fits."""
    style: Any = {"frameon": False, "fontsize": 8, "handlelength": 1.4, "columnspacing": 1.2}
    figure.legend(handles, labels, loc="outside upper center", ncols=4 if len(labels) <= 4 else 3, **style)


def _plain_log_ticks(axis: Any, low: float, high: float) -> None:
    """Label a logarithmic axis with a few plain numbers, on a short range too."""
    with extra("a figure"):
        from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    decades = math.log10(high / low)
    if decades < 0.5:
        axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    else:
        axis.set_major_locator(LogLocator(subs=(1, 3) if decades < 3 else (1,), numticks=8))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}"))
    axis.set_minor_formatter(NullFormatter())


def _log_ticks_in_powers(axis: Any, low: float, high: float) -> None:
    """Label a logarithmic axis with powers of ten, with several labels on a short range too."""
    with extra("a figure"):
        from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter

    decades = math.log10(high / low)
    subs = (1, 1.5, 2, 3, 5, 7) if decades < 0.8 else (1, 2, 5) if decades < 2 else (1,)
    axis.set_major_locator(LogLocator(subs=subs, numticks=8))
    axis.set_major_formatter(LogFormatterSciNotation(minor_thresholds=(math.inf, math.inf)))
    axis.set_minor_formatter(NullFormatter())
