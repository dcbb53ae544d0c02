"""The branch law as a sum of plays, where an effect changes the plays themselves."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from inkjet_env.printhead.hysteresis import BranchLaw, PlayOperators
from inkjet_env.typing import Real

PLAYS = 32


def play_sum_V(
    kernel: Callable[..., None],
    ends_V: Real,
    change: tuple[Real | float, ...],
    law: BranchLaw,
    periodic: bool,
    plays: int,
) -> Real:
    """What changed plays in place of the law give, but for its linear part, shape (n,).

    Parameters
    ----------
    kernel : compiled function
        Of `compiled_hysteresis`.
    ends_V : ndarray, shape (n,)
        Drive at the nodes; where periodic, with the first one again at its end.
    change : tuple of ndarray or float
        What the kernel wants to know after the drive.
    law : BranchLaw
    periodic : bool
    plays : int
        How many; the difference from the law falls with their square.
    """
    thresholds_V, weights = _thresholds_and_weights(law, plays)
    states_V, output_V = np.empty(plays), np.empty(ends_V.size)
    kernel(ends_V, *change, thresholds_V, weights, 2 if periodic else 1, states_V, output_V)
    return output_V


@lru_cache(maxsize=64)
def _thresholds_and_weights(law: BranchLaw, plays: int) -> tuple[Real, Real]:
    """Of the plays in place of a law, but for the linear one, shape (plays,) each."""
    sum_ = PlayOperators.of_branch_law(law, plays)
    return sum_.thresholds_V[1:].copy(), sum_.weights[1:].copy()
