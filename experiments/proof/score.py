"""The score of a proof: every figure with its criterion for a first-rate diagnosis, and the data behind it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.experiments.execution.provenance import code_digest, versions
from inkjet_env.experiments.proof.calibration import calibration_error, calibration_rows, reliability
from inkjet_env.experiments.proof.corpus import IDS
from inkjet_env.experiments.proof.criteria import GOALS, Figure, Goals, counted, estimated, finite
from inkjet_env.experiments.proof.sealing import JUDGE_SOURCES
from inkjet_env.experiments.validation.verdict_scores import OUTCOMES, VerdictRecord, confusion, f1

if TYPE_CHECKING:
    from inkjet_env.experiments.proof.protocol import Outcome

SCORE_FORMAT = "proof-score/1"
ALARMS = ("named", "set", "unknown")
CLEAR = ("strong", "medium")
"""Strengths of the effects over which the main figures are computed."""
PLACES = ("recordings", "time", "frequency", "drive")
LEAST_CALIBRATED = 50
"""Cases from which the calibration error is judged: of fewer, it exceeds its limit by chance."""
LEAST_INTERVALS = 5
"""Number of intervals of an effect from which on its own coverage counts."""
LEAST_ORACLE = 0.01
"""Smallest gain of the head's own optimum that can be shared, as a fraction of the base model's peak cost."""
NEVER_RIGHT = "outside the catalogue"

Case = Mapping[str, Any]


def verdict_record(case: Case) -> VerdictRecord:
    """The verdict on a case, with the truth."""
    draw, verdict = case["draw"], case["answer"]["verdict"]
    truth = frozenset(draw["effects"]) if draw["family"] in ("effect", "pair") else frozenset[str]()
    if draw["family"] in ("outside", "base"):
        truth = frozenset([NEVER_RIGHT])
    if verdict is None:
        return VerdictRecord(truth, "refused", frozenset())
    found = frozenset(effect["id"] for effect in verdict["effects"])
    return VerdictRecord(truth, verdict["verdict"], found, tuple(frozenset(group) for group in verdict["candidates"]))


def score(outcome: Outcome) -> dict[str, Any]:
    """The ``proof-score/1``: figures, curve, confusion matrix, closures, waveform gains, baselines and misses."""
    cases = outcome.cases
    manifest = outcome.manifest
    version = manifest["version"]
    figures = table(cases, version)
    seconds = [case["run"]["cpu_seconds"] for case in cases]
    return {
        "format": SCORE_FORMAT,
        **{name: manifest[name] for name in ("version", "seed", "profile", "published", "code", "versions")},
        "judge": outcome.judge or {"code": code_digest(JUDGE_SOURCES), "versions": versions()},
        "truth_sha256": manifest["truth_sha256"],
        "answers_sha256": outcome.answers["answers_sha256"],
        "cases": len(cases),
        "figures": [figure.as_json() for figure in figures],
        "short": [figure.name for figure in figures if figure.met is False],
        "curve": curve(cases),
        "confusion": matrix(cases, IDS[version]),
        "closures": closures(cases),
        "parameters": parameters(cases),
        "coverage": coverage(cases),
        "noise": alarms_by_noise(cases),
        "calibration": reliability(calibration_rows(cases)),
        "waveform_gain": waveform_gains(cases),
        "baselines": baselines_tried(cases),
        "misses": misses(cases),
        "cpu_seconds": {"median": float(np.median(seconds)), "most": max(seconds), "sum": float(sum(seconds))},
    }


def of(
    cases: Sequence[Case], family: str, strengths: Sequence[str] = (), meagre: bool = False, slow_only: bool = False
) -> list[Case]:
    """The cases of a family with some strengths (all if none is given)."""
    return [
        case
        for case in cases
        if case["draw"]["family"] == family
        and case["draw"]["meagre"] == meagre
        and case["draw"].get("slow_only", False) == slow_only
        and (not strengths or case["draw"]["strength"] in strengths)
    ]


def alarm(case: Case) -> bool:
    """Whether the verdict reports any mismatch."""
    return verdict_record(case).verdict in ALARMS


def right(case: Case) -> bool:
    """Whether the truth was named or is in the set given."""
    return verdict_record(case).judged in ("right", "in the set")


def wrong(case: Case) -> bool:
    """Whether effects were named of which none is present."""
    return verdict_record(case).judged == "wrong"


def table(cases: Sequence[Case], version: int) -> list[Figure]:
    """All figures, in the order of the report, with the criteria of a version of the corpus."""
    goals = GOALS[version]
    null, clear, faint = of(cases, "null"), of(cases, "effect", CLEAR), of(cases, "effect", ["faint"])
    outside, base, pairs = of(cases, "outside"), of(cases, "base"), of(cases, "pair")
    meagre = [case for case in cases if case["draw"]["meagre"]]
    said = [verdict_record(case) for case in clear]
    sizes = [float(set_size(one)) for one in said if one.verdict in ("named", "set")]
    closed = [row["closure"] for row in closures(cases)]
    held_out = [
        value
        for case in clear
        if (value := _held_out_closure(case)) is not None and verdict_record(case).verdict in ("named", "set")
    ]
    known, heads = parameters(cases), waveform_gains(cases)["heads"]
    shares = [
        _share_of_oracle_gain([head])
        for head in heads
        if head["base"] - head["oracle"] > LEAST_ORACLE * abs(head["base"])
    ]
    hidden_meagre = [case for case in meagre if case["draw"]["family"] != "null"]
    return [
        counted("false alarms where nothing is concealed", [alarm(c) for c in null], most=goals.alarms),
        counted("detected, strong and medium", [alarm(c) for c in clear], least=goals.detected),
        counted("right name or right set", [right(c) for c in clear], least=goals.right),
        counted("right name alone", [verdict_record(c).judged == "right" for c in clear]),
        counted("partly right: another effect named as well", [verdict_record(c).judged == "partly" for c in clear]),
        estimated("mean size of a set", sizes, mean, most=goals.size),
        counted("confidently wrong, inside the catalogue", [wrong(c) for c in clear], most=goals.wrong),
        counted("confidently wrong, outside the catalogue", [wrong(c) for c in outside], most=goals.wrong_outside),
        counted(
            "outside the catalogue, reported as unknown",
            [verdict_record(c).verdict == "unknown" for c in outside],
            least=goals.unknown,
        ),
        counted("outside the catalogue, detected", [alarm(c) for c in outside]),
        estimated("median closure on fresh drives", closed, _median, least=goals.closure),
        estimated("10th percentile of that closure", closed, _tenth, least=goals.tenth_closure),
        estimated("median closure as the diagnosis reports it", held_out, _median),
        estimated("F1 of two effects at once", [verdict_record(c) for c in pairs], f1, least=goals.f1),
        counted("90 % intervals that contain the truth", [bool(row["inside"]) for row in known], least=0.85, most=0.95),
        estimated("median error of a parameter", [row["error"] for row in known], _median, kind="share"),
        *(_located(clear, place, getattr(goals, place, None)) for place in PLACES),
        counted("detected, faint", [alarm(c) for c in faint]),
        counted("confidently wrong, faint", [wrong(c) for c in faint]),
        counted("another hysteresis law: an effect named", [wrong(c) for c in base]),
        counted("meagre campaigns: false alarms", [alarm(c) for c in meagre if c["draw"]["family"] == "null"]),
        counted("meagre campaigns: right name or right set", [right(c) for c in of(cases, "effect", meagre=True)]),
        counted("meagre campaigns: confidently wrong", [wrong(c) for c in hidden_meagre]),
        counted("refused or failed", [c["answer"]["verdict"] is None for c in cases]),
        estimated(
            "fraction of the oracle's gain achieved, all heads together", heads, _share_of_oracle_gain, kind="share"
        ),
        estimated("median fraction of the oracle's gain achieved, per head", shares, _median, kind="share"),
        *(_later(cases, goals) if version >= 2 else ()),
    ]


def _later(cases: Sequence[Case], goals: Goals) -> list[Figure]:
    """Figures that version 1 did not have."""
    by_noise, by_effect = alarms_by_noise(cases), coverage(cases)
    known = {name: row for name, row in by_effect.items() if len(row) >= LEAST_INTERVALS}
    loudest = max(by_noise.values(), key=lambda row: sum(row) / len(row), default=[])
    worst = min(known.values(), key=lambda row: sum(row) / len(row), default=[])
    slow = [case for case in cases if case["draw"].get("slow_only", False)]
    hidden = of(cases, "effect", slow_only=True)
    told = calibration_rows(cases)
    calibrated = goals.calibration if len(told) >= LEAST_CALIBRATED else None
    return [
        counted("false alarms, worst kind of noise", loudest),
        counted("90 % intervals that contain the truth, worst effect", worst, least=goals.worst_coverage),
        estimated("expected calibration error", told, calibration_error, most=calibrated),
        counted("slow-only campaigns: false alarms", [alarm(c) for c in slow if c["draw"]["family"] == "null"]),
        counted("slow-only campaigns: right name or right set", [right(c) for c in hidden]),
    ]


def coverage(cases: Sequence[Case]) -> dict[str, list[bool]]:
    """By effect, whether each of its parameters' intervals contains the truth."""
    rows: dict[str, list[bool]] = {}
    for row in parameters(cases):
        rows.setdefault(row["effect"], []).append(bool(row["inside"]))
    return dict(sorted(rows.items()))


