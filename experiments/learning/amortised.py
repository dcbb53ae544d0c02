"""Learning once over many heads, compared with optimising every head from scratch.

On one head an agent is only a search distribution. Over many heads it is *amortised*: it is trained on some heads, and
an unseen head gets its waveform at once, or a warm start. Four learning methods, and lookup tables of waveforms, are
compared by the number of evaluations: every evaluation of a waveform counts, including those of training; one with its
gradient counts as one. Everything that learns is trained several times.

``python -m inkjet_env.experiments.learning.amortised`` trains, tests and prints the results; results in its folder are
reused.
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

from inkjet_env.experiments.benchmark.metrics import Places, crossed_bootstrap
from inkjet_env.experiments.learning.heads import TEST_SEED, Heads, drawn
from inkjet_env.experiments.learning.learners import LEARNERS, Begun, Table, one_waveform, table_of, tuned_costs_V
from inkjet_env.experiments.learning.repeated_training import (
    RESAMPLES,
    Arrays,
    ResultTable,
    best_costs_V,
    each,
    kept_arrays,
    kept_policy,
    median_difference,
    median_of,
    over,
    run_command,
    seeds,
    spread_of,
    with_interval,
)
from inkjet_env.storage import json_text, write_atomically
from inkjet_env.typing import Real

MODULE = "inkjet_env.experiments.learning.amortised"
FORMAT = "amortised/3"
TITLE = "Learning over heads"
BUDGETS = (50, 150, 2000)
SCRATCH = ("cma-es", "lbfgsb-multistart", "pso", "coordinate")
WARM = "cma-es"
"""Optimiser that continues from the waveform of a policy or a table."""
REFERENCE = "table of one head"
"""Baseline of least effort: one waveform, stretched to the period of each head."""
SMALLER = 10
"""Ratio of a training's evaluations to those of the smaller table."""


@dataclass(frozen=True, eq=False)
class TuningResult:
    """Result of a tuning method on unseen heads.

    Parameters
    ----------
    name : str
        Name of the method.
    at_once_V : ndarray, shape (trainings, heads)
        Regret in volts of the policy's own waveform; NaN if there is no policy.
    curves_V : ndarray, shape (trainings, heads, evaluations)
        Regret in volts of the best waveform after each further evaluation.
    trained : ndarray, shape (trainings,)
        Evaluations that each training took; 0 if nothing is learnt.
    """

    name: str
    at_once_V: Real
    curves_V: Real
    trained: Real


def soonest(scratch: Sequence[TuningResult], target_V: float, heads: Places) -> tuple[float, str]:
    """Evaluations until the first from-scratch method reaches a median regret over the heads, and that method's name.

    If none reaches it, infinity and the name of the method with the lowest final median.
    """
    found = []
    for one in scratch:

        def risen(place: int, curves_V: Real = one.curves_V) -> float:
            """The negative median regret, which rises with the evaluations because all regret curves fall."""
            return -float(np.median(curves_V[0, heads, place]))

        longest = one.curves_V.shape[-1]
        place = bisect.bisect_left(range(longest), -target_V, key=risen)
        found.append((place + 1.0 if place < longest else math.inf, -risen(longest - 1), one.name))
    first = min(found)
    return first[0], first[2]


def break_even(
    policy: TuningResult,
    scratch: Sequence[TuningResult],
    evaluations: int,
    trainings: Places | None = None,
    heads: Places | None = None,
) -> float:
    """Number of heads above which learning takes fewer evaluations than optimising each head from scratch.

    Both must reach the policy's median regret after ``evaluations`` on each head. Infinite if from-scratch
    optimisation reaches it no later; 0 if it never reaches it.

    Parameters
    ----------
    policy : TuningResult
        Result of the method that learns.
    scratch : sequence of TuningResult
        Results of the methods from scratch, of which the fastest counts.
    evaluations : int
        Evaluations per head after the policy's waveform.
    trainings, heads : ndarray of int, optional
        Indices of the trainings and heads that count; all unless given.
    """
    trainings = np.arange(len(policy.trained)) if trainings is None else trainings
    heads = np.arange(policy.at_once_V.shape[1]) if heads is None else heads
    target_V = float(np.median(policy.curves_V[trainings[:, None], heads, evaluations - 1]))
    saved = soonest(scratch, target_V, heads)[0] - evaluations
    return float(np.mean(policy.trained[trainings])) / saved if saved > 0 else math.inf


