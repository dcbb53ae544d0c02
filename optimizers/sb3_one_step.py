"""Reinforcement learning as an optimiser: Stable-Baselines3 on single-step episodes."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from inkjet_env.optimizers.base import checked_count
from inkjet_env.optimizers.callback import CallbackOptimizer
from inkjet_env.optimizers.process_randomness import OwnRandomness
from inkjet_env.typing import Real


class OneStepEnvs(VecEnv):
    """Parallel single-step tasks: the action is a point, the reward minus its cost, the observation constant."""

    def __init__(self, optimizer: CallbackOptimizer, tasks: int) -> None:
        box = spaces.Box(-1.0, 1.0, (optimizer.dimension,), np.float32)
        super().__init__(tasks, spaces.Box(0.0, 1.0, (1,), np.float32), box)
        self._optimizer = optimizer
        self._points: Real = np.empty((tasks, optimizer.dimension))

    def reset(self) -> Any:
        """The constant observations, shape (tasks, 1)."""
        return np.ones((self.num_envs, 1), np.float32)

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions, shape (tasks, d), clipped to the box."""
        self._points = np.clip(actions.astype(np.float64), -1.0, 1.0)

    def step_wait(self) -> Any:
        """Evaluate the actions; every episode ends."""
        costs = self._optimizer.evaluate(self._points)
        ended = np.ones(self.num_envs, dtype=bool)
        return self.reset(), -costs.astype(np.float32), ended, [{} for _ in range(self.num_envs)]

    def close(self) -> None:
        """Do nothing: there are no resources to release."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The same attribute for each task."""
        return [getattr(self, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not offered."""
        raise NotImplementedError("these tasks have no attributes to set")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Not offered."""
        raise NotImplementedError("these tasks have no methods of their own")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """False for the one environment: it is not wrapped."""
        return [False] * self.num_envs


class _OneStepLearner(CallbackOptimizer):
    """Training is the search: every training episode is one evaluation of the budget, and there are no others."""

    def __init__(self, dimension: int, budget: int, seed: int, *, tasks: int) -> None:
        super().__init__(dimension, budget, seed)
        self._tasks = checked_count("tasks", tasks)
        self._randomness = OwnRandomness(self.seed)
        torch.set_num_threads(1)  # more threads only slow down networks this small

    def algorithm(self, envs: VecEnv) -> BaseAlgorithm:
        """The untrained learner."""
        raise NotImplementedError

    def search(self) -> None:
        """Train until the budget is spent."""
        # gamma = 0: an episode's return is its only reward. It is normalised because the costs' scale is unknown.
        envs = VecNormalize(OneStepEnvs(self, self._tasks), norm_obs=False, norm_reward=True, gamma=0.0)
        algorithm = self.algorithm(envs)
        algorithm.set_logger(Logger(None, []))  # SB3's default logger creates a folder for every run
        algorithm.learn(total_timesteps=self.budget)

    def propose(self) -> Real:
        """Continue training up to the next episodes, on private random streams."""
        with self._randomness:
            return super().propose()

    def close(self) -> None:
        """Stop the training at its present step."""
        with self._randomness:
            super().close()


class OneStepPPO(_OneStepLearner):
    """Proximal policy optimisation (Schulman et al., arXiv:1707.06347) from Stable-Baselines3.

    The policy is a Gaussian over the box, clipped at its walls. With single-step episodes neither gamma nor lambda has
    an effect: the advantage is the reward minus its learnt mean. A rollout is one step of 40 tasks, as many as the
    swarm has particles, so a budget of 2,000 gives 50 updates. Four settings differ from SB3's defaults, all because a
    budget of 2,000 is tiny for reinforcement learning: the learning rate is 1e-2 instead of 3e-4, the initial standard
    deviation exp(-0.7) (half the half width of the box) instead of 1, the networks have one layer of 32, and a batch
    is the whole rollout. The settings were chosen on a sphere and a rippled sphere function, not on the printhead's
    problems.

    Parameters
    ----------
    dimension, budget, seed : int
        See `Optimizer`.
    tasks : int
        Number of parallel episodes, at least 2.
    learning_rate : float
        Step size of Adam.
    log_std : float
        Natural logarithm of the initial standard deviation, which is in half widths of the box.
    """

    name = "sb3-ppo"

    def __init__(
        self,
        dimension: int,
        budget: int,
        seed: int,
        *,
        tasks: int = 40,
        learning_rate: float = 1e-2,
        log_std: float = -0.7,
    ) -> None:
        super().__init__(dimension, budget, seed, tasks=tasks)
        checked_count("tasks", tasks, least=2)
        self._learning_rate, self._log_std = learning_rate, log_std

    def algorithm(self, envs: VecEnv) -> BaseAlgorithm:
        """PPO with the settings above."""
        return PPO(
            "MlpPolicy",
            envs,
            learning_rate=self._learning_rate,
            n_steps=1,
            batch_size=self._tasks,
            n_epochs=10,
            policy_kwargs={"net_arch": [32], "log_std_init": self._log_std},
            seed=self.seed % 2**32,
            device="cpu",
        )


class OneStepSAC(_OneStepLearner):
    """Soft actor-critic (Haarnoja et al., arXiv:1801.01290, arXiv:1812.05905) from Stable-Baselines3.

    The policy is a Gaussian squashed into the box by tanh. With single-step episodes the critics learn the reward
    itself; gamma and the target networks have no effect. The first 100 evaluations are uniform; then 2 gradient steps
    follow every 10 evaluations, about 380 in a budget of 2,000. SB3's default, one gradient step per evaluation, takes
    five times as long; a learning rate of 3e-3 instead of 3e-4 compensates for the fewer steps. The networks have two
    layers of 64, the batches 128 samples. The entropy weight is fixed at 0.02 (rewards are scaled to unit variance):
    SB3's automatic weight holds the policy at an entropy of -d, too wide to settle on one best point. The settings
    were chosen on a sphere and a rippled sphere function, not on the printhead's problems.

    Parameters
    ----------
    dimension, budget, seed : int
        See `Optimizer`.
    tasks : int
        Number of parallel episodes, at least 1.
    learning_rate : float
        Step size of Adam.
    entropy : float
        Weight of the policy's entropy in the objective, relative to rewards of unit variance.
    """

    name = "sb3-sac"

    def __init__(
        self,
        dimension: int,
        budget: int,
        seed: int,
        *,
        tasks: int = 10,
        learning_rate: float = 3e-3,
        entropy: float = 0.02,
    ) -> None:
        super().__init__(dimension, budget, seed, tasks=tasks)
        self._learning_rate, self._entropy = learning_rate, entropy

    def algorithm(self, envs: VecEnv) -> BaseAlgorithm:
        """SAC with the settings above."""
        return SAC(
            "MlpPolicy",
            envs,
            learning_rate=self._learning_rate,
            buffer_size=max(self.budget, self._tasks),
            learning_starts=100,
            batch_size=128,
            train_freq=1,
            gradient_steps=2,
            ent_coef=self._entropy,
            policy_kwargs={"net_arch": [64, 64]},
            seed=self.seed % 2**32,
            device="cpu",
        )
