"""A few tries on an unknown head: the tuning strategies compared on ``inkjet_env/TuneWaveform-v0``.

``python -m inkjet_env.experiments.learning.few_shot`` compares optimisers that spend the tries from scratch, one
waveform for all heads, CMA-ES started from it, a fixed list of waveforms, unchanged or stretched to the ringing period
measured after a pulse, Bayesian optimisation with a prior that is learnt from other heads, a trained agent that
observes the peaks, a recurrent policy trained on the simulator's exact gradients, and the model-based tuner ``tune``,
which weighs simulated heads by the peaks it reads and fires the waveform that is best on them; all on the same unseen
heads, and also where readings are noisier and heads lie further out than most were prepared for. The cost of learning
is counted in evaluations; everything that learns is trained several times. A folder stores policies and results."""

from __future__ import annotations

import copy
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.envs.tune_waveform import TRIES, TuneWaveformVectorEnv
from inkjet_env.experiments.learning.benches import AS_EXPECTED, BENCHES
from inkjet_env.experiments.learning.few_shot_tuners import (
    SCRATCH,
    Agent,
    TuningStrategy,
    for_all,
    lists,
    scratch,
    trained_agent,
)
from inkjet_env.experiments.learning.heads import TEST_SEED
from inkjet_env.experiments.learning.learnt_prior import learnt_prior
from inkjet_env.experiments.learning.model_based_tuner import ModelBasedTuner
from inkjet_env.experiments.learning.recurrent_policy import RecurrentTuner
from inkjet_env.experiments.learning.repeated_training import (
    Arrays,
    ResultTable,
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

MODULE = "inkjet_env.experiments.learning.few_shot"
FORMAT = "few-tries/4"
TITLE = "A few tries on an unknown head"
AGENT, FOR_ALL, LISTS, PRIOR, MODEL_BASED = "sb3-ppo", "one for all", "lists", "learnt prior", "tune"
RECURRENT = "recurrent policy"
REFERENCE = "list, stretched"
"""Baseline of least effort with which all are compared."""
LEARNT = (AGENT, FOR_ALL, LISTS, PRIOR, RECURRENT)
"""Methods that learn or collect waveforms from a seed; each of the middle two gives two tuning strategies."""
OF_A_GRADIENT = 32
"""Evaluations of the recurrent policy's training for each of the agent's: with exact gradients it is as fast."""
LEARNING = "evaluations to learn"
SHOWN = (1, 3, TRIES)
"""Numbers of tries after which the tables show the regret."""


def tested(
    folder: Path, way: str, training: int, evaluations: int, seed: int, heads: int, tries: int, test_seed: int
) -> Arrays:
    """Learn with a seed and tune; return by bench and tuner the true costs in volts after each try, (heads, tries).

    A cost is that of the waveform kept so far; the entry `LEARNING` is the number of evaluations that learning took.
    Result and policy are stored in the folder; what is stored there is reused.
    """
    file = f"{way.replace(' ', '-')}-{training}"
    asked = {"evaluations": evaluations, "tries": tries, "seed": seed}

    def make() -> Arrays:
        if way == AGENT:
            names = TuneWaveformVectorEnv(1, tries=tries).tuning.observation_names()
            train = functools.partial(trained_agent, evaluations, tries, seed)
            policy = kept_policy(folder / f"{file}.npz", asked, train, names)
            tuners: dict[str, TuningStrategy] = {AGENT: Agent(policy)}
            spent = int(policy.made["evaluations"])
        elif way == FOR_ALL:
            tuners, spent = for_all(heads, tries, seed)
        elif way == LISTS:
            tuners, spent = lists(tries, seed)
        elif way == PRIOR:
            optimiser, spent = learnt_prior(seed)
            tuners = {PRIOR: optimiser}
        elif way == RECURRENT:
            from inkjet_env.experiments.learning.recurrent_training import trained_recurrent_policy

            learnt = trained_recurrent_policy(OF_A_GRADIENT * evaluations, tries, seed)
            learnt.save(folder / f"{file}.npz")
            tuners, spent = {RECURRENT: RecurrentTuner(learnt)}, int(learnt.made["evaluations"])
        elif way == MODEL_BASED:
            tuners, spent = {MODEL_BASED: ModelBasedTuner(seed)}, 0
        else:
            tuners, spent = scratch(way, heads, tries, seed), 0
        kept = {
            _entry(bench, name): where.kept_costs_V(copy.deepcopy(tuner), heads, tries, test_seed)
            for bench, where in BENCHES.items()
            for name, tuner in tuners.items()
        }
        return {**kept, LEARNING: np.array(spent)}

    return kept_arrays(folder / f"{file}-tested.npz", {**asked, "way": way, "heads": heads, "on": test_seed}, make)


def _entry(bench: str, name: str) -> str:
    return f"{bench}: {name}"


def study(
    folder: Path,
    evaluations: int,
    heads: int,
    labelling: int,
    seed: int,
    trainings: int = 1,
    workers: int = 1,
    tries: int = TRIES,
) -> dict[str, Any]:
    """Learn, tune every head with every strategy, and write ``few_tries.json``.

    Parameters
    ----------
    folder : Path
        Folder for policies and results, which are reused.
    evaluations : int
        Evaluations of an agent's training.
    heads : int
        Number of heads to tune.
    labelling : int
        Number of descents for the best known cost of a head.
    seed, trainings, workers, tries : int
        Seed of the study, number of trainings of each method, number of processes, and number of tries per head.
    """
    test_seed = TEST_SEED + seed
    once = (MODEL_BASED, *SCRATCH)  # the longest job first
    jobs = {name: (folder, name, 1, evaluations, seed, heads, tries, test_seed) for name in once} | {
        f"{way}, training {k}": (folder, way, k, evaluations, one, heads, tries, test_seed)
        for way in LEARNT
        for k, one in enumerate(seeds(seed, trainings), 1)
    }
    found = each("few tries", tested, jobs, workers)
    kept_V: dict[str, Real] = {}
    learning: dict[str, int] = {}
    trained: dict[str, int] = {}
    for way in (*once, *LEARNT):
        some = [found[job] for job, arguments in jobs.items() if arguments[1] == way]
        spent = [float(one.pop(LEARNING)) for one in some]
        for entry in some[0]:
            kept_V[entry] = np.array([one[entry] for one in some])
            name = entry.partition(": ")[2]
            learning[name], trained[name] = round(float(np.mean(spent))), len(some)
    rows: dict[str, dict[str, Any]] = {
        name: {"name": name, "learning": learning[name], "trainings": trained[name]} for name in learning
    }
    nothing_V = {}
    for bench, where in BENCHES.items():
        known = folder / bench.replace(" ", "-")
        best_V = where.best_costs_V(known, heads, labelling, seed, test_seed)
        mine_V = {name: kept_V[_entry(bench, name)] for name in rows}
        least_V = np.min([best_V, *(kept.min(axis=(0, 2)) for kept in mine_V.values())], axis=0)
        nothing_V[bench] = float(np.median(-least_V))
        rng = np.random.default_rng(seed)
        counts = sorted({min(count, tries) for count in SHOWN})
        reference_V = mine_V[REFERENCE] - least_V[:, None]
        for name, row in rows.items():
            regret_V = mine_V[name] - least_V[:, None]
            told: dict[str, Any] = {"after": {str(count): median_of(regret_V[..., count - 1], rng) for count in counts}}
            if name != REFERENCE:
                told["behind"] = median_difference(regret_V[..., -1], reference_V[..., -1], rng)
            if bench == AS_EXPECTED:
                row |= told
            else:
                row.setdefault("elsewhere", {})[bench] = told
    content = {
        "format": FORMAT,
        "heads": heads,
        "tries": tries,
        "evaluations": evaluations,
        "labelling": labelling,
        "seed": seed,
        "trainings": trainings,
        "nothing_V": nothing_V,
        "rows": list(rows.values()),
    }
    write_atomically(folder / "few_tries.json", json_text(content))
    return content


def result_tables(found: Mapping[str, Any]) -> tuple[ResultTable, ResultTable]:
    """Tables of a study, the best after the last try first: where all is as expected, and elsewhere."""
    counts = tuple(found["rows"][0]["after"])
    ordered = sorted(found["rows"], key=lambda row: float(row["after"][counts[-1]]["value"]))
    rows = [
        (
            row["name"], f"{row['learning']:,}", *map(with_interval, row["after"].values()),
            spread_of(row["after"][counts[-1]]["each"]), with_interval(row.get("behind")),
        )
        for row in ordered
    ]  # fmt: skip
    elsewhere = [
        (row["name"], *(with_interval(told["after"][n]) for told in row["elsewhere"].values() for n in counts[1:]))
        for row in ordered
    ]
    after = (f"after {count}" for count in counts)
    ends = (f"range of trainings, after {counts[-1]}", f"above {REFERENCE}, after {counts[-1]}")
    where = (f"after {count}, {bench}" for bench in found["rows"][0]["elsewhere"] for count in counts[1:])
    return (("method", "training evaluations", *after, *ends), rows), (("method", *where), elsewhere)


def legend(found: Mapping[str, Any]) -> str:
    """Explanation of the table's numbers."""
    return (
        f"Median regret in volts {over(found['heads'], found['trainings'])}. Without any drive it is "
        + "; ".join(f"{volts:.2f} V {bench}" for bench, volts in found["nothing_V"].items())
        + "."
    )


def main(arguments: list[str] | None = None) -> None:
    """Learn, tune and print the results."""
    run_command(MODULE, Path("results/few-tries"), __doc__, 500_000, 200, study, result_tables, legend, arguments)


if __name__ == "__main__":
    main()
