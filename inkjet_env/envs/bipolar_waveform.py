"""The Gymnasium environment: one waveform, one response, one reward."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from inkjet_env.envs.options import check_option_names
from inkjet_env.envs.task import make_task
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Printhead, check_name
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from inkjet_env.envs.window import Window

RENDER_MODES = ("human", "rgb_array")


def check_render_mode(render_mode: str | None, known: Sequence[str] = RENDER_MODES) -> str | None:
    """Return the render mode; ``ValueError`` unless it is supported."""
    if render_mode is not None:
        check_name("render_mode", render_mode, known)
    return render_mode


def check_no_options(options: dict[str, Any] | None) -> None:
    """Raise ``ValueError`` if a reset is given options, since there are none."""
    if options:
        raise ValueError(f"reset takes no options; got {', '.join(map(repr, options))}. Pass them to gymnasium.make.")


def warn_of_no_render_mode() -> None:
    """Warn, as Gymnasium's own environments do, that nothing was drawn."""
    gymnasium.logger.warn('render() needs a render mode: gymnasium.make(id, render_mode="rgb_array").')


class BipolarWaveformEnv(gymnasium.Env[NDArray[Any], NDArray[Any]]):
    """Choose a waveform and fire it; the reward is minus its peak cost, or minus its regret. An episode has one step.

    The action, shape (7,), is ``U1, U2, t1 … t5`` scaled to ``[-1, 1]``. The observation, shape (4,), is the resonance
    frequency, damping ratio, gain and strength of the hysteresis of the head on the bench, on a scale where ±1 are the
    ends of the ranges of ``context="random"``. A fixed head has its own values on that scale, so that a policy learnt
    on random heads can be applied to it; the observation space is wider if such a head lies outside.

    ``info`` after a step holds ``waveform``, shape (7,), in volts and seconds, and ``cost``, in volts, without noise.

    Parameters
    ----------
    render_mode : {None, "rgb_array", "human"}
        Rendering: none, `render` returns a picture, or each picture is shown in a window.
    **options
        Options of the task; see `inkjet_env.envs.task.make_task`.

    Raises
    ------
    ValueError
        From the constructor, an unknown or invalid option; from `step`, an action of wrong shape, NaN, or outside the
        box without ``clip_actions``.
    gymnasium.error.ResetNeeded
        From `step`, before the first reset and after the episode's only step.

    Examples
    --------
    >>> import gymnasium, inkjet_env
    >>> env = gymnasium.make("inkjet_env/BipolarWaveform-v0")
    >>> _ = env.reset(seed=0)
    >>> _, reward, terminated, truncated, info = env.step(env.action_space.sample())
    >>> terminated, truncated, bool(reward == -info["cost"])
    (True, False, True)
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(RENDER_MODES), "render_fps": 4}  # type: ignore[misc]

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        check_option_names(BipolarWaveformEnv.__init__, options)
        self.render_mode = check_render_mode(render_mode)
        self.task = make_task(**options)
        self.action_space = self.task.action_space()
        self.observation_space = self.task.observation_space()
        self._context = self.task.fixed_context
        self._heads = self.task.heads(self._context[None])
        self._awaits_action = False
        self._fired: Real | None = None
        self._window: Window | None = None

    @property
    def printhead(self) -> Printhead | AugmentedPrinthead:
        """The head on the bench in this episode."""
        return self.task.head(self._context)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; in a random context, draw a head. There are no ``options``; ``info`` is empty."""
        check_no_options(options)
        super().reset(seed=seed)
        if self.task.context == "random":
            self._context = self.task.contexts((self.np_random,))[0]
            self._heads = self.task.heads(self._context[None])
        self._awaits_action = True
        self._fired = None
        if self.render_mode == "human":
            self.render()
        return self._context.copy(), {}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Fire one waveform, which ends the episode."""
        if not self._awaits_action:
            raise ResetNeeded("An episode is a single step: call reset() before every step().")
        waveforms = self.task.waveforms(action, (7,))
        read, costs = self.task.measure(waveforms, self._heads, self._generators)
        self._awaits_action = False
        self._fired = waveforms[0]
        if self.render_mode == "human":
            self.render()
        info = {"waveform": waveforms[0].copy(), "cost": costs[0]}
        reward = -float(read[0])
        if self.task.reference is not None:
            reward += float(self.task.references_V(self._context[None])[0])
        return self._context.copy(), reward, True, False, info

    @property
    def _generators(self) -> tuple[np.random.Generator, ...]:
        return (self.np_random,) if self.task.noise else ()

    def render(self) -> NDArray[np.uint8] | None:
        """Picture of this episode's drive, hysteresis loop, response and peaks, shape (640, 960, 3).

        Before the waveform is fired the axes are empty. In mode ``human`` the picture is shown in a window.
        """
        if self.render_mode is None:
            warn_of_no_render_mode()
            return None
        from inkjet_env.envs.rendering import picture

        image = picture(self.task.respond(self._fired, self._context), self.task.cost)
        if self.render_mode == "rgb_array":
            return image
        if self._window is None:
            from inkjet_env.envs.window import Window

            self._window = Window(self.metadata["render_fps"])
        self._window.show(image)
        return None

    def close(self) -> None:
        """Close the window, if there is one; may be called repeatedly."""
        if self._window is not None:
            self._window.close()
            self._window = None
