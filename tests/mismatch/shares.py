"""Residuals in which conditions hold something by given shares of its size."""

import numpy as np

GROUPS = [np.arange(40 * k, 40 * (k + 1)) for k in range(12)]
"""Rows of each of twelve conditions."""


def held_by_shares(shares, rng):
    """Noise, shape (480,), that holds a direction by the share of each condition, and that unit vector."""
    direction = rng.standard_normal(480)
    direction /= np.linalg.norm(direction)
    residuals = rng.standard_normal(480)
    residuals -= direction * (direction @ residuals)
    for rows, share in zip(GROUPS, shares, strict=True):
        residuals[rows] += share * direction[rows] / np.linalg.norm(direction[rows]) ** 2
    return residuals, direction


def without(residuals, direction):
    """The residuals without what they hold of a direction."""
    return residuals - direction * (direction @ residuals)
