"""The HTML page of a tuning session: the waveform to fire or the recordings to take, and what was done so far."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from inkjet_env.cli.drive_csv import waveform_files
from inkjet_env.experiments.tuning.check import Measured, averaged, expected_V
from inkjet_env.experiments.tuning.figures import check_figure, check_picture, request_figure, waveforms_figure
from inkjet_env.experiments.tuning.session import LOG, NAMES, Session, Tuned, name_of_check, requests_of_round
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.wording import CHANNEL_WORDS
from inkjet_env.printhead import Printhead
from inkjet_env.printhead.printhead_json import printhead_data
from inkjet_env.recordings import Recording
from inkjet_env.reporting.diagnosis_report import VERDICT_WORDS
from inkjet_env.reporting.formatting import short
from inkjet_env.reporting.page import page_environment
from inkjet_env.reporting.plotting import time_scale
from inkjet_env.reporting.zoomable import Picture
from inkjet_env.rig import Request
from inkjet_env.storage import write_atomically

SURE = 2.0
"""Standard errors beyond which a difference between two costs is told without a reservation."""
BEYOND_NOISE = 2.0
"""RMS of a check's residual over its noise beyond which the prediction is said to be wrong."""
STATES = {"periodic": "repeated until settled", "demagnetised": "once, from rest, demagnetised"}
PURPOSES = {"battery": "first campaign", "request": "asked for by a diagnosis", "check": "checks of waveforms"}
"""What recordings of a session are for, by the beginning of their names."""


def write_page(
    path: Path, session: Session, name: str, tuned: Tuned | None = None, requests: Sequence[Request] = ()
) -> None:
    """Write the page of a session: one self-contained HTML file.

    Parameters
    ----------
    path : Path
        The file.
    session : Session
        The session.
    name : str
        Name of what was tuned.
    tuned : Tuned, optional
        The session's end; None while it waits.
    requests : sequence of Request
        Recordings that it waits for.

    Raises
    ------
    OSError
        The folder is missing or not writable.
    """
    folder = quote(os.path.relpath(session.folder.resolve(), path.resolve().parent))
    write_atomically(path, page_html(session, name, tuned, requests, folder))


def page_html(
    session: Session, name: str, tuned: Tuned | None = None, requests: Sequence[Request] = (), folder: str = "."
) -> str:
    """The page as HTML text; ``folder`` is the session's folder as links from the page name it."""
    environment = page_environment("inkjet_env.experiments.tuning")
    environment.filters |= {"state": STATES.__getitem__, "time": time_text}
    recorded = session.exchange.recorded
    return environment.get_template("tuning.html").render(
        name=name,
        headline=headline(tuned) if tuned is not None else waiting_headline(requests),
        sentences=[] if tuned is None else sentences(tuned),
        tuned=tuned,
        pictures=[] if tuned is None else [chosen_picture(session, tuned, recorded)],
        head_file=session.folder / f"corrected-{len(session.rounds) - 1}.json",
        corrected=tuned is not None and isinstance(tuned.head, AugmentedPrinthead),
        settings=session.settings.as_json(),
        waveforms=None if tuned is None else waveforms_figure(tuned, session.settings),
        tried=tried(session, tuned, recorded),
        requests=requests,
        drives=[(names, one.purpose, request_figure(one)) for names, one in distinct(requests)],
        rounds=rounds(session, recorded),
        recordings=recording_rows(session, recorded),
        log=log_rows(session.folder / LOG),
        files={} if tuned is None else waveform_files(tuned.proposals[tuned.best].as_waveform),
        place=session.folder,
        folder=folder,
        verdicts=VERDICT_WORDS,
        names=NAMES,
    )


def headline(tuned: Tuned) -> str:
    """The waveform to fire, and its cost on the head against that of the base model's, in one line."""
    best, check = tuned.proposals[tuned.best], tuned.checks[tuned.best]
    first_V, second_V, *times_s = best.waveform
    fire = (
        f"fire U1 = {first_V:.4g} V, U2 = {second_V:.4g} V, t1 … t5 = {', '.join(f'{1e6 * t:.4g}' for t in times_s)} "
        f"µs; it costs {check.cost_V:.3f} ± {check.error_V:.3f} V on the head"
    )
    base = next((k for k, one in enumerate(tuned.proposals) if one.name == "base"), None)
    if base is None:
        return f"{fire}, and the best waveform of the base model is practically the same"
    if base == tuned.best:
        return f"{fire}, and no other waveform that was checked costs less than this one, the base model's"
    gain_V = tuned.checks[base].cost_V - check.cost_V
    error_V = math.hypot(check.error_V, tuned.checks[base].error_V)
    return (
        f"{fire}, {gain_V:.3f} ± {error_V:.3f} V less than the base model's waveform"
        f"{'' if gain_V > SURE * error_V else ', a difference that may be noise'}"
    )


def waiting_headline(requests: Sequence[Request]) -> str:
    """What a session that is not at its end waits for."""
    return f"the session waits for {len(requests)} {'recording' if len(requests) == 1 else 'recordings'}"


def sentences(tuned: Tuned) -> list[str]:
    """What else is to be known about the chosen waveform."""
    best, check = tuned.proposals[tuned.best], tuned.checks[tuned.best]
    said = [
        f"It is the best waveform of the {NAMES[best.name]}. Predicted were {best.predicted_V:.3f} V; on 90 % of the "
        f"heads that the recordings leave possible, {best.low_V:.3f} to {best.high_V:.3f} V. The lower a cost, the "
        f"better. If small peaks count that the noise may hide, it costs {check.worst_V:.3f} V at worst."
    ]
    over_noise = check.residual_V / max(check.noise_V, 1e-300)
    wrong = ": the prediction is wrong, and the cost may be off by more than its error"
    said.append(
        f"Its recording differs from the prediction by {short(over_noise)} times the noise (RMS)"
        f"{wrong if over_noise > BEYOND_NOISE else ''}."
    )
    if tuned.rounds[-1]["verdict"] in ("set", "unknown"):
        said.append(f"The diagnosis is not settled: {tuned.rounds[-1]['headline']}")
    return said


