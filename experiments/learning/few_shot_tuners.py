"""Who tunes heads in a few tries, and how each is made: an optimiser, an agent, one waveform for all, a list."""

from __future__ import annotations

import math
from collections import deque
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from experiments.learning.heads import TRAIN_SEED, Heads, drawn, stretched, the_task
from experiments.learning.learners import HIDDEN, labelled, let_learn
from experiments.learning.policies import Policy, policy_of_sb3
from inkjet_env.envs.task import CONTEXT_LOWER, CONTEXT_UPPER
from inkjet_env.envs.tune_waveform import TuneWaveformVectorEnv
from inkjet_env.envs.waveform_tuning_task import TIME_SCALE_S
from inkjet_env.typing import Real

MIDDLE = np.zeros((1, 4))
"""The middle of the heads, as the environment shows it: what waveforms of a list are made for."""
SCRATCH: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (name, {}) for name in ("random", "sobol", "pso", "coordinate", "cma-es", "optuna-gp")},
    "pso of 3": ("pso", {"particles": 3}),
    "cma-es of 4": ("cma-es", {"population": 4}),
    "optuna-gp from 3": ("optuna-gp", {"startup": 3}),
}
"""Optimisers that know nothing: at their defaults, which use no reading before some ten tries, and smaller ones."""
LISTED = 100_000
"""Evaluations that the heads cost whose best waveforms the lists are chosen from."""
NEAR = 0.15
"""First step of CMA-ES around the waveform for all, in half widths of the box: heads differ by that much."""
PULSE = np.array([1.0, 1.0, -1.0, -1.0, -1.0, -1.0, -1.0])
"""The shortest pulse of the box, after which a head rings freely."""


class TuningStrategy(Protocol):
    """How N heads are tuned side by side: the next waveform of each, from what its last ones cost."""

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """Actions for the next try, shape (n, 7)."""

    def tell(self, readings: Real) -> None:
        """Costs as they were read, shape (n,)."""


class Optimisers:
    """An optimiser a head, which is told readings and nothing else.

    Parameters
    ----------
    name : str
    count : int
        Number of heads.
    tries : int
    seed : int
    **options
        Of the optimiser.
    """

    def __init__(self, name: str, count: int, tries: int, seed: int, **options: Any) -> None:
        import optimizers

        self.each = [optimizers.make(name, budget=tries, seed=seed + k, **options) for k in range(count)]
        self.asked: list[Real] = [np.empty((0, 7))] * count
        self.waiting: list[deque[Real]] = [deque() for _ in range(count)]
        self.read: list[list[float]] = [[] for _ in range(count)]

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """The next of what each has asked for."""
        for k, optimizer in enumerate(self.each):
            if not self.waiting[k]:
                self.asked[k], self.read[k] = optimizer.ask(), []
                self.waiting[k].extend(self.asked[k])
        return np.array([waiting.popleft() for waiting in self.waiting])

    def tell(self, readings: Real) -> None:
        """Each is told once all that it asked for has been read."""
        for k, optimizer in enumerate(self.each):
            self.read[k].append(float(readings[k]))
            if not self.waiting[k]:
                optimizer.tell(self.asked[k], np.array(self.read[k]))


