"""What else one could do about a mismatch, on the same cases: python -m experiments.validation.baselines.compare.

Each peer is fitted to the recordings that the diagnosis fits, runs freely, and is judged on the recordings that the
diagnosis holds out, by the RMS of what it leaves, in standard deviations of the noise, over all channels.

base
    The base model refitted, nothing added; its branch law of the published degree, which all peers stand on. Names
    nothing.
base, as diagnosed
    The base model that the diagnosis compares its own with: its law has as many powers as the recordings seem to ask
    for, which is more where something is left out, and then predicts less well.
pysindy
    A sparse polynomial of degree 3 in deflection ``x``, scaled speed ``p = x'/ω0`` and hysteretic drive ``v``, and the
    drive's rate ``w = v'/ω0``, as a further force on the resonator (of ``v`` and ``w``, as a further signal, for a
    strain gauge); by pysindy's library and STLSQ. Every term goes through the base model's resonator before the
    regression, so that noise is never differentiated. The threshold is the sparsest that predicts recordings put
    aside, each once, no worse than the best one does, within a standard error of the logarithm. What it names is read
    from its terms:

    ======================  =================================================================================
    terms                   what they say
    ======================  =================================================================================
    1, x, p, v              base parameters: nothing
    x³, x p²                stiffness changes with amplitude: cubic_stiffness
    p³, x² p                damping changes with amplitude: quadratic_damping
    one of each of these    ferroelastic_softening
    v²                      positive and negative drives differ: asymmetric_hysteresis
    w                       late, or with a part of the rate: amplifier_bandwidth, sensor_bandwidth, trigger_delay or
                            feedthrough
    others                  nothing that the catalogue has a name for
    ======================  =================================================================================
narx
    A neural network on the base model's signal, the drive and the hysteretic drive, now and before, added to the base
    model's signal; stopped where it predicts recordings put aside best. Names nothing.
flexible
    The ridge regression by which the diagnosis tells whether anything is left. Names nothing.
diagnosis
    The model with the effects that were found, or the base model where none was.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from experiments.validation.baselines.base_fit import base_fit, base_of, over_noise, put_aside
from experiments.validation.baselines.narx import with_network
from experiments.validation.baselines.sindy import said, sparse_force
from experiments.validation.diagnosis_study import Case, cases, recorded, verdict_record
from experiments.validation.synthetic_campaigns import effect_named
from inkjet_env.mismatch import Diagnosis, diagnose
from inkjet_env.mismatch.selection.discrepancy_regression import discrepancy_regression
from inkjet_env.mismatch.selection.hypotheses import base_hypothesis
from inkjet_env.progress import shown_progress
from inkjet_env.recordings import Campaign, read_campaign
from inkjet_env.reporting.tables import print_table
from inkjet_env.storage import write_json

PEERS = ("base", "base, as diagnosed", "pysindy", "narx", "flexible", "diagnosis")


def verdict_on(groups: Sequence[Sequence[str]], truth: Sequence[str]) -> str:
    """right, in the set, among others, wrong or nothing: of what was said, where one effect or none is there."""
    if not groups:
        return "nothing" if truth else "right"
    if not any(set(truth) & set(group) for group in groups):
        return "wrong"
    if len(groups) > 1:
        return "among others"
    return "right" if len(groups[0]) == 1 else "in the set"


def compared(campaign: Campaign, found: Diagnosis, seed: int) -> dict[str, Any]:
    """Each peer's held-out RMS over the noise, and what pysindy's terms are."""
    joint = base_fit(campaign, base_of(found, campaign))
    modelled = joint.modelled(joint.base)
    sparse, network = dict(modelled), dict(modelled)
    terms: dict[str, tuple[str, ...]] = {}
    for channel in sorted({recording.channel for recording in found.recordings}):
        if not put_aside(joint, channel)[1]:
            continue  # too few recordings to choose by: nothing is added
        force = sparse_force(joint, channel)
        terms[channel] = force.active
        sparse |= {o.name: force.signal(o) for o in joint.observed if o.channel == channel}
        network |= with_network(joint, channel, seed)
    base = base_hypothesis(joint)
    added = discrepancy_regression(base).modelled
    residuals = [(base.fit.residuals[o.name] - added[o.name])[o.rows(held_out=True)] for o in joint.observed]
    first = next(o for o in joint.observed if o.channel == found.main_channel)
    errors = {
        "base": over_noise(joint, modelled),
        "base, as diagnosed": over_noise(
            joint, {recording.name: recording.modelled["base"] for recording in found.recordings}
        ),
        "pysindy": over_noise(joint, sparse),
        "narx": over_noise(joint, network),
        "flexible": float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))),
        "diagnosis": over_noise(
            joint, {recording.name: recording.modelled["augmented"] for recording in found.recordings}
        ),
    }
    return {
        "over_noise": {peer: error if math.isfinite(error) else None for peer, error in errors.items()},
        "noise_rms": joint.noise.models[first.noise_key].rms,
        "noise_known": joint.noise.known(first),
        "unit": first.unit,
        "terms": {channel: list(names) for channel, names in terms.items()},
    }


def told_of(subject: Case | Path) -> dict[str, Any]:
    """Record a planted case, or read measured recordings whose truth nobody knows; diagnose, and let the peers try."""
    if isinstance(subject, Path):
        return _told(read_campaign(subject), None, 0)
    return _told(recorded(subject)[0], subject.effects, subject.seed)


def _told(campaign: Campaign, truth: Sequence[str] | None, seed: int) -> dict[str, Any]:
    found = diagnose(campaign, rng=seed, workers=1)
    row = compared(campaign, found, seed)
    groups = said([term for terms in row["terms"].values() for term in terms])
    verdict = {
        "verdict": found.verdict,
        "found": [e.effect.id for e in found.effects],
        "candidates": [list(group) for group in found.candidates],
    }
    row |= {"name": campaign.name if truth is None else "+".join(truth) or "nothing", "diagnosis": verdict}
    row["said"] = [list(group) for group in groups]
    if truth is not None:
        right = {"diagnosis": verdict_record({"effects": truth} | verdict).judged, "pysindy": verdict_on(groups, truth)}
        row["judged"] = {peer: right.get(peer, verdict_on((), truth)) for peer in PEERS}
    return row


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Over the cases with an effect: median RMS over noise, and how often each peer said what."""
    mine = [row for row in rows if "judged" in row and row["name"] != "nothing"]
    peers = PEERS if mine else ()
    return {
        "cases": len(mine),
        "median": {p: float(np.median([_error(row, p) for row in mine])) for p in peers},
        "judged": {p: dict(Counter(row["judged"][p] for row in mine)) for p in peers},
    }


