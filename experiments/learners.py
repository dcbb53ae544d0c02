"""Ways to a waveform for any head: by the exact gradient, imitation, PPO and SAC; and tables, which learn nothing.

One ledger for all: every evaluation of a waveform in training counts; one with its gradient counts as one.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from experiments.drawn_heads import TRAIN_SEED, Heads, OneHead, Real, descended, drawn, stretched
from experiments.policies import Policy, policy_of_layers, policy_of_sb3
from experiments.progress import shown_progress

HIDDEN = (128, 128)
LABELLING_STARTS = 4
"""Descents that a waveform to imitate is the best of."""

STARTS_FOR_ONE = 20
"""The same of the waveform that is stretched for all heads."""

Trained = tuple[Policy, int]
"""A policy, and the evaluations that it cost."""


@dataclass(frozen=True, eq=False)
class Table:
    """Waveforms that descents found for heads; another head gets that of the nearest, stretched to its resonance.

    Nearest: in what the environment shows of a head, where every range is two wide.

    Parameters
    ----------
    observations : ndarray, shape (heads, 4)
    points : ndarray, shape (heads, 7)
    made : dict
        How it was made; ``evaluations`` that it cost.
    """

    observations: Real
    points: Real
    made: Mapping[str, Any]

    def act(self, observations: ArrayLike) -> Real:
        """Actions in ``[-1, 1]``, shape (n, 7), for observations, shape (n, 4)."""
        shown = np.atleast_2d(np.asarray(observations, dtype=np.float64))
        nearest = np.sum((shown[:, None] - self.observations[None]) ** 2, axis=2).argmin(axis=1)
        return stretched(self.points[nearest], self.observations[nearest], shown)


def table_of(evaluations: int, seed: int) -> Table:
    """A table of as many heads as the evaluations allow."""
    observations, points, spent = labelled("table", evaluations, seed)
    return Table(observations, points, {"by": "table", "evaluations": spent, "heads": len(points), "seed": seed})


def one_waveform(seed: int) -> Table:
    """A table of one head, the middle one."""
    middle = np.zeros((1, 4), dtype=np.float32)
    point, _, spent = descended(OneHead(middle), STARTS_FOR_ONE, seed)
    made = {"by": "table", "evaluations": spent, "heads": 1, "seed": seed}
    return Table(middle.astype(np.float64), point[None, :], made)


def labelled(name: str, evaluations: int, seed: int) -> tuple[Real, Real, int]:
    """Heads (n, 4) and their best waveforms (n, 7), until so many evaluations are spent, and what was spent."""
    observations: list[Real] = []
    points: list[Real] = []
    spent = 0
    with shown_progress(name, evaluations) as progress:
        while spent < evaluations:
            k = len(points)
            one = drawn(1, TRAIN_SEED + seed * 100_000 + k)
            point, cost, used = descended(OneHead(one), LABELLING_STARTS, seed + k)
            observations.append(one[0].astype(np.float64))
            points.append(point)
            spent += used
            progress(min(spent, evaluations), f"{k + 1} heads, {cost:.2f} V")
    return np.array(observations), np.array(points), spent


def by_gradient(evaluations: int, seed: int, heads: int = 256) -> Trained:
    """A network trained on the simulator's exact gradient: the mean cost over heads that are drawn anew each step."""
    import torch

    torch.manual_seed(seed)
    torch.set_num_threads(1)
    network, layers = _network()
    steps = max(1, evaluations // heads)
    optimiser = torch.optim.Adam(network.parameters(), lr=3e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    with shown_progress("gradient", steps) as progress:
        for step in range(steps):
            some = Heads(drawn(heads, TRAIN_SEED + seed * 100_000 + step))
            actions = torch.tanh(network(torch.as_tensor(some.observations)))
            costs, gradients = some.evaluate_with_gradient(actions.detach().double().numpy())
            optimiser.zero_grad()
            # the chain rule by hand: the simulator's gradient, then the network's
            actions.backward(torch.as_tensor(gradients / heads, dtype=actions.dtype))
            torch.nn.utils.clip_grad_norm_(network.parameters(), 10.0)
            optimiser.step()
            schedule.step()
            progress(step + 1, f"mean cost {costs.mean():.2f} V")
    made = {"by": "gradient", "evaluations": steps * heads, "seed": seed}
    return policy_of_layers(layers, "tanh", made), steps * heads


def by_imitation(evaluations: int, seed: int) -> Trained:
    """A plain regression on the best waveforms that descents found for heads, as many as the evaluations allow."""
    import torch

    observations, points, spent = labelled("imitation", evaluations, seed)
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
    return policy_of_layers(layers, "clip", made), spent


def by_agent(algorithm: str, evaluations: int, seed: int) -> Trained:
    """PPO or SAC of Stable-Baselines3 on the environment with drawn heads."""
    import stable_baselines3
    import torch
    from torch import nn

    from inkjet_env.envs.sb3 import BipolarWaveformVecEnv

    torch.set_num_threads(1)
    ppo = algorithm == "PPO"
    envs = BipolarWaveformVecEnv(512 if ppo else 16, context="random")
    envs.seed(seed)
    network = {"net_arch": list(HIDDEN), "activation_fn": nn.Tanh}
    options: dict[str, Any] = (
        {"n_steps": 1, "batch_size": 512, "learning_rate": 1e-3, "policy_kwargs": network | {"log_std_init": -0.7}}
        if ppo
        else {"train_freq": 1, "gradient_steps": 4, "batch_size": 256, "gamma": 0.0, "policy_kwargs": network}
    )
    model = getattr(stable_baselines3, algorithm)("MlpPolicy", envs, seed=seed, device="cpu", **options)
    name = f"sb3-{algorithm.lower()}"
    spent = let_learn(model, name, evaluations)
    return policy_of_sb3(model, {"by": name, "evaluations": spent, "seed": seed}), spent


def let_learn(model: Any, name: str, evaluations: int) -> int:
    """Train an agent of Stable-Baselines3 and show how far it is; evaluations spent, perhaps some more than asked."""
    from stable_baselines3.common.logger import Logger

    model.set_logger(Logger(None, []))  # its own would leave a folder behind for every training
    with shown_progress(name, evaluations) as progress:

        def tell(*_: Any) -> bool:
            progress(min(model.num_timesteps, evaluations), "")
            return True

        model.learn(evaluations, callback=tell)
    return int(model.num_timesteps)


def _network() -> tuple[Any, list[Any]]:
    """Linear layers with tanh between them, and the linear ones alone."""
    from torch import nn

    sizes = (4, *HIDDEN, 7)
    layers = [nn.Linear(a, b) for a, b in itertools.pairwise(sizes)]
    between = [part for layer in layers[:-1] for part in (layer, nn.Tanh())]
    return nn.Sequential(*between, layers[-1]), layers


LEARNERS: dict[str, Callable[[int, int], Trained]] = {
    "gradient": by_gradient,
    "imitation": by_imitation,
    "sb3-ppo": functools.partial(by_agent, "PPO"),
    "sb3-sac": functools.partial(by_agent, "SAC"),
}
