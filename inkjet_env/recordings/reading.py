"""Reading of a measuring campaign from a folder of either layout."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path

from inkjet_env.recordings.campaign import Campaign
from inkjet_env.recordings.data_package import DESCRIPTOR, read_data_package
from inkjet_env.recordings.oscilloscope import read_scope_folder
from inkjet_env.recordings.recording import CHANNELS, INITIAL_STATES, CampaignError, brief, check_label


def read_campaign(
    folder: str | os.PathLike[str],
    *,
    columns: Mapping[str, str | int] | None = None,
    channel: str | None = None,
    initial_state: str | None = None,
    interval_s: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Campaign:
    """Read a measuring campaign: a Data Package, or a folder of an instrument's files.

    Parameters
    ----------
    folder : str or Path
        Folder of the campaign. Its `datapackage.json`, if there is one, describes the recordings; otherwise each
        ``*.csv``, ``*.txt``, ``*.npz``, ``*.mat`` … file is one, see `inkjet_env.recordings.instrument_file`.
    columns : mapping, optional
        Column of each role, if the names in the files do not show it: ``time``, ``drive``, ``sensor``, ``monitor`` and
        ``neighbour``, each by the column's name or by its number from 1.
    channel : {"self_sensing", "strain_gauge", "displacement"}, optional
        Recorded sensor, if nothing in the folder says so.
    initial_state : {"demagnetised", "periodic", "free"}, optional
        Initial state of the head, if nothing in the folder says so; ``free`` by default. ``periodic``: the drive has
        been repeated, and one repetition is recorded.
    interval_s : float, optional
        Sampling interval in seconds, for files that hold neither times nor an interval.
    progress : callable, optional
        Called with the name of each recording, in words, before it is read.

    Returns
    -------
    Campaign
        The recordings; its ``notes`` say how the columns were understood.

    Raises
    ------
    CampaignError
        Anything is missing, damaged or contradictory; one sentence names the file, the row, the rule and a fix.
    """
    folder = Path(folder)
    for label, given, known in (("channel", channel, CHANNELS), ("initial_state", initial_state, INITIAL_STATES)):
        try:
            check_label(label, known[0] if given is None else given, known)
        except ValueError as error:
            raise CampaignError(str(error)) from None
    if columns is not None and not isinstance(columns, Mapping):
        raise CampaignError(f"columns must map roles to columns, such as {{'drive': 'CH1'}}; got {brief(columns)}.")
    if not folder.is_dir():
        raise CampaignError(
            f"{folder}: must be a folder; there is {'a file' if folder.exists() else 'none'}. Check it."
        )
    if (folder / DESCRIPTOR).exists():
        return read_data_package(folder, columns, channel, initial_state, progress)
    return read_scope_folder(folder, columns or {}, channel, initial_state or "free", interval_s, progress)