class Agent:
    """A policy that sees what the environment shows."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """What it does where it sees that."""
        return self.policy.act(observations)

    def tell(self, readings: Real) -> None:
        """It will see them."""


class ConstantWaveform:
    """The same waveform whatever the head, again and again."""

    def __init__(self, point: Real) -> None:
        self.point = point

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """That waveform."""
        return np.tile(self.point, (len(observations), 1))

    def tell(self, readings: Real) -> None:
        """It does not listen."""


class FixedSequence:
    """The waveforms of a list, one after the other; or a pulse first, and they are stretched to the period that rings.

    Parameters
    ----------
    points : ndarray, shape (tries, 7)
        In ``[-1, 1]``; of those that are stretched, for the middle of the heads.
    names : tuple of str, or None
        What each number of an observation is, where the period is read; None where nothing is.
    """

    def __init__(self, points: Real, names: tuple[str, ...] | None = None) -> None:
        self.points, self.done = points, 0
        self.times = [k for k, name in enumerate(names or ()) if name.endswith("_time")]
        self.heads: Real | None = None

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """The next of the list."""
        number, self.done = self.done, self.done + 1
        if not self.times:
            return np.tile(self.points[number], (len(observations), 1))
        if self.heads is None and number:
            self.heads = self._read(TIME_SCALE_S * np.asarray(observations, dtype=np.float64)[:, self.times])
        if self.heads is None:
            return np.tile(PULSE, (len(observations), 1))
        return stretched(np.tile(self.points[number - 1], (len(observations), 1)), MIDDLE, self.heads)

    def tell(self, readings: Real) -> None:
        """It does not listen to costs."""

    def _read(self, times_s: Real) -> Real:
        """Heads in the middle but for their resonances, shape (n, 4), from times of peaks, shape (n, peaks)."""
        over_s = float(the_task().bounds.from_unit(PULSE[None, :])[0, 2:].sum())
        low_Hz, high_Hz = CONTEXT_LOWER[0], CONTEXT_UPPER[0]
        heads = np.tile(MIDDLE, (len(times_s), 1))
        for head, times in zip(heads, times_s, strict=True):
            free = times[times > over_s]
            if len(free) > 1:  # peaks of a free ringing are half a period apart
                resonance_Hz = 0.5 * (len(free) - 1) / (free[-1] - free[0])
                head[0] = (2 * resonance_Hz - low_Hz - high_Hz) / (high_Hz - low_Hz)
        return heads


def best_list(observations: Real, points: Real, count: int, stretch: bool) -> tuple[Real, int]:
    """The list of waveforms, shape (count, 7), that leaves heads the least mean cost; and the evaluations it took.

    The next is always that which betters the list most, beginning with what is best alone.

    Parameters
    ----------
    observations : ndarray, shape (n, 4)
        Heads.
    points : ndarray, shape (n, 7)
        The best waveform of each.
    count : int
    stretch : bool
        Whether waveforms will be stretched to the heads' resonances.
    """
    candidates = stretched(points, observations, MIDDLE) if stretch else points
    heads = Heads(observations.astype(np.float32))
    tried = [np.tile(candidate, (len(observations), 1)) for candidate in candidates]
    costs = np.array([heads.evaluate(stretched(one, MIDDLE, observations) if stretch else one) for one in tried])
    chosen: list[int] = []
    least = np.zeros(len(observations))  # firing nothing
    for _ in range(count):
        chosen.append(int(np.minimum(costs, least).mean(axis=1).argmin()))
        least = np.minimum(least, costs[chosen[-1]])
    return candidates[chosen], costs.size


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
    spent = let_learn(model, evaluations)
    made = {"by": "sb3-ppo", "evaluations": spent, "tries": tries, "seed": seed}
    return policy_of_sb3(model, made, names)


def kept_costs_V(tuner: TuningStrategy, heads: int, tries: int, seed: int) -> Real:
    """True cost of the waveform kept after each try, shape (heads, tries); the same heads for the same seed."""
    envs = TuneWaveformVectorEnv(heads, tries=tries)
    observations, _ = envs.reset(seed=seed)
    kept = np.empty((heads, tries))
    for k in range(tries):
        actions = np.asarray(tuner.fire(observations), dtype=np.float32)
        observations, _, _, _, infos = envs.step(actions)
        kept[:, k] = infos["kept_cost"]
        tuner.tell(infos["reading"])
    return kept


def scratch(name: str, heads: int, tries: int, seed: int) -> dict[str, TuningStrategy]:
    """One of `SCRATCH` for so many heads."""
    of, options = SCRATCH[name]
    return {name: Optimisers(of, heads, tries, seed, **options)}


def for_all(heads: int, tries: int, seed: int) -> tuple[dict[str, TuningStrategy], int]:
    """The waveform for all and CMA-ES from there, and the evaluations that it took to find."""
    point, spent = one_for_all(seed)
    near = Optimisers("cma-es", heads, tries, seed, start=point.tolist(), first_step=NEAR)
    return {"one for all": ConstantWaveform(point), "cma-es from one for all": near}, spent


def lists(tries: int, seed: int) -> tuple[dict[str, TuningStrategy], int]:
    """A list as it is, and one that is stretched to the period that rings after a pulse; and what either took."""
    observations, points, spent = labelled(LISTED, seed)
    plain, more = best_list(observations, points, tries, stretch=False)
    stretching, _ = best_list(observations, points, tries, stretch=True)
    names = TuneWaveformVectorEnv(1, tries=tries).tuning.observation_names()
    return {"list": FixedSequence(plain), "list, stretched": FixedSequence(stretching, names)}, spent + more
