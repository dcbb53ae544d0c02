"""Base of the vector environments of N heads: one generator per head, seeds, infos with Gymnasium's masks."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from inkjet_env.envs.bipolar_waveform import BipolarWaveformEnv, check_render_mode
from inkjet_env.typing import Real


class LockstepVectorEnv(VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """N heads, each with its own random stream; their episodes end together and restart in the same step.

    Parameters
    ----------
    num_envs : int
        Number of heads, N.
    render_mode : {None, "rgb_array"}
        Rendering: none, or one picture per head.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        **BipolarWaveformEnv.metadata,
        "render_modes": ["rgb_array"],
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(self, num_envs: int, render_mode: str | None) -> None:
        if isinstance(num_envs, bool) or not isinstance(num_envs, (int, np.integer)) or num_envs < 1:
            raise ValueError(f"num_envs must be a whole number of at least 1; got {num_envs!r}.")
        if check_render_mode(render_mode) == "human":
            raise ValueError("render_mode of a vector environment must be 'rgb_array' or None; got 'human'.")
        self.num_envs = int(num_envs)
        self.render_mode = render_mode
        self._generators: list[np.random.Generator | None] = [None] * self.num_envs
        self._seeds: list[int | None] = [None] * self.num_envs

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

    def _seed(self, i: int, seed: int | None) -> None:
        self._generators[i], self._seeds[i] = seeding.np_random(None if seed is None else operator.index(seed))

    def _seed_all(self, seed: int | Sequence[int | None] | None) -> None:
        """Take the seeds of a reset: that of the first head, or one per head."""
        if seed is None:
            return
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, (int, np.integer)) else list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed must be a number, or {self.num_envs} of them; got {len(seeds)}.")
        for i, one in enumerate(seeds):
            if one is not None:
                self._seed(i, one)

    def _infos(self, **values: Real) -> dict[str, NDArray[Any]]:
        """Values of all heads, each with Gymnasium's mask, which is true for every head."""
        masks = {f"_{name}": np.ones(self.num_envs, dtype=np.bool_) for name in values}
        return {**values, **masks}
