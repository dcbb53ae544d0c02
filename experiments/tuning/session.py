"""A tuning session: from a campaign, or from nothing, to a waveform that was checked on the head.

Everything that a step finds is written before the next one begins; a session that is stopped, or waits for recordings,
goes on where it was. Its folder holds ``session.json`` (settings), ``diagnosis-K.json``, ``corrected-K.json`` and
``report-K.html`` of each round, the recordings that were taken (`exchange`), ``proposals.json`` and ``tune.json``.
"""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.tuning.check import Measured, check_request, measured, seen
from inkjet_env.experiments.tuning.drop_signal import Shown
from inkjet_env.experiments.tuning.exchange import Exchange
from inkjet_env.experiments.tuning.proposals import Proposal, best_of, head_to_use, nearby, proposal, proposals
from inkjet_env.identification import identify
from inkjet_env.mismatch import clear_checkpoint, diagnose
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.head_ensemble import ensemble_of
from inkjet_env.printhead import Bounds, DriverLimits, PeakCost, Printhead
from inkjet_env.printhead.printhead_json import printhead_data
from inkjet_env.printhead.window import DEFAULT_WINDOW_S, check_window
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.reporting.diagnosis_report import diagnosis_html
from inkjet_env.rig import Request, battery_within, default_battery
from inkjet_env.storage import json_text, stored_object, write_atomically

FORMAT, SESSION_FORMAT = "tune/1", "tune-session/1"
SETTINGS, PROPOSALS, RESULT, LOG = "session.json", "proposals.json", "tune.json", "log.md"
NAMES = {
    "robust": "heads that the recordings leave possible",
    "fit": "corrected head",
    "base": "base model",
    "refined": "corrected head, moved by what a check has shown",
}
"""What each proposal is the best waveform of, in words."""
BATTERY = "battery"
"""Beginning of the names of a first campaign's recordings."""


@dataclass(frozen=True)
class TuneSettings:
    """What a session is asked for.

    Parameters
    ----------
    most_requests : int
        Largest number of different recordings that are asked for to tell rival effects apart.
    most_refinements : int
        Largest number of further waveforms that are checked, each near the best one so far.
    risk : {"mean", "cvar", "worst"}
        How a waveform is judged on the heads that the recordings leave possible.
    budget, searches : int
        Evaluations of each search for a waveform, and number of searches of each objective.
    seed : int
        Seed of all random numbers.
    frequency_Hz : float
        Expected resonance, in hertz, for the drives of a first campaign.
    limits : DriverLimits
        What the driver can do.
    cost : PeakCost
        The cost of a response.
    window_s : float
        Time after the start within which peaks count, in seconds.
    """

    most_requests: int = 3
    most_refinements: int = 2
    risk: str = "cvar"
    budget: int = 2000
    searches: int = 3
    seed: int = 0
    frequency_Hz: float = 50e3
    limits: DriverLimits = field(default_factory=DriverLimits)
    cost: PeakCost = field(default_factory=PeakCost)
    window_s: float = DEFAULT_WINDOW_S

    def __post_init__(self) -> None:
        Bounds(limits=self.limits)  # refused before any work if no waveform is within them
        if math.isinf(check_window(self.window_s)):
            raise ValueError("a waveform is checked within a finite window, such as 350e-6 s.")

    def as_json(self) -> dict[str, Any]:
        """The settings as plain JSON values."""
        cost = {"A": self.cost.A, "B": self.cost.B, "effective": self.cost.effective}
        return asdict(self) | {"limits": self.limits.as_json(), "cost": cost}


