"""Reading, checking and identifying campaigns: one, or several in parallel."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from inkjet_env.cli.campaign_reading import Reading, warn
from inkjet_env.extras import extra
from inkjet_env.identification import Identification, identify
from inkjet_env.identification.work_done import PARTS
from inkjet_env.processes import end_with_parent
from inkjet_env.progress import shown_progress, shown_steps
from inkjet_env.recordings import Campaign
from inkjet_env.storage import write_json

ALONE = Path("printhead.json")
TOGETHER = Path("printheads")


def identify_one(
    folder: Path, reading: Reading, options: Mapping[str, Any], progress: bool = True
) -> tuple[Campaign, Identification]:
    """Read, check and identify the campaign of one folder; warnings go to standard error.

    Parameters
    ----------
    folder : Path
        Folder of the campaign.
    reading : Reading
        How to read and check it.
    options : mapping
        Keyword arguments of `identify`.
    progress : bool
        Whether to show the current step on standard error.

    Raises
    ------
    ValueError
        A file cannot be read, a recording's unit is implausible, or there is nothing to identify from. The message
        names file and row.
    """
    with shown_steps(f"identify {folder}", PARTS) if progress else nullcontext() as step:
        campaign = reading.campaign(folder, step)
        warned = reading.warnings(campaign)
        try:
            found = identify(campaign, progress=step, **options)
        except ValueError:
            warn(warned)  # they may explain the failure
            raise
    warn([*warned, *(w for w in reading.warnings(campaign, found.printhead) if w not in warned)])
    return campaign, found


def identify_folders(
    folders: Sequence[Path],
    out: Path,
    reading: Reading,
    options: Mapping[str, Any],
    workers: int | None = None,
) -> None:
    """Identify several campaigns in parallel; each printhead is written as soon as it is identified.

    Parameters
    ----------
    folders : sequence of Path
        Folders of the campaigns; their names must differ.
    out : Path
        Folder for ``<campaign's folder>.json``; created if it is missing.
    reading, options
        As for `identify_one`.
    workers : int, optional
        Number of processes; all cores unless given.

    Raises
    ------
    ValueError
        Two folders have the same name, or campaigns could not be identified: one sentence for each. The others are
        written.
    """
    with extra("identifying several folders"):
        from joblib import Parallel, delayed, parallel_config

    out = TOGETHER if out == ALONE else out
    names = [folder.resolve().name for folder in folders]
    name, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise ValueError(f"{count} folders are called {name!r}, and each gives {out / name}.json. Rename one.")
    out.mkdir(parents=True, exist_ok=True)
    jobs = (
        delayed(_written)(folder, out / f"{name}.json", reading, options)
        for folder, name in zip(folders, names, strict=True)
    )
    refused = []
    with (
        shown_progress("identify", len(folders)) as progress,
        parallel_config("loky", initializer=end_with_parent, initargs=(os.getpid(),)),
    ):
        finished = Parallel(n_jobs=workers or -1, return_as="generator_unordered")(jobs)
        for done, (folder, complaint) in enumerate(finished, start=1):
            progress(done, folder.name)
            if complaint:
                refused.append(complaint)
    print(f"{out}: {len(folders) - len(refused)} printheads")
    if refused:
        raise ValueError("\ninkjet: ".join(sorted(refused)))


def _written(folder: Path, file: Path, reading: Reading, options: Mapping[str, Any]) -> tuple[Path, str | None]:
    """Identify one campaign in a worker process; its folder, and the error message if it could not be identified."""
    try:
        found = identify_one(folder, reading, options, progress=False)[1]
    except (ValueError, OSError) as error:
        return folder, f"{folder}: {error}" if str(folder) not in str(error) else str(error)
    write_json(file, found.as_json())
    return folder, None
