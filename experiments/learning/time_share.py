"""How much of the time of a learning agent the environment takes.

``python -m inkjet_env.experiments.learning.time_share`` trains PPO and SAC of Stable-Baselines3 on heads drawn at
random, with the settings of the comparison of learners, each on two batches of environments: its own
(``make_vec_env``), which steps single environments one after another, and that of this package. What ``reset`` and
``step`` take is the environment's share; the rest is the agent's network."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from inkjet_env.experiments.learning.learners import AGENT_HEADS, agent_on, let_learn
from inkjet_env.extras import MissingExtraError, extra
from inkjet_env.reporting.tables import print_table
from inkjet_env.storage import write_json

FORMAT = "time-share/1"
CONTEXT = "random"
"""How the environment chooses its heads."""
BATCHES = {"make_vec_env": "one after another", "BipolarWaveformVecEnv": "side by side"}
"""Batches of environments by their names, and how they step."""


def batch_of(name: str, heads: int, seed: int) -> Any:
    """The vector environment of that name, seeded."""
    with extra("learning"):
        from stable_baselines3.common.env_util import make_vec_env

        from inkjet_env.envs.sb3 import BipolarWaveformVecEnv

    if name == "BipolarWaveformVecEnv":
        envs: Any = BipolarWaveformVecEnv(heads, context=CONTEXT)
        envs.seed(seed)
        return envs
    return make_vec_env("inkjet_env/BipolarWaveform-v0", heads, seed=seed, env_kwargs={"context": CONTEXT})


def timed(envs: Any) -> Any:
    """The vector environment with the time that it takes, in seconds, as ``taken_s``."""
    with extra("learning"):
        from stable_baselines3.common.vec_env import VecEnvWrapper

    class Timed(VecEnvWrapper):
        taken_s = 0.0

        def reset(self) -> Any:
            begin_s = time.perf_counter()
            observations = self.venv.reset()
            self.taken_s += time.perf_counter() - begin_s
            return observations

        def step_async(self, actions: Any) -> None:
            begin_s = time.perf_counter()
            self.venv.step_async(actions)
            self.taken_s += time.perf_counter() - begin_s

        def step_wait(self) -> Any:
            begin_s = time.perf_counter()
            stepped = self.venv.step_wait()
            self.taken_s += time.perf_counter() - begin_s
            return stepped

    return Timed(envs)


def shared(algorithm: str, batch: str, steps: int, seed: int) -> dict[str, float]:
    """Train an agent; seconds for a thousand steps, in all and within the environment, and its share.

    Parameters
    ----------
    algorithm : {"PPO", "SAC"}
        The agent.
    batch : str
        One of `BATCHES`.
    steps : int
        Number of environment steps.
    seed : int
        Seed of agent and heads.
    """
    heads = AGENT_HEADS[algorithm]
    let_learn(agent_on(batch_of(batch, heads, seed), algorithm, seed), 2 * heads)  # compiles, and warms up
    envs = timed(batch_of(batch, heads, seed))
    agent = agent_on(envs, algorithm, seed)
    begin_s = time.perf_counter()
    learned = let_learn(agent, steps)
    whole_s = time.perf_counter() - begin_s
    return {
        "heads": heads,
        "steps": learned,
        "whole_s": 1e3 * whole_s / learned,
        "environment_s": 1e3 * envs.taken_s / learned,
        "share": envs.taken_s / whole_s,
    }


def main(arguments: list[str] | None = None) -> None:
    """Train, print, and write what was found."""
    parser = argparse.ArgumentParser(prog="python -m inkjet_env.experiments.learning.time_share", description=__doc__)
    parser.add_argument("--steps", type=int, default=50_000, help="environment steps of PPO; SAC takes a tenth")
    parser.add_argument("--seed", type=int, default=0, help="seed of agents and heads")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything that was measured")
    chosen = parser.parse_args(arguments)
    if chosen.steps < 1:
        parser.error(f"--steps must be at least 1; got {chosen.steps}.")
    found: dict[str, dict[str, dict[str, float]]] = {}
    rows = []
    try:
        for algorithm in AGENT_HEADS:
            steps = chosen.steps if algorithm == "PPO" else max(chosen.steps // 10, 1)
            found[algorithm] = {batch: shared(algorithm, batch, steps, chosen.seed) for batch in BATCHES}
            for batch, one in found[algorithm].items():
                rows.append(
                    (
                        f"{algorithm}, {one['heads']:.0f} heads {BATCHES[batch]}",
                        f"{one['whole_s']:.3f}",
                        f"{one['environment_s']:.4f}",
                        f"{100 * one['share']:.1f} %",
                    )
                )
    except MissingExtraError as error:
        parser.error(str(error))
    print_table(("seconds for 1,000 steps", "whole", "environment", "share"), rows)
    if chosen.json is not None:
        write_json(chosen.json, {"format": FORMAT, "seed": chosen.seed, "agents": found})


if __name__ == "__main__":
    main()
