"""Learning once over many heads, against optimising every head from scratch.

With one head an agent is only a search distribution. Over heads it is *amortised*: it is trained on some, and a head
that it never saw gets its waveform at once, or a warm start. Four ways of learning, and tables of waveforms that learn
nothing, are compared on one ledger, in which every evaluation of a waveform counts, those of training too; one with its
gradient counts as one.

``python -m experiments.amortised`` trains, tests and tells; what a folder holds is not done again.
"""

from __future__ import annotations

import argparse
import functools
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.comparison import as_json
from experiments.drawn_heads import TEST_SEED, Heads, Real, descended, drawn
from experiments.learners import LEARNERS, Table, Trained, one_waveform, table_of
from experiments.measures import first_hits, stratified
from experiments.policies import Policy, PolicyFileError, kept_policy
from experiments.progress import shown_progress
from inkjet_env.storage import json_text, write_atomically

FORMAT = "amortised/2"
TITLE = "Learning over heads"
BUDGETS = (50, 150, 2000)
WARM_STEP = 0.05
"""First step of a warm start, in half widths of the box: a policy is near, or it is worth nothing."""
SCRATCH = ("cma-es", "lbfgsb-multistart", "pso", "coordinate")
SMALLER = 10
"""The smaller table costs so many times less than a training."""
RESAMPLES = 1000


@dataclass(frozen=True, eq=False)
class TuningResult:
    """What a way of tuning came to on heads that nobody had seen.

    Parameters
    ----------
    name : str
    at_once_V : ndarray, shape (heads,)
        Regret of the policy's own waveform; NaN where there is no policy.
    curves_V : ndarray, shape (heads, evaluations)
        Regret of the best waveform after each further evaluation.
    trained : int
        Evaluations that training cost.
    """

    name: str
    at_once_V: Real
    curves_V: Real
    trained: int


def tuned(
    name: str, policy: Policy | Table | None, optimizer: str, heads: Heads, best_V: Real, seed: int
) -> TuningResult:
    """Tune every head: by an optimiser from scratch, or by one from where a policy begins, which may be CMA-ES only."""
    import optimizers
    from optimizers.loop import minimise

    budget = max(BUDGETS)
    count = len(heads.observations)
    begin = None if policy is None else policy.act(heads.observations)
    at_once = np.full(count, math.nan) if begin is None else heads.evaluate(begin) - best_V
    curves = np.empty((count, budget))
    with shown_progress(f"test {name}", count) as progress:
        for k in range(count):
            options: dict[str, Any] = {}
            if begin is not None:
                options = {"start": begin[k].tolist(), "first_step": WARM_STEP}
            run = minimise(heads.one(k), optimizers.make(optimizer, budget=budget, seed=seed + k, **options), budget)
            curves[k] = np.minimum.accumulate(run.costs) - best_V[k]
            if begin is not None:  # the policy's own waveform is the first evaluation
                curves[k] = np.minimum(np.concatenate([[at_once[k]], curves[k][:-1]]), at_once[k])
            progress(k + 1, "")
    return TuningResult(name, at_once, curves, 0 if policy is None else int(policy.made["evaluations"]))


def break_even(policy: TuningResult, scratch: TuningResult, evaluations: int, heads: Any = slice(None)) -> float:
    """Heads from which on learning has cost less than optimising each from scratch, to be as good as it is.

    As good: the policy's median regret after so many evaluations a head. Infinite where scratch is there sooner.

    Parameters
    ----------
    policy, scratch : TuningResult
    evaluations : int
    heads : slice or ndarray of int
        Which of the heads count; all unless given.
    """
    target = float(np.median(policy.curves_V[heads, evaluations - 1]))
    curve = np.median(scratch.curves_V[heads], axis=0)
    needed = float(first_hits(curve[None, :], [target])[0, 0])
    saved = needed - evaluations
    return policy.trained / saved if saved > 0 else math.inf


def told(results: Sequence[TuningResult], rng: np.random.Generator) -> list[dict[str, Any]]:
    """Median regrets with 95 % intervals over heads, at once and after each budget, and break-even numbers."""
    scratch = min((one for one in results if not one.trained), key=lambda one: float(np.median(one.curves_V[:, -1])))
    rows = []
    for one in results:
        row: dict[str, Any] = {"name": one.name, "trained": one.trained}
        columns = {"0": one.at_once_V} | {str(b): one.curves_V[:, b - 1] for b in BUDGETS}
        for label, values in columns.items():
            if np.isfinite(values).all():
                found = stratified(lambda x: np.median(x, axis=(-2, -1)), [values[:, None]], rng)
                row[label] = as_json(found)
        if one.trained:
            evens = functools.partial(_break_evens, one, scratch)
            heads = np.arange(len(one.curves_V))[:, None]
            row["break_even_heads"] = as_json(stratified(evens, [heads], rng, RESAMPLES))
            row["against"] = scratch.name
        rows.append(row)
    return rows


def _break_evens(policy: TuningResult, scratch: TuningResult, heads: Real) -> Real:
    """Break-even numbers of samples of the heads, which are numbers (..., heads, 1); shape (...)."""
    flat = heads[..., 0].reshape(-1, heads.shape[-2]).astype(int)
    found = np.array([break_even(policy, scratch, BUDGETS[0], some) for some in flat])
    evens: Real = found.reshape(heads.shape[:-2])
    return evens


