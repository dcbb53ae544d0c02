"""The compiled simulator on several threads, if there are enough rows to pay for them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from inkjet_env.naming import check_name
from inkjet_env.typing import Real

SIMULATORS = ("scalar", "lanes", "cuda")
"""What computes costs: one waveform after another, eight side by side, or thousands on a graphics processor."""
ROWS_A_PART = 64
"""Rows per part, about 0.15 ms of simulation: threads take parts as they become free, so that none waits long."""
ROWS_A_PART_IN_LANES = 512
"""The same in lanes, of which eight waveforms alike are side by side; such are found among many."""
PARTS_WORTH_A_THREAD = 4
"""Number of parts that justify a further thread; starting one takes some 0.05 ms."""


@lru_cache
def available_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def check_threads(threads: int | None) -> int | None:
    """Return the number of threads; ``ValueError`` unless it is a whole number of at least 1, or None."""
    whole = isinstance(threads, (int, np.integer)) and not isinstance(threads, bool)
    if threads is not None and not (whole and threads >= 1):
        raise ValueError(
            f"threads must be a whole number of at least 1, or None for the number of cores; got {threads!r}."
        )
    return threads


def in_parts(fill: Callable[[slice], None], rows: int, threads: int | None, rows_a_part: int = ROWS_A_PART) -> None:
    """Call ``fill`` with slices that cover all rows.

    Parameters
    ----------
    fill : callable
        Works on one slice of the rows, independently of the others.
    rows : int
        Number of rows.
    threads : int, optional
        Largest number of threads; by default the number of cores. Few rows are one slice on one thread.
    rows_a_part : int
        Rows of a slice.
    """
    threads = min(threads or available_cores(), rows // (rows_a_part * PARTS_WORTH_A_THREAD))
    if threads < 2:
        fill(slice(None))
        return
    parts = iter([slice(start, start + rows_a_part) for start in range(0, rows, rows_a_part)])

    def fill_parts() -> None:
        for part in parts:
            fill(part)

    # A new pool each time: a persistent one would not survive a fork.
    with ThreadPoolExecutor(threads - 1) as pool:
        others = [pool.submit(fill_parts) for _ in range(threads - 1)]
        fill_parts()
        for other in others:
            other.result()


def check_simulator(simulator: str, settings: tuple, costs_alone: bool) -> None:
    """Check that one of `SIMULATORS` can compute the costs of a task.

    Parameters
    ----------
    simulator : str
        Its name.
    settings : tuple
        As in `simulated_costs`.
    costs_alone : bool
        Whether the costs of a printhead without effects are all that the task needs.

    Raises
    ------
    ValueError
        There is no simulator of this name, or it cannot.
    RuntimeError
        It is ``cuda``, and there is no graphics processor.
    """
    check_name("simulator", simulator, SIMULATORS)
    if simulator == "scalar":
        return
    if not costs_alone:
        raise ValueError(f'simulator="{simulator}" needs a printhead without effects, and noise=0.')
    if simulator == "cuda":
        from inkjet_env.printhead import cuda

        cuda.check_device()
        return
    from inkjet_env.printhead import lanes

    if not lanes.possible(settings):
        raise ValueError(
            'simulator="lanes" needs the largest peak to be effective, initial_state="periodic", '
            'hysteresis="full_memory" and a finite window_s.'
        )


def simulated_costs(
    waveforms: Real,
    heads: Real,
    settings: tuple,
    capacity: int,
    threads: int | None = None,
    simulator: str = "scalar",
) -> Real:
    """Peak costs in volts, shape (n,), of waveforms (n, 7) on heads (1 or n rows).

    Parameters
    ----------
    waveforms : ndarray, shape (n, 7)
        Checked waveforms, in volts and seconds.
    heads : ndarray, shape (1 or n, columns)
        Rows of `inkjet_env.printhead.batch.head_table`.
    settings, capacity
        As in `inkjet_env.printhead.compiled.batch_costs`.
    threads : int, optional
        Largest number of threads; by default the number of cores. No result depends on it, in lanes but for its last
        digits.
    simulator : {"scalar", "lanes", "cuda"}
        The module of `inkjet_env.printhead` that simulates: `batch`, `lanes` or `cuda`.

    Returns
    -------
    ndarray, shape (n,)
        Costs in volts.
    """
    if simulator == "lanes":
        from inkjet_env.printhead.lanes import fill_costs
    elif simulator == "cuda":
        from inkjet_env.printhead.cuda import fill_costs
    else:
        from inkjet_env.printhead.batch import fill_costs
    costs = np.empty(len(waveforms))

    def fill(part: slice) -> None:
        fill_costs(waveforms[part], heads[part] if len(heads) > 1 else heads, settings, capacity, costs[part])

    if simulator == "cuda":
        fill(slice(None))
    else:
        in_parts(fill, len(waveforms), threads, ROWS_A_PART_IN_LANES if simulator == "lanes" else ROWS_A_PART)
    return costs


def simulated_peaks(
    waveforms: Real, heads: Real, settings: tuple, capacity: int, threads: int | None = None
) -> tuple[Real, Real, NDArray[np.int64], Real]:
    """Times in seconds and signed heights in volts of peaks, (n, capacity or more) each, of waveforms (n, 7) on heads.

    Parameters
    ----------
    waveforms, heads, threads
        As in `simulated_costs`.
    settings, capacity
        Further arguments of `inkjet_env.envs.compiled_episodes.batch_peaks`, and the columns to begin with.

    Returns
    -------
    times_s, heights_V : ndarray, shape (n, columns)
        Peaks in time order, then zeros.
    counts : ndarray of int, shape (n,)
        Number of peaks.
    tails_V : ndarray, shape (n,)
        Summed magnitude beyond them, in volts.
    """
    from inkjet_env.envs.compiled_episodes import batch_peaks

    n = len(waveforms)
    counts, tails_V = np.zeros(n, dtype=np.int64), np.empty(n)
    while True:
        times_s, heights_V = np.zeros((2, n, capacity))
        enough: list[bool] = []

        def fill(part: slice, filled: tuple = (times_s, heights_V, counts, tails_V), enough: list = enough) -> None:
            own_heads = heads[part] if len(heads) > 1 else heads
            enough.append(batch_peaks(waveforms[part], own_heads, *settings, *(array[part] for array in filled)))

        in_parts(fill, n, threads)
        if all(enough):
            return times_s, heights_V, counts, tails_V
        capacity *= 2