def alarms_by_noise(cases: Sequence[Case]) -> dict[str, list[bool]]:
    """By kind of noise, whether each case with nothing concealed raised an alarm."""
    rows: dict[str, list[bool]] = {}
    for case in of(cases, "null"):
        if noise := case["draw"].get("noise"):
            rows.setdefault(noise, []).append(alarm(case))
    return dict(sorted(rows.items()))


def mean(values: Sequence[float]) -> float:
    """Mean of several values."""
    return float(np.mean(values))


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))


def _tenth(values: Sequence[float]) -> float:
    return float(np.percentile(values, 10))


def set_size(one: VerdictRecord) -> int:
    """Number of effects in the largest candidate group of a verdict; 1 for a named effect."""
    return max([1, *(len(group) for group in one.candidates)]) if one.verdict == "set" else 1


def _held_out_closure(case: Case) -> float | None:
    verdict = case["answer"]["verdict"]
    return None if verdict is None else verdict["fit"]["closure"]


def _located(cases: Sequence[Case], place: str, least: float | None) -> Figure:
    hits = [hit for case in cases if (hit := case["judged"]["location"].get(place)) is not None]
    return counted(f"located: {place}", hits, least=least)


def closures(cases: Sequence[Case]) -> list[dict[str, Any]]:
    """Closure on fresh drives for every strong or medium effect that shows there."""
    return [
        {
            "effect": case["draw"]["effects"][0],
            "strength": case["draw"]["strength"],
            "judged": verdict_record(case).judged,
            "closure": case["judged"]["closure"],
        }
        for case in of(cases, "effect", CLEAR)
        if case["judged"]["closure"] is not None
    ]


