"""Rewards for learners on one head that seek the best waveform instead of the best average one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.envs.sb3 import BipolarWaveformVecEnv
from inkjet_env.extras import extra

with extra("inkjet_env.envs.softmax_rewards"):
    from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper


class SoftmaxRewards(VecEnvWrapper):
    """Replace the rewards of a batch by their softmax, whose temperature falls while the learner learns.

    The mean reward of a Gaussian policy is best where the cost is bad but flat: on the published head PPO with
    minibatches of 64 stops at 5 to 6 V of 22.8 V, and most descents along the gradient end at 0 V, firing nothing. With
    the weights ``exp(r / T) / mean exp(r / T)`` of the rewards ``r`` of a batch, each relative to the others, what
    counts is what the better part of the batch reaches; as T falls the part becomes smaller and the policy narrower.
    (Risk-seeking policy gradients: Petersen et al., ICLR 2021; weights of this form: Peters & Schaal, ICML 2007.) It is
    for a fixed head: among drawn heads the weights would prefer lucky heads to good waveforms.

    Parameters
    ----------
    venv : VecEnv
        The environments; the more, the better the softmax of a batch is known. 1,024 is a good number.
    steps : int
        Steps of single environments within which T falls from ``first_V`` to ``last_V``, geometrically.
    first_V, last_V : float
        Temperatures in volts.

    Attributes
    ----------
    best_V : float
        The largest reward so far, in volts.
    best_action : ndarray, shape (7,), or None
        Its action.

    Examples
    --------
    ::

        from stable_baselines3 import PPO
        from inkjet_env.envs.sb3 import BipolarWaveformVecEnv
        from inkjet_env.envs.softmax_rewards import SoftmaxRewards

        env = SoftmaxRewards(BipolarWaveformVecEnv(1024), steps=400_000)
        model = PPO("MlpPolicy", env, n_steps=1, batch_size=1024, learning_rate=1e-3, gamma=1.0,
                    policy_kwargs={"log_std_init": -1.0})
        model.learn(400_000)
    """

    def __init__(self, venv: VecEnv, steps: int, first_V: float = 3.0, last_V: float = 0.3) -> None:
        super().__init__(venv)
        if isinstance(venv, BipolarWaveformVecEnv) and venv.vector_env.task.context != "fixed":
            raise ValueError(
                'rewards are weighed against those of the same batch, so all must be of one head: context="fixed".'
            )
        if steps < 1:
            raise ValueError(f"steps must be at least 1; got {steps!r}.")
        for name, value in (("first_V", first_V), ("last_V", last_V)):
            if not (isinstance(value, (int, float)) and 0 < value < math.inf):
                raise ValueError(f"{name} must be a temperature above 0 V; got {value!r}.")
        self.steps, self.first_V, self.last_V = steps, first_V, last_V
        self.done = 0
        self.best_V = -math.inf
        self.best_action: NDArray[Any] | None = None
        self._actions: NDArray[Any] | None = None

    @property
    def temperature_V(self) -> float:
        """Temperature of the next batch, in volts."""
        return self.first_V * (self.last_V / self.first_V) ** min(self.done / self.steps, 1.0)

    def reset(self) -> Any:
        """Start all episodes."""
        return self.venv.reset()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Hand the actions on, and remember them."""
        self._actions = actions
        self.venv.step_async(actions)

    def step_wait(self) -> Any:
        """Fire the waveforms; the rewards are weights, with mean 1."""
        observations, rewards, dones, infos = self.venv.step_wait()
        best = int(np.argmax(rewards))
        if rewards[best] > self.best_V and self._actions is not None:
            self.best_V, self.best_action = float(rewards[best]), self._actions[best].copy()
        weights = np.exp((rewards - rewards[best]) / self.temperature_V)
        self.done += len(rewards)
        return observations, (weights / weights.mean()).astype(np.float32), dones, infos
