"""The Gymnasium environment of tuning: a few tries on an unknown head."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from inkjet_env.envs.bipolar_waveform import check_no_options, check_render_mode, warn_of_no_render_mode
from inkjet_env.envs.given_heads import HeadsOption
from inkjet_env.envs.options import check_option_names
from inkjet_env.envs.vector_of_heads import Fired, Rows, VectorOfHeads
from inkjet_env.envs.waveform_tuning_task import WaveformTuningTask

TRIES, PEAKS, NOISE_V = 10, 8, 0.05
"""Default steps of an episode, peaks of an observation, and standard deviation of a reading in volts."""
NOT_OFFERED = ("context", "reference")
"""Options of the other environment that a head to be tuned does not have."""


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
    heads : HeadEnsemble, head, path or sequence of heads and paths, optional
        What the head of an episode is drawn from: heads with weights, the one head, or the file of a head, which is
        what ``inkjet diagnose --printhead-out`` writes, with the heads that its recordings leave possible; see
        `inkjet_env.envs.given_heads.ensemble_of_heads`. By default heads are drawn as with ``context="random"``.
    **options
        Options of the task; see `inkjet_env.envs.task.make_task`. ``printhead`` cannot be given beside ``heads``.

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
        heads: HeadsOption | None = None,
        **options: Any,
    ) -> None:
        _check_option_names(TuneWaveformEnv.__init__, options)
        self.render_mode = check_render_mode(render_mode, ("rgb_array",))
        self.tuning = WaveformTuningTask(1, tries, peaks, heads=heads, noise=noise, **options)
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
        over = bool(self.tuning.over[0])
        self._awaits_action = not over
        info = {name: values[0] for name, values in reported.items()}
        return self.tuning.observations()[0], float(rewards[0]), over, False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Picture of the last try's drive, hysteresis loop, response and peaks, shape (640, 960, 3)."""
        if self.render_mode is None:
            warn_of_no_render_mode()
            return None
        return _picture(self.tuning, 0)


class TuneWaveformVectorEnv(VectorOfHeads, VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """Vector of N single environments, with identical numbers; see `TuneWaveformEnv` and `BipolarWaveformVectorEnv`.

    All episodes end in the same step, unless single heads were restarted by a ``reset_mask``. ``infos["final_obs"]``
    and ``infos["final_info"]`` exist only in the mode ``SAME_STEP``, in a step that ends an episode.

    Parameters
    ----------
    num_envs : int
        Number of heads, N.
    tries, peaks, noise, **options
        See `TuneWaveformEnv`.
    render_mode : {None, "rgb_array"}
        Rendering: none, or one picture per head.
    autoreset_mode : gymnasium.vector.AutoresetMode or {"SameStep", "NextStep", "Disabled"}
        When an ended episode is restarted; see `BipolarWaveformVectorEnv`.
    threads : int, optional
        Largest number of threads that simulate; None is the number of cores. No number depends on it, and fewer than
        512 heads are simulated on one; so are heads with effects.
    heads
        See `TuneWaveformEnv`; every head draws its own.

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
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        threads: int | None = 1,
        heads: HeadsOption | None = None,
        **options: Any,
    ) -> None:
        _check_option_names(TuneWaveformVectorEnv.__init__, options)
        super().__init__(num_envs, render_mode, autoreset_mode, threads)
        self.tuning = WaveformTuningTask(self.num_envs, tries, peaks, threads, heads, noise=noise, **options)
        self._set_spaces(self.tuning.action_space(), self.tuning.observation_space())

    def _begin(self, rows: Rows, in_same_step: bool) -> None:
        self.tuning.begin(self._generators_of(rows), rows)

    def _fire(self, actions: NDArray[Any], rows: Rows) -> Fired:
        rewards, reported = self.tuning.fire(actions, (self.num_envs, 7), self._generators_of(rows), rows)
        return rewards, self.tuning.over[rows], reported

    def _observations(self) -> NDArray[np.float32]:
        return self.tuning.observations()

    def _picture(self, row: int) -> NDArray[np.uint8]:
        return _picture(self.tuning, row)


def _check_option_names(constructor: Callable[..., Any], options: dict[str, Any]) -> None:
    """As `check_option_names`; `WaveformTuningTask` says why those of `NOT_OFFERED` cannot be given."""
    check_option_names(constructor, [name for name in options if name not in NOT_OFFERED], fixed=NOT_OFFERED)


def _picture(tuning: WaveformTuningTask, row: int) -> NDArray[np.uint8]:
    from inkjet_env.envs.rendering import picture

    return picture(tuning.respond(row), tuning.task.cost)