def tried(session: Session, tuned: Tuned | None, recorded: Sequence[Recording]) -> list[dict[str, Any]]:
    """Each proposal with what its check showed, as far as the session is."""
    by_name = {recording.name: recording for recording in recorded}
    rows = []
    for k, one in enumerate(session.waveforms if tuned is None else tuned.proposals):
        check: Measured | None = None
        figure = None
        if tuned is not None:
            check, window_s = tuned.checks[k], session.settings.window_s
            taken = by_name[name_of_check(k + 1, one)]
            frequency_Hz = tuned.head.frequency_Hz
            taken = averaged(taken, one.as_waveform, frequency_Hz, window_s)
            predicted_V = expected_V(taken, one.as_waveform, tuned.head, frequency_Hz, window_s)
            figure = check_figure(taken, predicted_V, check, window_s)
        rows.append(
            {"proposal": one, "chosen": tuned is not None and k == tuned.best, "check": check, "figure": figure}
        )
    return rows


def chosen_picture(session: Session, tuned: Tuned, recorded: Sequence[Recording]) -> Picture:
    """The check of the chosen waveform, measured and as each head predicted it."""
    number, proposal = tuned.best + 1, tuned.proposals[tuned.best]
    taken = next(one for one in recorded if one.name == name_of_check(number, proposal))
    window_s = session.settings.window_s
    waveform, frequency_Hz = proposal.as_waveform, tuned.head.frequency_Hz
    taken = averaged(taken, waveform, frequency_Hz, window_s)
    heads: dict[str, Printhead | AugmentedPrinthead] = {"augmented": tuned.head}
    base = session.folder / f"base-{len(session.rounds) - 1}.json"
    if isinstance(tuned.head, AugmentedPrinthead) and base.exists():
        heads = {"base": Printhead.from_json(base), **heads}
    predicted = {which: expected_V(taken, waveform, head, frequency_Hz, window_s) for which, head in heads.items()}
    return check_picture(taken, predicted, tuned.checks[tuned.best], window_s)


def distinct(requests: Sequence[Request]) -> list[tuple[str, Request]]:
    """Requests with different drives, each with the names of all that have its drive."""
    groups: dict[tuple[float, bytes], list[Request]] = {}
    for request in requests:
        groups.setdefault((request.step_s, request.drive_V.tobytes()), []).append(request)
    return [(", ".join(one.name for one in group), group[0]) for group in groups.values()]


def rounds(session: Session, recorded: Sequence[Recording]) -> list[dict[str, Any]]:
    """Each diagnosis with its fit, and its requests with what came back."""
    found: list[dict[str, Any]] = []
    before = 0
    for number_, stored in enumerate(session.rounds):
        fit: Mapping[str, Any] = printhead_data(session.folder / f"corrected-{number_}.json")["fit"]
        asked = []
        for one in stored["requests"]:
            requests = requests_of_round([one], before)
            before += 1
            names = {request.name for request in requests}
            answers = [recording for recording in recorded if recording.name in names]
            asked.append(
                {
                    "request": requests[0],
                    "repeats": len(requests),
                    "answers": answers,
                    "figure": request_figure(requests[0], answers) if answers else None,
                }
            )
        found.append(
            {
                "told": stored["round"],
                "effects": effects_of(stored["round"]),
                "rms_V": [fit.get(f"{of}_V") for of in ("noise_rms", "base_heldout_rms", "augmented_heldout_rms")],
                "asked": asked,
                "not_asked": stored["round"]["asked"][len(asked) :],
            }
        )
    return found


def effects_of(told: Mapping[str, Any]) -> list[str]:
    """Effects of a diagnosis, and its groups of candidates that the recordings cannot distinguish, in words."""
    groups = told["candidates"]
    sure = [effect for effect in told["effects"] if not any(effect in group for group in groups)]
    return sure + [f"one of {', '.join(group)}" for group in groups]


def recording_rows(session: Session, recorded: Sequence[Recording]) -> list[tuple[str, str, int, int, float]]:
    """What recordings are for, their sensor, how many, their samples and their length in seconds."""
    given = () if session.given is None else session.given.recordings
    labelled = [("campaign that was there", one) for one in given]
    labelled += [(PURPOSES[one.name.partition("-")[0]], one) for one in recorded]
    groups: dict[tuple[str, str], list[Recording]] = {}
    for purpose, one in labelled:
        groups.setdefault((purpose, CHANNEL_WORDS[one.channel]), []).append(one)
    return [
        (*key, len(group), sum(r.sensor.size for r in group), sum(r.sensor.size * r.step_s for r in group))
        for key, group in groups.items()
    ]


def time_text(time_s: float, digits: int = 6) -> str:
    """A time in the unit that suits it, with at most ``digits`` significant digits.

    Examples
    --------
    >>> time_text(2e-7), time_text(0.0104719755), time_text(124.3, 3)
    ('0.2 µs', '10.472 ms', '124 s')
    """
    seconds, unit = time_scale(time_s)
    return f"{time_s / seconds:.{digits}g} {unit}"


def log_rows(file: Path) -> list[tuple[str, str]]:
    """Times and sentences of a session's log."""
    if not file.exists():
        return []
    lines = [line[2:] for line in file.read_text(encoding="utf-8").splitlines() if line.startswith("* ")]
    return [(line[:16], line[17:]) for line in lines]