def summary_rows(results: Sequence[TuningResult], rng: np.random.Generator) -> list[dict[str, Any]]:
    """Median regrets over trainings and heads with intervals, at once and after each budget, and break-even numbers."""
    scratch = [one for one in results if not one.trained.any()]
    seen = {one.name: {"0": one.at_once_V} | {str(b): one.curves_V[..., b - 1] for b in BUDGETS} for one in results}
    every_head = np.arange(results[0].at_once_V.shape[1])
    rows = []
    for one in results:
        row: dict[str, Any] = {"name": one.name, "trained": round(one.trained.mean()), "trainings": len(one.trained)}
        row["behind"] = {}
        for label, regrets_V in seen[one.name].items():
            if np.isfinite(regrets_V).all():
                row[label] = median_of(regrets_V, rng)
                if one.name != REFERENCE and REFERENCE in seen:
                    row["behind"][label] = median_difference(regrets_V, seen[REFERENCE][label], rng)
        if row["trained"]:
            evens = functools.partial(break_even, one, scratch, BUDGETS[0])
            row["break_even_heads"] = crossed_bootstrap(evens, one.at_once_V.shape, rng, RESAMPLES).as_json()
            row["against"] = soonest(scratch, row[str(BUDGETS[0])]["value"], every_head)[1]
            row["at_most_heads"] = one.trained.mean() / (one.curves_V.shape[-1] + 1 - BUDGETS[0])
        rows.append(row)
    return rows


