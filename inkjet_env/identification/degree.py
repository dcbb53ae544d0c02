"""Degree of the branch law from error against degree: by the paper's rule, and by leave-one-drive-out validation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inkjet_env.typing import Real

HIGHEST_DEGREE = 12
"""Highest degree that is tried."""
LEAST_IMPROVEMENT = 0.05
"""The error has flattened where one more degree explains less than this share of the excess over the noise."""
F_QUANTILE_999 = 10.83
"""F statistic above which a gain is significant: at the level of 1 in 1,000 for one coefficient and many samples."""


@dataclass(frozen=True)
class DegreeChoice:
    """Error of the branch law against its degree.

    Attributes
    ----------
    degrees : tuple of int
        Degrees that were tried.
    rms_error : tuple of float
        RMS error of the fit at each degree, in units of the noise.
    held_out_error : tuple of float or None
        The same on drives that were left out one after another; None if that was not done.
    by_flattening : int
        The paper's rule: the last degree that lowers the squared error significantly, and by at least a twentieth of
        the excess over the noise.
    by_held_out : int or None
        Lowest degree whose held-out error is within one standard error of the smallest.
    """

    degrees: tuple[int, ...]
    rms_error: tuple[float, ...]
    held_out_error: tuple[float, ...] | None
    by_flattening: int
    by_held_out: int | None


def choose_degree(
    blocks: Sequence[Real],
    samples: Sequence[int],
    correlation: float = 1.0,
    nuisances: int = 1,
    leave_out: bool = True,
) -> DegreeChoice:
    """Error against degree, and the degree of each rule.

    Parameters
    ----------
    blocks : sequence of ndarray, shape (k, highest + nuisances + 1)
        One block per drive, in units of the noise: columns of the powers 1 … highest, of everything else that is fitted
        (such as offsets), and the signal.
    samples : sequence of int
        Number of samples that each block stands for.
    correlation : float
        Power of the residual in the signal's band over that of white noise of its variance: random gains are larger by
        this factor.
    nuisances : int
        Number of columns that are not powers.
    leave_out : bool
        Whether to hold out one drive after another; this needs at least three.
    """
    highest = blocks[0].shape[1] - nuisances - 1
    degrees = tuple(range(1, highest + 1))
    total = sum(samples)
    errors = np.array([_errors(blocks, _solution(blocks, highest, n)).sum() for n in degrees])
    before = np.concatenate([[np.inf], errors[:-1]])
    gain = before - errors
    freedom = np.maximum(total - np.array(degrees) - nuisances, 1)
    material = gain > correlation * F_QUANTILE_999 * np.maximum(errors / freedom, 1.0)
    material &= gain >= LEAST_IMPROVEMENT * np.maximum(before - total, 0.0)
    material[0] = True
    left_out = by_held_out = None
    if leave_out and len(blocks) >= 3:
        per_drive = np.array([_left_out_errors(blocks, highest, n) for n in degrees]) / samples
        mean = per_drive.mean(axis=1)
        best = int(np.argmin(mean))
        # Paired comparison: excess of each degree over the best one, drive by drive.
        excess = per_drive - per_drive[best]
        with np.errstate(over="ignore"):  # a law may leave a drive unpredicted by any number
            uncertain = excess.std(axis=1, ddof=1) / np.sqrt(len(blocks))
        by_held_out = int(np.argmax(excess.mean(axis=1) <= uncertain)) + 1
        left_out = tuple(float(v) for v in np.sqrt(per_drive @ np.array(samples) / total))
    return DegreeChoice(
        degrees,
        tuple(float(v) for v in np.sqrt(errors / total)),
        left_out,
        int(np.flatnonzero(material)[-1]) + 1,
        by_held_out,
    )


def _left_out_errors(blocks: Sequence[Real], highest: int, degree: int) -> list[float]:
    """Squared error of each drive under the solution for all others."""
    return [
        _errors([block], _solution([*blocks[:i], *blocks[i + 1 :]], highest, degree))[0]
        for i, block in enumerate(blocks)
    ]


def _solution(blocks: Sequence[Real], highest: int, degree: int) -> Real:
    """Coefficients of all columns, zero for the powers above ``degree``."""
    stacked = np.vstack(blocks)
    used = np.r_[:degree, highest : stacked.shape[1] - 1]
    scale = np.linalg.norm(stacked[:, used], axis=0)
    scale[scale == 0] = 1.0
    solution = np.zeros(stacked.shape[1] - 1)
    solution[used] = np.linalg.lstsq(stacked[:, used] / scale, stacked[:, -1], rcond=1e-13)[0] / scale
    return solution


def _errors(blocks: Sequence[Real], solution: Real) -> Real:
    """Squared error of each block."""
    return np.array([np.sum((block[:, -1] - block[:, :-1] @ solution) ** 2) for block in blocks])
