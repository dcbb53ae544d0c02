"""Baselines for a mismatch compared on the same cases: python -m inkjet_env.experiments.validation.baselines.compare.

Each baseline is fitted to the recordings that the diagnosis fits, runs freely, and is judged on the recordings that
the diagnosis holds out, by the RMS of its residuals in standard deviations of the noise, over all channels.

base
    The refitted base model without additions. Its branch law has the published degree, as for all baselines. It names
    no effect.
base, as diagnosed
    The base model to which the diagnosis compares its own. Its law has the degree that the recordings seem to require,
    which is higher if an effect is missing; it then predicts less well.
pysindy
    A sparse polynomial of degree 3 in deflection ``x``, scaled velocity ``p = x'/ω0`` and hysteretic drive ``v``, plus
    the drive's rate ``w = v'/ω0``, as an additional force on the resonator (for a strain gauge, a polynomial in ``v``
    and ``w`` as an additional signal); from pysindy's library and STLSQ. Every term passes through the base model's
    resonator before the regression, so that noise is never differentiated. The threshold is the sparsest whose
    prediction of recordings put aside, each once, is no worse than the best, within one standard error of the
    logarithm. The named effects are read from the terms:

    ======================  =================================================================================
    terms                   meaning
    ======================  =================================================================================
    1, x, p, v              base parameters: no effect
    x³, x p²                stiffness changes with amplitude: cubic_stiffness
    p³, x² p                damping changes with amplitude: quadratic_damping
    one of each of these    ferroelastic_softening
    v²                      positive and negative drives differ: asymmetric_hysteresis
    w                       delay, or a contribution of the rate: amplifier_bandwidth, sensor_bandwidth,
                            trigger_delay or feedthrough
    others                  no effect of the catalogue
    ======================  =================================================================================
narx
    A neural network of present and past values of the base model's signal, the drive and the hysteretic drive, added to
    the base model's signal; training stops where it best predicts recordings put aside. It names no effect.
flexible
    The ridge regression with which the diagnosis tests for remaining structure. It names no effect.
diagnosis
    The model with the effects found, or the base model if there are none.
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

from inkjet_env.experiments.validation.baselines.base_fit import base_fit, base_of, over_noise, put_aside
from inkjet_env.experiments.validation.baselines.narx import with_network
from inkjet_env.experiments.validation.baselines.sindy import said, sparse_force
from inkjet_env.experiments.validation.diagnosis_study import Case, cases, recorded, verdict_record
from inkjet_env.experiments.validation.synthetic_campaigns import effect_named
from inkjet_env.mismatch import Diagnosis, diagnose
from inkjet_env.mismatch.selection.discrepancy_regression import discrepancy_regression
from inkjet_env.mismatch.selection.hypotheses import base_hypothesis
from inkjet_env.progress import shown_progress
from inkjet_env.recordings import Campaign, read_campaign
from inkjet_env.reporting.tables import print_table
from inkjet_env.storage import write_json

METHODS = ("base", "base, as diagnosed", "pysindy", "narx", "flexible", "diagnosis")


def verdict_on(groups: Sequence[Sequence[str]], truth: Sequence[str]) -> str:
    """Judgement of the named groups, given at most one true effect: right, in the set, among others, wrong, nothing."""
    if not groups:
        return "nothing" if truth else "right"
    if not any(set(truth) & set(group) for group in groups):
        return "wrong"
    if len(groups) > 1:
        return "among others"
    return "right" if len(groups[0]) == 1 else "in the set"


def compared(campaign: Campaign, found: Diagnosis, seed: int) -> dict[str, Any]:
    """Held-out RMS over the noise of each baseline, and pysindy's terms, as plain JSON values."""
    joint = base_fit(campaign, base_of(found, campaign))
    modelled = joint.modelled(joint.base)
    sparse, network = dict(modelled), dict(modelled)
    terms: dict[str, tuple[str, ...]] = {}
    for channel in sorted({recording.channel for recording in found.recordings}):
        if not put_aside(joint, channel)[1]:
            continue  # too few recordings for model selection: nothing is added
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
        "over_noise": {method: error if math.isfinite(error) else None for method, error in errors.items()},
        "noise_rms": joint.noise.models[first.noise_key].rms,
        "noise_known": joint.noise.known(first),
        "unit": first.unit,
        "terms": {channel: list(names) for channel, names in terms.items()},
    }


