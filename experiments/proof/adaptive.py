"""Adaptive rounds after a proof: the concealed rig records what a diagnosis asks for, and the diagnosis is repeated.

A verdict that leaves a set of candidates asks for recordings. Each round continues the campaign by them and diagnoses
the whole anew, as blind as the first time, until one candidate is left, nothing more is asked for, or `MOST_REQUESTS`
different recordings were asked for. As a baseline, as many are drawn at random from the same library of drives.
"""

from __future__ import annotations

import functools
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.experiments.concealed_plant import RIG
from inkjet_env.experiments.execution.cluster import run_each
from inkjet_env.experiments.execution.provenance import code_digest
from inkjet_env.experiments.proof.answering import ConcealedRig, continued_campaign
from inkjet_env.experiments.proof.blind_run import diagnose_blind
from inkjet_env.experiments.proof.campaign_files import ProofError, digest, unpack
from inkjet_env.experiments.proof.concealment import plant_of
from inkjet_env.experiments.proof.corpus import Draw
from inkjet_env.experiments.proof.criteria import Figure, counted, estimated, finite
from inkjet_env.experiments.proof.score import CLEAR, LEAST_ORACLE, mean, of, right, set_size, verdict_record, wrong
from inkjet_env.experiments.proof.sealing import JUDGE_SOURCES, canonical, check_answer, read_json
from inkjet_env.printhead import Bounds
from inkjet_env.progress import shown_progress
from inkjet_env.storage import json_text, write_atomically

if TYPE_CHECKING:
    from inkjet_env.experiments.proof.protocol import Outcome

ADAPTED_FORMAT, ADAPTIVE_FORMAT = "proof-adapted/1", "proof-adaptive/1"
MOST_REQUESTS = 3
WAYS = ("designed", "random")
"""Where requests come from: from the diagnosis, or from its library of drives at random."""
WORSE = 0.02
"""Loss against the base model's waveform that counts, as a fraction of its cost."""
LAGS = ("amplifier_bandwidth", "sensor_bandwidth", "trigger_delay")
"""Effects that differ only far above the resonance."""


def asks(answer: Mapping[str, Any]) -> bool:
    """Whether an answer leaves several candidates, and asks for a recording."""
    return answer["verdict"] is not None and bool(answer["requests"])


def adapt_case(
    name: str,
    case: Mapping[str, Any],
    answer: Mapping[str, Any],
    waveforms: Mapping[str, Any] | None,
    way: str,
    rig: str,
    code: str,
) -> dict[str, Any]:
    """All rounds of one case at a worker.

    Parameters
    ----------
    name : str
        Opaque name of the campaign.
    case : dict
        The case as sealed: draw and attempt.
    answer : dict
        The first answer, from `blind_run.diagnose_blind`.
    waveforms : dict, optional
        Waveforms of `reoptimised_costs` for that answer, if this case's waveform is re-optimised.
    way : {"designed", "random"}
        Where requests come from.
    rig, code : str
        Module of the concealed plant, and the digest of the code.

    Returns
    -------
    dict
        ``rounds``: what was recorded (``requests`` without their drives, and their digest), ``entry`` with the answer;
        ``loop``: the waveform that the closed loop ends with, from `waveform_gain.checked`, if one is asked for.

    Raises
    ------
    ProofError
        The worker has other code.
    """
    if code_digest(JUDGE_SOURCES) != code:
        raise ProofError("the code was changed, here or at a worker. Restart the workers with the same code.")
    draw = Draw.from_json(dict(case["draw"]))
    plant = plant_of(draw, case["attempt"], rig)
    requests: list[Mapping[str, Any]] = []
    rounds: list[dict[str, Any]] = []
    verdict = answer["verdict"]
    held_out = verdict["fit"]["heldout"] if verdict is not None else ()  # what is asked for is to be fitted
    rng = np.random.default_rng([draw.case_seed(case["attempt"]), WAYS.index(way)])
    while asks(answer) and (left := MOST_REQUESTS - sum(len(one["requests"]) for one in rounds)) > 0:
        asked = answer["requests"][:left]
        if way == "random":
            packed = continued_campaign(plant, requests, name, rig)
            asked = random_requests(packed, name, sum(one["repeats"] for one in asked), rng)
        requests.extend(asked)
        packed = continued_campaign(plant, requests, name, rig)
        entry = diagnose_blind(name, packed, packed_digest(packed, name), held_out)
        answer = entry["answer"]
        rounds.append({"requests": [_in_short(one) for one in asked], "entry": entry})
    loop = None
    if waveforms is not None and answer["verdict"] is not None:
        from inkjet_env.experiments.proof.waveform_gain import checked, waveforms_of

        points = {one: Bounds().to_unit(np.array(values)) for one, values in waveforms.items()}
        if rounds:
            points = waveforms_of(answer["base"], answer["augmented"], draw.number)
        order = len(plant.setup.rows) + 1 + sum(one["repeats"] for one in requests)
        loop = checked(answer["base"], answer["augmented"], points, ConcealedRig(plant, rig), order)
    return {"rounds": rounds, "loop": loop}


