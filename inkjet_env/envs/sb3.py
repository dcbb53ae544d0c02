"""The vector environments as Stable-Baselines3 wants them. Importing this module imports it and torch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from inkjet_env.envs.bipolar_waveform import check_no_options
from inkjet_env.envs.tune_waveform import TuneWaveformVectorEnv
from inkjet_env.envs.vector import BipolarWaveformVectorEnv


class _HeadsVecEnv(VecEnv):
    """A vector environment of this package with Stable-Baselines3's interface."""

    def __init__(self, vector_env: Any) -> None:
        self.vector_env = vector_env
        super().__init__(vector_env.num_envs, vector_env.single_observation_space, vector_env.single_action_space)
        self._actions: NDArray[Any] | None = None

    def reset(self) -> NDArray[np.float32]:
        """Begin all episodes, with the seeds given to `seed` since the last reset."""
        for options in self._options:
            check_no_options(options)
        observations, _ = self.vector_env.reset(seed=self._seeds)
        self._reset_seeds()
        self._actions = None
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Fire the waveforms; episodes that end begin again."""
        if self._actions is None:
            raise RuntimeError("step_wait() needs actions: call step_async(actions) first.")
        actions, self._actions = self._actions, None
        observations, rewards, dones, _, infos = self.vector_env.step(actions)
        columns = {name: values if values.ndim > 1 else values.tolist() for name, values in self._told(infos).items()}
        told: list[dict[str, Any]] = [
            {name: values[i] for name, values in columns.items()} | {"TimeLimit.truncated": False}
            for i in range(self.num_envs)
        ]
        if "final_obs" in infos:
            for info, final in zip(told, infos["final_obs"], strict=True):
                info["terminal_observation"] = final
        return observations, rewards.astype(np.float32), dones, told

    @staticmethod
    def _told(infos: dict[str, Any]) -> dict[str, NDArray[Any]]:
        """What the vector environment tells of every head, without Gymnasium's masks."""
        return {name: values for name, values in infos.items() if not name.startswith(("_", "final_"))}

    def close(self) -> None:
        """Nothing is held open."""
        self.vector_env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """One picture a head of the waveforms fired last."""
        return self.vector_env.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The vector environment's attribute, once for each environment asked for; all of them share it."""
        value = getattr(self.vector_env, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refused: the environments are one object, and its task is fixed when it is made."""
        raise NotImplementedError(f"{attr_name} cannot be set: pass the option when making the environment.")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Refused: there are no single environments to call."""
        raise NotImplementedError(f"{method_name} cannot be called: the environments are one object, `vector_env`.")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """False for each environment asked for."""
        return [False for _ in self._get_indices(indices)]


class BipolarWaveformVecEnv(_HeadsVecEnv):
    """`BipolarWaveformVectorEnv` with Stable-Baselines3's interface; the numbers are the same, rewards in float32.

    An environment's info holds ``waveform``, shape (7,), ``cost`` in volts, and ``terminal_observation``.

    Parameters
    ----------
    num_envs : int
    render_mode : {None, "rgb_array"}
    **options
        See `inkjet_env.envs.task.make_task`.

    Examples
    --------
    A batch of one step each, since an episode has one::

        from stable_baselines3 import PPO
        from inkjet_env.envs.sb3 import BipolarWaveformVecEnv

        model = PPO("MlpPolicy", BipolarWaveformVecEnv(64), n_steps=1, batch_size=64).learn(2048)
    """

    def __init__(self, num_envs: int, render_mode: str | None = None, **options: Any) -> None:
        super().__init__(BipolarWaveformVectorEnv(num_envs, render_mode, **options))


class TuneWaveformVecEnv(_HeadsVecEnv):
    """`TuneWaveformVectorEnv` with Stable-Baselines3's interface; the numbers are the same, rewards in float32.

    An environment's info holds what the single one's does, and ``terminal_observation`` where the episode has ended.

    Parameters
    ----------
    num_envs : int
    render_mode : {None, "rgb_array"}
    **options
        See `TuneWaveformEnv`.

    Examples
    --------
    An episode is ten steps unless told::

        from stable_baselines3 import PPO
        from inkjet_env.envs.sb3 import TuneWaveformVecEnv

        model = PPO("MlpPolicy", TuneWaveformVecEnv(64), n_steps=10, batch_size=64, gamma=1.0).learn(6400)
    """

    def __init__(self, num_envs: int, render_mode: str | None = None, **options: Any) -> None:
        super().__init__(TuneWaveformVectorEnv(num_envs, render_mode=render_mode, **options))
