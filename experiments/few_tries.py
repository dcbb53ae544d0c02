"""A few tries on a head that nobody knows: what to expect of whom on ``inkjet_env/TuneWaveform-v0``.

``python -m experiments.few_tries`` has optimisers spend the tries from scratch, fires one waveform for all heads, goes
on from it by CMA-ES, fires a list of waveforms, as it is or stretched to the period that rings after a pulse, and
trains an agent that sees the peaks; all on the same heads, which nobody saw before. What learning took is counted in
evaluations. A folder keeps what was learnt.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.amortised import run_command
from experiments.drawn_heads import TEST_SEED, TRAIN_SEED, Heads, Real, descended, drawn
from experiments.learners import HIDDEN, labelled, let_learn
from experiments.measures import stratified
from experiments.policies import Policy, kept_policy, policy_of_sb3
from experiments.progress import shown_progress
from experiments.tuners import Agent, Listed, OneForAll, Optimisers, Tuner, best_list
from inkjet_env.envs.tune_waveform import TRIES, TuneWaveformVectorEnv
from inkjet_env.storage import json_text, write_atomically

FORMAT = "few-tries/2"
TITLE = "A few tries on an unknown head"
SCRATCH: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (name, {}) for name in ("random", "sobol", "pso", "coordinate", "cma-es", "optuna-gp")},
    "pso of 3": ("pso", {"particles": 3}),
    "cma-es of 4": ("cma-es", {"population": 4}),
    "optuna-gp from 3": ("optuna-gp", {"startup": 3}),
}
"""Optimisers that know nothing: at their defaults, which use no reading before some ten tries, and smaller ones."""
LISTED = 100_000
"""Evaluations that the heads cost whose best waveforms the lists are chosen from."""
SHOWN = (1, 3, TRIES)
"""After how many tries the tables tell."""
NEAR = 0.15
"""First step of CMA-ES around the waveform for all, in half widths of the box: heads differ by that much."""


def kept_costs_V(tuner: Tuner, heads: int, tries: int, seed: int) -> Real:
    """True cost of the waveform kept after each try, shape (heads, tries); the same heads for the same seed."""
    envs = TuneWaveformVectorEnv(heads, tries=tries)
    observations, _ = envs.reset(seed=seed)
    kept = np.empty((heads, tries))
    for k in range(tries):
        actions = np.asarray(tuner.fire(observations), dtype=np.float32)
        observations, _, _, _, infos = envs.step(actions)
        kept[:, k] = infos["kept_cost"]
        tuner.told(infos["reading"])
    return kept


def heads_on_the_bench(heads: int, seed: int) -> Heads:
    """The heads that the environment puts on the bench for that seed."""
    envs = TuneWaveformVectorEnv(heads)
    envs.reset(seed=seed)
    return Heads(envs.tuning.contexts.copy())


def one_for_all(seed: int, heads: int = 64, waveforms: int = 3000) -> tuple[Real, int]:
    """The waveform of least mean cost over many heads, by CMA-ES, and the evaluations that it took."""
    import optimizers

    many = Heads(drawn(heads, TRAIN_SEED + seed))
    search = optimizers.make("bipop-cma-es", budget=waveforms, seed=seed)
    best, least = np.zeros(7), math.inf
    while search.remaining:
        points = search.ask()
        means = np.array([many.evaluate(np.tile(point, (heads, 1))).mean() for point in points])
        search.tell(points, means)
        if means.min() < least:
            best, least = points[means.argmin()], float(means.min())
    return best, heads * waveforms


def trained_agent(evaluations: int, tries: int, seed: int) -> Policy:
    """Stable-Baselines3's PPO on the environment, which sees peaks and is never told the head."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    from inkjet_env.envs.sb3 import TuneWaveformVecEnv

    torch.set_num_threads(1)
    envs = TuneWaveformVecEnv(64, tries=tries)
    names = envs.vector_env.tuning.observation_names()
    envs.seed(seed)
    model = PPO(
        "MlpPolicy", VecNormalize(envs, norm_obs=False, gamma=1.0), n_steps=4 * tries, batch_size=256,
        learning_rate=5e-4, gamma=1.0, seed=seed, device="cpu",
        policy_kwargs={"net_arch": list(HIDDEN), "activation_fn": torch.nn.Tanh, "log_std_init": -0.7},
    )  # fmt: skip
    spent = let_learn(model, "sb3-ppo", evaluations)
    made = {"by": "sb3-ppo", "evaluations": spent, "tries": tries, "seed": seed}
    return policy_of_sb3(model, made, names)