def tables(evaluations: int) -> dict[str, Callable[[int], Table]]:
    """Functions that make a lookup table from a seed, by name."""
    spent = {f"table for {count:,}": count for count in (max(1, evaluations // SMALLER), evaluations)}
    made = {name: functools.partial(table_of, count) for name, count in spent.items()}
    return {"table of one head": one_waveform, **made}


def tested(folder: Path, way: str, training: int, evaluations: int, seed: int, heads: int) -> Arrays:
    """Learn with a seed, or optimise from scratch, and tune the test heads; the result is that of `tuned_costs_V`.

    Result and policy are stored in the folder; what is stored there is reused.
    """
    file = f"{way.replace(' ', '-').replace(',', '')}-{training}"
    asked = {"way": way, "evaluations": evaluations, "seed": seed}
    tests, further = Heads(drawn(heads, TEST_SEED)), max(BUDGETS)

    def make() -> Arrays:
        if way in SCRATCH:
            return tuned_costs_V(None, way, tests, further, seed)
        if way in LEARNERS:
            learn = functools.partial(LEARNERS[way], evaluations, seed)
            begun: Begun = kept_policy(folder / f"{file}.npz", asked, learn)
        else:
            begun = tables(evaluations)[way](seed)
        return tuned_costs_V(begun, WARM, tests, further, seed)

    on = {"heads": heads, "first": tests.observations[0].tolist(), "further": further, "warm": WARM}
    return kept_arrays(folder / f"{file}-tested.npz", {**asked, **on}, make)


def study(
    folder: Path, evaluations: int, heads: int, labelling: int, seed: int, trainings: int = 1, workers: int = 1
) -> dict[str, Any]:
    """Train everything that learns, test all methods, write ``amortised.json``.

    Parameters
    ----------
    folder : Path
        Folder for policies and test results, which are reused.
    evaluations : int
        Evaluations of one training.
    heads : int
        Number of test heads.
    labelling : int
        Number of descents for the best known cost of a head.
    seed, trainings, workers : int
        Seed of the study, number of trainings of each method, and number of processes.
    """
    best_V = best_costs_V(folder, Heads(drawn(heads, TEST_SEED)), labelling, seed)
    learnt = {way: seeds(seed, trainings) for way in (*tables(evaluations), *LEARNERS)}
    names = {name: [seed] for name in SCRATCH} | learnt
    jobs = {
        f"{way}, training {k}" if way not in SCRATCH else way: (folder, way, k, evaluations, one, heads)
        for way, its_seeds in reversed(names.items())  # the longest jobs come first
        for k, one in enumerate(its_seeds, 1)
    }
    found = each("amortised", tested, jobs, workers)
    by_way = {way: [found[job] for job, arguments in jobs.items() if arguments[1] == way] for way in names}
    least_V = np.min([one["after_V"].min(axis=1) for some in by_way.values() for one in some] + [best_V], axis=0)
    results = [
        TuningResult(
            way,
            np.array([one["at_once_V"] for one in some]) - least_V,
            np.array([one["after_V"] for one in some]) - least_V[:, None],
            np.array([float(one["learning"]) for one in some]),
        )
        for way, some in by_way.items()
    ]
    content = {
        "format": FORMAT,
        "heads": heads,
        "evaluations": evaluations,
        "labelling": labelling,
        "seed": seed,
        "trainings": trainings,
        "best_improved": int(np.sum(least_V < best_V - 1e-6)),
        "rows": summary_rows(results, np.random.default_rng(seed)),
    }
    write_atomically(folder / "amortised.json", json_text(content))
    return content


def result_tables(found: Mapping[str, Any]) -> tuple[ResultTable]:
    """The table of a study."""

    def volts(entry: Mapping[str, float] | None) -> str:
        return with_interval(entry, ".3g", "–")

    rows = []
    for row in found["rows"]:
        spread = spread_of(row["0"]["each"], ".3g") if "0" in row else ""
        later = volts(row["behind"].get(str(BUDGETS[0])))
        pays = heads_from(row["break_even_heads"], row["at_most_heads"]) if row["trained"] else ""
        medians = (volts(row.get(str(b))) for b in (0, *BUDGETS))
        rows.append((row["name"], f"{row['trained']:,}", *medians, spread, later, pays))
    after = (f"after {b:,}" for b in (0, *BUDGETS))
    ends = ("range of trainings, after 0", f"above {REFERENCE}, after {BUDGETS[0]}", "pays from … heads")
    return ((("method", "training evaluations", *after, *ends), rows),)


def heads_from(even: Mapping[str, float | None], at_most: float) -> str:
    """A break-even number with its interval, in whole heads, from the entry that `summary_rows` makes.

    Examples
    --------
    >>> heads_from({"value": 101.2, "low": 0.0, "high": None}, 4.2)
    '102 (≤ 5 … ∞)'
    >>> heads_from({"value": None, "low": 7.0, "high": None}, 4.2)
    'never (7 … ∞)'
    >>> heads_from({"value": None, "low": None, "high": None}, 4.2)
    'never'
    """

    def whole(number: float | None) -> str:
        if number is None:
            return "∞"
        return f"{math.ceil(number):,}" if number else f"≤ {math.ceil(at_most):,}"

    value, low, high = (even[name] for name in ("value", "low", "high"))
    if low is None:
        return "never"
    return f"{'never' if value is None else whole(value)} ({whole(low)} … {whole(high)})"


def legend(found: Mapping[str, Any]) -> str:
    """Explanation of the table's numbers."""
    return f"Median regret in volts {over(found['heads'], found['trainings'])}."


def main(arguments: list[str] | None = None) -> None:
    """Train, test and print the results."""
    run_command(MODULE, Path("results/amortised"), __doc__, 200_000, 100, study, result_tables, legend, arguments)


if __name__ == "__main__":
    main()
