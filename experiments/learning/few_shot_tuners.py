"""Strategies that tune heads in a few tries: an optimiser, an agent, one waveform for all heads, a fixed list."""

from __future__ import annotations

import math
from collections import deque
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from inkjet_env.envs.task import CONTEXT_LOWER, CONTEXT_UPPER
from inkjet_env.envs.tune_waveform import TuneWaveformVectorEnv
from inkjet_env.envs.waveform_tuning_task import TIME_SCALE_S
from inkjet_env.experiments.learning.heads import TRAIN_SEED, Heads, drawn, stretched, the_task
from inkjet_env.experiments.learning.learners import HIDDEN, labelled, let_learn
from inkjet_env.experiments.learning.policies import Policy, policy_of_sb3
from inkjet_env.extras import extra
from inkjet_env.typing import Real

MIDDLE = np.zeros((1, 4))
"""Observation of the middle head, for which the waveforms of a list are made."""
SCRATCH: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (name, {}) for name in ("random", "sobol", "pso", "coordinate", "cma-es", "optuna-gp")},
    "pso of 3": ("pso", {"particles": 3}),
    "cma-es of 4": ("cma-es", {"population": 4}),
    "optuna-gp from 3": ("optuna-gp", {"startup": 3}),
}
"""Optimisers without prior knowledge: at defaults, which use no reading before about ten tries, and with smaller
populations, which use readings earlier."""
LISTED = 100_000
"""Number of evaluations spent on finding the waveforms from which the lists are chosen."""
NEAR = 0.15
"""First step of CMA-ES around the waveform for all heads, in half widths of the box: the heads' optima differ by that
much."""
PULSE = np.array([1.0, 1.0, -1.0, -1.0, -1.0, -1.0, -1.0])
"""The shortest pulse of the box, after which a head rings freely."""


class TuningStrategy(Protocol):
    """A strategy that tunes n heads in parallel: the next waveform of each from the costs of its previous ones."""

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """Actions for the next try, shape (n, 7)."""

    def tell(self, readings: Real) -> None:
        """Report the measured costs in volts, shape (n,)."""


class Optimisers:
    """One optimiser per head, which receives the measured costs and nothing else.

    Parameters
    ----------
    name : str
        Name of the optimiser in the registry.
    count : int
        Number of heads.
    tries : int
        Budget of each optimiser: tries per head.
    seed : int
        Seed of the first head's optimiser; each further head's is one higher.
    **options
        Keyword arguments of the optimiser.
    """

    def __init__(self, name: str, count: int, tries: int, seed: int, **options: Any) -> None:
        from inkjet_env import optimizers

        self.each = [optimizers.make(name, budget=tries, seed=seed + k, **options) for k in range(count)]
        self.asked: list[Real] = [np.empty((0, 7))] * count
        self.waiting: list[deque[Real]] = [deque() for _ in range(count)]
        self.read: list[list[float]] = [[] for _ in range(count)]

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """The next point of each optimiser's batch, shape (n, 7)."""
        for k, optimizer in enumerate(self.each):
            if not self.waiting[k]:
                self.asked[k], self.read[k] = optimizer.ask(), []
                self.waiting[k].extend(self.asked[k])
        return np.array([waiting.popleft() for waiting in self.waiting])

    def tell(self, readings: Real) -> None:
        """Store the costs in volts, shape (n,); an optimiser gets them once its whole batch is measured."""
        for k, optimizer in enumerate(self.each):
            self.read[k].append(float(readings[k]))
            if not self.waiting[k]:
                optimizer.tell(self.asked[k], np.array(self.read[k]))


class Agent:
    """A policy that acts on the environment's observations."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """The policy's actions for the observations, shape (n, 7)."""
        return self.policy.act(observations)

    def tell(self, readings: Real) -> None:
        """Do nothing: the readings are part of the next observation."""


class ConstantWaveform:
    """The same waveform for every head and every try."""

    def __init__(self, point: Real) -> None:
        self.point = point

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """That waveform for each head, shape (n, 7)."""
        return np.tile(self.point, (len(observations), 1))

    def tell(self, readings: Real) -> None:
        """Do nothing: the costs are not used."""


