"""The recordings as rows of a table: what was read and guessed of each file, and how the chosen head does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from inkjet_env.experiments.explore.modelled import Modelled
from inkjet_env.experiments.explore.reading import CORRECTABLE, GUESS, LABELS
from inkjet_env.experiments.explore.recordings_state import RecordingsState
from inkjet_env.recordings import Recording
from inkjet_env.recordings.campaign import Source
from inkjet_env.recordings.roles import ROLES
from inkjet_env.recordings.survey import SurveyedFile

REMARK = "remark"
COLUMNS = (
    "recording", "file", "drive", "sensor", "monitor", "neighbour", "channel", "unit", "initial_state", "drive_V",
    "signal", "residual", "noise", REMARK, "time", "samples", "rate",
)  # fmt: skip
ALWAYS = ("recording", "drive", "sensor", "channel", REMARK, "time")
"""Columns that are shown even if nothing stands in them."""
SELDOM = ("monitor", "neighbour")
"""Roles that most recordings lack: shown where a file has a column for them."""
TITLES = {
    "time": "time from", "drive": "drive from", "sensor": "sensor from", "monitor": "monitor from",
    "neighbour": "neighbour from", "initial_state": "initial state", "drive_V": "drive (V)",
}  # fmt: skip


def rows(state: RecordingsState) -> Sequence[dict[str, Any]]:
    """One row for each recording; of files that cannot be read, what their headers show."""
    if state.campaign is None:
        return [_surveyed(one, state) for one in state.surveyed]
    modelled = state.modelled.get(state.model)
    return [_read(one, state.campaign.sources.get(one.name), state, modelled) for one in state.campaign.recordings]


def choices(state: RecordingsState) -> dict[str, list[str]]:
    """What each column can be corrected to: `GUESS`, and the columns of any file, or the values of a label."""
    columns = list(dict.fromkeys(name for names in state.columns_by_recording().values() for name in names))
    return {what: [GUESS, *LABELS.get(what, columns)] for what in CORRECTABLE}


def unused(found: Sequence[Mapping[str, Any]], widest: int) -> list[str]:
    """Columns of the table in which nothing stands and nothing can be corrected; ``widest``: most columns of a file."""
    shown = (*ALWAYS, *(SELDOM if widest > 3 else ()))
    return [name for name in COLUMNS if name not in shown and not any(row[name] for row in found)]


def rate_text(rate_Hz: float) -> str:
    """A sample rate in the unit that suits it.

    Examples
    --------
    >>> rate_text(2e7)
    '20 MHz'
    """
    scale, unit = next(((scale, unit) for scale, unit in ((1e6, "MHz"), (1e3, "kHz")) if rate_Hz >= scale), (1.0, "Hz"))
    return f"{rate_Hz / scale:.4g} {unit}"


def _surveyed(one: SurveyedFile, state: RecordingsState) -> dict[str, Any]:
    told = dict(state.corrections.by_recording.get(one.name, {}))
    problem = one.problem.removeprefix(f"{one.file}: ")
    row = dict.fromkeys(COLUMNS, "") | {"recording": one.name, "file": Path(one.file).name}
    row |= {"channel": one.channel or ""} | dict(one.roles) | told
    return row | {REMARK: f"not read: {problem}" if problem else "not read yet"}


def _read(one: Recording, source: Source | None, state: RecordingsState, modelled: Modelled | None) -> dict[str, Any]:
    file = "" if source is None else Path(source.file).name
    roles = {} if source is None else source.roles
    row: dict[str, Any] = {
        "recording": one.name,
        "file": file if file != f"{one.name}.csv" else "",
        **{role: roles.get(role, "") for role in ROLES},
        "channel": one.channel,
        "unit": one.unit,
        "initial_state": one.initial_state,
        "samples": f"{one.time_s.size}",
        "rate": rate_text(one.sample_rate_Hz),
        "drive_V": f"{one.drive_V.min():.3g} … {one.drive_V.max():.3g}",
        "signal": f"{one.sensor.min():.3g} … {one.sensor.max():.3g}",
        "residual": "",
        "noise": "",
        REMARK: "corrected by you" if one.name in state.corrections.by_recording else "",
    }
    if modelled is not None:
        noise = modelled.noise_rms[one.name]
        row["residual"] = f"{modelled.evaluations[one.name].rms:.3g}"
        row["noise"] = "–" if noise != noise else f"{noise:.3g}"
        if modelled.differs[one.name]:
            row[REMARK] = " ".join(filter(None, ("differs", row[REMARK] and f"({row[REMARK]})")))
    return row
