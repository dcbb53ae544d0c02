"""The Gymnasium environment of tuning: a few tries on a head that nobody knows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from inkjet_env.envs.bipolar_waveform import check_no_options, check_render_mode, warn_of_no_render_mode
from inkjet_env.envs.lockstep_vector_env import LockstepVectorEnv
from inkjet_env.envs.waveform_tuning_task import WaveformTuningTask

TRIES, PEAKS, NOISE_V = 10, 8, 0.05


class TuneWaveformEnv(gymnasium.Env[NDArray[Any], NDArray[Any]]):
    """Tune the waveform of a head that was drawn and is not told, in ``tries`` tries.

    Action: ``U1, U2, t1 … t5`` scaled to ``[-1, 1]``, shape (7,): the next waveform to fire. Of what is fired the rig
    reads every peak, with an error, and keeps the waveform whose reading costs least; firing nothing, which costs
    nothing, is kept until one costs less. Reward: by how much less the waveform that is now kept truly costs than the
    one kept before, in volts; it may be negative, where an error of reading misled the rig. An episode's rewards add
    up to minus the true cost of what is kept at its end.

    Observation, shape (16 + 2 peaks,), clipped to ±10: the share of tries that are made; the reading of what is kept,
    in 20 V; the action fired last, and the one kept (zeros before there is one); heights, signed, in 5 V, and times, in
    100 µs, of the last response's first ``peaks`` peaks (zeros where there are fewer).

    ``info`` after a step: ``waveform``, shape (7,), in volts and seconds; ``cost`` and ``kept_cost``, in volts, free of
    noise, of what was fired and of what is kept; ``reading``, the cost as read.

    Parameters
    ----------
    tries : int
        Steps of an episode.
    peaks : int
    noise : float
        Standard deviation of the error of each peak's height, in volts.
    render_mode : {None, "rgb_array", "human"}
    **options
        See `inkjet_env.envs.task.make_task`: heads are drawn as by its ``context="random"``.

    Raises
    ------
    ValueError, gymnasium.error.ResetNeeded
        As `BipolarWaveformEnv`.

    Examples
    --------
    >>> import gymnasium, inkjet_env
    >>> env = gymnasium.make("inkjet_env/TuneWaveform-v0", tries=3)
    >>> _ = env.reset(seed=0)
    >>> env.action_space.seed(0), sum(env.step(env.action_space.sample())[2] for _ in range(3))
    (0, 1)
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 4}  # type: ignore[misc]

    def __init__(
        self,
        tries: int = TRIES,
        peaks: int = PEAKS,
        noise: float = NOISE_V,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        self.render_mode = _only_arrays(render_mode)
        self.tuning = WaveformTuningTask(1, tries, peaks, noise=noise, **options)
        self.action_space = self.tuning.action_space()
        self.observation_space = self.tuning.observation_space()
        self._awaits_action = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Put another head on the bench. There are no ``options``; ``info`` is empty."""
        check_no_options(options)
        super().reset(seed=seed)
        self.tuning.begin((self.np_random,))
        self._awaits_action = True
        return self.tuning.observations()[0], {}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Fire one waveform; the last try ends the episode."""
        if not self._awaits_action:
            raise ResetNeeded("All tries are made, or reset() was never called: call reset() first.")
        rewards, told = self.tuning.fire(action, (7,), (self.np_random,))
        self._awaits_action = not self.tuning.over
        info = {name: values[0].copy() if values.ndim > 1 else float(values[0]) for name, values in told.items()}
        return self.tuning.observations()[0], float(rewards[0]), self.tuning.over, False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Picture of the last try's drive, hysteresis loop, response and peaks, shape (640, 960, 3)."""
        if self.render_mode is None:
            warn_of_no_render_mode()
            return None
        return _pictures(self.tuning)[0]


class TuneWaveformVectorEnv(LockstepVectorEnv):
    """N single environments, number for number; see `TuneWaveformEnv` and `BipolarWaveformVectorEnv`.

    All episodes end in the same step and the next ones begin in it. ``infos["final_obs"]`` and ``infos["final_info"]``
    are there in such a step alone.

    Parameters
    ----------
    num_envs : int
    tries, peaks, noise, **options
        See `TuneWaveformEnv`.
    render_mode : {None, "rgb_array"}

    Examples
    --------
    >>> import gymnasium, inkjet_env
    >>> envs = gymnasium.make_vec("inkjet_env/TuneWaveform-v0", num_envs=3, tries=5)
    >>> envs.reset(seed=0)[0].shape
    (3, 32)
    """

    def __init__(
        self,
        num_envs: int = 1,
        tries: int = TRIES,
        peaks: int = PEAKS,
        noise: float = NOISE_V,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        super().__init__(num_envs, render_mode)
        self.tuning = WaveformTuningTask(self.num_envs, tries, peaks, noise=noise, **options)
        self.single_action_space = self.tuning.action_space()
        self.single_observation_space = self.tuning.observation_space()
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._is_reset = False

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Put N other heads on the bench. ``seed`` is the first head's, or one a head; there are no ``options``."""
        check_no_options(options)
        self._seed_all(seed)
        self.tuning.begin(self.np_random)
        self._is_reset = True
        return self.tuning.observations(), {}

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Fire N waveforms; where that was the last try, the observations are those of the next heads."""
        if not self._is_reset:
            raise ResetNeeded("Call reset() before the first step().")
        rewards, told = self.tuning.fire(actions, (self.num_envs, 7), self.np_random)
        over = self.tuning.over
        infos: dict[str, Any] = self._infos(**told)
        if over:
            infos |= {
                "final_obs": np.fromiter(self.tuning.observations(), dtype=object, count=self.num_envs),
                "_final_obs": np.ones(self.num_envs, dtype=np.bool_),
                "final_info": self._infos(**{name: values.copy() for name, values in told.items()}),
                "_final_info": np.ones(self.num_envs, dtype=np.bool_),
            }
            self.tuning.begin(self.np_random)
        ended = np.full(self.num_envs, over)
        return self.tuning.observations(), rewards, ended, np.zeros(self.num_envs, dtype=np.bool_), infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One picture a head of its last try; axes are empty before the first."""
        if self.render_mode is None:
            warn_of_no_render_mode()
            return None
        return _pictures(self.tuning)


def _only_arrays(render_mode: str | None) -> str | None:
    if check_render_mode(render_mode) == "human":
        raise ValueError("render_mode must be 'rgb_array' or None here; got 'human'.")
    return render_mode


def _pictures(tuning: WaveformTuningTask) -> tuple[NDArray[np.uint8], ...]:
    from inkjet_env.envs.rendering import picture

    waveforms = tuning.task.bounds.from_unit(np.clip(tuning.fired, -1.0, 1.0)) if tuning.done else [None] * tuning.count
    return tuple(
        picture(tuning.task.respond(waveform, context), tuning.task.cost)
        for waveform, context in zip(waveforms, tuning.contexts, strict=True)
    )
