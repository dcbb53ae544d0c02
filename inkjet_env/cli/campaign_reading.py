"""A campaign given on the command line: the options that say how to read it, its files, its warnings."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
MOST_WARNINGS = 10
"""Largest number of warnings that are printed."""


def reading_options(
    channel: str | None, columns: str | None, initial_state: str | None, interval_s: float | None = None
) -> dict[str, Any]:
    """Keyword arguments of `read_campaign` from the command line's options for oscilloscope files."""
    return {
        "channel": channel,
        "columns": None if columns is None else named_values("--columns", columns),
        "initial_state": initial_state,
        "interval_s": interval_s,
    }


def files_of(folder: Path) -> tuple[Path, ...]:
    """All files in a campaign's folder; no result may overwrite them."""
    return tuple(path for path in folder.rglob("*") if path.is_file()) if folder.is_dir() else ()


def checked(campaign: Campaign, head: Printhead | AugmentedPrinthead | None = None) -> list[str]:
    """The warnings about a campaign, and about its sampling if a head's resonance is known.

    The first error is raised as a `CampaignError`.
    """
    from inkjet_env.recordings import CampaignError, check_campaign

    findings = check_campaign(campaign, head.frequency_Hz if head is not None and head.has_dynamics else None)
    for finding in findings:
        if finding.level == "error":
            raise CampaignError(str(finding))
    return [str(finding) for finding in findings]


def warn(warnings: Sequence[str]) -> None:
    """Print at most `MOST_WARNINGS` warnings on standard error."""
    for warning in warnings[:MOST_WARNINGS]:
        print(f"warning: {warning}", file=sys.stderr)
    if len(warnings) > MOST_WARNINGS:
        print(f"warning: … and {len(warnings) - MOST_WARNINGS} more of this kind", file=sys.stderr)