@dataclass(frozen=True, eq=False)
class Tuned:
    """The end of a session.

    Attributes
    ----------
    proposals : tuple of Proposal
        Waveforms that were checked on the head.
    checks : tuple of Measured
        What each cost there.
    best : int
        Index of the one to fire.
    recordings : int
        Number of recordings that were taken in the session, checks among them.
    rounds : tuple of dict
        Verdict, headline and requests of each diagnosis; those beyond the limit were not made.
    seconds : float
        Time that the steps of this process took.
    head : Printhead or AugmentedPrinthead
        Head that predicted.
    """

    proposals: tuple[Proposal, ...]
    checks: tuple[Measured, ...]
    best: int
    recordings: int
    rounds: tuple[Mapping[str, Any], ...]
    seconds: float
    head: Printhead | AugmentedPrinthead

    def as_json(self) -> dict[str, Any]:
        """The result as ``tune/1``."""
        best, check = self.proposals[self.best], self.checks[self.best]
        tried = [
            asdict(tried) | {"measured_V": one.cost_V, "error_V": one.error_V, "worst_V": one.worst_V}
            for tried, one in zip(self.proposals, self.checks, strict=True)
        ]
        return {
            "format": FORMAT,
            "waveform": list(best.waveform),
            "of": best.name,
            "predicted_V": best.predicted_V,
            "measured_V": check.cost_V,
            "error_V": check.error_V,
            "worst_V": check.worst_V,
            "tried": tried,
            "rounds": [dict(one) for one in self.rounds],
            "recordings": self.recordings,
            "seconds": self.seconds,
        }


