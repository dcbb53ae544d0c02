"""A fitter for tests of effects, of textbook steps."""

import math

import numpy as np
import pytest


@pytest.fixture
def damped_least_squares():
    """Function of residual, begin and bounds: the size of what Levenberg and Marquardt's method leaves."""
    return _damped_least_squares


def _damped_least_squares(residual, z, bounds, most_steps=30):
    left, damping = residual(z), 1e-3
    widths = 1e-4 * np.where(z == 0, 0.01, np.abs(z))
    for _ in range(most_steps):
        slopes = np.array([(residual(z + row) - left) / row.sum() for row in np.diag(widths)]).T
        uphill, before = slopes.T @ left, left @ left
        free = ~((z <= bounds[0]) & (uphill > 0)) & ~((z >= bounds[1]) & (uphill < 0)) & (uphill != 0)
        columns = slopes[:, free]
        normal = columns.T @ columns
        while damping < 1e6:
            step = np.zeros(z.size)
            step[free] = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal)), uphill[free], rcond=1e-14)[0]
            moved = np.clip(z - step, *bounds)
            try:
                tried = residual(moved)
            except FloatingPointError:  # no head that rings
                tried = np.full(left.size, np.inf)
            damping *= 0.1 if tried @ tried < before else 10
            if tried @ tried < before:
                break
        else:
            break
        z, left = moved, tried
        if left @ left > 0.9999 * before:
            break
    return math.sqrt(left @ left)
