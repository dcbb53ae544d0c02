"""The HTML report of a diagnosis: the verdict, the recording that shows it, and all the evidence.

`write_diagnosis_report` writes one self-contained HTML file. From top to bottom: the verdict in words, the held-out
recording with both models, the effects found, the fit before and after, residual spectra, the location of the
mismatch, the hypotheses, the untestable effects, the next experiment, noise, the head, the computing time.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from inkjet_env.extras import extra
from inkjet_env.mismatch.headline import probabilities_text
from inkjet_env.reporting.diagnosis_figures import augmented, figures_of
from inkjet_env.reporting.diagnosis_tables import tables_of
from inkjet_env.reporting.formatting import (
    CHANNEL_WORDS,
    hertz,
    number,
    probability,
    share_text,
    short,
    unit_text,
    with_minus,
)
from inkjet_env.reporting.plotting import svg_text
from inkjet_env.storage import write_atomically

if TYPE_CHECKING:
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
    with extra("a report"):
        from jinja2 import Environment, PackageLoader, StrictUndefined

    from inkjet_env.plant.registry import known_effects

    environment = Environment(loader=PackageLoader("inkjet_env.reporting"), autoescape=True, undefined=StrictUndefined)
    environment.filters |= {"short": short, "unit": unit_text, "channel": CHANNEL_WORDS.__getitem__}
    environment.filters |= {
        "svg": svg_text,
        "minus": with_minus,
        "share": share_text,
        "hertz": hertz,
        "number": number,
        "probability": probability,
    }
    tables, settings = tables_of(diagnosis), diagnosis.settings.verdict
    return environment.get_template("diagnosis.html").render(
        diagnosis=diagnosis,
        verdict=VERDICT_WORDS[diagnosis.verdict],
        headline=diagnosis.headline.rstrip("."),
        probabilities=probabilities_text(diagnosis.probabilities),
        augmented=augmented(diagnosis.recordings),
        explained=diagnosis.left_over <= settings.left_over,
        predicted=not diagnosis.closure < settings.least_closure,
        heldout=[r.name for r in diagnosis.recordings if r.held_out and r.channel == diagnosis.main_channel],
        catalogue={effect.id: effect for effect in known_effects()},
        uncertain={effect_id for group in diagnosis.candidates for effect_id in group},
        single_effects={a.ids[0]: a for a in diagnosis.attributions if len(a.ids) == 1},
        found_ids={e.effect.id for e in diagnosis.effects},
        stages=sorted(diagnosis.stages.items(), key=lambda item: -item[1]),
        **tables,
        **figures_of(diagnosis, tables["conditions"]),
    )