def parameters(cases: Sequence[Case]) -> list[dict[str, Any]]:
    """Parameters of correctly found effects in physical units: truth, estimate, interval, relative error."""
    rows = []
    for case in of(cases, "effect", CLEAR):
        for row in case["judged"]["parameters"]:
            low = -math.inf if row["low"] is None else row["low"]
            high = math.inf if row["high"] is None else row["high"]
            rows.append(
                row
                | {
                    "strength": case["draw"]["strength"],
                    "inside": low <= row["truth"] <= high,
                    "error": abs(row["value"] / row["truth"] - 1),
                }
            )
    return rows


def curve(cases: Sequence[Case]) -> list[dict[str, Any]]:
    """Detection rate against strength; the first point has nothing concealed."""
    rows = []
    for label, mine in (
        ("nothing", of(cases, "null")),
        *((strength, of(cases, "effect", [strength])) for strength in ("faint", "medium", "strong")),
    ):
        if mine:
            reached = [case["truth"].get("rho") or 0.0 for case in mine]
            rows.append(
                {
                    "strength": label,
                    "rho": float(np.median(reached)),
                    "detected": counted("detected", [alarm(c) for c in mine]).as_json(),
                    "right": counted("right name or set", [right(c) for c in mine]).as_json()
                    if label != "nothing"
                    else None,
                }
            )
    return rows