class Session:
    """One tuning session in its folder.

    Parameters
    ----------
    folder : Path
        Folder of the session; created if missing.
    settings : TuneSettings
        What is asked for.
    exchange : Exchange
        How recordings are taken.
    campaign : Campaign, optional
        Recordings that exist already; without them the default battery is recorded first.
    progress : callable
        Told what is being done.
    workers : int
        Number of processes of a diagnosis.

    Raises
    ------
    ValueError
        The folder holds a session with other settings, or of another campaign.
    """

    def __init__(
        self,
        folder: Path,
        settings: TuneSettings,
        exchange: Exchange,
        campaign: Campaign | None = None,
        progress: Callable[[str], None] = lambda _: None,
        workers: int = 2,
    ) -> None:
        self.folder, self.settings, self.exchange = folder, settings, exchange
        self.given, self.progress, self.workers = campaign, progress, workers
        folder.mkdir(parents=True, exist_ok=True)
        asked = {"format": SESSION_FORMAT, "settings": settings.as_json(), "campaign": _digest(campaign)}
        stored = self._stored(SETTINGS)
        if stored is not None and stored != json.loads(json_text(asked)):
            raise ValueError(
                f"{folder} holds a session with other settings or of another campaign. Repeat them, or give another "
                "folder with --out."
            )
        self._write(SETTINGS, asked)

    def run(self) -> Tuned:
        """All steps in order, but for those that were done before.

        Raises
        ------
        WaitingError
            Recordings are still to be taken.
        """
        begin_s = time.monotonic()
        campaign = self._first()
        rounds = []
        asked = 0
        for number in itertools.count():
            found = self._diagnosed(campaign, number, self.settings.most_requests - asked)
            rounds.append(found["round"])
            if not found["requests"]:
                break
            campaign = self._with(campaign, self._obtain(requests_of_round(found["requests"], asked)))
            asked += len(found["requests"])
        base = self._base(number, campaign)
        head = head_to_use(printhead_data(self.folder / f"corrected-{number}.json"), base)
        problem, fit = self._problem(number, head)
        waveforms = self._proposed(problem, base, fit)
        while True:
            shown, checks = self._checked(waveforms, head)
            more = sum(one.name == "refined" for one in waveforms)
            point = nearby(problem, shown, checks) if more < self.settings.most_refinements else None
            if point is None:
                break
            waveforms = (*waveforms, proposal(problem, "refined", point))
            self._write(PROPOSALS, {"proposals": [asdict(one) for one in waveforms]})
        best = best_of(checks)
        for one, check in zip(waveforms, checks, strict=True):
            self._log(
                f"The best waveform of the {NAMES[one.name]} costs {check.cost_V:.3f} ± {check.error_V:.3f} V on the "
                f"head, at worst {check.worst_V:.3f} V; predicted were {one.predicted_V:.3f} V."
            )
        self._log(f"To fire: the best waveform of the {NAMES[waveforms[best].name]}.")
        tuned = Tuned(
            waveforms, checks, best, len(self.exchange.recorded), tuple(rounds), round(time.monotonic() - begin_s, 1),
            head,
        )  # fmt: skip
        self._write(RESULT, tuned.as_json())
        return tuned

    @property
    def rounds(self) -> tuple[Mapping[str, Any], ...]:
        """What each finished diagnosis told (``round``) and asked for (``request``, or None)."""
        found: list[Mapping[str, Any]] = []
        while (stored := self._stored(f"round-{len(found)}.json")) is not None:
            found.append(stored)
        return tuple(found)

    @property
    def waveforms(self) -> tuple[Proposal, ...]:
        """Waveforms to try; none before they were searched for."""
        stored = self._stored(PROPOSALS) or {"proposals": []}
        return tuple(Proposal(**{**one, "waveform": tuple(one["waveform"])}) for one in stored["proposals"])

    def _first(self) -> Campaign:
        """The campaign that the session begins with."""
        if self.given is not None:
            return self.given
        requests = []
        for line in battery_within(default_battery(self.settings.frequency_Hz), self.settings.limits):
            first = f"{BATTERY}-{line.channel}-{line.label}"
            for k in range(line.repeats):
                name, of = (first, None) if k == 0 else (f"{first}-{k + 1}", first)
                requests.append(
                    Request(
                        name, line.channel, line.initial_state, line.step_s, line.drive_V, False, line.excitation, of,
                        line.purpose,
                    )
                )  # fmt: skip
        return Campaign("tune", self._obtain(requests))

    def _obtain(self, requests: list[Request]) -> tuple[Recording, ...]:
        before = 0 if self.given is None else max(r.order for r in self.given.recordings)
        return self.exchange.obtain(requests, before + 1, self.progress)

    @staticmethod
    def _with(campaign: Campaign, more: tuple[Recording, ...]) -> Campaign:
        return replace(campaign, recordings=(*campaign.recordings, *more), sources={})

    def _diagnosed(self, campaign: Campaign, number: int, most_requests: int) -> dict[str, Any]:
        """Verdict and next requests of a round, from its files if it was done before."""
        file = f"round-{number}.json"
        if (stored := self._stored(file)) is not None:
            return stored
        fits = self.folder / f"fits-{number}"

        def tell(text: str) -> None:
            self.progress(f"diagnosis {number + 1}: {text}")

        first = self._stored("round-0.json")
        found = diagnose(
            campaign, None, rng=np.random.default_rng(self.settings.seed), workers=self.workers, progress=tell,
            checkpoint=fits, held_out=first["held_out"] if first else None,
        )  # fmt: skip
        following = [one for one in found.next_experiments if one.drive_V]
        requests = [
            one.as_json(None) | {"drive_V": list(one.drive_V), "neighbour_V": list(one.neighbour_V) or None}
            for one in following[:most_requests]
        ]
        self._write(f"diagnosis-{number}.json", found.as_json())
        self._write(f"corrected-{number}.json", found.augmented_json())
        write_atomically(self.folder / f"report-{number}.html", diagnosis_html(found))
        ids = [effect.effect.id for effect in found.effects]
        told = {
            "verdict": found.verdict,
            "headline": found.headline,
            "effects": ids,
            "candidates": [list(group) for group in found.candidates],
            "recordings": len(campaign.recordings),
            "asked": [one.sentence for one in following],
        }
        self._log(f"Diagnosis {number + 1}, of {len(campaign.recordings)} recordings: {found.headline}")
        for one in requests:
            self._log(f"Asked for: {one['sentence']}")
        whole = [r.name for r in found.recordings if r.fitted == 0]  # what is asked for is to be fitted
        self._write(file, {"round": told, "requests": requests, "held_out": whole or None})  # last: the round is done
        clear_checkpoint(fits)
        return self._stored(file) or {}

    def _base(self, number: int, campaign: Campaign) -> Printhead:
        """The base model, identified without any effect."""
        file = f"base-{number}.json"
        if self._stored(file) is None:
            self._write(file, identify(campaign, progress=self.progress).as_json())
        return Printhead.from_json(self.folder / file)

    def _problem(self, number: int, head: Printhead | AugmentedPrinthead) -> tuple[Problem, Mapping[str, Any]]:
        """What the waveform is searched for, and how well the last diagnosis fits."""
        settings = self.settings
        data = printhead_data(self.folder / f"corrected-{number}.json")
        limits = settings.limits if settings.limits != DriverLimits() else None
        problem = Problem(
            "tune", head, settings.cost, Bounds(limits=limits), window_s=settings.window_s,
            ensemble=ensemble_of(data), risk=settings.risk,
        )  # fmt: skip
        return problem, data["fit"]

    def _checked(
        self, waveforms: Sequence[Proposal], head: Printhead | AugmentedPrinthead
    ) -> tuple[list[Shown], tuple[Measured, ...]]:
        """What the recording of each waveform shows beyond the prediction, and what each costs."""
        window_s = self.settings.window_s
        requests = [
            check_request(name_of_check(k, one), one.as_waveform, head.frequency_Hz, window_s)
            for k, one in enumerate(waveforms, start=1)
        ]
        taken = zip(self._obtain(requests), waveforms, strict=True)
        shown = [seen(recording, one.as_waveform, head, window_s) for recording, one in taken]
        return shown, tuple(measured(one, head, self.settings.cost, window_s) for one in shown)

    def _proposed(self, problem: Problem, base: Printhead, fit: Mapping[str, Any]) -> tuple[Proposal, ...]:
        """Waveforms to try, from their file if they were found before."""
        if known := self.waveforms:
            return known
        settings = self.settings
        found = proposals(problem, base, fit, settings.budget, settings.searches, settings.seed, self.progress)
        for one in found:
            self._log(
                f"Proposed: the best waveform of the {NAMES[one.name]}, predicted to cost {one.predicted_V:.3f} V "
                f"(90 % of the heads that the recordings leave possible: {one.low_V:.3f} to {one.high_V:.3f} V)."
            )
        self._write(PROPOSALS, {"proposals": [asdict(one) for one in found]})
        return found

    def _stored(self, name: str) -> dict[str, Any] | None:
        file = self.folder / name
        if not file.exists():
            return None
        try:
            return stored_object(file)
        except ValueError as error:
            raise ValueError(f"{file}: is damaged: {error}. Remove it to have that step done again.") from None

    def _log(self, sentence: str) -> None:
        """Add a sentence to the session's log, once."""
        file = self.folder / LOG
        lines = file.read_text(encoding="utf-8") if file.exists() else "# Tuning session\n\n"
        if f" {sentence}\n" not in lines:
            write_atomically(file, f"{lines}* {time.strftime('%Y-%m-%d %H:%M')} {sentence}\n")

    def _write(self, name: str, value: Any) -> None:
        write_atomically(self.folder / name, json_text(value))


