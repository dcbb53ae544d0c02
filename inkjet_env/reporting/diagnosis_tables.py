"""Rows of a diagnosis's tables: fits by channel and condition, parameters, views, noise, the head."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.estimate import Estimate
from inkjet_env.plant.registry import known_effects
from inkjet_env.plant.wording import CHANNEL_WORDS
from inkjet_env.reporting.formatting import channels_in_words, engineering, hertz, parameter_text, prefixed_unit, short

if TYPE_CHECKING:
    from inkjet_env.identification import ModelledRecording
    from inkjet_env.mismatch.diagnosis import Diagnosis, NamedEffect

MOST_CELLS = 8
"""Largest number of rows in one view of the mismatch's location."""
VIEW_WORDS = {
    "amplitude": "Largest drive",
    "slope": "Steepest edge",
    "sign": "Polarity",
    "order": "Order of recording",
    "distortion": "Distortion",
}


@dataclass(frozen=True)
class Row:
    """RMS residuals of a condition, a recording or a channel, of the base and of the corrected model.

    Attributes
    ----------
    label : str
        Name of the row.
    channel : str
        Channel of its recordings.
    unit : str
        Unit of that channel.
    held_out : bool
        Whether the samples were held out of the fit.
    names : tuple of str
        Names of the recordings.
    drive_V : (float, float)
        Smallest and largest drive in volts.
    noise, base, augmented : float
        RMS of the noise and of the residuals of base and corrected model, in the channel's unit.
    """

    label: str
    channel: str
    unit: str
    held_out: bool
    names: tuple[str, ...]
    drive_V: tuple[float, float]
    noise: float
    base: float
    augmented: float

    @property
    def role(self) -> str:
        """``held out`` or ``fitted``."""
        return "held out" if self.held_out else "fitted"

    @property
    def closure(self) -> float:
        """Fraction of the mean square above the noise that the corrected model removes; NaN if there is hardly any."""
        beyond = self.base**2 - self.noise**2
        return (self.base**2 - self.augmented**2) / beyond if beyond > 0.1 * self.noise**2 else math.nan


def tables_of(diagnosis: Diagnosis) -> dict[str, Any]:
    """Rows of every table of the report, by the template's names."""
    channels = channel_rows(diagnosis)
    main = [row for row in channels if row.held_out and row.channel == diagnosis.main_channel]
    return {
        "effects": [(named, parameter_rows(named)) for named in (*diagnosis.effects, *diagnosis.minor)],
        "main": main[0] if main else None,
        "channels": channels,
        "conditions": condition_rows(diagnosis),
        "candidates": candidate_rows(diagnosis),
        "views": view_tables(diagnosis),
        "noises": noise_rows(diagnosis),
        "scales": {row.channel: prefixed_unit(row.noise, row.unit) for row in channels[::-1]},
        "heads": head_rows(diagnosis),
    }


def parameter_rows(named: NamedEffect) -> list[tuple[str, str, str, str, str]]:
    """Name, value, 90 % interval, unit and meaning of an effect's parameters."""
    known = {p.name: p for p in named.effect.parameters}
    return [
        (parameter_text(name), *engineering(estimate, named.unit_of(name)), known[name].meaning)
        for name, estimate in named.parameters.items()
    ]


def candidate_rows(diagnosis: Diagnosis) -> list[list[tuple[str, str, float]]]:
    """For each group of candidates: id, description, and gain in log-likelihood, of the whole model that has it.

    That is the hypothesis in which the candidate takes the place of the one that was chosen, beside the same other
    effects; its values are not those of a fit of the candidate alone. Without such a hypothesis among those listed, the
    effect is described without values, and its gain is NaN.
    """
    found = {e.effect.id: e for e in diagnosis.effects}
    with_law = {name for name, e in found.items() if not e.effect.random}
    catalogue = {effect.id: effect for effect in known_effects()}
    scores = {frozenset(score.ids): score for score in diagnosis.attributions}
    groups = []
    for first, *others in diagnosis.candidates:
        rows = []
        for name in (first, *others):
            score = scores.get(frozenset((with_law - {first}) | {name}))
            if name in found:  # in the words of the verdict, which is fitted last
                words = " ".join(found[one].sentence for one in found if one in with_law)
                rows.append((name, words, found[name].delta_nll if score is None else score.gain))
            elif score is not None:
                rows.append((name, score.description, score.gain))
            else:
                rows.append((name, catalogue[name].sentence if name in catalogue else "", math.nan))
        groups.append(rows)
    return groups


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
    """The fit of each channel with base and corrected model: held-out recordings, then fitted ones."""
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
        bars = [
            (channels_in_words(label), ratio, round(100 * _decades(ratio) / largest, 1), z) for label, ratio, z in rows
        ]
        if bars:
            tables.append((VIEW_WORDS.get(view, view.capitalize()), len(cells), bars))
    return tables


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
        (channel, step, float(np.sqrt(np.mean([r.noise_rms**2 for r in some]))), len(some), some[0].unit)
        for (channel, step), some in groups.items()
    ]


def head_rows(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Name, value without and value with effects of the head's parameters, which absorb part of missing effects."""
    base, augmented = diagnosis.base_printhead, diagnosis.printhead
    if not augmented.has_dynamics:
        before, after = (short(head.full_scale_V * float(head.branch_law.Q(1.0)), 4) for head in (base, augmented))
        return [("hysteretic drive at full scale, V", before, after)]
    return [
        ("resonance", hertz(base.frequency_Hz), hertz(augmented.frequency_Hz)),
        ("damping ratio", short(base.damping_ratio, 4), short(augmented.damping_ratio, 4)),
        ("gain of self-sensing b1, 1/s", short(base.b1, 4), short(augmented.b1, 4)),
    ]
