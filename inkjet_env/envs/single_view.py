"""One environment of a vector environment, as a single one."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from inkjet_env.envs.bipolar_waveform import check_no_options, warn_of_no_render_mode


class SingleView(gymnasium.Env[NDArray[Any], NDArray[Any]]):
    """Environment ``row`` of a vector environment, with the interface and the numbers of a single one.

    Attributes that are set on it are its own. What it does not have is read from the vector environment, which cannot
    be changed for one of its environments.

    Parameters
    ----------
    vector_env : BipolarWaveformVectorEnv or TuneWaveformVectorEnv
        The vector environment.
    row : int
        Number of the environment in it, from 0.
    """

    def __init__(self, vector_env: Any, row: int) -> None:
        own = {
            "vector_env": vector_env,
            "row": row,
            "action_space": vector_env.single_action_space,
            "observation_space": vector_env.single_observation_space,
            "render_mode": vector_env.render_mode,
            "metadata": vector_env.metadata,
        }
        vars(self).update(own)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "vector_env":
            raise AttributeError(f"the environment has no attribute {name!r}.")
        return getattr(self.vector_env, name)

    def __setattr__(self, name: str, value: Any) -> None:
        if name != "np_random" and hasattr(self.vector_env, name):
            raise AttributeError(
                f"{name} is shared by all environments and cannot be set: give it as an option when making them."
            )
        super().__setattr__(name, value)

    @property
    def np_random(self) -> np.random.Generator:
        """The random stream of this head."""
        return self.vector_env.np_random[self.row]

    @np_random.setter
    def np_random(self, generator: np.random.Generator) -> None:
        self.vector_env._generators[self.row], self.vector_env._seeds[self.row] = generator, -1

    @property
    def np_random_seed(self) -> int:
        """The seed of this head's random stream; −1 if the stream was set."""
        return self.vector_env.np_random_seed[self.row]

    @property
    def _rows(self) -> NDArray[np.bool_]:
        return np.arange(self.vector_env.num_envs) == self.row

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode in this environment; the others continue."""
        check_no_options(options)
        seeds = None if seed is None else [seed] * self.vector_env.num_envs
        observations, infos = self.vector_env.reset(seed=seeds, options={"reset_mask": self._rows})
        return observations[self.row], infos

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Fire one waveform in this environment alone; the others are not stepped. It is never restarted by itself."""
        actions = np.zeros((self.vector_env.num_envs, 7))
        try:
            actions[self.row] = action
        except (TypeError, ValueError):
            raise ValueError("action must be 7 numbers: U1 U2 t1 t2 t3 t4 t5 in [-1, 1].") from None
        rewards, over, reported = self.vector_env._fire_rows(actions, self._rows)
        info = {name: values[self.row] for name, values in reported.items()}
        observation = self.vector_env._observations()[self.row]
        return observation, float(rewards[self.row]), bool(over[self.row]), False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Picture of the waveform fired last, shape (640, 960, 3)."""
        if self.render_mode is None:
            warn_of_no_render_mode()
            return None
        return self.vector_env._picture(self.row)
