"""A damped Gauss–Newton step within bounds."""

from __future__ import annotations

import numpy as np

from inkjet_env.typing import Real


def damped_step(gram: Real, moment: Real, damping: float, theta: Real, low: Real, high: Real) -> Real:
    """Levenberg–Marquardt step of the normal equations; a coordinate that would leave its bounds is held at them.

    Parameters
    ----------
    gram : ndarray, shape (k, k)
        Jacobian transposed times Jacobian.
    moment : ndarray, shape (k,)
        Jacobian transposed times residuals.
    damping : float
        Levenberg's damping parameter, relative to the diagonal of ``gram``.
    theta, low, high : ndarray, shape (k,)
        Coordinates and their bounds.

    Returns
    -------
    ndarray, shape (k,)
        Change of the coordinates; ``theta`` plus it lies within the bounds.
    """
    step = np.zeros(theta.size)
    free = np.ones(theta.size, dtype=bool)
    size = np.sqrt(np.diag(gram))
    size[size == 0] = 1.0
    scaled = gram / np.outer(size, size)
    for _ in range(theta.size):
        target = (moment - gram[:, ~free] @ step[~free])[free] / size[free]
        normal = scaled[np.ix_(free, free)] + damping * np.eye(int(free.sum()))
        step[free] = np.linalg.lstsq(normal, target, rcond=1e-13)[0] / size[free]
        beyond = free & ((theta + step < low) | (theta + step > high))
        if not beyond.any():
            break
        step[beyond] = np.clip(theta[beyond] + step[beyond], low[beyond], high[beyond]) - theta[beyond]
        free &= ~beyond
        if not free.any():
            break
    return step
