"""The compiled simulator on several threads, if there are enough rows to pay for them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np

from inkjet_env.typing import Real

ROWS_A_PART = 64
"""Rows per part, about 0.15 ms of simulation: threads take parts as they become free, so that none waits long."""
PARTS_WORTH_A_THREAD = 4
"""Number of parts that justify a further thread; starting one takes some 0.05 ms."""


@lru_cache
def available_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def simulated_costs(waveforms: Real, heads: Real, settings: tuple, capacity: int, threads: int | None = None) -> Real:
    """Peak costs in volts, shape (n,), of waveforms (n, 7) on heads (1 or n rows).

    Parameters
    ----------
    waveforms : ndarray, shape (n, 7)
        Checked waveforms, in volts and seconds.
    heads : ndarray, shape (1 or n, columns)
        Rows of `inkjet_env.printhead.batch.head_table`.
    settings, capacity
        Further arguments of `inkjet_env.printhead.compiled.batch_costs`.
    threads : int, optional
        Largest number of threads; by default the number of cores. No result depends on it.

    Returns
    -------
    ndarray, shape (n,)
        Costs in volts.
    """
    from inkjet_env.printhead.compiled import batch_costs

    costs = np.empty(len(waveforms))

    def fill(parts: Iterator[slice]) -> None:
        for part in parts:
            room = capacity
            own_heads = heads[part] if len(heads) > 1 else heads
            while not batch_costs(waveforms[part], own_heads, *settings, room, costs[part]):
                room *= 2

    threads = min(threads or available_cores(), len(waveforms) // (ROWS_A_PART * PARTS_WORTH_A_THREAD))
    if threads < 2:
        fill(iter([slice(None)]))
        return costs
    parts = iter([slice(start, start + ROWS_A_PART) for start in range(0, len(waveforms), ROWS_A_PART)])
    # A new pool each time: a persistent one would not survive a fork.
    with ThreadPoolExecutor(threads - 1) as pool:
        others = [pool.submit(fill, parts) for _ in range(threads - 1)]
        fill(parts)
        for other in others:
            other.result()
    return costs
