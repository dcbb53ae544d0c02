"""State of *Recordings*: campaign, how it was read and corrected, models, what identify and diagnose say."""

from __future__ import annotations

import json
import shutil
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from inkjet_env.cli.arguments import named_values
from inkjet_env.experiments.explore.heads import HeadShelf, NamedHead
from inkjet_env.experiments.explore.job import Job
from inkjet_env.identification import Evaluation, evaluate
from inkjet_env.identification.agreement import agreement_sentence, agreements
from inkjet_env.naming import check_name
from inkjet_env.recordings import Campaign, CampaignError, Recording, check_campaign, read_campaign, write_campaign
from inkjet_env.recordings.recording import CHANNELS, INITIAL_STATES, SENSOR_COLUMNS

CORRECTABLE = {"channel": CHANNELS, "unit": tuple(SENSOR_COLUMNS), "initial_state": INITIAL_STATES}
"""What can be corrected of a recording, and to what."""
IDENTIFY, DIAGNOSE = "identify", "diagnose"


@dataclass(frozen=True)
class Reading:
    """How files are read, where nothing in the folder says so.

    Parameters
    ----------
    columns : str
        Column of each role, as ``time=NAME,drive=NAME,sensor=NAME``; empty to guess.
    channel, initial_state : str
        Channel and initial state of all files; empty to guess.
    interval_s : float or None
        Sampling interval in seconds, for files without times.
    """

    columns: str = ""
    channel: str = ""
    initial_state: str = ""
    interval_s: float | None = None

    def campaign(self, folder: Path) -> Campaign:
        """Read the campaign of a folder."""
        columns = named_values("columns", self.columns) if self.columns.strip() else None
        return read_campaign(
            folder, columns=columns, channel=self.channel or None, initial_state=self.initial_state or None,
            interval_s=self.interval_s,
        )  # fmt: skip

    def options(self) -> list[str]:
        """The same as options of a command."""
        pairs = (
            ("--columns", self.columns.strip()), ("--channel", self.channel), ("--initial-state", self.initial_state),
            ("--interval", "" if self.interval_s is None else f"{self.interval_s!r}"),
        )  # fmt: skip
        return [part for option, value in pairs if value for part in (option, value)]


@dataclass(frozen=True, eq=False)
class Modelled:
    """A campaign beside its simulation by one head.

    Attributes
    ----------
    evaluations : dict of str to Evaluation
        By recording.
    noise_rms : dict of str to float
        Standard deviation of the noise by recording, in its unit; NaN where nothing shows it.
    differs : dict of str to bool
        Whether the residual is more than noise and tolerance.
    sentence : str
        Whether it is the same head.
    """

    evaluations: Mapping[str, Evaluation]
    noise_rms: Mapping[str, float]
    differs: Mapping[str, bool]
    sentence: str


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
        self.corrections: dict[str, dict[str, str]] = {}
        self.campaign: Campaign | None = None
        self.warnings: list[str] = []
        self.shown: str = ""
        self.model: str = shelf.chosen
        self.modelled: dict[str, Modelled] = {}
        self.trouble = ""
        self.verdicts: dict[str, str] = {}
        self.job: Job | None = None
        self.busy = ""
        self._thread: threading.Thread | None = None
        self._whole: Campaign | None = None

    def open(self, folder: Path, reading: Reading | None = None) -> None:
        """Read a folder; the page is told when it is read, or why not."""
        if not str(folder).strip() or str(folder) == ".":
            raise ValueError("give the folder of a campaign, or drop its files.")
        self._idle()
        if folder.resolve() != self.folder:
            self.corrections, self.verdicts = {}, {}
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
        self.corrections, self.verdicts = {}, {}
        self.open(target, reading)

    def correct(self, name: str, what: str, value: str) -> None:
        """Correct the channel, the unit or the initial state of a recording."""
        check_name("what is corrected", what, CORRECTABLE)
        check_name(what, value, CORRECTABLE[what])
        if self._whole is None or name not in [one.name for one in self._whole.recordings]:
            raise ValueError(f"there is no recording {name[:40]!r}.")
        self._idle()
        before = {one: dict(values) for one, values in self.corrections.items()}
        self.corrections.setdefault(name, {})[what] = value
        try:
            self._check()
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
        self.job = Job(command, self.arguments(command), lambda: self._job_told(command))

    def arguments(self, command: str) -> list[str]:
        """Arguments with which the command sees the recordings as the page does."""
        folder, reading = self._source()
        results = {
            IDENTIFY: ["--out", self._result("identified.json"), "--report", self._result("identification.html")],
            DIAGNOSE: [
                "--json", self._result("diagnosis.json"), "--printhead-out", self._result("corrected.json"),
                "--report", self._result("diagnosis.html"),
            ],
        }  # fmt: skip
        return [str(folder), *reading, *results[command]]

    def stop(self) -> None:
        """Ask the command that runs to end; finished fits are kept, and the next start resumes."""
        if self.job is not None:
            self.job.stop()

    def join(self, timeout_s: float | None = 600.0) -> None:
        """Wait for what runs beside the page."""
        if self.job is not None:
            self.job.join(timeout_s)
        if self._thread is not None:
            self._thread.join(timeout_s)

    def close(self) -> None:
        """End what runs, since the server ends."""
        self.stop()
        self.join(20.0)

    def _source(self) -> tuple[Path, list[str]]:
        """Folder that a command reads, and options with which; corrected recordings are written there first."""
        assert self.folder is not None
        assert self.campaign is not None
        if not self.corrections:
            return self.folder, self.reading.options()
        target = self.files / "corrected"
        write_campaign(target, self.campaign)
        return target, []

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
        self.campaign, self._whole, self.modelled, self.warnings = None, None, {}, []
        self._whole = self.reading.campaign(self.folder)
        self._check()
        self._simulate()

    def _check(self) -> None:
        """Apply the corrections, and look for what is implausible."""
        assert self._whole is not None
        recordings = tuple(self._corrected(one) for one in self._whole.recordings)
        campaign = replace(self._whole, recordings=recordings)
        findings = check_campaign(campaign, None)
        if errors := [str(one) for one in findings if one.level == "error"]:
            raise CampaignError(errors[0])
        self.campaign, self.modelled, self.warnings = campaign, {}, [str(one) for one in findings]
        names = [one.name for one in recordings]
        self.shown = self.shown if self.shown in names else ""

    def _corrected(self, recording: Recording) -> Recording:
        changes: dict[str, Any] = dict(self.corrections.get(recording.name, {}))
        return replace(recording, **changes) if changes else recording

    def _simulate(self) -> None:
        """Simulate the recordings with the head that is chosen."""
        assert self.campaign is not None
        name = self.model if self.model in self.shelf.heads else self.shelf.chosen
        head, campaign = self.shelf.heads[name], self.campaign
        found, _ = evaluate(campaign, head.head, gains_of(head))
        agreed = agreements(campaign, found, {})
        self.model = name
        modelled = Modelled(
            {one.recording.name: one for one in found},
            {one.name: one.noise_rms for one in agreed},
            {one.name: one.differs for one in agreed},
            agreement_sentence(agreed),
        )
        self.modelled[name] = modelled
        if not self.shown:  # where it shows most
            self.shown = max(
                agreed, key=lambda one: (one.differs, one.share * (one.output_rms > 3 * one.noise_rms))
            ).name

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
        reading = self.reading
        return {
            "folder": None if self.folder is None else str(self.folder),
            "reading": {
                "columns": reading.columns, "channel": reading.channel, "initial_state": reading.initial_state,
                "interval_s": reading.interval_s,
            },
            "corrections": {name: dict(values) for name, values in list(self.corrections.items())},
            "shown": self.shown,
            "model": self.model,
            "verdicts": dict(self.verdicts),
        }  # fmt: skip

    def restore(self, stored: Mapping[str, Any]) -> None:
        """Take what `as_json` wrote, and read the recordings again."""
        reading = stored["reading"]
        interval_s = None if reading["interval_s"] is None else float(reading["interval_s"])
        self.reading = Reading(
            str(reading["columns"]), str(reading["channel"]), str(reading["initial_state"]), interval_s
        )
        self.corrections = {str(n): {str(k): str(v) for k, v in c.items()} for n, c in stored["corrections"].items()}
        self.shown, self.model = str(stored["shown"]), str(stored["model"])
        self.verdicts = {str(k): str(v) for k, v in stored["verdicts"].items()}
        if stored["folder"] is not None:
            self.folder = Path(stored["folder"])
            self._beside("reading", self._read)


