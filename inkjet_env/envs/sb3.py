"""The vector environments with Stable-Baselines3's interface. Importing this module imports it and torch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from inkjet_env.envs.bipolar_waveform import check_no_options
from inkjet_env.envs.tune_waveform import TuneWaveformVectorEnv
from inkjet_env.envs.vector import BipolarWaveformVectorEnv
from inkjet_env.extras import extra

with extra("inkjet_env.envs.sb3"):
    from stable_baselines3.common.vec_env import VecEnv


class _HeadsVecEnv(VecEnv):
    """A vector environment of this package with Stable-Baselines3's interface."""

    def __init__(self, vector_env: Any) -> None:
        if vector_env.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError("autoreset_mode cannot be given: Stable-Baselines3 restarts episodes in the same step.")
        self.vector_env = vector_env
        super().__init__(vector_env.num_envs, vector_env.single_observation_space, vector_env.single_action_space)
        self._actions: NDArray[Any] | None = None

    def reset(self) -> NDArray[np.float32]:
        """Start all episodes, with the seeds given to `seed` since the last reset."""
        for options in self._options:
            check_no_options(options)
        observations, _ = self.vector_env.reset(seed=self._seeds)
        self._reset_seeds()
        self._actions = None
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Store the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Fire the waveforms; episodes that end are restarted."""
        if self._actions is None:
            raise RuntimeError("step_wait() needs actions: call step_async(actions) first.")
        actions, self._actions = self._actions, None
        observations, rewards, dones, _, infos = self.vector_env.step(actions)
        step_infos: list[dict[str, Any]] = [
            {name: values[i] for name, values in self._reported(infos).items()} | {"TimeLimit.truncated": False}
            for i in range(self.num_envs)
        ]
        if "final_obs" in infos:
            for info, final, ended in zip(step_infos, infos["final_obs"], infos["_final_obs"], strict=True):
                if ended:
                    info["terminal_observation"] = final
        return observations, rewards.astype(np.float32), dones, step_infos

    @staticmethod
    def _reported(infos: dict[str, Any]) -> dict[str, NDArray[Any]]:
        """Infos of the vector environment for every head, without Gymnasium's masks."""
        return {name: values for name, values in infos.items() if not name.startswith(("_", "final_"))}

    def close(self) -> None:
        """Do nothing: no resources are held open."""
        self.vector_env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """One picture per head of the waveform fired last."""
        return self.vector_env.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Attribute of each requested environment."""
        return [getattr(self.vector_env.environments[i], attr_name) for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of each requested environment; ``AttributeError`` for what all of them share."""
        for i in self._get_indices(indices):
            setattr(self.vector_env.environments[i], attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call a method of each requested environment, such as ``reset``, ``step`` or ``render``."""
        methods = [getattr(self.vector_env.environments[i], method_name) for i in self._get_indices(indices)]
        return [method(*method_args, **method_kwargs) for method in methods]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """False for each requested environment."""
        return [False for _ in self._get_indices(indices)]


class BipolarWaveformVecEnv(_HeadsVecEnv):
    """`BipolarWaveformVectorEnv` with Stable-Baselines3's interface; the numbers are the same, rewards in float32.

    The info of an environment holds ``waveform``, shape (7,), in volts and seconds, ``cost`` in volts, and
    ``terminal_observation``.

    Parameters
    ----------
    num_envs : int
        Number of heads, N.
    render_mode : {None, "rgb_array"}
        Rendering: none, or one picture per head.
    **options
        Options of the task; see `inkjet_env.envs.task.make_task`.

    Examples
    --------
    A batch has one step per environment, since an episode has one::

        from stable_baselines3 import PPO
        from inkjet_env.envs.sb3 import BipolarWaveformVecEnv

        model = PPO("MlpPolicy", BipolarWaveformVecEnv(64), n_steps=1, batch_size=64).learn(2048)
    """

    def __init__(self, num_envs: int, render_mode: str | None = None, **options: Any) -> None:
        super().__init__(BipolarWaveformVectorEnv(num_envs, render_mode, **options))


class TuneWaveformVecEnv(_HeadsVecEnv):
    """`TuneWaveformVectorEnv` with Stable-Baselines3's interface; the numbers are the same, rewards in float32.

    The info of an environment is that of the single one, with ``terminal_observation`` if the episode has ended.

    Parameters
    ----------
    num_envs : int
        Number of heads, N.
    render_mode : {None, "rgb_array"}
        Rendering: none, or one picture per head.
    **options
        Options of the environment; see `TuneWaveformEnv`.

    Examples
    --------
    An episode has ten steps by default::

        from stable_baselines3 import PPO
        from inkjet_env.envs.sb3 import TuneWaveformVecEnv

        model = PPO("MlpPolicy", TuneWaveformVecEnv(64), n_steps=10, batch_size=64, gamma=1.0).learn(6400)
    """

    def __init__(self, num_envs: int, render_mode: str | None = None, **options: Any) -> None:
        super().__init__(TuneWaveformVectorEnv(num_envs, render_mode=render_mode, **options))
