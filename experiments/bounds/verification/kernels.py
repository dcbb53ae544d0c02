"""What the response over the last edge is made of, whatever the state at its start; see `last_edge`.

The response is ``z = E z0 + G``: what free motion makes of the state ``z0`` at the start, and the answer ``G`` to the
drive. Both are followed once for each piece of the range of ``t5`` and each range of ``b``, with their derivatives by
``t5`` and ``b`` and bounds of their second derivatives, see `enclosing`. For a disc of radius ``r0`` around ``z0`` and
half widths ``rt`` and ``rb`` the enclosure at a node, at the share ``θ`` of the edge, is a sum: its middle is
``E z0 + G``, and it reaches ``|E' z0 + G'| rt + |dG/db| rb + rest`` away for the piece and the range, and for the disc
``|E| r0``. As ``|E''| ≤ (|λ| θ)²`` the products of ``t5`` and ``z0`` add ``|λ| θ rt r0 + (|λ| θ rt)² (|z0| + r0) / 2``.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.experiments.bounds.verification.enclosing import (
    LAMBDA,
    NODES_MOST,
    OMEGA,
    SIGMA,
    SLOPE_MARGIN,
    follow,
)
from inkjet_env.experiments.bounds.verification.spiral import SLACK

CELL_US = 0.7
"""Longest cell between two nodes, in µs."""
NODES = 256
"""Most nodes on the last edge."""
COLUMNS = 20
COARSEST = 8
"""Number of pieces at the coarsest level."""
Array = NDArray[np.float64]


def kernels(
    b: float, rb: float, low_us: float, high_us: float, levels: int, k: Array, law: Array, sup1: float, sup2: float
) -> tuple[NDArray[np.int64], Array, NDArray[np.complex128]] | None:
    """What the enclosures are made of, for all pieces of the range of ``t5``.

    Parameters
    ----------
    b, rb : float
        Middle and half width of the range of ``b``, in V.
    low_us, high_us : float
        Range of ``t5``.
    levels : int
        Levels of pieces; the coarsest has `COARSEST` pieces, each further one twice as many.
    k, law, sup1, sup2
        The problem, see `checking.Problem`.

    Returns
    -------
    nodes, at, ends : arrays of shapes (pieces,), (pieces, `NODES`, `COLUMNS`) and (pieces, 6)
        Per piece the number of cells, what is to be summed at the nodes, and at the end; None if they do not fit.
    """
    pieces = COARSEST * ((1 << levels) - 1)
    nodes, ends = np.zeros(pieces, np.int64), np.zeros((pieces, 6), np.complex128)
    at = np.zeros((pieces, NODES, COLUMNS))
    work = _memory()
    piece = 0
    for level in range(levels):
        edges = np.linspace(low_us, high_us, (COARSEST << level) + 1)
        for low, high in pairwise(edges):
            n = _kernel(b, rb, float(low), float(high), k, law, sup1, sup2, work, at[piece], ends[piece])
            if n == 0:
                return None
            nodes[piece] = n
            piece += 1
    return nodes, at, ends


def _kernel(
    b: float, rb: float, low_us: float, high_us: float, k: Array, law: Array, sup1: float, sup2: float,
    work: tuple[Any, ...], at: Array, ends: NDArray[np.complex128],
) -> int:  # fmt: skip
    """Fill in one piece; the number of its cells, 0 if they do not fit."""
    lam = complex(-k[SIGMA], k[OMEGA])
    size = float(k[LAMBDA])
    t = 0.5 * (low_us + high_us)
    rt = 0.5 * (high_us - low_us) * (1.0 + SLACK) + 1e-12
    centre, radius = np.zeros(7), np.zeros(7)
    centre[1], centre[6] = b, t
    radius[1], radius[6] = rb, rt
    z, dz, rest, seconds, cell = work
    z[0], dz[0], rest[0] = 0.0, 0.0, 0.0
    n: int = follow(4, 4, CELL_US, centre, radius, k, law, sup1, sup2, 0.0, z, dz, rest, seconds, cell)
    if n == 0 or n >= NODES:
        return 0
    z, rest, by_b, by_t = z[: n + 1], rest[: n + 1], dz[: n + 1, 1] * rb, dz[: n + 1, 6] * rt
    theta = np.concatenate([[0.0], np.cumsum(seconds[:n, 0])]) / (t + rt)
    e = np.exp(lam * t * theta)
    e_t = lam * rt * theta * e
    turned = theta * size * rt
    at = at[: n + 1]
    for column, (of_state, alone) in ((0, (e, z)), (6, (e_t, by_t))):
        # y = Im(E z0 + G) and the slope Im(λ (E z0 + G)), with z0 by its real and imaginary part
        for offset, factor in ((0, 1.0), (3, lam)):
            at[:, column + offset] = (factor * of_state).imag
            at[:, column + offset + 1] = (factor * of_state).real
            at[:, column + offset + 2] = (factor * alone).imag
    at[:, 12] = abs(by_b.imag) + rest
    at[:, 13] = abs((lam * by_b).imag) + size * rest + SLOPE_MARGIN
    at[:, 14] = abs(e) + turned
    at[:, 15] = 0.5 * turned * turned
    # by how much y and the slope may differ from straight lines within the cell before a node
    square = seconds[:n, 0] ** 2 / 8.0
    at[1:, 16], at[1:, 17] = seconds[:n, 1] * square, size**2 * square
    at[1:, 18], at[1:, 19] = seconds[:n, 2] * square, size**3 * square
    ends[:] = z[n], e_t[n], by_t[n], by_b[n], rest[n], e[n]
    if not math.isfinite(float(at.sum())):
        return 0
    return n


def _memory() -> tuple[Any, ...]:
    """Working memory for `enclosing.follow`."""
    count = NODES_MOST + 1
    return (
        np.empty(count, np.complex128),
        np.empty((count, 7), np.complex128),
        np.empty(count),
        np.empty((count, 3)),
        np.empty(count, np.int64),
    )
