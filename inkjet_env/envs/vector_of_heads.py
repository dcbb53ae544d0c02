"""What the vector environments have in common: a random stream for each head, and the restart of ended episodes."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from inkjet_env.envs.bipolar_waveform import (
    BipolarWaveformEnv,
    check_no_options,
    check_render_mode,
    warn_of_no_render_mode,
)
from inkjet_env.envs.parallel import check_threads
from inkjet_env.envs.single_view import SingleView
from inkjet_env.naming import check_name
from inkjet_env.typing import Real

Rows = NDArray[np.bool_]
"""Whether each of N heads is meant, shape (N,)."""
Fired = tuple[Real, Rows, dict[str, Real]]
"""Of the heads that were fired: rewards in volts, whether the episode is over, and infos; one row each."""


class VectorOfHeads(VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """N heads with a random stream each, whose ended episodes are restarted as ``autoreset_mode`` says.

    An environment derives from this class and once more from `gymnasium.vector.VectorEnv`, which some libraries look
    for among the direct base classes. It provides `_begin`, `_fire`, `_observations` and `_picture`.

    Parameters
    ----------
    num_envs : int
        Number of heads, N.
    render_mode : {None, "rgb_array"}
        Rendering: none, or one picture per head.
    autoreset_mode : gymnasium.vector.AutoresetMode or str
        When an ended episode is restarted: in the same step, in the next one, or by ``reset`` only.
    threads : int, optional
        Largest number of threads that simulate; None is the number of cores.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        **BipolarWaveformEnv.metadata,
        "render_modes": ["rgb_array"],
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self, num_envs: int, render_mode: str | None, autoreset_mode: AutoresetMode | str, threads: int | None
    ) -> None:
        if isinstance(num_envs, bool) or not isinstance(num_envs, (int, np.integer)) or num_envs < 1:
            raise ValueError(f"num_envs must be a whole number of at least 1; got {num_envs!r}.")
        if check_render_mode(render_mode) == "human":
            raise ValueError("render_mode of a vector environment must be 'rgb_array' or None; got 'human'.")
        self.num_envs = int(num_envs)
        self.render_mode = render_mode
        self.autoreset_mode = _checked_mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}  # type: ignore[misc]
        self.threads = check_threads(threads)
        self._generators: list[np.random.Generator | None] = [None] * self.num_envs
        self._seeds: list[int | None] = [None] * self.num_envs
        self._open, self._ended = np.zeros((2, self.num_envs), dtype=np.bool_)

    def _set_spaces(self, action_space: spaces.Box, observation_space: spaces.Box) -> None:
        """Take the spaces of a single environment."""
        self.single_action_space, self.single_observation_space = action_space, observation_space
        self.action_space = batch_space(action_space, self.num_envs)
        self.observation_space = batch_space(observation_space, self.num_envs)

    def __len__(self) -> int:
        return self.num_envs

    def _begin(self, rows: Rows, in_same_step: bool) -> None:
        """Put the heads of new episodes on the bench; ``in_same_step`` as the one that ended the last episodes."""
        raise NotImplementedError

    def _fire(self, actions: NDArray[Any], rows: Rows) -> Fired:
        """Fire one waveform on some heads; the actions, shape (N, 7), of the others are ignored."""
        raise NotImplementedError

    def _observations(self) -> NDArray[np.float32]:
        """A new array of what is observed of every head, one row each."""
        raise NotImplementedError

    def _picture(self, row: int) -> NDArray[np.uint8]:
        """Picture of the waveform fired last on one head, shape (640, 960, 3)."""
        raise NotImplementedError

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One picture per head of the waveform fired last; the axes are empty before the first step."""
        if self.render_mode is None:
            warn_of_no_render_mode()
            return None
        return tuple(self._picture(row) for row in range(self.num_envs))

    @cached_property
    def environments(self) -> tuple[SingleView, ...]:
        """The environments as single ones."""
        return tuple(SingleView(self, row) for row in range(self.num_envs))

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of each single environment, or read an attribute, as Gymnasium's ``SyncVectorEnv``."""
        found = [getattr(one, name) for one in self.environments]
        return tuple(one(*args, **kwargs) if callable(one) else one for one in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Attribute of each single environment."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of each single environment: a list or tuple with a value for each, or one value for all.

        ``AttributeError`` for what all of them share, ``ValueError`` for a wrong number of values.
        """
        each = values if isinstance(values, (list, tuple)) else [values] * self.num_envs
        if len(each) != self.num_envs:
            raise ValueError(f"values must be one for each of {self.num_envs} environments; got {len(each)}.")
        for one, value in zip(self.environments, each, strict=True):
            setattr(one, name, value)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start new episodes; ``infos`` is empty.

        Parameters
        ----------
        seed : int or sequence of int, optional
            Seed of the first head, whose successors get the next numbers; or one per head.
        options : dict, optional
            ``{"reset_mask": mask}`` restarts the heads for which the mask, a boolean array of shape (N,), is true; the
            others continue, and their last observation is returned. There are no other options.
        """
        given = dict(options or {})
        rows = self._checked_mask(given.pop("reset_mask")) if "reset_mask" in given else np.ones(self.num_envs, bool)
        check_no_options(given)
        self._seed_rows(seed, rows)
        self._restart(rows)
        return self._observations(), {}

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Fire N waveforms, or restart a head whose episode has ended, as ``autoreset_mode`` says."""
        restarted = self._ended & (self.autoreset_mode is AutoresetMode.NEXT_STEP)
        rewards, over, reported = self._fire_rows(actions, ~restarted)
        infos: dict[str, Any] = _with_masks(reported, ~restarted)
        if restarted.any():
            self._restart(restarted)
        if over.any() and self.autoreset_mode is AutoresetMode.SAME_STEP:
            final = np.full(self.num_envs, None)
            final[over] = np.fromiter(self._observations()[over], dtype=object, count=np.count_nonzero(over))
            told = {name: _placed(values[over], over) for name, values in reported.items()}
            infos |= {"final_obs": final, "final_info": _with_masks(told, over)}
            infos |= {"_final_obs": over.copy(), "_final_info": over.copy()}
            self._restart(over, in_same_step=True)
        return self._observations(), rewards, over, np.zeros(self.num_envs, dtype=np.bool_), infos

    def _fire_rows(self, actions: NDArray[Any], rows: Rows) -> Fired:
        """`_fire`, if every head concerned has an open episode; one row for every head, zeros for those not fired."""
        if not self._open[rows].all():
            if self._ended[rows].any():
                raise ResetNeeded(
                    f"The episode of head {int(np.argmax(self._ended & rows))} has ended: call reset(), "
                    'or reset(options={"reset_mask": terminations | truncations}), before the next step().'
                )
            raise ResetNeeded("Call reset() before the first step().")
        if not rows.any():
            return np.zeros(self.num_envs), np.zeros(self.num_envs, dtype=np.bool_), {}
        rewards, ended, reported = self._fire(actions, rows)
        over = _placed(ended, rows)
        self._open[over], self._ended[over] = False, True
        return _placed(rewards, rows), over, {name: _placed(values, rows) for name, values in reported.items()}

    def _restart(self, rows: Rows, in_same_step: bool = False) -> None:
        self._begin(rows, in_same_step)
        self._open[rows], self._ended[rows] = True, False

    def _checked_mask(self, mask: object) -> Rows:
        if not (isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (self.num_envs,)):
            raise ValueError(f"reset_mask must be a NumPy array of {self.num_envs} booleans; got {mask!r}.")
        if not mask.any():
            raise ValueError("reset_mask must be true for at least one head; all of it is false.")
        return mask

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generator of each head; one that was never seeded gets a random seed."""
        for i, generator in enumerate(self._generators):
            if generator is None:
                self._seed(i, None)
        return tuple(self._generators)  # type: ignore[arg-type]

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each head's generator."""
        _ = self.np_random
        return tuple(self._seeds)  # type: ignore[arg-type]

    def _generators_of(self, rows: Rows) -> list[np.random.Generator]:
        return [generator for generator, chosen in zip(self.np_random, rows.tolist(), strict=True) if chosen]

    def _seed(self, i: int, seed: int | None) -> None:
        self._generators[i], self._seeds[i] = seeding.np_random(None if seed is None else operator.index(seed))

    def _seed_rows(self, seed: int | Sequence[int | None] | None, rows: Rows) -> None:
        """Take the seeds of a reset, that of the first head or one per head, for the heads that are restarted."""
        if seed is None:
            return
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, (int, np.integer)) else list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed must be a number, or {self.num_envs} of them; got {len(seeds)}.")
        for i in np.flatnonzero(rows).tolist():
            if (one := seeds[i]) is not None:
                self._seed(i, one)


def _checked_mode(given: AutoresetMode | str) -> AutoresetMode:
    if isinstance(given, AutoresetMode):
        return given
    known = {name: mode for mode in AutoresetMode for name in (mode.value, mode.name)}
    check_name("autoreset_mode", given, known)
    return known[given]


def _placed(values: NDArray[Any], rows: Rows) -> NDArray[Any]:
    """An array with one entry for every head: the values of the chosen ones, and zeros."""
    if len(values) == len(rows):
        return values
    placed = np.zeros((len(rows), *values.shape[1:]), dtype=values.dtype)
    placed[rows] = values
    return placed


def _with_masks(values: dict[str, NDArray[Any]], rows: Rows) -> dict[str, NDArray[Any]]:
    """Infos with Gymnasium's masks, which say for which heads they hold."""
    return values | {f"_{name}": rows.copy() for name in values}
