"""Cost of a grey level: several drops in a row that merge to one dot."""

from __future__ import annotations

import numpy as np

from inkjet_env.typing import Real


def grey_level(weighted: Real, unweighted: Real, weight: float) -> Real:
    """Cost of each grey level and, in further columns, its derivatives.

    The effective peaks count by their sum, since each of them ejects a part of the dot; other peaks count after the
    last drop only, since the dot does not see what rings between its own drops. A drop that is slower than the one
    before does not reach it: the largest such shortfall of a height counts with the weight's magnitude too. For a
    single drop it is the peak cost.

    Parameters
    ----------
    weighted, unweighted : ndarray, shape (drops, n, k)
        Peak cost of each drop with weights 1 and 0 of the effective peak, in the first column in volts; derivatives in
        the others.
    weight : float
        Weight A of the effective peak.

    Returns
    -------
    ndarray, shape (n, k)
        Costs in volts, and their derivatives.
    """
    heights = weighted - unweighted
    found: Real = weight * heights.sum(axis=0) + unweighted[-1]
    if len(heights) > 1:
        shortfall = heights[:-1] - heights[1:]
        worst, each = shortfall[..., 0].argmax(axis=0), np.arange(heights.shape[1])
        largest = shortfall[worst, each]
        found = found + abs(weight) * np.where(largest[:, :1] > 0, largest, 0.0)
    return found
