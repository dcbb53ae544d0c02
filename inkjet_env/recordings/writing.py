"""Atomic writing of a measuring campaign."""

from __future__ import annotations

import io
import os
import shutil
from pathlib import Path

from inkjet_env.recordings.campaign import Campaign
from inkjet_env.recordings.data_package import DESCRIPTOR, descriptor, listed_files, recording_columns
from inkjet_env.recordings.recording import CampaignError, Recording
from inkjet_env.storage import UNFINISHED, json_text, write_atomically

ROWS_A_BLOCK = 1 << 16
"""Number of rows that are held in memory as lines."""


def write_campaign(folder: str | os.PathLike[str], campaign: Campaign) -> None:
    """Write a campaign as a Data Package that `read_campaign` reads back with identical numbers.

    Parameters
    ----------
    folder : str or Path
        Destination. It is created, or replaced if it is empty or holds nothing but a campaign.
    campaign : Campaign
        Recordings to write.

    Raises
    ------
    CampaignError
        The folder holds other files, or is a file; it is left unchanged.
    OSError
        The destination is not writable; nothing is left behind.
    """
    target = Path(os.path.realpath(folder))
    _check_target(target)
    unfinished = target.with_name(f"{target.name}.{os.getpid()}{UNFINISHED}")
    replaced = target.with_name(f"{target.name}.{os.getpid()}.replaced{UNFINISHED}")
    try:
        unfinished.mkdir(parents=True)
        for recording in campaign.recordings:
            write_atomically(unfinished / f"{recording.name}.csv", _csv_bytes(recording))
        write_atomically(unfinished / DESCRIPTOR, json_text(descriptor(campaign)))
        if target.exists():
            os.rename(target, replaced)
        try:
            os.rename(unfinished, target)
        except BaseException:  # Ctrl-C too
            if replaced.exists() and not target.exists():
                os.rename(replaced, target)
            raise
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
    shutil.rmtree(replaced, ignore_errors=True)


def extend_campaign(folder: str | os.PathLike[str], campaign: Campaign) -> None:
    """Add recordings to a campaign that `write_campaign` wrote; files that are there stay as they are.

    Parameters
    ----------
    folder : str or Path
        Folder of the campaign; without a campaign there, everything is written.
    campaign : Campaign
        The recordings that are there, unchanged but for what the descriptor tells of them, and those to add.

    Raises
    ------
    CampaignError
        The folder holds other files and no campaign, or is a file; it is left unchanged.
    OSError
        The folder is not writable; the campaign there is what it was.
    """
    target = Path(os.path.realpath(folder))
    if not (target / DESCRIPTOR).exists():
        write_campaign(target, campaign)
        return
    listed = listed_files(target)
    for recording in campaign.recordings:
        if f"{recording.name}.csv" not in listed:
            write_atomically(target / f"{recording.name}.csv", _csv_bytes(recording))
    write_atomically(target / DESCRIPTOR, json_text(descriptor(campaign)))  # last: before, nothing was added


def _check_target(target: Path) -> None:
    if target.exists() and not target.is_dir():
        raise CampaignError(f"{target}: is not a folder, so no campaign can be written there. Give another name.")
    present = {path.name for path in target.iterdir()} if target.exists() else set()
    if not present:
        return
    if DESCRIPTOR not in present:
        raise CampaignError(f"{target}: holds files and no campaign; nothing was written. Give another folder.")
    foreign = sorted(present - {DESCRIPTOR} - listed_files(target))
    if foreign:
        raise CampaignError(
            f"{target}: holds {foreign[0]!r}, which is not part of the campaign there and would be lost; nothing was "
            "written. Move it, or give another folder."
        )


def _csv_bytes(recording: Recording) -> bytes:
    """Content of a recording's file: a header line, then numbers in the shortest form that reads back exactly.

    A million rows of three columns take about 3 s.
    """
    columns = recording_columns(recording)
    buffer = io.BytesIO()
    buffer.write((",".join(columns) + "\n").encode())
    for start in range(0, len(recording.time_s), ROWS_A_BLOCK):
        printed = (map(repr, values[start : start + ROWS_A_BLOCK].tolist()) for values in columns.values())
        buffer.write("".join(",".join(row) + "\n" for row in zip(*printed, strict=True)).encode())
    return buffer.getvalue()
