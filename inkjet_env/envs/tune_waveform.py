"""The Gymnasium environment of tuning: a few tries on an unknown head."""

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
"""Default steps of an episode, peaks of an observation, and standard deviation of a reading in volts."""


class TuneWaveformEnv(gymnasium.Env[NDArray[Any], NDArray[Any]]):
    """Tune the waveform of a randomly drawn, unknown head in ``tries`` tries.

    The action, shape (7,), is the next waveform to fire: ``U1, U2, t1 … t5`` scaled to ``[-1, 1]``. The rig reads every
    peak of its response, with an error, and keeps the waveform with the lowest cost of the readings; firing nothing,
    which costs 0 V, is kept until a waveform costs less. The reward is the decrease of the true cost of the kept
    waveform, in volts; it is negative if an error of reading misled the rig. The rewards of an episode add up to minus
    the true cost of the waveform that is kept at its end.

    The observation, shape (16 + 2 peaks,), is clipped to ±10: the share of tries made; the reading of the kept
    waveform, in units of 20 V; the action fired last, and the one kept (zeros before there is one); signed heights, in
    units of 5 V, and times, in units of 100 µs, of the first ``peaks`` peaks of the last response (zeros if there are
    fewer).

    ``info`` after a step holds ``waveform``, shape (7,), in volts and seconds; ``cost`` and ``kept_cost``, the
    noise-free costs in volts of the waveforms fired and kept; ``reading``, the cost as read, in volts.

    Parameters
    ----------
    tries : int
        Number of steps of an episode.
    peaks : int
        Number of peaks of the last response in the observation.
    noise : float
        Standard deviation of the error of each peak's height, in volts.
    render_mode : {None, "rgb_array", "human"}
        Rendering: none, `render` returns a picture, or each picture is shown in a window.
    **options
        Options of the task; see `inkjet_env.envs.task.make_task`. Heads are drawn as with its ``context="random"``.

    Raises
    ------
    ValueError, gymnasium.error.ResetNeeded
        As in `BipolarWaveformEnv`.

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
        """Start an episode with another head. There are no ``options``; ``info`` is empty."""
        check_no_options(options)
        super().reset(seed=seed)
        self.tuning.begin((self.np_random,))
        self._awaits_action = True
        return self.tuning.observations()[0], {}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Fire one waveform; the last try ends the episode."""
        if not self._awaits_action:
            raise ResetNeeded("All tries are made, or reset() was never called: call reset() first.")
        rewards, reported = self.tuning.fire(action, (7,), (self.np_random,))
        self._awaits_action = not self.tuning.over
        info = {name: values[0].copy() if values.ndim > 1 else float(values[0]) for name, values in reported.items()}
        return self.tuning.observations()[0], float(rewards[0]), self.tuning.over, False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Picture of the last try's drive, hysteresis loop, response and peaks, shape (640, 960, 3)."""
        if self.render_mode is None:
            warn_of_no_render_mode()
            return None
        return _pictures(self.tuning)[0]


class TuneWaveformVectorEnv(LockstepVectorEnv):
    """Vector of N single environments, with identical numbers; see `TuneWaveformEnv` and `BipolarWaveformVectorEnv`.

    All episodes end in the same step, in which the next ones start. ``infos["final_obs"]`` and ``infos["final_info"]``
    exist only in such a step.

    Parameters
    ----------
    num_envs : int
        Number of heads, N.
    tries, peaks, noise, **options
        See `TuneWaveformEnv`.
    render_mode : {None, "rgb_array"}
        Rendering: none, or one picture per head.

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
        """Start N episodes with other heads. ``seed`` is that of the first head, or one per head; no ``options``."""
        check_no_options(options)
        self._seed_all(seed)
        self.tuning.begin(self.np_random)
        self._is_reset = True
        return self.tuning.observations(), {}

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Fire N waveforms; after the last try, the observations are those of the next heads."""
        if not self._is_reset:
            raise ResetNeeded("Call reset() before the first step().")
        rewards, reported = self.tuning.fire(actions, (self.num_envs, 7), self.np_random)
        over = self.tuning.over
        infos: dict[str, Any] = self._infos(**reported)
        if over:
            infos |= {
                "final_obs": np.fromiter(self.tuning.observations(), dtype=object, count=self.num_envs),
                "_final_obs": np.ones(self.num_envs, dtype=np.bool_),
                "final_info": self._infos(**{name: values.copy() for name, values in reported.items()}),
                "_final_info": np.ones(self.num_envs, dtype=np.bool_),
            }
            self.tuning.begin(self.np_random)
        ended = np.full(self.num_envs, over)
        return self.tuning.observations(), rewards, ended, np.zeros(self.num_envs, dtype=np.bool_), infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One picture per head of its last try; the axes are empty before the first."""
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
