"""Methods that give any head a waveform: the exact gradient, imitation, PPO, SAC, and lookup tables.

All are charged alike: every evaluation of a waveform in training counts; one with its gradient counts as one. The
total is in ``made["evaluations"]`` of the policy or table.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkjet_env.experiments.learning.heads import TRAIN_SEED, Heads, OneHead, descended, drawn, stretched
from inkjet_env.experiments.learning.policies import Policy, policy_of_layers, policy_of_sb3
from inkjet_env.extras import extra
from inkjet_env.typing import Real

HIDDEN = (128, 128)
LABELLING_STARTS = 4
"""Number of descents of which the best gives a waveform to imitate."""

STARTS_FOR_ONE = 20
"""Number of descents of which the best gives the waveform that is stretched for all heads."""
WARM_STEP = 0.05
"""First step of a warm start, in half widths of the box; small, because a useful policy starts near the optimum."""


@dataclass(frozen=True, eq=False)
class Table:
    """Waveforms that descents found for some heads; any head gets that of the nearest, stretched to its resonance.

    The distance is Euclidean in the environment's observations, each of which has a range of 2.

    Parameters
    ----------
    observations : ndarray, shape (heads, 4)
        Observations of the heads in the table.
    points : ndarray, shape (heads, 7)
        Their best waveforms, in ``[-1, 1]``.
    made : dict
        How the table was made; ``evaluations`` is the number that it took.
    """

    observations: Real
    points: Real
    made: Mapping[str, Any]

    def act(self, observations: ArrayLike) -> Real:
        """Actions in ``[-1, 1]``, shape (n, 7), for observations, shape (n, 4)."""
        shown = np.atleast_2d(np.asarray(observations, dtype=np.float64))
        nearest = np.sum((shown[:, None] - self.observations[None]) ** 2, axis=2).argmin(axis=1)
        return stretched(self.points[nearest], self.observations[nearest], shown)


Begun = Policy | Table
"""A policy or a table: it gives any head its initial waveform."""


def table_of(evaluations: int, seed: int) -> Table:
    """A table of as many heads as ``evaluations`` allows."""
    observations, points, spent = labelled(evaluations, seed)
    return Table(observations, points, {"by": "table", "evaluations": spent, "heads": len(points), "seed": seed})


def one_waveform(seed: int) -> Table:
    """A table of one head, the middle one."""
    middle = np.zeros((1, 4), dtype=np.float32)
    point, _, spent = descended(OneHead(middle), STARTS_FOR_ONE, seed)
    made = {"by": "table", "evaluations": spent, "heads": 1, "seed": seed}
    return Table(middle.astype(np.float64), point[None, :], made)


def labelled(evaluations: int, seed: int) -> tuple[Real, Real, int]:
    """Heads, shape (n, 4), and their best waveforms, shape (n, 7), with about ``evaluations``; and the number spent."""
    observations: list[Real] = []
    points: list[Real] = []
    spent = 0
    while spent < evaluations:
        k = len(points)
        one = drawn(1, TRAIN_SEED + seed * 100_000 + k)
        point, _, used = descended(OneHead(one), LABELLING_STARTS, seed + k)
        observations.append(one[0].astype(np.float64))
        points.append(point)
        spent += used
    return np.array(observations), np.array(points), spent


def by_gradient(evaluations: int, seed: int, heads: int = 256) -> Policy:
    """A network trained on the simulator's exact gradient of the mean cost over heads, which are redrawn each step."""
    with extra("learning"):
        import torch

    torch.manual_seed(seed)
    torch.set_num_threads(1)
    network, layers = _network()
    steps = max(1, evaluations // heads)
    optimiser = torch.optim.Adam(network.parameters(), lr=3e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for step in range(steps):
        some = Heads(drawn(heads, TRAIN_SEED + seed * 100_000 + step))
        actions = torch.tanh(network(torch.as_tensor(some.observations)))
        _, gradients = some.evaluate_with_gradient(actions.detach().double().numpy())
        optimiser.zero_grad()
        # the chain rule by hand: the simulator's gradient, then the network's
        actions.backward(torch.as_tensor(gradients / heads, dtype=actions.dtype))
        torch.nn.utils.clip_grad_norm_(network.parameters(), 10.0)
        optimiser.step()
        schedule.step()
    return policy_of_layers(layers, "tanh", {"by": "gradient", "evaluations": steps * heads, "seed": seed})


def by_imitation(evaluations: int, seed: int) -> Policy:
    """A regression on the best waveforms that descents found for as many heads as ``evaluations`` allows."""
    with extra("learning"):
        import torch

    observations, points, spent = labelled(evaluations, seed)
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    network, layers = _network()
    x = torch.as_tensor(observations, dtype=torch.float32)
    y = torch.as_tensor(points, dtype=torch.float32)
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-3, weight_decay=1e-4)
    for _ in range(3000):
        optimiser.zero_grad()
        torch.mean((network(x) - y) ** 2).backward()
        optimiser.step()
    made = {"by": "imitation", "evaluations": spent, "heads": len(points), "seed": seed}
    return policy_of_layers(layers, "clip", made)


AGENT_HEADS = {"PPO": 512, "SAC": 16}
"""Number of heads on which an agent acts at once."""


def by_agent(algorithm: str, evaluations: int, seed: int) -> Policy:
    """PPO or SAC from Stable-Baselines3, trained on the environment with random heads."""
    with extra("learning"):
        from inkjet_env.envs.sb3 import BipolarWaveformVecEnv

    envs = BipolarWaveformVecEnv(AGENT_HEADS[algorithm], context="random")
    envs.seed(seed)
    model = agent_on(envs, algorithm, seed)
    name = f"sb3-{algorithm.lower()}"
    return policy_of_sb3(model, {"by": name, "evaluations": let_learn(model, evaluations), "seed": seed})


def agent_on(envs: Any, algorithm: str, seed: int) -> Any:
    """PPO or SAC of Stable-Baselines3 with settings for episodes of one step, on any of its vector environments."""
    with extra("learning"):
        import stable_baselines3
        import torch
        from torch import nn

    torch.set_num_threads(1)
    network = {"net_arch": list(HIDDEN), "activation_fn": nn.Tanh}
    options: dict[str, Any] = (
        {"n_steps": 1, "batch_size": 512, "learning_rate": 1e-3, "policy_kwargs": network | {"log_std_init": -0.7}}
        if algorithm == "PPO"
        else {"train_freq": 1, "gradient_steps": 4, "batch_size": 256, "gamma": 0.0, "policy_kwargs": network}
    )
    return getattr(stable_baselines3, algorithm)("MlpPolicy", envs, seed=seed, device="cpu", **options)


def let_learn(model: Any, evaluations: int) -> int:
    """Train a Stable-Baselines3 agent; return the evaluations spent, which may slightly exceed ``evaluations``."""
    with extra("learning"):
        from stable_baselines3.common.logger import Logger

    model.set_logger(Logger(None, []))  # SB3's default logger creates a folder for every training
    model.learn(evaluations)
    return int(model.num_timesteps)


def tuned_costs_V(
    begun: Begun | None, optimizer: str, heads: Heads, further: int, seed: int
) -> dict[str, NDArray[Any]]:
    """Tune every head with an optimiser, from scratch or from the waveform of a policy or a table (CMA-ES only).

    Returns
    -------
    dict
        ``at_once_V``, shape (heads,): costs in volts of the initial waveforms, NaN from scratch; ``after_V``, shape
        (heads, further): costs in volts of the best waveform after each further evaluation; ``learning``, shape ():
        evaluations that learning took.
    """
    from inkjet_env import optimizers
    from inkjet_env.optimizers.loop import minimise

    count = len(heads.observations)
    begin = None if begun is None else begun.act(heads.observations)
    at_once_V = np.full(count, math.nan) if begin is None else heads.evaluate(begin)
    after_V = np.empty((count, further))
    for k in range(count):
        options = {} if begin is None else {"start": begin[k].tolist(), "first_step": WARM_STEP}
        run = minimise(heads.one(k), optimizers.make(optimizer, budget=further, seed=seed + k, **options), further)
        after_V[k] = np.minimum.accumulate(run.costs)
        if begin is not None:  # the policy's own waveform is the first evaluation
            after_V[k] = np.minimum(np.concatenate([[at_once_V[k]], after_V[k][:-1]]), at_once_V[k])
    spent = 0 if begun is None else int(begun.made["evaluations"])
    return {"at_once_V": at_once_V, "after_V": after_V, "learning": np.array(spent)}


def _network() -> tuple[Any, list[Any]]:
    """A network of linear layers with tanh between them, and the list of its linear layers."""
    with extra("learning"):
        from torch import nn

    sizes = (4, *HIDDEN, 7)
    layers = [nn.Linear(a, b) for a, b in itertools.pairwise(sizes)]
    between = [part for layer in layers[:-1] for part in (layer, nn.Tanh())]
    return nn.Sequential(*between, layers[-1]), layers


LEARNERS: dict[str, Callable[[int, int], Policy]] = {
    "gradient": by_gradient,
    "imitation": by_imitation,
    "sb3-ppo": functools.partial(by_agent, "PPO"),
    "sb3-sac": functools.partial(by_agent, "SAC"),
}
