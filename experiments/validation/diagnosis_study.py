"""How well the diagnosis distinguishes its own effects.

``python -m inkjet_env.experiments.validation.diagnosis_study [PART ...]``.

Parts: null (no effect, white noise), noise (no effect, each kind of noise of `noise_zoo`), single (each effect, strong
and medium), pairs (two effects of different stages), withheld (each effect present but removed from the catalogue),
summary. Every case is one line of results/diagnosis/cases.jsonl;
a stopped study resumes if code and packages are unchanged. ``--seeds N`` takes N heads for every case.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.experiments.execution.provenance import code_digest, first_difference, versions
from inkjet_env.experiments.validation.noise_zoo import ZOO
from inkjet_env.experiments.validation.synthetic_campaigns import (
    MEDIUM,
    STRONG,
    effect_named,
    largest_signal_V,
    record_synthetic,
    synthetic_values,
)
from inkjet_env.experiments.validation.verdict_scores import OUTCOMES, VerdictRecord, confusion, f1, share
from inkjet_env.identification import UnidentifiableError
from inkjet_env.identification.convention import in_convention
from inkjet_env.mismatch import diagnose
from inkjet_env.plant import Effect, catalogue
from inkjet_env.printhead import Printhead
from inkjet_env.progress import shown_progress
from inkjet_env.recordings import Campaign

RESULTS = Path("results/diagnosis/cases.jsonl")
FIRST_NOISE_SEED, NOISE_SEEDS = 100, 30
"""Heads of the part `noise`; the limits of the diagnosis were set on heads 0 to 29 of that part."""
SOURCES = (
    "inkjet_env/**/*.py",
    *(f"experiments/validation/{name}.py" for name in ("synthetic_campaigns", "noise_zoo", "diagnosis_study")),
)
"""Files that determine the result of a case."""
STRENGTHS = {"strong": STRONG, "medium": MEDIUM}
PAIRS = (
    ("amplifier_bandwidth", "asymmetric_hysteresis"), ("amplifier_bandwidth", "second_mode"),
    ("amplifier_bandwidth", "feedthrough"), ("slew_limit", "cubic_stiffness"), ("slew_limit", "sensor_saturation"),
    ("trigger_delay", "creep"), ("trigger_delay", "meniscus_refill"), ("trigger_delay", "crosstalk"),
    ("creep", "second_mode"), ("creep", "mains_hum"), ("rate_dependent_hysteresis", "thermal_drift"),
    ("asymmetric_hysteresis", "wave_echo"), ("asymmetric_hysteresis", "baseline_drift"),
    ("cubic_stiffness", "feedthrough"), ("quadratic_damping", "crosstalk"), ("ferroelastic_softening", "mains_hum"),
    ("second_mode", "sensor_saturation"), ("wave_echo", "baseline_drift"), ("thermal_drift", "sensor_bandwidth"),
    ("meniscus_refill", "feedthrough"),
)  # fmt: skip


class OtherCodeError(ValueError):
    """The results file holds results of other code or packages; the message states the difference."""


@dataclass(frozen=True)
class Case:
    """One campaign to diagnose."""

    part: str
    effects: tuple[str, ...]
    strength: str
    seed: int
    monitored: bool = False

    @property
    def name(self) -> str:
        """Unique name of the case."""
        monitored = " monitored" if self.monitored else ""
        return f"{self.part} {'+'.join(self.effects) or 'nothing'} {self.strength}{monitored} {self.seed}"


def head_of(seed: int) -> Printhead:
    """A random head, its branch law scaled by the convention, so that truth and fit share the same hysteretic volt."""
    rng = np.random.default_rng([7, seed])
    head = Printhead.published().varied(
        frequency_Hz=rng.uniform(35e3, 70e3),
        damping_ratio=rng.uniform(0.03, 0.08),
        gain=rng.uniform(0.7, 1.3),
        hysteresis_strength=rng.uniform(0.6, 1.4),
    )
    return in_convention(head)


def cases(part: str, seeds: int) -> Iterator[Case]:
    """The cases of a part."""
    names = [effect.id for effect in catalogue()]
    if part == "null":
        yield from (Case("null", (), "none", seed) for seed in range(100))
    elif part == "noise":
        heads = range(FIRST_NOISE_SEED, FIRST_NOISE_SEED + NOISE_SEEDS)
        yield from (Case("noise", (), kind, seed) for seed in heads for kind in ZOO)
    elif part == "single":
        for seed in range(seeds):
            yield from (Case("single", (name,), strength, seed) for strength in STRENGTHS for name in names)
    elif part == "pairs":
        for seed in range(seeds):
            yield from (Case("pairs", pair, "strong", seed) for pair in PAIRS)
    elif part == "withheld":
        for seed in range(seeds):
            yield from (Case("withheld", (name,), "strong", seed) for name in names)
    else:
        raise ValueError(f"part must be null, noise, single, pairs, withheld or summary; got {part!r}.")


def recorded(case: Case) -> tuple[Campaign, list[tuple[Effect, dict[str, float]]]]:
    """The campaign of a case, and the effects in it with their values."""
    head = head_of(case.seed)
    hidden, largest_V = map(effect_named, case.effects), largest_signal_V(head)
    on = [(effect, synthetic_values(effect, STRENGTHS[case.strength], head, largest_V)) for effect in hidden]
    kind = case.strength if case.part == "noise" else "white"
    return record_synthetic(head, on, 1000 + case.seed, monitored=case.monitored, noise_kind=kind), on


def outcome(case: Case) -> dict[str, Any]:
    """Record and diagnose a case; its outcome as plain JSON values."""
    head = head_of(case.seed)
    campaign, on = recorded(case)
    known = [e for e in catalogue() if case.part != "withheld" or e.id not in case.effects]
    found = diagnose(campaign, effects=known, rng=case.seed, workers=1)
    # the scale of hysteretic volts is a convention, which depends on the swing at which the law was identified
    swing_V = found.printhead.full_scale_V
    scale = in_convention(head, swing_V).coefficients[-2] / head.coefficients[-2]
    by_unit = {"1/V": 1 / scale, "1/V²": 1 / scale**2}
    by_name = {"bending": swing_V / head.full_scale_V / scale}
    truth = {
        e.id: {p.name: v[p.name] * by_name.get(p.name, by_unit.get(p.unit, 1.0)) for p in e.parameters} for e, v in on
    }
    return asdict(case) | {
        "name": case.name,
        "verdict": found.verdict,
        "found": [e.effect.id for e in found.effects],
        "candidates": [list(group) for group in found.candidates],
        "closure": None if np.isnan(found.closure) else found.closure,
        "left_over": found.left_over,
        "p_value": found.p_value,
        "located": bool(found.location.recordings),
        "seconds": found.seconds,
        "stages": dict(found.stages),
        "headline": found.headline,
        "parameters": {
            e.effect.id: {
                name: [truth.get(e.effect.id, {}).get(name), v.value, v.low, v.high] for name, v in e.parameters.items()
            }
            for e in found.effects
        },
        "best": [[list(a.ids), a.gain, a.share] for a in found.attributions[:4]],
    }


def run(parts: list[str], seeds: int, workers: int) -> None:
    """Diagnose all cases that have no result yet.

    Parameters
    ----------
    parts : list of str
        Parts of the study; see `cases`.
    seeds : int
        Number of heads for every case.
    workers : int
        Number of processes.

    Raises
    ------
    OtherCodeError
        The existing results are of other code or packages. Nothing is diagnosed.
    """
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    made = {"code": code_digest(SOURCES), "versions": versions()}
    before = rows()
    if before and (difference := first_difference(_made_by(before[0]), made)):
        raise OtherCodeError(
            f"{RESULTS} holds results of other code or packages: {difference}. Delete or rename that file to start "
            "again, or restore the code and packages to resume."
        )
    done = {row["name"] for row in before}
    todo = [case for part in parts for case in cases(part, seeds) if case.name not in done]
    with (
        ProcessPoolExecutor(workers) as pool,
        shown_progress("diagnoses", len(todo)) as shown,
        RESULTS.open("a", encoding="utf-8") as file,
    ):
        for k, row in enumerate(pool.map(_guarded, todo), start=1):
            file.write(json.dumps(row | {"made": made}) + "\n")
            file.flush()
            shown(k, f"{row['name']}: {row['verdict']} {'+'.join(row['found'])}")


def _guarded(case: Case) -> dict[str, Any]:
    """The outcome of a case; a campaign without an identifiable head counts as refused. Any other error is a fault."""
    try:
        return outcome(case)
    except UnidentifiableError as error:
        return asdict(case) | {"name": case.name, "verdict": "refused", "found": [], "headline": str(error)}


def rows() -> list[dict[str, Any]]:
    """Results of all cases so far.

    Returns
    -------
    list of dict
        The `outcome` of each case; ``made`` holds code and packages, the same in all.

    Raises
    ------
    OtherCodeError
        Two lines are of different code or packages.
    """
    if not RESULTS.exists():
        return []
    found = [json.loads(line) for line in RESULTS.read_text(encoding="utf-8").splitlines() if line]
    for row in found:
        if difference := first_difference(_made_by(found[0]), _made_by(row)):
            raise OtherCodeError(
                f"{RESULTS} mixes results of different code or packages, {found[0]['name']} and {row['name']}: "
                f"{difference}. Delete the lines of one of them."
            )
    return found


def _made_by(row: dict[str, Any]) -> dict[str, Any]:
    """Code and packages of a line; "unknown" for older lines, which do not record them."""
    return dict(row.get("made", {"code": "unknown"}))


def verdict_record(row: dict[str, Any]) -> VerdictRecord:
    """The verdict in a line, with the truth."""
    groups = tuple(frozenset(group) for group in row.get("candidates", []))
    return VerdictRecord(frozenset(row["effects"]), row["verdict"], frozenset(row["found"]), groups)


def summary() -> None:
    """Print a summary of all results."""
    found = rows()
    for part in ("null", "noise", "single", "pairs", "withheld"):
        mine = [row for row in found if row["part"] == part]
        if mine:
            _print_part(part, mine)
    single = [row for row in found if row["part"] == "single"]
    inside = [
        low <= truth <= high
        for row in single
        for name, estimates in row.get("parameters", {}).items()
        if name in row["effects"] and not effect_named(name).random
        for truth, _, low, high in estimates.values()
        if truth
    ]
    if inside:
        value, low, high = share(sum(inside), len(inside))
        print(f"\n90 % intervals: {value:.1%} ({low:.1%} … {high:.1%}) of {len(inside)} contain the truth")


def _print_part(part: str, mine: list[dict[str, Any]]) -> None:
    print(f"\n{part}: {len(mine)} campaigns")
    for strength in sorted({row["strength"] for row in mine}):
        these = [row for row in mine if row["strength"] == strength]
        print(f"  {strength}: {dict(Counter(verdict_record(row).judged for row in these))}")
        for row in these:
            if verdict_record(row).judged not in ("right", "in the set"):
                said = "+".join(row["found"]) or row["headline"][:60]
                hidden = "+".join(row["effects"]) or "nothing"
                print(f"    {hidden} ({row['seed']}): {row['verdict']} {said} {row.get('candidates', '')}")
        if part == "single":
            _print_confusion([verdict_record(row) for row in these])
    if part == "pairs":
        print(f"  F1: {f1(verdict_record(row) for row in mine):.3f}")
    closures = [row["closure"] for row in mine if row.get("closure") is not None and row["verdict"] == "named"]
    if closures:
        print(f"  closure, named: median {np.median(closures):.3f}, 10th percentile {np.quantile(closures, 0.1):.3f}")
    sizes = [len(group) for row in mine for group in row.get("candidates", [])]
    if sizes:
        print(f"  sets: {len(sizes)}, mean size {np.mean(sizes):.2f}")
    p_values = np.array([row["p_value"] for row in mine if "p_value" in row])
    if part in ("null", "noise") and len(p_values):
        tenths = np.histogram(p_values, np.linspace(0, 1, 11))[0]
        print(f"  p-values below 0.01: {np.mean(p_values < 0.01):.1%}; in tenths from 0 to 1: {tenths.tolist()}")
    if part == "null":
        print(f"  located somewhere: {sum(row['located'] for row in mine if 'located' in row)}")
    seconds = [row["seconds"] for row in mine if "seconds" in row]
    print(f"  seconds: median {np.median(seconds):.1f}, most {max(seconds):.1f}")


def _print_confusion(these: list[VerdictRecord]) -> None:
    """Print the confusion matrix. Rows: hidden effect; columns: named effect, by number."""
    names = [effect.id for effect in catalogue()]
    table = confusion(these, names)
    width = max(map(len, names)) + 4
    print(" " * (width + 4) + " ".join(f"{k:2d}" for k in range(1, len(names) + 1)) + "  " + "  ".join(OUTCOMES))
    for k, name in enumerate(names, start=1):
        row = table[name]
        counts = " ".join(f"{row[other] or '.':>2}" for other in names)
        rest = "  ".join(f"{row[outcome] or '.':>{len(outcome)}}" for outcome in OUTCOMES)
        print(f"    {f'{k} {name}':<{width}}{counts}  {rest}")


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=["null", "single", "pairs", "withheld"])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args(arguments)
    parts = [part for part in given.parts if part != "summary"]
    try:
        if parts:
            run(parts, given.seeds, given.workers)
        summary()
    except OtherCodeError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
