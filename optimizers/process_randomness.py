"""A private set of process-wide random generators for each optimiser that uses them."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np


class OwnRandomness:
    """Within this context, `numpy.random` and (if imported before) torch draw from the optimiser's own streams.

    Some libraries draw from the process-wide generators. To make their runs depend on their seed alone, and to keep
    other code's draws independent of them, each has its own generators and restores the others on exit. (One trace
    remains: NumPy drops the second normal number that `numpy.random.randn` may have cached.)

    Parameters
    ----------
    seed : int
        Seed of both streams, at least 0.
    """

    def __init__(self, seed: int) -> None:
        words = np.random.SeedSequence(seed).generate_state(2)
        self._numpy: Any = np.random.MT19937(int(words[0]))
        self._torch: Any = None
        if torch := sys.modules.get("torch"):
            self._torch = torch.Generator().manual_seed(int(words[1])).get_state()

    def __enter__(self) -> None:
        self._swap()

    def __exit__(self, *_: object) -> None:
        self._swap()

    def _swap(self) -> None:
        numpy_random: Any = np.random  # its type stubs do not know these two
        others = numpy_random.get_bit_generator()
        numpy_random.set_bit_generator(self._numpy)
        self._numpy = others
        if self._torch is not None:
            torch = sys.modules["torch"]
            state = torch.get_rng_state()
            torch.set_rng_state(self._torch)
            self._torch = state