def study(folder: Path, evaluations: int, heads: int, labelling: int, seed: int) -> dict[str, Any]:
    """Train every learner, test all ways, write ``amortised.json``; policies are kept and not trained again."""
    folder.mkdir(parents=True, exist_ok=True)
    tests = Heads(drawn(heads, TEST_SEED))
    best = np.array([descended(tests.one(k), labelling, seed + k)[1] for k in range(heads)])
    asked = {"evaluations": evaluations, "seed": seed}
    trained = {
        name: kept_policy(folder / f"{name}.npz", asked, functools.partial(_policy, learn, evaluations, seed))
        for name, learn in LEARNERS.items()
    }
    results = []
    for optimizer in SCRATCH:
        results.append(tuned(optimizer, None, optimizer, tests, best, seed))
    tables = [one_waveform(seed), *(table_of(count, seed) for count in (max(1, evaluations // SMALLER), evaluations))]
    begun: dict[str, Policy | Table] = {f"table of {_heads(table.made['heads'])}": table for table in tables}
    begun.update(trained)
    for name, policy in begun.items():
        results.append(tuned(name, policy, "cma-es", tests, best, seed))
    least = np.min([one.curves_V.min(axis=1) for one in results], axis=0)
    moved = [TuningResult(o.name, o.at_once_V - least, o.curves_V - least[:, None], o.trained) for o in results]
    found = {
        "format": FORMAT,
        "heads": heads,
        "evaluations": evaluations,
        "seed": seed,
        "best_improved": int(np.sum(least < -1e-6)),
        "rows": told(moved, np.random.default_rng(seed)),
    }
    write_atomically(folder / "amortised.json", json_text(found))
    return found


def _policy(learn: Callable[[int, int], Trained], evaluations: int, seed: int) -> Policy:
    return learn(evaluations, seed)[0]


def table(found: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Header and rows of a study, for people."""

    def volts(entry: Mapping[str, float] | None) -> str:
        return "–" if entry is None else f"{entry['value']:.3g} ({entry['low']:.3g} … {entry['high']:.3g})"

    rows = []
    for row in found["rows"]:
        pays = "" if not row["trained"] else _heads_from(row["break_even_heads"])
        rows.append(
            (row["name"], f"{row['trained']:,}", *(volts(row.get(str(b))) for b in (0, *BUDGETS)), pays),
        )
    return ("tuned by", "evaluations to learn", *(f"after {b:,}" for b in (0, *BUDGETS)), "pays from … heads"), rows


def _heads(count: int) -> str:
    return "1 head" if count == 1 else f"{count} heads"


def _heads_from(even: Mapping[str, float | None]) -> str:
    """A break-even number with its interval; whole heads."""
    whole = {name: None if value is None else f"{math.ceil(value):,}" for name, value in even.items()}
    if whole["value"] is None:
        return "never" if whole["low"] is None else f"never ({whole['low']} … ∞)"
    return f"{whole['value']} ({whole['low']} … {whole['high'] or '∞'})"


def legend(found: Mapping[str, Any]) -> str:
    """What the table's numbers are."""
    return (
        f"Medians over {found['heads']} heads that nobody had seen, of the regret in volts, with 95 % intervals over "
        f"heads; one training each."
    )


def print_study(found: Mapping[str, Any]) -> None:
    """The table for people."""
    from experiments.tables import print_table

    print_table(*table(found))
    print(legend(found))


def run_command(
    module: str,
    description: str | None,
    evaluations: int,
    heads: int,
    run: Callable[[Path, int, int, int, int], Mapping[str, Any]],
    show: Callable[[Mapping[str, Any]], None],
    arguments: list[str] | None,
) -> None:
    """A study from the command line: ``run(folder, evaluations, heads, labelling, seed)``, then ``show`` of it."""
    parser = argparse.ArgumentParser(prog=f"python -m experiments.{module}", description=description)
    parser.add_argument("--folder", type=Path, default=Path("results") / module.replace("_", "-"))
    parser.add_argument("--evaluations", type=int, default=evaluations, help="of a training")
    parser.add_argument("--heads", type=int, default=heads, help="to test on")
    parser.add_argument("--labelling", type=int, default=60, help="descents for the best cost known of a test head")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    for name, least in (("evaluations", 1), ("heads", 1), ("labelling", 1), ("seed", 0)):
        if getattr(chosen, name) < least:
            parser.error(f"--{name} must be at least {least}; got {getattr(chosen, name)}.")
    try:
        show(run(chosen.folder, chosen.evaluations, chosen.heads, chosen.labelling, chosen.seed))
    except PolicyFileError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    except KeyboardInterrupt:
        print(f"Interrupted; policies that are trained are kept in {chosen.folder}.", file=sys.stderr)
        sys.exit(130)


def main(arguments: list[str] | None = None) -> None:
    """Train, test and tell."""
    run_command("amortised", __doc__, 200_000, 100, study, print_study, arguments)


if __name__ == "__main__":
    main()
