"""Degree of the branch law: error against degree, as the paper chooses it and by loops held out one after another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

HIGHEST_DEGREE = 12
LEAST_SHARE = 0.05
"""The error has flattened where one more degree explains less than this share of what exceeds the noise."""
CHANCE_F = 10.83
"""F above which a gain is no chance: 1 in 1,000 for one coefficient and many samples."""


@dataclass(frozen=True)
class DegreeChoice:
    """Error of the branch law against its degree.

    Attributes
    ----------
    degrees : tuple of int
    rms_error : tuple of float
        Of the fit, as a share of the noise (1 is the noise itself).
    held_out_error : tuple of float or None
        The same on loops that were left out one after another; None where there are fewer than three.
    by_flattening : int
        The paper's rule: the last degree that lowers the squared error by more than chance would, and by a twentieth or
        more of what exceeds the noise.
    by_held_out : int or None
        The least degree whose held-out error is within one standard error of the least.
    """

    degrees: tuple[int, ...]
    rms_error: tuple[float, ...]
    held_out_error: tuple[float, ...] | None
    by_flattening: int
    by_held_out: int | None


def choose_degree(blocks: Sequence[Real], samples: Sequence[int], correlation: float = 1.0) -> DegreeChoice:
    """Error against degree for one channel.

    Parameters
    ----------
    blocks : sequence of ndarray, shape (k, highest + 2)
        One a drive: whitened columns of the powers 1 … highest, of the offset, and the signal, reduced to a triangle;
        in units of the noise.
    samples : sequence of int
        How many samples each stands for.
    correlation : float
        How much stronger the residual is in the signal's band than white noise of its variance would be: by so much
        chance gains more.
    """
    highest = blocks[0].shape[1] - 2
    degrees = tuple(range(1, highest + 1))
    total = sum(samples)
    errors = np.array([_misfit(_solution(blocks, n), blocks, n).sum() for n in degrees])
    before = np.concatenate([[np.inf], errors[:-1]])
    gain = before - errors
    chance = correlation * CHANCE_F * np.maximum(errors / np.maximum(total - np.array(degrees) - 1, 1), 1.0)
    material = (gain > chance) & (gain >= LEAST_SHARE * np.maximum(before - total, 0.0))
    material[0] = True
    left_out = None
    by_held_out = None
    if len(blocks) >= 3:
        per_loop = np.array(
            [
                [
                    _misfit(_solution([*blocks[:i], *blocks[i + 1 :]], n), blocks[i : i + 1], n)[0] / samples[i]
                    for i in range(len(blocks))
                ]
                for n in degrees
            ]
        )
        mean = per_loop.mean(axis=1)
        best = int(np.argmin(mean))
        # Paired: how far each degree lies above the best one, loop by loop.
        excess = per_loop - per_loop[best]
        error = excess.std(axis=1, ddof=1) / np.sqrt(len(blocks))
        by_held_out = int(np.argmax(excess.mean(axis=1) <= error)) + 1
        left_out = tuple(float(v) for v in np.sqrt(mean))
    return DegreeChoice(
        degrees,
        tuple(float(v) for v in np.sqrt(errors / total)),
        left_out,
        int(np.flatnonzero(material)[-1]) + 1,
        by_held_out,
    )


def _solution(blocks: Sequence[Real], degree: int) -> Real:
    """Coefficients of the powers and the offset."""
    stacked = np.vstack([np.column_stack([b[:, :degree], b[:, -2:]]) for b in blocks])
    scale = np.linalg.norm(stacked[:, :-1], axis=0)
    scale[scale == 0] = 1.0
    return np.linalg.lstsq(stacked[:, :-1] / scale, stacked[:, -1], rcond=1e-13)[0] / scale


def _misfit(solution: Real, blocks: Sequence[Real], degree: int) -> Real:
    """Squared error of each block."""
    return np.array([np.sum((b[:, -1] - b[:, :degree] @ solution[:-1] - b[:, -2] * solution[-1]) ** 2) for b in blocks])
