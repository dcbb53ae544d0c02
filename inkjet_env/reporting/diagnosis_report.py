"""The HTML report of a diagnosis: the verdict, the recording that shows it, and all the evidence.

`write_diagnosis_report` writes one self-contained HTML file. From top to bottom: the verdict in words, the held-out
recording with both models, the effects found, the fit before and after, residual spectra, the location of the
mismatch, the hypotheses, the untestable effects, the next experiment, noise, the head, the computing time.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from inkjet_env.estimate import Estimate
from inkjet_env.mismatch.settings import LEFT_OVER, PREDICTED_POORLY
from inkjet_env.reporting import diagnosis_figures as figures
from inkjet_env.reporting.diagnosis_figures import Row, augmented
from inkjet_env.reporting.formatting import (
    CHANNEL_WORDS,
    engineering,
    hertz,
    number,
    probability,
    share_text,
    short,
    unit_text,
)
from inkjet_env.reporting.plotting import svg_text
from inkjet_env.storage import write_atomically
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from inkjet_env.identification import ModelledRecording
    from inkjet_env.mismatch.diagnosis import Diagnosis, NamedEffect


PERIODS_SHOWN = 6
"""Periods of the resonance shown in the enlarged view of the difference."""
FEWEST_SHOWN = 60
"""Smallest number of samples in the enlarged view."""
MOST_CONDITIONS = 60
"""Largest number of conditions in a figure; the table has all."""
MOST_CELLS = 8
"""Largest number of rows in one view of the mismatch's location."""
VIEW_WORDS = {
    "amplitude": "Largest drive",
    "slope": "Steepest edge",
    "sign": "Polarity",
    "order": "Order of recording",
    "distortion": "Distortion",
}
VERDICT_WORDS = {"none": "nothing found", "named": "named", "set": "one of several", "unknown": "unknown cause"}


def write_diagnosis_report(path: str | os.PathLike[str], diagnosis: Diagnosis) -> None:
    """Write the report atomically.

    Parameters
    ----------
    path : path
        Path of the HTML file; an existing file is replaced.
    diagnosis : Diagnosis
        The diagnosis to report.

    Raises
    ------
    OSError
        The folder is missing or not writable.
    """
    write_atomically(path, diagnosis_html(diagnosis))