def matrix(cases: Sequence[Case], ids: Sequence[str]) -> dict[str, dict[str, int]]:
    """Confusion matrix, concealed against verdict: nothing, strong and medium effects, outside families, other laws."""
    mine = [verdict_record(case) for case in (*of(cases, "null"), *of(cases, "effect", CLEAR))]
    rows = confusion(mine, list(ids))
    for case in (*of(cases, "outside"), *of(cases, "base")):
        row = rows.setdefault(case["draw"]["effects"][0], dict.fromkeys((*ids, *OUTCOMES), 0))
        row[verdict_record(case).column] += 1
    return rows


def waveform_gains(cases: Sequence[Case]) -> dict[str, Any]:
    """Peak costs on the concealed plant of the waveforms optimised on base model, augmented model and plant itself.

    The oracle's cost is the lowest of the three: a search on the plant that ends above another model's waveform has not
    found the plant's optimum.
    """
    heads = []
    for case in cases:
        if found := case["judged"].get("reoptimised"):
            best = min(found[name] for name in ("base", "augmented", "oracle"))
            about = {"effects": case["draw"]["effects"], "strength": case["draw"]["strength"]}
            heads.append({**about, **found, "oracle": best})
    return {"heads": heads, "share": finite(_share_of_oracle_gain(heads))}


def _share_of_oracle_gain(heads: Sequence[Mapping[str, Any]]) -> float:
    """Gain of the augmented model's waveforms over the base model's, as a fraction of the oracle's, over all heads."""
    gain = sum(head["base"] - head["augmented"] for head in heads)
    oracle = sum(head["base"] - head["oracle"] for head in heads)
    return gain / oracle if oracle > 0 else math.nan


def baselines_tried(cases: Sequence[Case]) -> dict[str, Any]:
    """Median held-out RMS over the noise and judgements of each baseline, over the cases on which they were tried.

    ``same`` is the number of cases in which the repeated diagnosis gave the same verdict.
    """
    rows = [case["judged"]["baselines"] for case in cases if case["judged"].get("baselines")]
    names = list(rows[0]["over_noise"]) if rows else []
    errors = {
        name: [math.inf if row["over_noise"][name] is None else row["over_noise"][name] for row in rows]
        for name in names
    }
    judged: dict[str, dict[str, int]] = {}
    for row in rows:
        for name, word in row["judged"].items():
            counts = judged.setdefault(name, {})
            counts[word] = counts.get(word, 0) + 1
    return {
        "cases": len(rows),
        "same": sum(row["same"] for row in rows),
        "median_over_noise": {name: finite(float(np.median(values))) for name, values in errors.items()},
        "judged": judged,
    }


def misses(cases: Sequence[Case]) -> list[dict[str, Any]]:
    """Every case whose verdict differs from the truth, for inspection."""
    rows = []
    for case in cases:
        draw, one = case["draw"], verdict_record(case)
        fine = right(case) or (draw["family"] in ("outside", "base") and one.verdict == "unknown")
        fine = fine or (draw["family"] in ("base",) and one.verdict == "none")
        if not fine:
            verdict = case["answer"]["verdict"]
            said = "+".join(sorted(one.found)) or (verdict["headline"] if verdict else case["answer"]["sentence"])
            rows.append(
                {
                    "name": case["name"],
                    "number": draw["number"],
                    "concealed": "+".join(draw["effects"]) or "nothing",
                    "strength": draw["strength"] + _recordings(draw),
                    "verdict": one.verdict,
                    "said": said,
                }
            )
    return rows


def _recordings(draw: Mapping[str, Any]) -> str:
    return ", meagre" if draw["meagre"] else ", slow only" if draw.get("slow_only", False) else ""
