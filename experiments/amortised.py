"""Learning once over many heads, against optimising every head from scratch.

With one head an agent is only a search distribution. Over heads it is *amortised*: it is trained on some, and a head
that it never saw gets its waveform at once, or a warm start. Four ways of learning, and tables of waveforms that learn
nothing, are compared on one ledger, in which every evaluation of a waveform counts, those of training too; one with its
gradient counts as one. Everything that learns is learnt several times.

``python -m experiments.amortised`` trains, tests and tells; what a folder holds is not done again.
"""

from __future__ import annotations

import bisect
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.comparison import as_json
from experiments.drawn_heads import TEST_SEED, Heads, Real, drawn
from experiments.learners import LEARNERS, Begun, Table, one_waveform, table_of, tuned_costs_V
from experiments.measures import Places, crossed
from experiments.trainings import (
    RESAMPLES,
    Arrays,
    best_costs_V,
    each,
    kept_arrays,
    kept_policy,
    median_of,
    over,
    run_command,
    seeds,
    spread_of,
)
from inkjet_env.storage import json_text, write_atomically

FORMAT = "amortised/3"
TITLE = "Learning over heads"
BUDGETS = (50, 150, 2000)
SCRATCH = ("cma-es", "lbfgsb-multistart", "pso", "coordinate")
SMALLER = 10
"""The smaller table costs so many times less than a training."""


@dataclass(frozen=True, eq=False)
class TuningResult:
    """What a way of tuning came to on heads that nobody had seen.

    Parameters
    ----------
    name : str
    at_once_V : ndarray, shape (trainings, heads)
        Regret of the policy's own waveform; NaN where there is no policy.
    curves_V : ndarray, shape (trainings, heads, evaluations)
        Regret of the best waveform after each further evaluation.
    trained : float
        Evaluations that a training cost, in the mean.
    """

    name: str
    at_once_V: Real
    curves_V: Real
    trained: float


def break_even(
    policy: TuningResult,
    scratch: TuningResult,
    evaluations: int,
    trainings: Places | slice = slice(None),
    heads: Places | slice = slice(None),
) -> float:
    """Heads from which on learning has cost less than optimising each from scratch, to be as good as it is.

    As good: the policy's median regret after so many evaluations a head. Infinite where scratch is there sooner. Where
    it never comes there, its whole budget counts, and fewer heads may be enough.

    Parameters
    ----------
    policy, scratch : TuningResult
    evaluations : int
    trainings, heads : slice or ndarray of int
        Which of the trainings and of the heads count; all unless given.
    """
    target = float(np.median(policy.curves_V[trainings, :, evaluations - 1][:, heads]))

    def risen(place: int) -> float:
        """Curves fall, and so do their medians."""
        return -float(np.median(scratch.curves_V[:, :, place][:, heads]))

    needed = 1 + bisect.bisect_left(range(scratch.curves_V.shape[-1]), -target, key=risen)
    return policy.trained / (needed - evaluations) if needed > evaluations else math.inf


def told(results: Sequence[TuningResult], rng: np.random.Generator) -> list[dict[str, Any]]:
    """Medians of regret over trainings and heads with their intervals, at once and after each budget; break-evens."""
    scratch = min((one for one in results if not one.trained), key=lambda one: float(np.median(one.curves_V[..., -1])))
    rows = []
    for one in results:
        row: dict[str, Any] = {"name": one.name, "trained": round(one.trained), "trainings": len(one.at_once_V)}
        columns = {"0": one.at_once_V} | {str(b): one.curves_V[..., b - 1] for b in BUDGETS}
        for label, values in columns.items():
            if np.isfinite(values).all():
                row[label] = median_of(values, rng)
        if one.trained:
            evens = functools.partial(break_even, one, scratch, BUDGETS[0])
            row["break_even_heads"] = as_json(crossed(evens, one.at_once_V.shape, rng, RESAMPLES))
            row["against"] = scratch.name
        rows.append(row)
    return rows