def diagnosis_html(diagnosis: Diagnosis) -> str:
    """The report as HTML text."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    from inkjet_env.plant.registry import known_effects

    environment = Environment(loader=PackageLoader("inkjet_env.reporting"), autoescape=True, undefined=StrictUndefined)
    environment.filters |= {"short": short, "unit": unit_text, "channel": CHANNEL_WORDS.__getitem__}
    environment.filters |= {"share": share_text, "hertz": hertz, "number": number, "probability": probability}
    proof = proof_recording(diagnosis)
    models = models_of(proof, diagnosis)
    zoom = zoom_of(proof, models, diagnosis.printhead.frequency_Hz)
    whole = slice(0, proof.measured.size)
    conditions = condition_rows(diagnosis)
    channels = channel_rows(diagnosis)
    held_out = [row for row in channels if row.held_out and row.channel == diagnosis.main_channel]
    experiment = diagnosis.next_experiment
    return environment.get_template("diagnosis.html").render(
        diagnosis=diagnosis,
        verdict=VERDICT_WORDS[diagnosis.verdict],
        headline=diagnosis.headline.rstrip("."),
        augmented=augmented(diagnosis.recordings),
        explained=diagnosis.left_over <= LEFT_OVER,
        predicted=not diagnosis.closure < PREDICTED_POORLY,
        heldout=[r.name for r in diagnosis.recordings if r.held_out and r.channel == diagnosis.main_channel],
        proof=proof,
        models=models,
        whole=svg_text(figures.view_figure(proof, models, whole, zoom)),
        zoom=svg_text(figures.view_figure(proof, models, zoom)),
        effects=[(named, parameter_rows(named)) for named in diagnosis.effects],
        catalogue={effect.id: effect for effect in known_effects()},
        uncertain={effect_id for group in diagnosis.candidates for effect_id in group},
        told={a.ids[0]: a for a in diagnosis.attributions if len(a.ids) == 1},
        main=held_out[0] if held_out else None,
        channels=channels,
        conditions=conditions,
        fits=[svg_text(figures.fits_figure(rows)) for rows in shown_conditions(conditions)],
        most_conditions=MOST_CONDITIONS,
        spectra=[svg_text(figures.spectrum_figure(recordings)) for recordings in spectrum_recordings(diagnosis)],
        views=view_tables(diagnosis),
        found_ids={e.effect.id for e in diagnosis.effects},
        next_picture=svg_text(figures.next_figure(experiment)) if experiment and len(experiment.drive_V) > 1 else None,
        noises=noise_rows(diagnosis),
        heads=head_rows(diagnosis),
        stages=sorted(diagnosis.stages.items(), key=lambda item: -item[1]),
    )


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
    if diagnosis.correction is not None and recording.name in diagnosis.correction.modelled:
        models["corrected"] = recording.modelled["augmented"] + diagnosis.correction.modelled[recording.name]
    return models


def zoom_of(recording: ModelledRecording, models: Mapping[str, Real], frequency_Hz: float) -> slice:
    """The segment where the best model differs most from the base model, or the base model from the measurement."""
    n = recording.measured.size
    periods = (
        round(PERIODS_SHOWN / (frequency_Hz * recording.step_s)) if recording.channel != "strain_gauge" else n // 6
    )
    width = min(max(periods, FEWEST_SHOWN), n)
    other = recording.measured if len(models) == 1 else list(models.values())[-1]
    power = np.concatenate([[0.0], np.cumsum((other - recording.modelled["base"]) ** 2)])
    first = recording.fitted if recording.held_out and n - recording.fitted >= width else 0
    start = first + int(np.argmax(power[first + width :] - power[first : n - width + 1]))
    half = (power[start] + power[start + width]) / 2
    start = min(max(int(np.searchsorted(power, half)) - 1 - width // 4, 0), n - width)  # shows what precedes it too
    return slice(start, start + width)


def parameter_rows(named: NamedEffect) -> list[tuple[str, str, str, str, str]]:
    """Name, value, 90 % interval, unit and meaning of an effect's parameters."""
    known = {p.name: p for p in named.effect.parameters}
    return [
        (name, *engineering(estimate, named.unit_of(name)), known[name].meaning)
        for name, estimate in named.parameters.items()
    ]


def pooled_row(label: str, recordings: Sequence[ModelledRecording], held_out: bool) -> Row:
    """RMS residuals pooled over the held-out or the fitted samples of recordings of one channel."""
    weights = np.array([r.measured.size - r.fitted if held_out else r.fitted for r in recordings], dtype=np.float64)

    def pooled(values: Sequence[float]) -> float:
        return math.sqrt(float(np.average(np.square(values), weights=weights)))

    return Row(
        label,
        recordings[0].channel,
        recordings[0].unit,
        held_out,
        tuple(r.name for r in recordings),
        (min(float(r.drive_V.min()) for r in recordings), max(float(r.drive_V.max()) for r in recordings)),
        pooled([r.noise_rms for r in recordings]),
        pooled([r.rms("base", held_out) for r in recordings]),
        pooled([r.rms("augmented", held_out) for r in recordings]),
    )


def _having(recordings: Sequence[ModelledRecording], held_out: bool) -> list[ModelledRecording]:
    """The recordings of which any samples were held out, or fitted."""
    return [r for r in recordings if (r.held_out if held_out else r.fitted > 0)]


def channel_rows(diagnosis: Diagnosis) -> list[Row]:
    """The fit of each channel with base and augmented model: held-out recordings, then fitted ones."""
    rows = []
    for channel in CHANNEL_WORDS:
        mine = [r for r in diagnosis.recordings if r.channel == channel]
        rows += [
            pooled_row(CHANNEL_WORDS[channel], some, held_out)
            for held_out in (True, False)
            if (some := _having(mine, held_out))
        ]
    return rows


