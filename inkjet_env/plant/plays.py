"""The branch law as a sum of plays, where an effect changes the plays themselves."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from inkjet_env.printhead.hysteresis import BranchLaw, PlayOperators
from inkjet_env.typing import Real

PLAYS = 32
"""Number of plays that replace a branch law."""


def play_sum_V(
    kernel: Callable[..., None],
    ends_V: Real,
    change: tuple[Real | float, ...],
    law: BranchLaw,
    periodic: bool,
    plays: int,
) -> Real:
    """Output in volts of modified plays that replace the law, without its linear part, shape (n,).

    Parameters
    ----------
    kernel : compiled function
        Kernel of `compiled_hysteresis`.
    ends_V : ndarray, shape (n,)
        Drive at the nodes, in volts; if periodic, the first one again at its end.
    change : tuple of ndarray or float
        Arguments of the kernel after the drive: how the plays are modified.
    law : BranchLaw
        Branch law that the plays replace.
    periodic : bool
        Whether the drive has been repeated; otherwise it starts from the demagnetised state.
    plays : int
        Number of plays; the difference from the law falls with its square.
    """
    thresholds_V, weights = _thresholds_and_weights(law, plays)
    states_V, output_V = np.empty(plays), np.empty(ends_V.size)
    kernel(ends_V, *change, thresholds_V, weights, 2 if periodic else 1, states_V, output_V)
    return output_V


@lru_cache(maxsize=64)
def _thresholds_and_weights(law: BranchLaw, plays: int) -> tuple[Real, Real]:
    """Thresholds in volts and weights of the plays that replace a law, without the linear one, shape (plays,) each."""
    sum_ = PlayOperators.of_branch_law(law, plays)
    return sum_.thresholds_V[1:].copy(), sum_.weights[1:].copy()
