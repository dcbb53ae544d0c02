"""A campaign given on the command line: the options that say how to read it, its files, its warnings."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inkjet_env.cli.arguments import named_values

if TYPE_CHECKING:
    from inkjet_env.plant.augmented import AugmentedPrinthead
    from inkjet_env.printhead import Printhead
    from inkjet_env.recordings import Campaign

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="folder of the campaign", show_default=False)]
ScopeChannel = Annotated[
    str | None,
    typer.Option("--channel", help="channel of oscilloscope files: self_sensing, strain_gauge or displacement"),
]
ScopeColumns = Annotated[
    str | None,
    typer.Option(
        "--columns",
        help="columns of oscilloscope files: time=NAME,drive=NAME,sensor=NAME (or numbers); guessed unless given",
    ),
]
ScopeState = Annotated[
    str | None,
    typer.Option("--initial-state", help="initial state of oscilloscope files: demagnetised, periodic or free (free)"),
]
Interval = Annotated[
    float | None,
    typer.Option("--interval", help="sampling interval in seconds, for files without times", min=1e-15),
]
Implausible = Annotated[
    bool, typer.Option("--implausible", help="drives beyond 1 kV and impossible-looking sample rates are meant")
]
MOST_WARNINGS = 10
"""Largest number of warnings or notes that are printed."""
REASONS = re.compile(r" ?\([^()]*\)")
"""What a note adds in brackets: why a column was taken for what it is."""
NUMBERS = re.compile(r"(?<![\w.=])(?<!= )\d[\d.,]*(?:e[+-]?\d+)?(?!\w)")
"""Numbers in a note that differ from file to file; not those of a column's name, such as CH1 or = 2."""


@dataclass(frozen=True)
class Reading:
    """How to read and check campaigns, from the command line's options.

    Attributes
    ----------
    channel, columns, initial_state, interval_s
        As in `read_campaign`.
    implausible : bool
        Whether implausible units are meant.
    """

    channel: str | None = None
    columns: Mapping[str, str] | None = None
    initial_state: str | None = None
    interval_s: float | None = None
    implausible: bool = False

    @classmethod
    def of(
        cls,
        channel: str | None,
        columns: str | None,
        initial_state: str | None,
        interval_s: float | None,
        implausible: bool,
    ) -> Reading:
        """The reading that options ask for; ``columns`` is still text."""
        named = None if columns is None else named_values("--columns", columns)
        return cls(channel, named, initial_state, interval_s, implausible)

    def campaign(self, folder: Path, progress: Callable[[str], None] | None = None) -> Campaign:
        """Read the campaign of a folder; ``progress`` is told what is being read."""
        from inkjet_env.recordings import read_campaign

        return read_campaign(
            folder,
            columns=self.columns,
            channel=self.channel,
            initial_state=self.initial_state,
            interval_s=self.interval_s,
            progress=progress,
        )

    def warnings(self, campaign: Campaign, head: Printhead | AugmentedPrinthead | None = None) -> list[str]:
        """The warnings about a campaign, and about its sampling if a head's resonance is known.

        The first error is raised as a `CampaignError`, unless what is implausible is meant.
        """
        from inkjet_env.recordings import CampaignError, check_campaign

        findings = check_campaign(campaign, head.frequency_Hz if head is not None and head.has_dynamics else None)
        for finding in findings:
            if finding.level == "error" and not self.implausible:
                raise CampaignError(f"{finding} If it is meant, give --implausible.")
        return [str(finding) for finding in findings]


def files_of(folder: Path) -> tuple[Path, ...]:
    """All files in a campaign's folder; no result may overwrite them."""
    return tuple(path for path in folder.rglob("*") if path.is_file()) if folder.is_dir() else ()


def warn(warnings: Sequence[str]) -> None:
    """Print at most `MOST_WARNINGS` warnings on standard error."""
    for warning in warnings[:MOST_WARNINGS]:
        print(f"warning: {warning}", file=sys.stderr)
    if len(warnings) > MOST_WARNINGS:
        print(f"warning: … and {len(warnings) - MOST_WARNINGS} more of this kind", file=sys.stderr)


def notes_of(campaign: Campaign) -> list[str]:
    """The notes on how a campaign was read: those that say the same of several files as one, with an example.

    Parameters
    ----------
    campaign : Campaign
        A campaign as it was read.

    Returns
    -------
    list of str
        In the order of the campaign's own notes.
    """
    files = {source.file for source in campaign.sources.values()}
    groups: dict[str, list[tuple[str, str]]] = {}
    for note in campaign.notes:
        file, mark, text = note.partition(": ")
        if not mark or file not in files:
            file, text = "", note
        kind = NUMBERS.sub("#", REASONS.sub("", text)) if file else note
        groups.setdefault(kind, []).append((file, text))
    told = []
    for alike in groups.values():
        file, text = alike[0]
        if len(alike) > 1:
            told.append(f"{len(alike)} files in {Path(file).parent} alike, such as {Path(file).name}: {text}")
        else:
            told.append(f"{file}: {text}" if file else text)
    return told


def print_notes(campaign: Campaign) -> None:
    """Print how a campaign was read, in at most `MOST_WARNINGS` notes, on standard error."""
    notes = notes_of(campaign)
    for note in notes[:MOST_WARNINGS]:
        print(note, file=sys.stderr)
    if len(notes) > MOST_WARNINGS:
        print(f"… and {len(notes) - MOST_WARNINGS} more notes of this kind", file=sys.stderr)
