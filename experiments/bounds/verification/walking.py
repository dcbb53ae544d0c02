"""The tree of a part: its bytes divide the whole box in preorder into leaves.

A walk over some of the bytes needs no more of those before than the boxes that are still to come. So one walk may pass
all leaves, to see that they are the whole box, while others check those of a piece each.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inkjet_env.experiments.bounds.verification.leaves import check_leaf, working_memory

LEAF = 7
SIDES = 7
DEEPEST = 1000
"""Most halvings one within another that a tree may have."""
DIVISIONS_DEEPEST = 60
"""Most further halvings of a leaf, one within another."""
BOXES_MOST = 2_000_000
"""Most boxes into which a leaf is divided further."""

# how the walk over some bytes ended
GOING_ON, NO_SUCH_BYTE, NO_WIDTH, TOO_DEEP, AFTER_END, NOT_SHOWN, STOPPED = range(7)
# what has been counted
BOXES, LEAVES, DIVISIONS = range(3)
COUNTED = 6
"""These, and how many bounds of each way were computed, see `leaves.check_leaf`."""


@njit(nogil=True)
def walk(
    checks, data, lows, highs, top, counted, least, most, bound, k, law, sup1, sup2, tables, stop, failed, work
):  # fmt: skip
    """Walk on over the bytes of a tree.

    Parameters
    ----------
    checks : bool
        Whether leaves are checked, or only passed.
    data : array of uint8
        The next bytes.
    lows, highs : array of shape (`DEEPEST` + 2, 7)
        The boxes that are still to come, the next one last.
    top : int
        Index of the next box, −1 at the end of the tree.
    counted : array of shape (`COUNTED`,)
        What has been counted so far.
    least, most, bound, k, law, sup1, sup2, tables, stop, failed, work
        See `leaves.check_leaf`.

    Returns
    -------
    ended : int
        How the walk ended.
    top : int
        Index of the next box.
    """
    for i in range(data.size):
        if top < 0:
            return AFTER_END, top
        byte = data[i]
        if byte > LEAF:
            return NO_SUCH_BYTE, top
        counted[BOXES] += 1
        if byte == LEAF:
            counted[LEAVES] += 1
            if not checks:
                top -= 1
                continue
            divisions = check_leaf(
                lows[top], highs[top], least, most, bound, k, law, sup1, sup2, tables,
                DIVISIONS_DEEPEST, BOXES_MOST, stop, failed, work, counted[3:],
            )  # fmt: skip
            if divisions == -1:
                return NOT_SHOWN, top
            if divisions == -2:
                return STOPPED, top
            counted[DIVISIONS] += divisions
            top -= 1
            continue
        middle = 0.5 * (lows[top, byte] + highs[top, byte])
        if not (lows[top, byte] < middle and middle < highs[top, byte]):
            return NO_WIDTH, top
        if top >= DEEPEST:
            return TOO_DEEP, top
        for j in range(SIDES):
            lows[top + 1, j], highs[top + 1, j] = lows[top, j], highs[top, j]
        highs[top + 1, byte] = middle
        lows[top, byte] = middle
        top += 1
    return GOING_ON, top


def first_boxes(
    lower: tuple[float, ...], upper: tuple[float, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """The stack of boxes at the beginning of a tree: the whole box alone, and the index of the next box."""
    lows, highs = np.empty((DEEPEST + 2, SIDES)), np.empty((DEEPEST + 2, SIDES))
    lows[0], highs[0] = lower, upper
    return lows, highs, 0


def memory() -> tuple[Any, ...]:
    """Working memory of a thread, see `leaves.working_memory`."""
    arrays: tuple[Any, ...] = working_memory(DIVISIONS_DEEPEST)
    return arrays
