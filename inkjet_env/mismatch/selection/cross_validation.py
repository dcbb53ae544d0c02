"""Cross-validation from a single fit: each condition is left out in turn, to first order.

Leaving the rows of condition g out of least squares changes the residual there from ``r_g`` to ``(I - H_gg)⁻¹ r_g``
with ``H`` the hat matrix (Cook & Weisberg 1982). A parameter that is determined by one condition alone cannot be tested
by leaving that condition out, and keeps its fitted value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class LeaveOutResiduals:
    """Residuals with each condition left out of the fit.

    Attributes
    ----------
    residuals : ndarray, shape (rows,)
        Whitened residual of each row, predicted without its condition.
    groups : tuple of ndarray of int
        Rows of each condition.
    """

    residuals: Real
    groups: tuple[NDArray[np.intp], ...]

    def log_likelihood_gain(self, other: LeaveOutResiduals) -> tuple[Real, Real]:
        """Log-likelihood that another model gains in predicting each condition, and its standard error, (g,) each."""
        gains, errors = [], []
        for rows in self.groups:
            mine, theirs = self.residuals[rows], other.residuals[rows]
            gains.append(0.5 * float(mine @ mine - theirs @ theirs))
            errors.append(float(np.linalg.norm(mine - theirs)))
        return np.array(gains), np.array(errors)


def predicted(
    residuals: Real, q: Real, groups: Sequence[NDArray[np.intp]], single_condition: float
) -> LeaveOutResiduals:
    """Residuals with each condition left out.

    Parameters
    ----------
    residuals : ndarray, shape (rows,)
        Whitened residuals of the fit.
    q : ndarray, shape (rows, p)
        Orthonormal columns that span the whitened sensitivities to all fitted parameters.
    groups : sequence of ndarray of int
        Rows of each condition.
    single_condition : float
        Share of the information on a parameter direction that comes from one condition, above which leaving that
        condition out does not test it.
    """
    result = residuals.copy()
    for rows in groups:
        mine = q[rows]
        share, directions = np.linalg.eigh(mine.T @ mine)
        factor = np.where(share < single_condition, 1 / (1 - np.minimum(share, single_condition)), 0.0)
        result[rows] = residuals[rows] + mine @ (directions @ (factor * (directions.T @ (mine.T @ residuals[rows]))))
    return LeaveOutResiduals(result, tuple(groups))


def spanned(q: Real, columns: Real) -> Real:
    """Orthonormal columns ``q``, shape (rows, p), and what further columns add to their span: (rows, p + rank)."""
    size = np.linalg.norm(columns, axis=0)
    own = columns[:, size > 0] / size[size > 0]
    for _ in range(2):  # twice, for columns that are nearly in the span
        own = own - q @ (q.T @ own)
    added, r = np.linalg.qr(own)
    return np.column_stack([q, added[:, np.abs(np.diag(r)) > 1e-9]])


def orthonormal(columns: Real) -> Real:
    """Orthonormal columns of the same span, shape (rows, rank)."""
    size = np.linalg.norm(columns, axis=0)
    q, r = np.linalg.qr(columns[:, size > 0] / size[size > 0])
    independent: Real = q[:, np.abs(np.diag(r)) > 1e-9]
    return independent
