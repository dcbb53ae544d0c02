"""State of *Recordings*: campaign, how it was read and corrected, models, what identify and diagnose say."""

from __future__ import annotations

import contextlib
import json
import shlex
import shutil
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from inkjet_env.experiments.explore.heads import HeadShelf
from inkjet_env.experiments.explore.job import Job
from inkjet_env.experiments.explore.modelled import Modelled, modelled_by
from inkjet_env.experiments.explore.reading import GUESS, Corrections, Reading
from inkjet_env.naming import check_name
from inkjet_env.recordings import Campaign, CampaignError, check_campaign, write_campaign
from inkjet_env.recordings.roles import ROLES
from inkjet_env.recordings.survey import SurveyedFile

IDENTIFY, DIAGNOSE = "identify", "diagnose"


class RecordingsState:
    """The campaign and what was made of it.

    Parameters
    ----------
    files : Path
        Folder for dropped files, corrected campaigns and results.
    shelf : HeadShelf
        Where identified and corrected heads are put.
    told : callable
        Called, from any thread, when there is something new.
    """

    def __init__(self, files: Path, shelf: HeadShelf, told: Callable[[], object]) -> None:
        self.files, self.shelf, self.told = files, shelf, told
        self.folder: Path | None = None
        self.reading = Reading()
        self.corrections = Corrections()
        self.campaign: Campaign | None = None
        self.surveyed: tuple[SurveyedFile, ...] = ()
        self.warnings: list[str] = []
        self.shown: str = ""
        self.model: str = shelf.chosen
        self.modelled: dict[str, Modelled] = {}
        self.trouble = ""
        self.verdicts: dict[str, str] = {}
        self.job: Job | None = None
        self.busy = ""
        self._thread: threading.Thread | None = None
        self._as_read: Campaign | None = None
        self._written: Campaign | None = None

    def open(self, folder: Path, reading: Reading | None = None) -> None:
        """Read a folder; the page is told when it is read, or why not."""
        if not str(folder).strip() or str(folder) == ".":
            raise ValueError("give the folder of a campaign, or drop its files.")
        self._idle()
        if folder.resolve() != self.folder:
            self._forget()
        self.folder, self.reading = folder.resolve(), reading or Reading()
        self._beside("reading", self._read)

    def drop(self, dropped: Mapping[str, bytes], reading: Reading | None = None) -> None:
        """Read dropped files as one campaign; those dropped before are replaced."""
        self._idle()
        target = self.files / "dropped"
        shutil.rmtree(target, ignore_errors=True)
        target.mkdir(parents=True)
        for name, content in dropped.items():
            file = target / Path(name.replace("\\", "/")).name
            if file.name in ("", ".", ".."):
                raise ValueError(f"a dropped file must have a name; got {name[:40]!r}.")
            file.write_bytes(content)
        self._forget()
        self.open(target, reading)

    def columns_by_recording(self) -> dict[str, tuple[str, ...]]:
        """Names of the columns of each recording's file."""
        if self.campaign is None:
            return {one.name: one.columns for one in self.surveyed}
        sources = self.campaign.sources
        return {one.name: sources[one.name].columns if one.name in sources else () for one in self.campaign.recordings}

    def correct(self, name: str, what: str, value: str) -> None:
        """Correct the column of a role, the channel, the unit or the initial state of a recording.

        Parameters
        ----------
        name : str
            The recording; it need not have been read.
        what : str
            A role such as drive, or channel, unit or initial_state.
        value : str
            Its column, or its value; `GUESS` takes the correction back.

        Raises
        ------
        ValueError
            There is no such recording, column or value, the recordings would be implausible, or a command is under way.
        """
        columns = self.columns_by_recording()
        if name not in columns:
            raise ValueError(f"there is no recording {name[:40]!r}.")
        self._idle()
        before, self.corrections = self.corrections, self.corrections.corrected(name, what, value, columns[name])
        if self._as_read is None or what in ROLES or value == GUESS:
            self.verdicts = {}
            self._beside("reading", self._read)
            return
        try:
            self._check(self._as_read)
        except ValueError:
            self.corrections = before
            raise
        self.verdicts = {}
        self._beside("simulating", self._simulate)

    def show(self, name: str) -> None:
        """Choose the recording that is drawn."""
        if self.campaign is not None and name in [one.name for one in self.campaign.recordings]:
            self.shown = name

    def choose_model(self, name: str) -> None:
        """Choose the head that is drawn beside what was measured."""
        if name not in self.shelf.heads:
            raise ValueError(f"there is no head {name[:40]!r}.")
        self.model = name
        if self.campaign is not None and name not in self.modelled and not self.busy:
            self._beside("simulating", self._simulate)

    def start(self, command: str) -> None:
        """Identify or diagnose the campaign, in a process of its own."""
        check_name("command", command, (IDENTIFY, DIAGNOSE))
        self._idle()
        if self.campaign is None or self.folder is None:
            raise ValueError("there are no recordings yet. Give a folder, or drop files.")
        self.verdicts.pop(command, None)
        self.trouble = ""
        self.files.mkdir(parents=True, exist_ok=True)
        if self._is_written():
            self._begin(command)
        else:
            self._beside("writing", lambda: self._begin(command))

    def write_corrected(self) -> None:
        """Write the corrected recordings as a campaign, unless they are there or nothing is corrected."""
        if self.campaign is not None and not self._is_written():
            write_campaign(self.corrected, self.campaign)
            self._written = self.campaign

    def _begin(self, command: str) -> None:
        self.write_corrected()
        self.job = Job(command, self.arguments(command), lambda: self._job_told(command))

    @property
    def corrected(self) -> Path:
        """Folder of the campaign as corrected; it is written when a command starts."""
        return self.files / "corrected"

    def _is_written(self) -> bool:
        """Whether a command would see the recordings as the page does."""
        there = self._written is self.campaign and self.corrected.is_dir()
        return not self.corrections.by_recording or there

    def command_text(self, command: str) -> str:
        """The command line that gives the same as the page; empty while the corrected recordings are in no folder."""
        if self.folder is None or self.campaign is None or not self._is_written():
            return ""
        return shlex.join(["inkjet", command, *self.arguments(command)])

    def arguments(self, command: str) -> list[str]:
        """Arguments with which the command sees the recordings as the page does, once they are written."""
        assert self.folder is not None
        whole = not self.corrections.by_recording
        source = [str(self.folder), *self.reading.options()] if whole else [str(self.corrected)]
        results = {
            IDENTIFY: ["--out", self._result("identified.json"), "--report", self._result("identification.html")],
            DIAGNOSE: [
                "--json", self._result("diagnosis.json"), "--printhead-out", self._result("corrected.json"),
                "--report", self._result("diagnosis.html"),
            ],
        }  # fmt: skip
        return [*source, *results[command]]

    def stop(self) -> None:
        """Ask the command that runs to end; finished fits are kept, and the next start resumes."""
        if self.job is not None:
            self.job.stop()

    def join(self, timeout_s: float | None = 600.0) -> None:
        """Wait for what runs beside the page: reading and writing, a command, and what follows it."""
        if self._thread is not None:
            self._thread.join(timeout_s)
        if self.job is not None:
            self.job.join(timeout_s)
        if self._thread is not None:
            self._thread.join(timeout_s)

    def close(self) -> None:
        """End what runs, since the server ends."""
        self.stop()
        self.join(20.0)

    def _result(self, name: str) -> str:
        return str(self.files / name)

    def _idle(self) -> None:
        if self.job is not None and self.job.running:
            raise ValueError(f"{self.job.name} is under way. Stop it first.")
        if self.busy:
            raise ValueError(f"the page is {self.busy} the recordings. Wait for it.")

    def _beside(self, what: str, work: Callable[[], None]) -> None:
        """Do something slow in a thread; what it refuses becomes `trouble`."""

        def done() -> None:
            try:
                work()
            except (ValueError, OSError, FloatingPointError) as error:
                self.trouble = str(error)
            self.busy = ""
            self.told()

        self.busy, self.trouble = what, ""
        self._thread = threading.Thread(target=done, daemon=True, name=what)
        self._thread.start()

    def _read(self) -> None:
        assert self.folder is not None
        try:
            found = self.reading.campaign(self.folder, self.corrections)
            self._check(found)
        except ValueError:  # is told; the headers show what can be corrected, if they can be read
            surveyed: tuple[SurveyedFile, ...] = ()
            with contextlib.suppress(ValueError, OSError):
                surveyed = self.reading.survey(self.folder, self.corrections)
            self._forget_samples(surveyed)
            raise
        self._as_read, self.surveyed = found, ()
        self._simulate()

    def _forget(self) -> None:
        """Other files than before are read."""
        self.corrections, self.verdicts = Corrections(), {}
        self._forget_samples()

    def _forget_samples(self, surveyed: tuple[SurveyedFile, ...] = ()) -> None:
        """There are no recordings, but what was surveyed."""
        self.campaign, self._as_read, self.surveyed = None, None, surveyed
        self.modelled, self.warnings = {}, []

    def _check(self, as_read: Campaign) -> None:
        """Apply the corrections of labels, and look for what is implausible."""
        recordings = tuple(self.corrections.applied(one) for one in as_read.recordings)
        campaign = replace(as_read, recordings=recordings)
        findings = check_campaign(campaign, None)
        if errors := [str(one) for one in findings if one.level == "error"]:
            raise CampaignError(errors[0])
        self.campaign, self.modelled, self.warnings = campaign, {}, [str(one) for one in findings]
        names = [one.name for one in recordings]
        self.shown = self.shown if self.shown in names else ""

    def _simulate(self) -> None:
        """Simulate the recordings with the head that is chosen."""
        assert self.campaign is not None
        self.model = self.model if self.model in self.shelf.heads else self.shelf.chosen
        modelled = modelled_by(self.shelf.heads[self.model], self.campaign)
        self.modelled[self.model] = modelled
        self.shown = self.shown or modelled.clearest

    def _job_told(self, command: str) -> None:
        job = self.job
        if job is not None and not job.running:
            if job.status == 0:
                self.verdicts[command] = next((line for line in job.out.splitlines() if line.strip()), "")
                self._take_head("identified.json" if command == IDENTIFY else "corrected.json")
            elif job.stopped:
                self.trouble = f"{command} was interrupted; start it again to go on."
            else:
                lines = [line for line in job.err.splitlines() if line.strip()]
                self.trouble = lines[-1].removeprefix("inkjet: ") if lines else f"{command} failed."
        self.told()

    def _take_head(self, file: str) -> None:
        try:
            head = self.shelf.add(self.files / file)
        except ValueError as error:
            self.trouble = str(error)
            return
        self.modelled.pop(head.name, None)
        self.model = head.name
        self._beside("simulating", self._simulate)

    def verdict(self) -> dict[str, Any] | None:
        """The ``diagnosis/1`` of the last diagnosis of these recordings; None without one."""
        file = self.files / "diagnosis.json"
        if DIAGNOSE not in self.verdicts or not file.exists():
            return None
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return found

    def as_json(self) -> dict[str, Any]:
        """The state as plain JSON values."""
        return {
            "folder": None if self.folder is None else str(self.folder),
            "reading": self.reading.as_json(),
            "corrections": self.corrections.as_json(),
            "shown": self.shown,
            "model": self.model,
            "verdicts": dict(self.verdicts),
        }

    def restore(self, stored: Mapping[str, Any]) -> None:
        """Take what `as_json` wrote, and read the recordings again."""
        self.reading = Reading.from_json(stored["reading"])
        self.corrections = Corrections.from_json(stored["corrections"])
        self.shown, self.model = str(stored["shown"]), str(stored["model"])
        self.verdicts = {str(k): str(v) for k, v in stored["verdicts"].items()}
        if stored["folder"] is not None:
            self.folder = Path(stored["folder"])
            self._beside("reading", self._read)