def packed_digest(packed: bytes, name: str) -> str:
    """SHA-256 of a packed campaign's folder."""
    with tempfile.TemporaryDirectory(prefix="inkjet-conceal-") as scratch:
        unpack(packed, Path(scratch) / name)
        return digest(Path(scratch) / name)


def _in_short(request: Mapping[str, Any]) -> dict[str, Any]:
    """A request with the digest of its drive in place of its samples."""
    drive = sha256(canonical([request["drive_V"], request["neighbour_V"]]).encode()).hexdigest()
    return {name: value for name, value in request.items() if name not in ("drive_V", "neighbour_V")} | {"drive": drive}


def random_requests(packed: bytes, name: str, count: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Requests drawn from the library of drives of a campaign's channels, each with or without a probe at the head."""
    from inkjet_env.identification import identify
    from inkjet_env.mismatch.design.drive_library import benches, library
    from inkjet_env.mismatch.fitting.dataset import observe
    from inkjet_env.mismatch.settings import DesignSettings
    from inkjet_env.recordings import read_campaign

    with tempfile.TemporaryDirectory(prefix="inkjet-conceal-") as scratch:
        unpack(packed, Path(scratch) / name)
        campaign = read_campaign(Path(scratch) / name)
    sensors = [o for o in observe(campaign) if o.channel != "drive_monitor"]
    drives = [
        proposal
        for bench in benches(sensors, identify(campaign).printhead.frequency_Hz, DesignSettings())
        for proposal in library(bench)
    ]
    chosen = []
    for k in rng.integers(len(drives), size=count):
        excitation = drives[k].excitation
        neighbour = excitation.neighbour_V
        chosen.append(
            {
                "sentence": f"Record {excitation.channel} {drives[k].words}.",
                "channel": excitation.channel,
                "initial_state": excitation.initial_state,
                "step_s": excitation.step_s,
                "repeats": 1,
                "drive_monitor": excitation.fast and bool(rng.random() < 0.5),
                "drive_V": excitation.drive_V.tolist(),
                "neighbour_V": None if neighbour is None else neighbour.tolist(),
            }
        )
    return chosen


def adapt(folder: Path, outcome: Outcome, client: Any, step: Callable[..., Any], rig: str = RIG) -> dict[str, Any]:
    """Carry out the rounds of all cases that ask for a recording, both ways, and score them; resumes if stopped.

    Parameters
    ----------
    folder : Path
        Folder of the proof, which gets ``adaptive/WAY/NAME.json`` and ``adaptive.json``.
    outcome : Outcome
        The finished proof.
    client : distributed.Client
        Client of the cluster that does the work.
    step : callable
        `adapt_case`, or one in its place.
    rig : str
        Module of the concealed plant.
    """
    code = code_digest(JUDGE_SOURCES)
    asking = {case["name"]: case for case in outcome.cases if asks(_with_requests(case["answer"], folder))}
    tried = {case["name"]: case for case in outcome.cases if case["judged"].get("reoptimised")}
    taken = {"designed": asking | tried, "random": asking}
    labels = [f"{way}/{name}" for way in WAYS for name in taken[way]]

    def file(label: str) -> Path:
        way, name = label.split("/")
        return folder / "adaptive" / way / f"{name}.json"

    done: dict[str, Any] = {}
    for label in labels:
        if file(label).exists() and (stored := read_json(file(label))).get("code") == code:
            done[label] = stored["adapted"]

    def job(label: str) -> tuple[Any, ...]:
        way, name = label.split("/")
        case = taken[way][name]
        found = case["judged"].get("reoptimised") if way == "designed" else None
        waveforms = None if found is None else found["waveforms"]
        return name, {"draw": case["draw"], "attempt": case["attempt"]}, case["answer"], waveforms, way, rig, code

    jobs = {label: functools.partial(job, label) for label in labels if label not in done}
    with shown_progress("rounds", len(labels), len(done)) as progress:

        def keep(label: str, adapted: dict[str, Any]) -> None:
            for one in adapted["rounds"]:
                manifest = {"campaigns": {one["entry"]["name"]: one["entry"]["campaign"]}}
                check_answer(folder, one["entry"], manifest)
            file(label).parent.mkdir(parents=True, exist_ok=True)
            write_atomically(file(label), json_text({"format": ADAPTED_FORMAT, "code": code, "adapted": adapted}))
            done[label] = json.loads(json_text(adapted))
            progress(len(done), label)

        run_each(client, step, jobs, keep)
    found = adaptive_score(outcome.cases, done)
    write_atomically(folder / "adaptive.json", json_text(found))
    return found


def _with_requests(answer: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    if "requests" not in answer:
        raise ProofError(
            f"the answers in {folder} hold no requests: an earlier version gave them. Start again in another folder."
        )
    return answer


def adaptive_score(cases: Sequence[Mapping[str, Any]], done: Mapping[str, Any]) -> dict[str, Any]:
    """The ``proof-adaptive/1``: figures before and after the rounds, for all strong and medium effects and for lags.

    Parameters
    ----------
    cases : sequence of dict
        Cases of the proof.
    done : mapping
        Result of `adapt_case` by ``WAY/NAME``.
    """
    groups = {"strong and medium": of(cases, "effect", CLEAR), "lags": [c for c in of(cases, "effect") if _lag(c)]}
    figures: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for group, mine in groups.items():
        figures[group] = {"before": [figure.as_json() for figure in _figures(mine)]}
        for way in WAYS:
            after = [_after(case, done.get(f"{way}/{case['name']}")) for case in mine]
            figures[group][way] = [figure.as_json() for figure in _figures(after)]
    rows = []
    for label, adapted in done.items():
        way, name = label.split("/")
        case = next(case for case in cases if case["name"] == name)
        rows.append(
            {
                "name": name,
                "way": way,
                "number": case["draw"]["number"],
                "effects": case["draw"]["effects"],
                "family": case["draw"]["family"],
                "strength": case["draw"]["strength"],
                "before": _said(case),
                "rounds": [
                    {
                        "asked": [one["sentence"] for one in made["requests"]],
                        "recordings": sum(one["repeats"] for one in made["requests"]),
                        "said": _said({**case, "answer": made["entry"]["answer"]}),
                    }
                    for made in adapted["rounds"]
                ],
            }
        )
    heads = []
    for case in cases:
        adapted = done.get(f"designed/{case['name']}")
        if adapted and adapted["loop"]:
            costs = {name: case["judged"]["reoptimised"][name] for name in ("base", "augmented", "robust", "oracle")}
            costs["loop"] = adapted["loop"]["cost"]
            costs["oracle"] = min(costs.values())
            about = {"effects": case["draw"]["effects"], "rounds": len(adapted["rounds"])}
            heads.append(about | costs | {"chosen": adapted["loop"]["chosen"], "verdict": _said(case)["judged"]})
    return {
        "format": ADAPTIVE_FORMAT,
        "most_requests": MOST_REQUESTS,
        "figures": figures,
        "cases": rows,
        "waveforms": {"heads": heads, "gains": gains(heads)},
    }


def gains(heads: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float | None]]:
    """Gain over the base model's waveforms of those of the corrected heads, of the robust ones and of the closed loop.

    Returns
    -------
    dict
        By way: fraction of what the oracles gain, all volts together (``share``) and of the median head (``median``);
        number of heads that are worse off than with the base model's waveform by more than `WORSE` (``worse``), and
        the largest such loss as a fraction of the base model's cost (``worst``).
    """
    found = {}
    for way in ("augmented", "robust", "loop"):
        could = [head["base"] - head["oracle"] for head in heads]
        did = [head["base"] - head[way] for head in heads]
        losses = [-gain / abs(head["base"]) for gain, head in zip(did, heads, strict=True)]
        each = [a / b for a, b, head in zip(did, could, heads, strict=True) if b > LEAST_ORACLE * abs(head["base"])]
        found[way] = {
            "share": finite(sum(did) / sum(could)) if sum(could) > 0 else None,
            "median": finite(float(np.median(each))) if each else None,
            "worse": sum(loss > WORSE for loss in losses),
            "worst": max([0.0, *losses]),
        }
    return found


def _lag(case: Mapping[str, Any]) -> bool:
    return case["draw"]["effects"][0] in LAGS


def _after(case: Mapping[str, Any], adapted: Mapping[str, Any] | None) -> dict[str, Any]:
    """A case with its last answer, and the number of recordings that led to it."""
    if not adapted or not adapted["rounds"]:
        return dict(case)
    count = sum(one["repeats"] for made in adapted["rounds"] for one in made["requests"])
    return {**case, "answer": adapted["rounds"][-1]["entry"]["answer"], "recordings": count}


def _said(case: Mapping[str, Any]) -> dict[str, Any]:
    one = verdict_record(case)
    return {"verdict": one.verdict, "judged": one.judged, "effects": sorted(one.found), "size": set_size(one)}


def _figures(cases: Sequence[Mapping[str, Any]]) -> list[Figure]:
    said = [verdict_record(case) for case in cases]
    sizes = [float(set_size(one)) for one in said if one.verdict in ("named", "set")]
    return [
        counted("left as a set", [one.verdict == "set" for one in said]),
        counted("right name or right set", [right(case) for case in cases]),
        counted("right name alone", [one.judged == "right" for one in said]),
        counted("confidently wrong", [wrong(case) for case in cases]),
        estimated("mean size of a set", sizes, mean),
        estimated("recordings asked for, per case", [case.get("recordings", 0) for case in cases], mean),
    ]