def name_of_check(number: int, proposal: Proposal) -> str:
    """Name of the recording that checks the waveform ``number`` (1, 2, 3)."""
    return f"check-{number}-{proposal.name}"


def _digest(campaign: Campaign | None) -> str | None:
    """SHA-256 of a campaign's recordings; None without one."""
    if campaign is None:
        return None
    total = sha256()
    for recording in campaign.recordings:
        total.update(f"{recording.name} {recording.channel} {recording.initial_state} {recording.step_s!r}\n".encode())
        for samples in (recording.drive_V, recording.sensor, recording.drive_monitor_V, recording.neighbour_V):
            total.update(b"none" if samples is None else samples.tobytes())
    return total.hexdigest()


def requests_of_round(asked: Sequence[Mapping[str, Any]], before: int) -> list[Request]:
    """The requests of a round: each drive as often as it is to be recorded; ``before`` were asked for earlier."""
    found = []
    for number, one in enumerate(asked, start=before + 1):
        first = f"request-{number}"
        neighbour_V = None if one["neighbour_V"] is None else np.array(one["neighbour_V"])
        found += [
            Request(
                first if k == 0 else f"{first}-{k + 1}", one["channel"], one["initial_state"], one["step_s"],
                np.array(one["drive_V"]), bool(one["drive_monitor"]), "arbitrary", None if k == 0 else first,
                one["sentence"], neighbour_V,
            )
            for k in range(int(one["repeats"]))
        ]  # fmt: skip
    return found
