"""The compiled simulator on several threads, where there are rows enough to be worth it."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

ROWS_WORTH_A_THREAD = 256
"""About 0.6 ms of simulation; starting a thread takes some 0.05 ms."""


@lru_cache
def available_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def simulated_costs(waveforms: Real, heads: Real, settings: tuple, capacity: int, threads: int | None = None) -> Real:
    """Peak costs in volts, shape (n,), of waveforms (n, 7) on heads (1 or n rows).

    Parameters
    ----------
    settings, capacity
        Further arguments of `inkjet_env.printhead.compiled.batch_costs`.
    threads : int, optional
        As many as there are cores unless given; no number depends on it.
    """
    from inkjet_env.printhead.compiled import batch_costs

    costs = np.empty(len(waveforms))

    def fill(part: slice) -> None:
        room = capacity
        while not batch_costs(waveforms[part], heads[part] if len(heads) > 1 else heads, *settings, room, costs[part]):
            room *= 2

    threads = min(threads or available_cores(), len(waveforms) // ROWS_WORTH_A_THREAD)
    if threads < 2:
        fill(slice(None))
        return costs
    edges = np.linspace(0, len(waveforms), threads + 1).astype(int).tolist()
    parts = [slice(low, high) for low, high in pairwise(edges)]
    # A pool of its own: one that is kept would not survive a fork.
    with ThreadPoolExecutor(threads - 1) as pool:
        others = [pool.submit(fill, part) for part in parts[1:]]
        fill(parts[0])
        for other in others:
            other.result()
    return costs