class FixedSequence:
    """The waveforms of a list in order; optionally after a pulse, stretched to the ringing period it reveals.

    Parameters
    ----------
    points : ndarray, shape (tries, 7)
        Points in ``[-1, 1]``; if they are stretched, made for the middle head.
    names : tuple of str, or None
        Name of each number of an observation, from which the period is read; None for no stretching.
    """

    def __init__(self, points: Real, names: tuple[str, ...] | None = None) -> None:
        self.points, self.done = points, 0
        self.times = [k for k, name in enumerate(names or ()) if name.endswith("_time")]
        self.heads: Real | None = None

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """The next waveform of the list for each head, shape (n, 7)."""
        number, self.done = self.done, self.done + 1
        if not self.times:
            return np.tile(self.points[number], (len(observations), 1))
        if self.heads is None and number:
            self.heads = self._read(TIME_SCALE_S * np.asarray(observations, dtype=np.float64)[:, self.times])
        if self.heads is None:
            return np.tile(PULSE, (len(observations), 1))
        return stretched(np.tile(self.points[number - 1], (len(observations), 1)), MIDDLE, self.heads)

    def tell(self, readings: Real) -> None:
        """Do nothing: the costs are not used."""

    def _read(self, times_s: Real) -> Real:
        """Observations of the middle head with the measured resonances, shape (n, 4), from peak times, shape (n, k)."""
        over_s = float(the_task().bounds.from_unit(PULSE[None, :])[0, 2:].sum())
        low_Hz, high_Hz = CONTEXT_LOWER[0], CONTEXT_UPPER[0]
        heads = np.tile(MIDDLE, (len(times_s), 1))
        for head, times in zip(heads, times_s, strict=True):
            free = times[times > over_s]
            if len(free) > 1:  # peaks of free ringing are half a period apart
                resonance_Hz = 0.5 * (len(free) - 1) / (free[-1] - free[0])
                head[0] = (2 * resonance_Hz - low_Hz - high_Hz) / (high_Hz - low_Hz)
        return heads


def best_list(observations: Real, points: Real, count: int, stretch: bool) -> tuple[Real, int]:
    """A list of waveforms, shape (count, 7), chosen for least mean cost over the heads; and the evaluations it took.

    The choice is greedy: each waveform is the one that most reduces the mean over the heads of the lowest cost so far.

    Parameters
    ----------
    observations : ndarray, shape (n, 4)
        Observations of the heads.
    points : ndarray, shape (n, 7)
        Best waveform of each head, in ``[-1, 1]``.
    count : int
        Number of waveforms in the list.
    stretch : bool
        Whether waveforms will be stretched to the heads' resonances.
    """
    candidates = stretched(points, observations, MIDDLE) if stretch else points
    heads = Heads(observations.astype(np.float32))
    tried = [np.tile(candidate, (len(observations), 1)) for candidate in candidates]
    costs = np.array([heads.evaluate(stretched(one, MIDDLE, observations) if stretch else one) for one in tried])
    chosen: list[int] = []
    least = np.zeros(len(observations))  # the cost of the zero waveform
    for _ in range(count):
        chosen.append(int(np.minimum(costs, least).mean(axis=1).argmin()))
        least = np.minimum(least, costs[chosen[-1]])
    return candidates[chosen], costs.size


def one_for_all(seed: int, heads: int = 64, waveforms: int = 3000) -> tuple[Real, int]:
    """The waveform with the lowest mean cost over many heads, found by CMA-ES, and the evaluations that it took."""
    from inkjet_env import optimizers

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
    """Policy of Stable-Baselines3's PPO trained on the environment; it observes peaks but not the head's parameters."""
    with extra("learning"):
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
    spent = let_learn(model, evaluations)
    made = {"by": "sb3-ppo", "evaluations": spent, "tries": tries, "seed": seed}
    return policy_of_sb3(model, made, names)


def kept_costs_V(tuner: TuningStrategy, count: int, tries: int, seed: int, spread: float = 1.0, **options: Any) -> Real:
    """True cost in volts of the waveform kept after each try, shape (count, tries); the seed determines the heads.

    Their parameters are ``spread`` times as far from the middle of their ranges as the environment draws them;
    ``options`` are further ones of the environment.
    """
    envs = TuneWaveformVectorEnv(count, tries=tries, **options)
    observations, _ = envs.reset(seed=seed)
    if spread != 1.0:
        envs.tuning.put_on_the_bench(spread * envs.tuning.contexts)
    kept = np.empty((count, tries))
    for k in range(tries):
        actions = np.asarray(tuner.fire(observations), dtype=np.float32)
        observations, _, _, _, infos = envs.step(actions)
        kept[:, k] = infos["kept_cost"]
        tuner.tell(infos["reading"])
    return kept


def scratch(name: str, heads: int, tries: int, seed: int) -> dict[str, TuningStrategy]:
    """One of `SCRATCH`, for ``heads`` heads."""
    of, options = SCRATCH[name]
    return {name: Optimisers(of, heads, tries, seed, **options)}


def for_all(heads: int, tries: int, seed: int) -> tuple[dict[str, TuningStrategy], int]:
    """The waveform for all heads, CMA-ES started from it, and the evaluations that finding it took."""
    point, spent = one_for_all(seed)
    near = Optimisers("cma-es", heads, tries, seed, start=point.tolist(), first_step=NEAR)
    return {"one for all": ConstantWaveform(point), "cma-es from one for all": near}, spent


def lists(tries: int, seed: int) -> tuple[dict[str, TuningStrategy], int]:
    """An unchanged list, one stretched to the ringing period after a pulse, and the evaluations that each took."""
    observations, points, spent = labelled(LISTED, seed)
    plain, more = best_list(observations, points, tries, stretch=False)
    stretching, _ = best_list(observations, points, tries, stretch=True)
    names = TuneWaveformVectorEnv(1, tries=tries).tuning.observation_names()
    return {"list": FixedSequence(plain), "list, stretched": FixedSequence(stretching, names)}, spent + more
