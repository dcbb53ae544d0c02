"""Recordings that a tuning session asks for: taken by a rig at once, or by people through two folders.

``requests/NAME.csv`` holds the drive of each open request, and ``requests/requests.csv`` what to record; the recording
is put into ``answers/`` under the same name, as any file that `read_campaign` reads.
"""

from __future__ import annotations

import csv
import io
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from inkjet_env.cli.drive_csv import write_columns
from inkjet_env.recordings import Campaign, CampaignError, Recording, read_campaign
from inkjet_env.recordings.writing import extend_campaign
from inkjet_env.rig import Request, Rig
from inkjet_env.storage import write_atomically

REQUESTS, ANSWERS, RECORDED = "requests", "answers", "recorded"
LIST = "requests.csv"
COLUMNS = ("name", "channel", "initial_state", "sample_step_s", "samples", "drive_monitor", "purpose")
SAME_DRIVE = 0.05
"""Largest RMS difference between the drive of an answer and the one that was asked for, relative to the latter."""


class WaitingError(Exception):
    """Recordings are still to be taken.

    Attributes
    ----------
    requests : tuple of Request
        The open requests.
    """

    def __init__(self, requests: Sequence[Request]) -> None:
        super().__init__(f"{len(requests)} recordings are to be taken")
        self.requests = tuple(requests)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the open requests."""
        return tuple(request.name for request in self.requests)


@dataclass(frozen=True, eq=False)
class Exchange:
    """Asks for recordings, and keeps those that were taken.

    Parameters
    ----------
    folder : Path
        Folder of the session.
    rig : Rig, optional
        Takes recordings at once; without it they come through the folders.
    columns : mapping, optional
        Columns of each role in the files of `ANSWERS`, as in `read_campaign`.
    """

    folder: Path
    rig: Rig | None = None
    columns: Mapping[str, str] | None = None

    @property
    def recorded(self) -> tuple[Recording, ...]:
        """Recordings that were taken so far, in their order."""
        folder = self.folder / RECORDED
        return read_campaign(folder).recordings if folder.exists() else ()

    def obtain(
        self, requests: Sequence[Request], first_order: int, progress: Callable[[str], None]
    ) -> tuple[Recording, ...]:
        """The recordings of these requests; what is taken is kept at once.

        Parameters
        ----------
        requests : sequence of Request
            What to record.
        first_order : int
            Position within the session of the first recording that was not taken before the session began.
        progress : callable
            Told what is recorded.

        Raises
        ------
        WaitingError
            Without a rig, some are still to be taken; their requests are written.
        CampaignError
            An answer cannot be read, or is not what was asked for.
        """
        have = {recording.name: recording for recording in self.recorded}
        open_requests = []
        for request in requests:
            if request.name in have:
                continue
            order = first_order + len(have)
            if self.rig is not None:
                progress(f"recording {request.name}")
                taken = self.rig.record(request, order)
            elif (file := self._answer(request.name)) is not None:
                taken = self._read(file, request, order)
            else:
                open_requests.append(request)
                continue
            have[request.name] = taken
            self._keep(tuple(have.values()))
        self._write(open_requests)
        if open_requests:
            raise WaitingError(open_requests)
        return tuple(have[request.name] for request in requests)

    def _keep(self, recordings: tuple[Recording, ...]) -> None:
        names = {recording.name for recording in recordings}
        alone = [r if r.repeat_of in names else replace(r, repeat_of=None) for r in recordings]
        extend_campaign(self.folder / RECORDED, Campaign("recorded", tuple(alone)))

    def _answer(self, name: str) -> Path | None:
        folder = self.folder / ANSWERS
        found = sorted(file for file in folder.glob("*") if file.stem == name) if folder.exists() else []
        return found[0] if found else None

    def _read(self, file: Path, request: Request, order: int) -> Recording:
        """The recording in a file, checked against its request."""
        with tempfile.TemporaryDirectory() as alone:  # files of a folder are read together, and these differ
            shutil.copy(file, alone)
            try:
                campaign = read_campaign(
                    alone, columns=self.columns, channel=request.channel, initial_state=request.initial_state
                )
            except CampaignError as error:
                raise CampaignError(str(error).replace(f"{alone}", str(file.parent))) from None
        taken = campaign.recordings[0]
        asked_V = np.interp(taken.time_s - taken.time_s[0], request.time_s, request.drive_V)
        size_V = float(np.sqrt(np.mean(np.square(request.drive_V))))
        apart_V = float(np.sqrt(np.mean(np.square(taken.drive_V - asked_V))))
        if apart_V > SAME_DRIVE * max(size_V, 1e-12):
            raise CampaignError(
                f"{file}: its drive differs from the one that was asked for by {apart_V:.3g} V (RMS). Record "
                f"{self.folder / REQUESTS / request.name}.csv from its first sample on, or remove the file."
            )
        if request.drive_monitor and taken.drive_monitor_V is None:
            raise CampaignError(
                f"{file}: the voltage at the head was asked for too, as a column drive_monitor_V. Add it."
            )
        if request.neighbour_V is not None and taken.neighbour_V is None:
            raise CampaignError(
                f"{file}: the neighbouring channel was to be driven, as its column neighbour_V tells. Drive it, and "
                "keep that column."
            )
        return replace(
            taken, name=request.name, excitation=request.excitation, initial_state=request.initial_state, order=order,
            repeat_of=request.repeat_of,
        )  # fmt: skip

    def _write(self, requests: Sequence[Request]) -> None:
        """Write the open requests, and nothing else, into their folder."""
        folder = self.folder / REQUESTS
        shutil.rmtree(folder, ignore_errors=True)
        if not requests:
            return
        folder.mkdir(parents=True)
        (self.folder / ANSWERS).mkdir(exist_ok=True)
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(COLUMNS)
        for one in requests:
            columns = {"time_s": one.time_s, "drive_V": one.drive_V}
            if one.neighbour_V is not None:
                columns["neighbour_V"] = one.neighbour_V
            write_columns(folder / f"{one.name}.csv", columns)
            monitor = "yes" if one.drive_monitor else "no"
            rows.writerow(
                [one.name, one.channel, one.initial_state, f"{one.step_s:.12g}", one.drive_V.size, monitor, one.purpose]
            )
        write_atomically(folder / LIST, text.getvalue())
