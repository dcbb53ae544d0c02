"""What a user tells about the columns and the sensors of files, of all of them or of single recordings."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from inkjet_env.printhead import nearest_name
from inkjet_env.recordings.instrument_file import Table
from inkjet_env.recordings.recording import CHANNELS, CampaignError, brief, check_label
from inkjet_env.recordings.roles import column_number


@dataclass(frozen=True)
class Wiring:
    """Columns by role, and channels.

    Parameters
    ----------
    columns : mapping of str to str or int
        Column of each role that is told of all files, by name or by number from 1.
    channel : str or None
        Channel of all recordings of which nothing in the folder states it.
    columns_of : mapping of str to mapping
        The same as ``columns``, of single recordings, by their names; it comes before ``columns``.
    channel_of : mapping of str to str
        Channel of single recordings; it comes before ``channel`` and what the folder states.

    Raises
    ------
    CampaignError
        A channel that does not exist, or columns that are no mapping.
    """

    columns: Mapping[str, str | int] = field(default_factory=dict)
    channel: str | None = None
    columns_of: Mapping[str, Mapping[str, str | int]] = field(default_factory=dict)
    channel_of: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for given in (self.columns, *self.columns_of.values()):
            if not isinstance(given, Mapping):
                raise CampaignError(
                    f"columns must map roles to columns, such as {{'drive': 'CH1'}}; got {brief(given)}."
                )
        for channel in (*([] if self.channel is None else [self.channel]), *self.channel_of.values()):
            try:
                check_label("channel", channel, CHANNELS)
            except ValueError as error:
                raise CampaignError(str(error)) from None

    def check_names(self, folder: Path, names: Collection[str]) -> None:
        """Raise a `CampaignError` if something is told of a recording that there is not."""
        for name in (*self.columns_of, *self.channel_of):
            if name not in names:
                raise CampaignError(
                    f"{folder}: has no recording {brief(name)}, of which columns or a channel were given."
                    f"{nearest_name(name[:60], sorted(names))}"
                )

    def columns_for(self, name: str, table: Table) -> dict[str, str | int]:
        """Column of each role that is told of a recording: its own first, then those of all files that remain free."""
        own = self.columns_of.get(name, {})
        taken = {column_number(table, role, column) for role, column in own.items()}
        others = {} if not own else {r: column_number(table, r, c) for r, c in self.columns.items() if r not in own}
        free = {role: c for role, c in self.columns.items() if role not in own and others.get(role) not in taken}
        return {**free, **own}

    def channel_for(self, name: str) -> str | None:
        """Channel that is told of a recording; None if none is."""
        return self.channel_of.get(name, self.channel)
