"""The HTML report of a diagnosis: the verdict, the recording that shows it, and all the evidence.

`write_diagnosis_report` writes one self-contained HTML file. From top to bottom: the verdict in words, the held-out
recording with both models, the effects found, the fit before and after, residual spectra, the location of the
mismatch, the hypotheses, the untestable effects, the next experiment, noise, the head, the computing time.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from inkjet_env.mismatch.settings import LEFT_OVER, PREDICTED_POORLY
from inkjet_env.reporting import diagnosis_figures as figures
from inkjet_env.reporting.diagnosis_figures import augmented
from inkjet_env.reporting.diagnosis_tables import (
    MOST_CONDITIONS,
    channel_rows,
    condition_rows,
    head_rows,
    noise_rows,
    parameter_rows,
    shown_conditions,
    view_tables,
)
from inkjet_env.reporting.formatting import (
    CHANNEL_WORDS,
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
    from inkjet_env.mismatch.diagnosis import Diagnosis

PERIODS_SHOWN = 6
"""Periods of the resonance shown in the enlarged view of the difference."""
FEWEST_SHOWN = 60
"""Smallest number of samples in the enlarged view."""
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


def spectrum_recordings(diagnosis: Diagnosis) -> list[list[ModelledRecording]]:
    """Recordings whose spectra are pooled: each channel's driven held-out recordings, or all driven ones if none is."""
    chosen = []
    for channel in CHANNEL_WORDS:
        mine = [r for r in diagnosis.recordings if r.channel == channel and np.ptp(r.drive_V) > 0]
        if mine:
            chosen.append([r for r in mine if r.held_out] or mine)
    return chosen