def tables(evaluations: int) -> dict[str, Callable[[int], Table]]:
    """Tables by name, each from a seed."""
    spent = {f"table for {count:,}": count for count in (max(1, evaluations // SMALLER), evaluations)}
    made = {name: functools.partial(table_of, count) for name, count in spent.items()}
    return {"table of one head": one_waveform, **made}


def tested(folder: Path, way: str, training: int, evaluations: int, seed: int, heads: int) -> Arrays:
    """Costs on the test heads of one training, or of an optimiser from scratch, as `tuned_costs_V` has them.

    What the folder keeps is neither learnt nor tested again.
    """
    file = f"{way.replace(' ', '-').replace(',', '')}-{training}"
    asked = {"way": way, "evaluations": evaluations, "seed": seed}

    def make() -> Arrays:
        tests, further = Heads(drawn(heads, TEST_SEED)), max(BUDGETS)
        if way in SCRATCH:
            return tuned_costs_V(None, way, tests, further, seed)
        if way in LEARNERS:
            learn = functools.partial(LEARNERS[way], evaluations, seed)
            begun: Begun = kept_policy(folder / f"{file}.npz", asked, learn)
        else:
            begun = tables(evaluations)[way](seed)
        return tuned_costs_V(begun, "cma-es", tests, further, seed)

    return kept_arrays(folder / f"{file}-tested.npz", {**asked, "heads": heads, "further": max(BUDGETS)}, make)


def study(
    folder: Path, evaluations: int, heads: int, labelling: int, seed: int, trainings: int = 1, workers: int = 1
) -> dict[str, Any]:
    """Train everything that learns, test all ways, write ``amortised.json``.

    Parameters
    ----------
    folder : Path
        Keeps what was learnt and tested.
    evaluations : int
        Of a training.
    heads : int
        To test on.
    labelling : int
        Descents for the best cost known of a head.
    seed, trainings, workers : int
    """
    best_V = best_costs_V(Heads(drawn(heads, TEST_SEED)), labelling, seed)
    learnt = {way: seeds(seed, trainings) for way in (*tables(evaluations), *LEARNERS)}
    names = {name: [seed] for name in SCRATCH} | learnt
    jobs = {
        f"{way}, training {k}" if way not in SCRATCH else way: (folder, way, k, evaluations, one, heads)
        for way, its_seeds in reversed(names.items())  # what takes longest comes first
        for k, one in enumerate(its_seeds, 1)
    }
    found = each("amortised", tested, jobs, workers)
    by_way = {way: [found[job] for job, told_of in jobs.items() if told_of[1] == way] for way in names}
    least_V = np.min([one["after_V"].min(axis=1) for some in by_way.values() for one in some] + [best_V], axis=0)
    results = [
        TuningResult(
            way,
            np.array([one["at_once_V"] for one in some]) - least_V,
            np.array([one["after_V"] for one in some]) - least_V[:, None],
            float(np.mean([one["learning"] for one in some])),
        )
        for way, some in by_way.items()
    ]
    content = {
        "format": FORMAT,
        "heads": heads,
        "evaluations": evaluations,
        "seed": seed,
        "trainings": trainings,
        "best_improved": int(np.sum(least_V < best_V - 1e-6)),
        "rows": told(results, np.random.default_rng(seed)),
    }
    write_atomically(folder / "amortised.json", json_text(content))
    return content


def table(found: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Header and rows of a study, for people."""

    def volts(entry: Mapping[str, float] | None) -> str:
        return "–" if entry is None else f"{entry['value']:.3g} ({entry['low']:.3g} … {entry['high']:.3g})"

    rows = []
    for row in found["rows"]:
        spread = spread_of(row["0"]["each"], ".3g") if "0" in row else ""
        pays = "" if not row["trained"] else _heads_from(row["break_even_heads"])
        rows.append(
            (row["name"], f"{row['trained']:,}", *(volts(row.get(str(b))) for b in (0, *BUDGETS)), spread, pays),
        )
    after = (f"after {b:,}" for b in (0, *BUDGETS))
    return ("tuned by", "evaluations to learn", *after, "single trainings, after 0", "pays from … heads"), rows


def _heads_from(even: Mapping[str, float | None]) -> str:
    """A break-even number with its interval; whole heads."""
    whole = {name: None if value is None else f"{math.ceil(value):,}" for name, value in even.items()}
    if whole["value"] is None:
        return "never" if whole["low"] is None else f"never ({whole['low']} … ∞)"
    return f"{whole['value']} ({whole['low']} … {whole['high'] or '∞'})"


def legend(found: Mapping[str, Any]) -> str:
    """What the table's numbers are."""
    return f"Median regret in volts {over(found['heads'], found['trainings'])}."


def print_study(found: Mapping[str, Any]) -> None:
    """The table for people."""
    from experiments.tables import print_table

    print_table(*table(found))
    print(legend(found))


def main(arguments: list[str] | None = None) -> None:
    """Train, test and tell."""
    run_command("amortised", __doc__, 200_000, 100, study, print_study, arguments)


if __name__ == "__main__":
    main()
