"""The same environment for N heads at once: one compiled call per step."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from inkjet_env.envs.options import check_option_names
from inkjet_env.envs.task import make_task
from inkjet_env.envs.vector_of_heads import Fired, Rows, VectorOfHeads


class BipolarWaveformVectorEnv(VectorOfHeads, VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """N single environments with identical numbers: a seed ``s`` stands for N environments seeded ``s … s + N − 1``.

    Every step ends all episodes. In which step the next ones start is ``autoreset_mode``, with the meaning of
    Gymnasium's ``SyncVectorEnv``: ``SAME_STEP`` returns the observations of the next episodes at once; ``NEXT_STEP``
    ignores the actions of the following step and returns them then; ``DISABLED`` waits for
    ``reset(options={"reset_mask": terminations | truncations})``.

    In the mode ``SAME_STEP`` the ended episodes are, as usual, in ``infos["final_obs"]`` and ``infos["final_info"]``;
    ``infos["waveform"]``, shape (N, 7), and ``infos["cost"]``, shape (N,), repeat them under the names of the single
    environment.

    Parameters
    ----------
    num_envs : int
        Number of heads, N.
    render_mode : {None, "rgb_array"}
        Rendering: none, or one picture per head.
    autoreset_mode : gymnasium.vector.AutoresetMode or {"SameStep", "NextStep", "Disabled"}
        When an ended episode is restarted.
    threads : int, optional
        Largest number of threads that simulate; by default the number of cores. No number depends on it, but for the
        last digits in lanes; fewer than 512 heads, or 4,096 in lanes, are simulated on one.
    simulator : {"scalar", "lanes", "cuda"}
        ``lanes`` simulates eight heads side by side with vector instructions, by `inkjet_env.printhead.lanes`, in two
        fifths of the time: costs differ from those of the single environment by up to 3e-10 V, and their last digits
        may depend on the other heads. ``cuda`` simulates on a graphics processor, by `inkjet_env.printhead.cuda`: up
        to 1e-9 V. Both are for a printhead without effects that is read without noise.
    **options
        Options of the task; see `inkjet_env.envs.task.make_task`.

    Raises
    ------
    ValueError, gymnasium.error.ResetNeeded
        As in `BipolarWaveformEnv`; or the simulator cannot compute costs of this task.
    RuntimeError
        The simulator is ``cuda``, and there is no graphics processor.

    Examples
    --------
    >>> import gymnasium, inkjet_env
    >>> envs = gymnasium.make_vec("inkjet_env/BipolarWaveform-v0", num_envs=3, context="random")
    >>> _ = envs.reset(seed=0)
    >>> observations, rewards, *_ = envs.step(envs.action_space.sample())
    >>> observations.shape, rewards.shape
    ((3, 4), (3,))
    """

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        threads: int | None = None,
        simulator: str = "scalar",
        **options: Any,
    ) -> None:
        check_option_names(BipolarWaveformVectorEnv.__init__, options)
        super().__init__(num_envs, render_mode, autoreset_mode, threads)
        self.task = make_task(**options)
        self.task.check_simulator(simulator)
        self.simulator = simulator
        self._set_spaces(self.task.action_space(), self.task.observation_space())
        self._contexts = np.tile(self.task.fixed_context, (self.num_envs, 1))
        self._heads = self.task.heads(self._contexts)
        self._shown = np.full((self.num_envs, 7), np.nan)
        self._shown_contexts = self._contexts

    def _begin(self, rows: Rows, in_same_step: bool) -> None:
        if self.task.context == "random":
            self._contexts = self._contexts.copy()
            self._contexts[rows] = self.task.contexts(self._generators_of(rows))
            self._heads = self.task.heads(self._contexts)
        if not in_same_step:
            self._shown[rows], self._shown_contexts = np.nan, self._contexts

    def _fire(self, actions: NDArray[Any], rows: Rows) -> Fired:
        waveforms = self.task.waveforms(actions, (self.num_envs, 7), rows)[rows]
        heads = self._heads[rows] if self.task.context == "random" else self._heads
        generators = self._generators_of(rows) if self.task.noise else ()
        read, costs = self.task.measure(waveforms, heads, generators, self.threads, self.simulator)
        self._shown[rows], self._shown_contexts = waveforms, self._contexts
        rewards = -read if self.task.reference is None else self.task.references_V(self._contexts[rows]) - read
        return rewards, np.ones(len(read), dtype=np.bool_), {"waveform": waveforms, "cost": costs}

    def _observations(self) -> NDArray[np.float32]:
        return self._contexts.copy()

    def _picture(self, row: int) -> NDArray[np.uint8]:
        from inkjet_env.envs.rendering import picture

        fired = None if np.isnan(self._shown[row, 0]) else self._shown[row]
        return picture(self.task.respond(fired, self._shown_contexts[row]), self.task.cost)
