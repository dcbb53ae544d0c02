"""The same environment for N heads at once: one compiled call per step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from inkjet_env.envs.bipolar_waveform import check_no_options, warn_of_no_render_mode
from inkjet_env.envs.lockstep_vector_env import LockstepVectorEnv
from inkjet_env.envs.task import make_task
from inkjet_env.typing import Real


class BipolarWaveformVectorEnv(LockstepVectorEnv):
    """N single environments with identical numbers: a seed ``s`` stands for N environments seeded ``s … s + N − 1``.

    Every step ends all episodes and starts the next ones (autoreset in the same step). As usual in Gymnasium, the ended
    episodes are in ``infos["final_obs"]`` and ``infos["final_info"]``; ``infos["waveform"]``, shape (N, 7), and
    ``infos["cost"]``, shape (N,), repeat them under the names of the single environment.

    Parameters
    ----------
    num_envs : int
        Number of heads, N.
    render_mode : {None, "rgb_array"}
        Rendering: none, or one picture per head.
    **options
        Options of the task; see `inkjet_env.envs.task.make_task`.

    Raises
    ------
    ValueError, gymnasium.error.ResetNeeded
        As in `BipolarWaveformEnv`.

    Examples
    --------
    >>> import gymnasium, inkjet_env
    >>> envs = gymnasium.make_vec("inkjet_env/BipolarWaveform-v0", num_envs=3, context="random")
    >>> _ = envs.reset(seed=0)
    >>> observations, rewards, *_ = envs.step(envs.action_space.sample())
    >>> observations.shape, rewards.shape
    ((3, 4), (3,))
    """

    def __init__(self, num_envs: int = 1, render_mode: str | None = None, **options: Any) -> None:
        super().__init__(num_envs, render_mode)
        self.task = make_task(**options)
        self.single_action_space = self.task.action_space()
        self.single_observation_space = self.task.observation_space()
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._contexts = np.tile(self.task.fixed_context, (self.num_envs, 1))
        self._heads = self.task.heads(self._contexts)
        self._is_reset = False
        self._fired: tuple[Real, NDArray[np.float32]] | None = None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start N episodes. ``seed`` is that of the first head, or one per head; there are no ``options``."""
        check_no_options(options)
        self._seed_all(seed)
        self._begin()
        self._is_reset = True
        self._fired = None
        return self._contexts.copy(), {}

    def _begin(self) -> None:
        if self.task.context == "random":
            self._contexts = self.task.contexts(self.np_random)
            self._heads = self.task.heads(self._contexts)

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Fire N waveforms, which ends N episodes; the observations are those of the next ones."""
        if not self._is_reset:
            raise ResetNeeded("Call reset() before the first step().")
        waveforms = self.task.waveforms(actions, (self.num_envs, 7))
        read, costs = self.task.measure(waveforms, self._heads, self.np_random if self.task.noise else ())
        ended = self._contexts.copy()
        self._fired = waveforms.copy(), self._contexts
        self._begin()
        infos = {
            **self._infos(waveform=waveforms, cost=costs),
            "final_obs": np.fromiter(ended, dtype=object, count=self.num_envs),
            "_final_obs": np.ones(self.num_envs, dtype=np.bool_),
            "final_info": self._infos(waveform=waveforms.copy(), cost=costs.copy()),
            "_final_info": np.ones(self.num_envs, dtype=np.bool_),
        }
        terminations, truncations = np.ones(self.num_envs, dtype=np.bool_), np.zeros(self.num_envs, dtype=np.bool_)
        return self._contexts.copy(), -read, terminations, truncations, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One picture per head of the waveform fired last; the axes are empty before the first step."""
        if self.render_mode is None:
            warn_of_no_render_mode()
            return None
        from inkjet_env.envs.rendering import picture

        waveforms, contexts = self._fired or ([None] * self.num_envs, self._contexts)
        return tuple(
            picture(self.task.respond(waveform, context), self.task.cost)
            for waveform, context in zip(waveforms, contexts, strict=True)
        )
