"""The HTML report of a diagnosis: the verdict, the recording that shows it, and all the evidence.

`write_diagnosis_report` writes one self-contained HTML file. From top to bottom: the verdict in words, the held-out
recording with both models where they differ most, what to do next, the effects found; then, folded, the fit before and
after, residual spectra, the location of the mismatch, the hypotheses, the untestable effects, noise, the head, the
computing time.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from inkjet_env.mismatch.headline import probabilities_text
from inkjet_env.reporting.columns import columns_text
from inkjet_env.reporting.diagnosis_figures import augmented, figures_of, sample_times_s
from inkjet_env.reporting.diagnosis_tables import Row, tables_of
from inkjet_env.reporting.page import PageFile, page_environment
from inkjet_env.storage import json_text, write_atomically

if TYPE_CHECKING:
    from inkjet_env.mismatch.design.next_experiment import NextExperiment
    from inkjet_env.mismatch.diagnosis import Diagnosis

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
    from inkjet_env.plant.registry import known_effects

    environment = page_environment()
    tables, settings = tables_of(diagnosis), diagnosis.settings.verdict
    mine = [r for r in diagnosis.recordings if r.channel == diagnosis.main_channel]
    heldout = [r.name for r in mine if r.held_out]
    return environment.get_template("diagnosis.html").render(
        diagnosis=diagnosis,
        verdict=VERDICT_WORDS[diagnosis.verdict],
        headline=diagnosis.headline.rstrip("."),
        probabilities=probabilities_text(diagnosis.probabilities),
        augmented=augmented(diagnosis.recordings),
        explained=diagnosis.left_over <= settings.left_over,
        predicted=not diagnosis.closure < settings.least_closure,
        heldout=heldout,
        others=[r.name for r in mine if not r.held_out][-len(heldout) :],
        catalogue={effect.id: effect for effect in known_effects()},
        asked=[(one, drive_file(one, k)) for k, one in enumerate(diagnosis.next_experiments, start=1)],
        files=[head_file(diagnosis), fit_file(tables["channels"], diagnosis.verdict)],
        uncertain={effect_id for group in diagnosis.candidates for effect_id in group},
        found_ids={e.effect.id for e in diagnosis.effects},
        stages=sorted(diagnosis.stages.items(), key=lambda item: -item[1]),
        **tables,
        **figures_of(diagnosis, tables["conditions"]),
    )


def head_words(diagnosis: Diagnosis) -> str:
    """What the head of a diagnosis is, in words: corrected only if effects were found."""
    if diagnosis.effects:
        words = "the corrected printhead"
        if diagnosis.candidates:
            doubted = {effect_id for group in diagnosis.candidates for effect_id in group}
            chosen = [e.effect.id.replace("_", " ") for e in diagnosis.effects if e.effect.id in doubted]
            words += f", with {' and '.join(chosen)}" if chosen else ""
            words += "; heads of the other candidates are in it too" if chosen and diagnosis.ensemble else ""
    else:
        beside = "" if diagnosis.remainder is None else " with the unexplained remainder"
        words = f"the base printhead{beside}: no effect was {'found' if diagnosis.verdict == 'none' else 'named'}"
    return words if diagnosis.printhead.has_dynamics else f"{words}; its resonance is not known"


def head_file(diagnosis: Diagnosis) -> PageFile:
    """The corrected head, or the base head where no effect was found."""
    name = "corrected.json" if diagnosis.effects else "printhead.json"
    return PageFile(name, json_text(diagnosis.augmented_json()), head_words(diagnosis))


def drive_file(experiment: NextExperiment, number: int) -> PageFile | None:
    """The drive of an experiment as CSV; None if no drive can be computed."""
    if len(experiment.drive_V) < 2:
        return None
    name = "next.csv" if number == 1 else f"next-{number}.csv"
    return PageFile(name, experiment_csv(experiment), "drive of the next experiment")


def experiment_csv(experiment: NextExperiment) -> str:
    """The drive of an experiment, and that of the neighbouring channel if it moves, as CSV."""
    columns = {
        "time_s": sample_times_s(len(experiment.drive_V), experiment.step_s),
        "drive_V": np.array(experiment.drive_V),
    }
    if experiment.neighbour_V:
        columns["neighbour_V"] = np.array(experiment.neighbour_V)
    return columns_text(columns)


FITTED = {
    "none": ("", "residuals of the model beside the noise, by channel"),
    "unknown": (
        "closest_rms",
        "residuals of the base model and of the closest hypothesis beside the noise, by channel",
    ),
}
"""Name of the second model's column in the file of the fit, and what that file is, where nothing was corrected."""


def fit_file(rows: Sequence[Row], verdict: str) -> PageFile:
    """The residuals of each channel as CSV: with the base model, and with the second model if there is one."""
    both = ("corrected_rms", "residuals of base and corrected model beside the noise, by channel")
    second, what = FITTED.get(verdict, both)
    lines = ["channel,recordings,number,unit,noise_rms,base_rms" + (f",{second}" if second else "")]
    lines += [
        f"{row.channel},{row.role},{len(row.names)},{row.unit},{row.noise:.6g},{row.base:.6g}"
        + (f",{row.augmented:.6g}" if second else "")
        for row in rows
    ]
    return PageFile("fit.csv", "\n".join(lines) + "\n", what)