def scored_of(subject: Case | Path) -> dict[str, Any]:
    """Record a synthetic case, or read measured recordings of unknown truth; diagnose them and fit all baselines."""
    if isinstance(subject, Path):
        return _scored(read_campaign(subject), None, 0)
    return _scored(recorded(subject)[0], subject.effects, subject.seed)


def _scored(campaign: Campaign, truth: Sequence[str] | None, seed: int) -> dict[str, Any]:
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
        row["judged"] = {method: right.get(method, verdict_on((), truth)) for method in METHODS}
    return row


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Median RMS over noise and counts of judgements by baseline, over the cases with an effect."""
    mine = [row for row in rows if "judged" in row and row["name"] != "nothing"]
    methods = METHODS if mine else ()
    return {
        "cases": len(mine),
        "median": {p: float(np.median([_error(row, p) for row in mine])) for p in methods},
        "judged": {p: dict(Counter(row["judged"][p] for row in mine)) for p in methods},
    }


def _error(row: Mapping[str, Any], method: str) -> float:
    """RMS over noise of one baseline; infinite if its model has no signal."""
    error = row["over_noise"][method]
    return math.inf if error is None else error


def print_rows(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print one line per case, and the summary."""
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
                *(f"{_error(row, p):.3g}" for p in METHODS),
                f"{names} ({count} terms): {judgement.get('pysindy', '')}",
                f"{verdict_record}: {judgement.get('diagnosis', '')}",
            )
        )
    whole = summary(rows)
    if whole["cases"]:
        lines.append((f"median of {whole['cases']}", *(f"{whole['median'][p]:.3g}" for p in METHODS), "", ""))
    print("Held-out RMS over the noise, free run; if the noise is unknown, over the level of most fitted samples:")
    print_table(("concealed effect", *METHODS, "pysindy says", "diagnosis"), lines)
    for row in rows:
        if not row["noise_known"]:
            print(f"{row['name']}: 1 corresponds to {row['noise_rms']:.4g} {row['unit']} of the fast channel.")
    for method, counts in whole["judged"].items():
        print(f"{method}: " + ", ".join(f"{count} {word}" for word, count in counts.items()))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    effects = [case.effects[0] for case in cases("single", 1) if case.strength == "strong"]
    names = ["nothing", *(name for name in effects if not effect_named(name).random)]
    parser.add_argument("effects", nargs="*", metavar="EFFECT", help="effects to try; all, and no effect, unless given")
    parser.add_argument("--folder", type=Path, action="append", default=[], help="folder of measured recordings")
    parser.add_argument("--json", type=Path, help="write the table as JSON too")
    parser.add_argument("--workers", type=int, default=2, help="number of processes")
    given = parser.parse_args(arguments)
    if find_spec("pysindy") is None:
        parser.error('pysindy is not installed; it comes with the development extra: pip install -e ".[dev]".')
    for name in given.effects:
        if name not in names:
            parser.error(f"EFFECT must be one of {', '.join(names)}; got {name!r}.")
    subjects: list[Case | Path] = list(given.folder)
    for name in given.effects or names:
        subjects.append(Case("null", (), "none", 0) if name == "nothing" else Case("single", (name,), "strong", 0))
    rows = []
    with ProcessPoolExecutor(given.workers) as pool, shown_progress("cases", len(subjects)) as shown:
        for row in pool.map(scored_of, subjects):
            rows.append(row)
            shown(len(rows), row["name"])
    print_rows(rows)
    if given.json is not None:
        write_json(given.json, {"format": "diagnosis-peers/1", "cases": rows, "summary": summary(rows)})


if __name__ == "__main__":
    main()
