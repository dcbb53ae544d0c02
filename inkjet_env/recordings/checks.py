"""What is suspicious about a campaign, though it can be read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inkjet_env.recordings.recording import Campaign, Recording, Source

LARGEST_DRIVE_V = 100.0
FEWEST_SAMPLES_A_PERIOD = 10


@dataclass(frozen=True)
class Finding:
    """Something to look at before a campaign is believed.

    Parameters
    ----------
    level : {"error", "warning"}
        An error leaves no use of the recording; a warning may be as it should be.
    recording : str
        Its name.
    file : str
        The recording's file.
    row : int or None
        Row of the file, counted from 1; None where the finding is about the whole file.
    message : str
        The rule, what came, the likely fix.
    """

    level: str
    recording: str
    file: str
    row: int | None
    message: str

    def __str__(self) -> str:
        return f"{self.file}{f', row {self.row}' if self.row else ''}: {self.message}"


def check_campaign(campaign: Campaign, frequency_Hz: float | None = None) -> list[Finding]:
    """List what is suspicious about the recordings of a campaign.

    Parameters
    ----------
    campaign : Campaign
    frequency_Hz : float, optional
        The head's resonance; where it is given, recordings of fast channels with fewer than 10 samples a period of it
        are found.

    Returns
    -------
    list of Finding
        In the recordings' order; empty where nothing is.
    """
    findings: list[Finding] = []
    for recording in campaign.recordings:
        source = campaign.sources.get(recording.name, Source(f"{recording.name}.csv"))
        findings += _drive_findings(recording, source)
    return findings


def _drive_findings(recording: Recording, source: Source) -> list[Finding]:
    beyond = np.abs(recording.drive_V) > LARGEST_DRIVE_V
    if not beyond.any():
        return []
    k = int(np.argmax(beyond))
    return [
        Finding(
            "warning",
            recording.name,
            source.file,
            source.first_row + k,
            f"drive_V should be within ±{LARGEST_DRIVE_V:g} V; got {recording.drive_V[k]:g} V. Check the unit.",
        )
    ]