def condition_rows(diagnosis: Diagnosis) -> list[tuple[Row, list[Row]]]:
    """The fit of each condition (one drive on one channel) with both models, and of each recording that repeats it.

    A channel's held-out conditions come first.
    """
    found = []
    for channel in CHANNEL_WORDS:
        by_drive: dict[tuple[float, bytes], list[ModelledRecording]] = {}
        for recording in diagnosis.recordings:
            if recording.channel == channel:
                by_drive.setdefault((recording.step_s, recording.drive_V.tobytes()), []).append(recording)
        for held_out in (True, False):
            for recordings in by_drive.values():
                if some := _having(recordings, held_out):
                    label = some[0].name if len(some) == 1 else f"{some[0].name} + {len(some) - 1} more"
                    each = [pooled_row(r.name, [r], held_out) for r in some] if len(some) > 1 else []
                    found.append((pooled_row(label, some, held_out), each))
    return found


def shown_conditions(conditions: Sequence[tuple[Row, list[Row]]]) -> list[list[Row]]:
    """Rows of each figure: a channel's conditions, at most `MOST_CONDITIONS` with the largest residual over noise."""
    pictures = []
    for channel in CHANNEL_WORDS:
        mine = [row for row, _ in conditions if row.channel == channel]
        kept = sorted(range(len(mine)), key=lambda k: -mine[k].base / max(mine[k].noise, 1e-300))[:MOST_CONDITIONS]
        if kept:
            pictures.append([mine[k] for k in sorted(kept)])
    return pictures


def spectrum_recordings(diagnosis: Diagnosis) -> list[list[ModelledRecording]]:
    """Recordings whose spectra are pooled: each channel's driven held-out recordings, or all driven ones if none is."""
    chosen = []
    for channel in CHANNEL_WORDS:
        mine = [r for r in diagnosis.recordings if r.channel == channel and np.ptp(r.drive_V) > 0]
        if mine:
            chosen.append([r for r in mine if r.held_out] or mine)
    return chosen


def view_tables(diagnosis: Diagnosis) -> list[tuple[str, int, list[tuple[str, float, float, float]]]]:
    """Title, number of cells and rows of each view of the mismatch's location.

    A row is a label, power over noise, the length of its bar in per cent, and z. A view with many cells shows those
    with the largest z, in the view's order.
    """
    tables = []
    for view, cells in diagnosis.location.tables.items():
        kept = sorted(range(len(cells)), key=lambda k: -np.nan_to_num(cells[k][2], nan=-math.inf))[:MOST_CELLS]
        rows = [cells[k] for k in sorted(kept)]
        largest = max(1.0, *(_decades(ratio) for _, ratio, _ in rows)) if rows else 1.0
        bars = [(_in_words(label), ratio, round(100 * _decades(ratio) / largest, 1), z) for label, ratio, z in rows]
        if bars:
            tables.append((VIEW_WORDS.get(view, view.capitalize()), len(cells), bars))
    return tables


def _in_words(label: str) -> str:
    for channel, words in CHANNEL_WORDS.items():
        label = label.replace(channel, words)
    return label


def _decades(ratio: float) -> float:
    """Decades of power above the noise; 0 for a power at or below it, which has no bar."""
    return math.log10(ratio) if 1 < ratio < math.inf else 0.0


def noise_rows(diagnosis: Diagnosis) -> list[tuple[str, str, float, int, str]]:
    """Channel, sampling step, RMS, number of recordings and unit of each noise."""
    groups: dict[tuple[str, str], list[ModelledRecording]] = {}
    for recording in diagnosis.recordings:
        step = " ".join(engineering(Estimate(recording.step_s, recording.step_s, recording.step_s), "s")[::2])
        groups.setdefault((CHANNEL_WORDS[recording.channel], step), []).append(recording)
    return [
        (channel, step, float(np.sqrt(np.mean([r.noise_rms**2 for r in some]))), len(some), unit_text(some[0].unit))
        for (channel, step), some in groups.items()
    ]


def head_rows(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Name, value without and value with effects of the head's parameters, which absorb part of missing effects."""
    base, augmented = diagnosis.base_printhead, diagnosis.printhead
    return [
        ("resonance", hertz(base.frequency_Hz), hertz(augmented.frequency_Hz)),
        ("damping ratio", short(base.damping_ratio, 4), short(augmented.damping_ratio, 4)),
        ("gain of self-sensing b1, 1/s", short(base.b1, 4), short(augmented.b1, 4)),
    ]
