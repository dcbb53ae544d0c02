"""Reading of a measuring campaign from a folder of either layout."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path

from inkjet_env.recordings.campaign import Campaign
from inkjet_env.recordings.data_package import DESCRIPTOR, read_data_package
from inkjet_env.recordings.oscilloscope import read_scope_folder
from inkjet_env.recordings.recording import INITIAL_STATES, CampaignError, check_label
from inkjet_env.recordings.wiring import Wiring


def read_campaign(
    folder: str | os.PathLike[str],
    *,
    columns: Mapping[str, str | int] | None = None,
    channel: str | None = None,
    initial_state: str | None = None,
    interval_s: float | None = None,
    columns_of: Mapping[str, Mapping[str, str | int]] | None = None,
    channel_of: Mapping[str, str] | None = None,
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
    columns_of : mapping of str to mapping, optional
        The same as ``columns``, of single recordings by their names: files of one folder may be wired differently.
    channel_of : mapping of str to str, optional
        Recorded sensor of single recordings, whatever the folder says.
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
    try:
        check_label("initial_state", INITIAL_STATES[0] if initial_state is None else initial_state, INITIAL_STATES)
    except ValueError as error:
        raise CampaignError(str(error)) from None
    wiring = Wiring({} if columns is None else columns, channel, columns_of or {}, channel_of or {})
    if not folder.is_dir():
        raise CampaignError(
            f"{folder}: must be a folder; there is {'a file' if folder.exists() else 'none'}. Check it."
        )
    if (folder / DESCRIPTOR).exists():
        return read_data_package(folder, wiring, initial_state, progress)
    return read_scope_folder(folder, wiring, initial_state or "free", interval_s, progress)