def _error(row: Mapping[str, Any], peer: str) -> float:
    """Infinite where a model has no signal."""
    error = row["over_noise"][peer]
    return math.inf if error is None else error


def print_rows(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print a line a case, and what they come to."""
    lines = []
    for row in rows:
        names = "; ".join(" or ".join(group) for group in row["said"]) or "-"
        verdict = row["diagnosis"]
        verdict_record = " + ".join(verdict["found"]) or verdict["verdict"]
        count = sum(len(terms) for terms in row["terms"].values())
        judgement = row.get("judged", {})
        lines.append(
            (
                row["name"],
                *(f"{_error(row, p):.3g}" for p in PEERS),
                f"{names} ({count} terms): {judgement.get('pysindy', '')}",
                f"{verdict_record}: {judgement.get('diagnosis', '')}",
            )
        )
    whole = summary(rows)
    if whole["cases"]:
        lines.append((f"median of {whole['cases']}", *(f"{whole['median'][p]:.3g}" for p in PEERS), "", ""))
    print("Held-out RMS over the noise, free run; where nothing tells the noise, over what most fitted samples show:")
    print_table(("planted", *PEERS, "pysindy says", "diagnosis says"), lines)
    for row in rows:
        if not row["noise_known"]:
            print(f"{row['name']}: 1 stands for {row['noise_rms']:.4g} {row['unit']} of the fast channel.")
    for peer, counts in whole["judged"].items():
        print(f"{peer}: " + ", ".join(f"{count} {word}" for word, count in counts.items()))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    effects = [case.effects[0] for case in cases("single", 1) if case.strength == "strong"]
    names = ["nothing", *(name for name in effects if not effect_named(name).random)]
    parser.add_argument("planted", nargs="*", metavar="EFFECT", help="only these; all, and nothing, unless given")
    parser.add_argument("--folder", type=Path, action="append", default=[], help="of measured recordings")
    parser.add_argument("--json", type=Path, help="write the table there too")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    given = parser.parse_args(arguments)
    if find_spec("pysindy") is None:
        parser.error('pysindy is not installed; it comes with the development extra: pip install -e ".[dev]".')
    for name in given.planted:
        if name not in names:
            parser.error(f"EFFECT must be one of {', '.join(names)}; got {name!r}.")
    subjects: list[Case | Path] = list(given.folder)
    for name in given.planted or names:
        subjects.append(Case("null", (), "none", 0) if name == "nothing" else Case("single", (name,), "strong", 0))
    rows = []
    with ProcessPoolExecutor(given.workers) as pool, shown_progress("cases", len(subjects)) as shown:
        for row in pool.map(told_of, subjects):
            rows.append(row)
            shown(len(rows), row["name"])
    print_rows(rows)
    if given.json is not None:
        write_json(given.json, {"format": "diagnosis-peers/1", "cases": rows, "summary": summary(rows)})


if __name__ == "__main__":
    main()
