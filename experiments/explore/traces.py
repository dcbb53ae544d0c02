"""Long signals as few points: the smallest and the largest value of each run of samples, so that no peak is lost."""

from __future__ import annotations

import numpy as np

from inkjet_env.typing import Real

MOST_POINTS = 3000
"""Largest number of points that are sent for one line."""


def decimated(
    begin_s: float, step_s: float, signal: Real, from_s: float, to_s: float, most: int = MOST_POINTS
) -> tuple[Real, Real]:
    """What can be seen of a uniformly sampled signal between two times.

    Parameters
    ----------
    begin_s, step_s : float
        Time of the first sample, and between samples, in seconds.
    signal : ndarray, shape (n,)
        The signal.
    from_s, to_s : float
        Ends of the time axis, in seconds.
    most : int
        Largest number of points.

    Returns
    -------
    time_s, values : ndarray, shape (m,)
        At most ``most`` points: every sample if there are few, else the extremes of each run, in the order of time.
    """
    first = max(int(np.floor((from_s - begin_s) / step_s)), 0)
    last = min(int(np.ceil((to_s - begin_s) / step_s)) + 1, signal.size)
    part = signal[first : max(last, first)]
    run = -(-2 * part.size // most)
    if run <= 2:
        kept = np.arange(part.size)
    else:
        whole = part.size // run * run
        rows, starts = part[:whole].reshape(-1, run), np.arange(0, whole, run)
        ends = [starts + rows.argmin(axis=1), starts + rows.argmax(axis=1), whole + np.arange(part.size - whole)[-2:]]
        kept = np.unique(np.concatenate(ends))
    time_s: Real = np.float64(begin_s) + np.float64(step_s) * (first + kept).astype(np.float64)
    return time_s, part[kept]
