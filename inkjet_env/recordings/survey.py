"""What can be told of a folder's files before their samples are read, so that it can be corrected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from inkjet_env.recordings.data_package import DESCRIPTOR
from inkjet_env.recordings.instrument_file import Table
from inkjet_env.recordings.instrument_folder import recording_tables
from inkjet_env.recordings.oscilloscope import guessed_channel
from inkjet_env.recordings.recording import CampaignError
from inkjet_env.recordings.roles import named_roles
from inkjet_env.recordings.wiring import Wiring


@dataclass(frozen=True)
class SurveyedFile:
    """One recording of a folder, as far as its file's header shows it.

    Parameters
    ----------
    name : str
        Name that the recording would have.
    file : str
        Path of its file, the first one if there are several.
    columns : tuple of str
        Names of the columns that hold samples.
    roles : mapping of str to str
        Name of the column of each role that was told or is named in the header.
    channel : str or None
        Sensor that was told or that the sensor's column shows.
    problem : str
        Why the roles are not known, in a sentence that names the file; empty if nothing contradicts.
    """

    name: str
    file: str
    columns: tuple[str, ...]
    roles: Mapping[str, str] = field(default_factory=dict)
    channel: str | None = None
    problem: str = ""


def survey_folder(folder: Path, wiring: Wiring, interval_s: float | None = None) -> tuple[SurveyedFile, ...]:
    """The recordings of an instrument's folder, in the order of their files; none of a Data Package, which states them.

    Parameters
    ----------
    folder : Path
        The folder.
    wiring : Wiring
        What was told of its files; of recordings that are not there it is ignored.
    interval_s : float, optional
        Sampling interval in seconds that was told.

    Raises
    ------
    CampaignError
        There is no file of an instrument, or one of them cannot be opened.
    """
    if (folder / DESCRIPTOR).exists():
        return ()
    tables, _ = recording_tables(folder)
    return tuple(_surveyed(name, table, wiring, interval_s) for name, table in tables.items())


def _surveyed(name: str, table: Table, wiring: Wiring, interval_s: float | None) -> SurveyedFile:
    names, units = table.header.names, table.header.units
    columns = tuple(names[i] for i in table.columns)
    channel = wiring.channel_for(name)
    try:
        roles = named_roles(table, wiring.columns_for(name, table), interval_s).columns
    except CampaignError as error:
        return SurveyedFile(name, str(table.file), columns, channel=channel, problem=str(error))
    sensor = roles.get("sensor")
    if channel is None and sensor is not None:
        channel = guessed_channel(names[sensor], units[sensor].base if sensor in units else "V")
    return SurveyedFile(name, str(table.file), columns, {role: names[i] for role, i in roles.items()}, channel)