def gains_of(head: NamedHead) -> dict[str, float]:
    """Gains of the channels from which a head was identified, in their units per hysteretic volt."""
    fit = head.data.get("fit")
    channels: Mapping[str, Any] = (fit.get("channels") or {}) if isinstance(fit, dict) else {}
    found = {}
    for channel, entry in channels.items():
        value = (entry.get("gain") or {}).get("value")
        if isinstance(value, (int, float)):
            found[channel] = float(value)
    return found


def rate_text(rate_Hz: float) -> str:
    """A sample rate in the unit that suits it.

    Examples
    --------
    >>> rate_text(2e7)
    '20 MHz'
    """
    scale, unit = next(((scale, unit) for scale, unit in ((1e6, "MHz"), (1e3, "kHz")) if rate_Hz >= scale), (1.0, "Hz"))
    return f"{rate_Hz / scale:.4g} {unit}"


def rows(state: RecordingsState) -> Sequence[dict[str, Any]]:
    """The recordings as rows of a table: what was read and guessed, and how the chosen head does."""
    if state.campaign is None:
        return []
    modelled = state.modelled.get(state.model)
    found = []
    for one in state.campaign.recordings:
        source = state.campaign.sources.get(one.name)
        file = "" if source is None else Path(source.file).name
        row: dict[str, Any] = {
            "recording": one.name,
            "file": file if file != f"{one.name}.csv" else "",
            "channel": one.channel,
            "unit": one.unit,
            "initial_state": one.initial_state,
            "samples": one.time_s.size,
            "rate": rate_text(one.sample_rate_Hz),
            "drive_V": f"{one.drive_V.min():.3g} … {one.drive_V.max():.3g}",
            "signal": f"{one.sensor.min():.3g} … {one.sensor.max():.3g}",
            "residual": "",
            "noise": "",
            "": "corrected by you" if one.name in state.corrections else "",
        }
        if modelled is not None:
            noise = modelled.noise_rms[one.name]
            row["residual"] = f"{modelled.evaluations[one.name].rms:.3g}"
            row["noise"] = "–" if noise != noise else f"{noise:.3g}"
            if modelled.differs[one.name]:
                row[""] = " ".join(filter(None, ("differs", row[""] and f"({row['']})")))
        found.append(row)
    return found