def _lists(tries: int, shown: tuple[str, ...], seed: int) -> list[tuple[str, int, Callable[[], Tuner]]]:
    """A list of waveforms as it is, and one that is stretched to the period that rings after a pulse."""
    heads, points, spent = labelled("lists", LISTED, seed)
    found: list[tuple[str, int, Callable[[], Tuner]]] = []
    for name, names in (("list", None), ("list, stretched", shown)):
        chosen, more = best_list(heads, points, tries, stretch=names is not None)
        found.append((name, spent + more, functools.partial(Listed, chosen, names)))
    return found


def study(folder: Path, evaluations: int, heads: int, labelling: int, seed: int, tries: int = TRIES) -> dict[str, Any]:
    """Learn, tune every head by everybody, and write ``few_tries.json``.

    Parameters
    ----------
    folder : Path
    evaluations : int
        Of the agent's training.
    heads : int
        To be tuned.
    labelling : int
        Descents for the best cost known of a head.
    seed, tries : int
    """
    folder.mkdir(parents=True, exist_ok=True)
    asked = {"evaluations": evaluations, "tries": tries, "seed": seed}
    shown = TuneWaveformVectorEnv(1, tries=tries).tuning.observation_names()
    policy = kept_policy(
        folder / "sb3-ppo.npz", asked, functools.partial(trained_agent, evaluations, tries, seed), shown
    )
    point, spent = one_for_all(seed)
    test_seed = TEST_SEED + seed
    tested = heads_on_the_bench(heads, test_seed)
    best_V = np.array([descended(tested.one(k), labelling, seed + k)[1] for k in range(heads)])

    near = {"start": point.tolist(), "first_step": NEAR}
    tuners: list[tuple[str, int, Callable[[], Tuner]]] = [
        *(
            (name, 0, functools.partial(Optimisers, of, heads, tries, seed, **more))
            for name, (of, more) in SCRATCH.items()
        ),
        ("one for all", spent, functools.partial(OneForAll, point)),
        ("cma-es from one for all", spent, functools.partial(Optimisers, "cma-es", heads, tries, seed, **near)),
        *_lists(tries, shown, seed),
        ("sb3-ppo", int(policy.made["evaluations"]), functools.partial(Agent, policy)),
    ]
    rng = np.random.default_rng(seed)
    rows = []
    with shown_progress("few tries", len(tuners)) as progress:
        for done, (name, learning, make) in enumerate(tuners):
            regrets = kept_costs_V(make(), heads, tries, test_seed) - best_V[:, None]
            after = {}
            for count in sorted({min(count, tries) for count in SHOWN}):
                median = stratified(lambda x: np.median(x, axis=(-2, -1)), [regrets[:, count - 1, None]], rng)
                after[str(count)] = vars(median)
            rows.append({"name": name, "learning": learning, "after": after})
            progress(done + 1, name)
    found = {
        "format": FORMAT,
        "heads": heads,
        "tries": tries,
        "evaluations": evaluations,
        "seed": seed,
        "nothing_V": float(np.median(-best_V)),
        "rows": rows,
    }
    write_atomically(folder / "few_tries.json", json_text(found))
    return found


def table(found: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Header and rows of a study, for people; who is best after the last try comes first."""
    counts = tuple(found["rows"][0]["after"])
    rows = [
        (
            row["name"], f"{row['learning']:,}",
            *(f"{e['value']:.2f} ({e['low']:.2f} … {e['high']:.2f})" for e in row["after"].values()),
        )
        for row in sorted(found["rows"], key=lambda row: float(row["after"][counts[-1]]["value"]))
    ]  # fmt: skip
    return ("tuned by", "evaluations to learn", *(f"after {count}" for count in counts)), rows


def legend(found: Mapping[str, Any]) -> str:
    """What the table's numbers are."""
    return (
        f"Median regret in volts over {found['heads']} heads that nobody had seen, with its 95 % interval; firing "
        f"nothing has {found['nothing_V']:.2f}."
    )


def print_study(found: Mapping[str, Any]) -> None:
    """The table for people."""
    from experiments.tables import print_table

    print_table(*table(found))
    print(legend(found))


def main(arguments: list[str] | None = None) -> None:
    """Learn, tune and tell."""
    run_command("few_tries", __doc__, 500_000, 200, study, print_study, arguments)


if __name__ == "__main__":
    main()
